"""Text, one `t x y p` per line: plain, gzip, or inside a zip; the columns in any other order too.

There is no header, so what the columns are is seen from the first lines, and told in the notes.
"""

from __future__ import annotations

import re
import zlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from data_tools.files.archives import member_names
from data_tools.recordings.formats import Columns, Options, Source
from data_tools.recordings.formats.csv import open_table, order_of
from data_tools.recordings.formats.events_text import (
    SIDES,
    declared,
    declared_size,
    head_lines,
    is_comment,
    read_text_columns,
)

NAMES = ("text",)

# A line that starts like a number, of printable characters: the parser says what is wrong with it.
_LINE = re.compile(rb"[+-]?\.?\d[\t -~]*")

# What the quick parser reads: numbers without a plus, whole ones after the first.
_QUICK = re.compile(r"\s*[\d.eE+-]+[ \t,]+-?\d+[ \t,]+-?\d+[ \t,]+-?\d+[\s,]*")


def matches(path: Path, head: bytes) -> bool:
    """Tell whether the first line that is not a comment starts with a number."""
    if head[:2] == b"\x1f\x8b":
        return _is_text(_inflated(head))
    if head[:4] == b"PK\x03\x04":
        return any(name.rsplit("/", 1)[-1] == "events.txt" for name in member_names(path))
    return _is_text(head)


def open(path: Path, options: Options) -> Source:
    """Open a text of events; `options.stream` is the name inside a zip."""
    lines = head_lines(path, options.stream)
    rows = [line for line in lines if line.strip() and not is_comment(line)]
    sides = SIDES.fullmatch(rows[0].strip()) is not None if len(rows) > 1 else False
    order = order_of(rows[sides:])
    marks = any(line.startswith(("%", "//")) for line in lines)
    if order is not None and (
        order != "txyp" or sides or marks or _QUICK.fullmatch(rows[0]) is None
    ):
        return open_table(path, options, "text", order)
    told = declared(lines)
    width, height = options.sensor(path, declared_size(told))
    unit = options.unit(told.get("time_unit"))

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        return read_text_columns(
            path,
            width,
            height,
            time_unit=unit,
            member=options.stream,
            in_order=False,
            losses=losses,
        )

    notes = ("there is no header: the columns were taken as t x y p",)
    return Source("text", width, height, pieces, notes, None if unit else "s")


def _is_text(head: bytes) -> bool:
    *whole, last = re.split(rb"[\r\n]", head.removeprefix(b"\xef\xbb\xbf"))
    for line in (*whole, last):
        line = line.strip()
        if line and not line.startswith((b"#", b"%", b"//")):
            return _LINE.fullmatch(line) is not None
    return False


def _inflated(head: bytes) -> bytes:
    try:
        return zlib.decompressobj(wbits=31).decompress(head, 1 << 16)
    except zlib.error:
        return b""

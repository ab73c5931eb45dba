"""Text, one `t x y p` per line: plain, gzip, or inside a zip."""

from __future__ import annotations

import re
import zlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from data_tools.files.archives import member_names
from data_tools.recordings.formats import Columns, Options, Source
from data_tools.recordings.formats.events_text import read_text_columns

NAMES = ("text",)

# A line that starts like a number, of printable characters: the parser says what is wrong with it.
_LINE = re.compile(rb"[+-]?\.?\d[\t -~]*")


def matches(path: Path, head: bytes) -> bool:
    """Tell whether the first line that is not a comment starts with a number."""
    if head[:2] == b"\x1f\x8b":
        return _is_text(_inflated(head))
    if head[:4] == b"PK\x03\x04":
        return any(name.rsplit("/", 1)[-1] == "events.txt" for name in member_names(path))
    return _is_text(head)


def open(path: Path, options: Options) -> Source:
    """Open a text of events; `options.stream` is the name inside a zip."""
    width, height = options.sensor(path, None)

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        return read_text_columns(
            path,
            width,
            height,
            time_unit=options.time_unit,
            member=options.stream,
            in_order=options.disorder == "refuse",
            losses=losses,
        )

    return Source("text", width, height, pieces)


def _is_text(head: bytes) -> bool:
    *whole, last = head.split(b"\n")
    for line in (*whole, last):
        line = line.strip()
        if line and not line.startswith(b"#"):
            return _LINE.fullmatch(line) is not None
    return False


def _inflated(head: bytes) -> bytes:
    try:
        return zlib.decompressobj(wbits=31).decompress(head, 1 << 16)
    except zlib.error:
        return b""

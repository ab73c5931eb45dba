"""CSV with a header that names the columns x, y, t, p, in any order, plain or gzip.

Also ``ts``, ``time``, ``timestamp(s)`` and ``pol``, ``polarity``, ``on``.  Commas, semicolons, tabs
or blanks separate; decimals have points, or commas where something else separates; other columns
are passed over.  Lines that start with ``#`` are comments; a comment of
`data_tools.recordings.convert` before the header tells the sensor's size and the unit of times.
Else times with a decimal point are taken for seconds, unless that is absurd, and the unit of whole
numbers must be said.
"""

from __future__ import annotations

import io
import re
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_tools.files.headers import parted
from data_tools.files.unpack import check_ratio
from data_tools.recordings.formats import Columns, Options, Source
from data_tools.recordings.formats._columns import Converter, find_columns
from data_tools.recordings.formats.events_text import (
    MARK as MARK,
)
from data_tools.recordings.formats.events_text import (
    SIDES,
    declared,
    declared_size,
    head_lines,
    is_comment,
    opened_text,
)
from evcalib.checks import MAX_SIDE
from evcalib.errors import InputError

NAMES = ("csv",)

ORDERS = ("txyp", "xytp", "xypt", "txpy", "tpxy", "pxyt", "ptxy")
"""Orders of columns without a header that are told apart; x is never behind y."""

_BLOCK = 1 << 23
_LINE = 1 << 16
_SOMETHING = re.compile(rb"^[ \t]*[^#\s]", re.MULTILINE)
_GZIP = b"\x1f\x8b"
_FRACTION = re.compile(r"[.,eEnN]")
_DECIMAL_COMMA = re.compile(r"\d,\d")
_WORDS = {b"true": b"1", b"on": b"1", b"false": b"0", b"off": b"0"}
_WORD = re.compile(rb"\b(true|false|on|off)\b", re.IGNORECASE)
"""Polarities in words."""
_BAD = re.compile(r"could not convert string '(.*)' to \S+ at row (\d+), column (\d+)")
_NUMBER = re.compile(r"[+-]?\d+(,\d+)?")


@dataclass(frozen=True)
class _Head:
    """What the lines above the events say."""

    lines: int
    names: list[str]
    delimiter: str | None
    declared: dict[str, str]
    kinds: dict[str, str]
    comma: bool
    words: bool
    sides: str


def matches(path: Path, head: bytes) -> bool:
    """Tell whether the first line that is no comment names the four columns."""
    if head[:2] == _GZIP:
        try:
            head = zlib.decompressobj(wbits=31).decompress(head, 1 << 16)
        except zlib.error:
            return False
    try:
        text = head.decode("utf-8-sig", "strict" if len(head) < 1024 else "ignore")
    except UnicodeDecodeError:
        return False
    return _named(text.splitlines()) is not None


def open(path: Path, options: Options) -> Source:
    """Open a CSV file of events."""
    return open_table(path, options, "csv")


def open_table(path: Path, options: Options, name: str, order: str | None = None) -> Source:
    """Open a table of events with a header, or without one and its columns in an `order`.

    Raises
    ------
    InputError
        If there is neither, or the size or the unit of times is not to be known.
    """
    member = options.stream if order else None
    head = _read_head(path, member, order)
    fields = find_columns(head.names)
    if fields is None:
        raise InputError(
            f"{path}: the header must name each of x, y, t, p once, not {', '.join(head.names)}"
        )
    size = options.sensor(path, declared_size(head.declared))
    unit = options.unit(head.declared.get("time_unit"))
    guessed = None if unit or head.kinds["t"] == "i8" else "s"
    unit = unit or guessed
    places = [head.names.index(fields[key]) for key in "xytp"]

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        convert = Converter(unit, unit)
        dtype = np.dtype([(key, head.kinds[key]) for key in "xytp"])
        with opened_text(path, member) as stream:
            for line, block in _blocks(stream, head.lines, path):
                if not block.endswith(b"\n"):
                    block = _without_cut(block, places, head, losses)
                comments = block.count(b"\n#") + block.startswith(b"#")
                if comments:
                    losses["comments between events"] += comments
                rows = _parse(block, line, places, head, dtype, path)
                yield convert(*(rows[key] for key in "xytp"))

    notes: tuple[str, ...]
    notes = (f"there is no header: the columns were taken as {' '.join(order)}",) if order else ()
    if order and head.sides:
        notes += (f"the first line, {head.sides}, was taken for the size of the sensor",)
    return Source(name, *size, pieces, notes, guessed)


def order_of(rows: list[str]) -> str | None:
    """Return the order of four columns without a header, as far as their values tell.

    ``"txyp"`` unless only another can be: polarities are 0 and 1 or -1 and 1, pixels are whole and
    small, times ascend.  None where there are not four numbers in a row.
    """
    if not rows:
        return None
    delimiter, comma = _dialect(rows[0])
    try:
        table = np.array(
            [
                [float(cell) for cell in (row.replace(",", ".") if comma else row).split(delimiter)]
                for row in rows
            ]
        )
    except ValueError:
        table = np.empty((0, 0))
    if table.ndim != 2 or table.shape[1] != 4:
        width = len(rows[0].split(delimiter))
        return ORDERS[0] if width == 4 and delimiter not in (None, ",", "\t") else None
    fitting = [order for order in ORDERS if _fits(dict(zip(order, table.T, strict=True)))]
    return fitting[0] if len(fitting) == 1 else ORDERS[0]


def _fits(columns: dict[str, np.ndarray]) -> bool:
    pixels = np.concatenate([columns["x"], columns["y"]])
    t, p = columns["t"], columns["p"]
    return bool(
        (np.abs(p) <= 1).all()
        and ((pixels >= 0) & (pixels <= MAX_SIDE) & (np.rint(pixels) == pixels)).all()
        and np.count_nonzero(np.diff(t) < 0) <= 0.1 * t.size
        and (t.size < 2 or np.ptp(t) > 0)
    )


def _dialect(row: str) -> tuple[str | None, bool]:
    """Return what separates the cells of a row (None: blanks), and whether decimals have commas."""
    for delimiter in (";", "\t"):
        if delimiter in row:
            return delimiter, bool(_DECIMAL_COMMA.search(row))
    cells = row.split()
    if len(cells) > 1 and "," in row and all(_NUMBER.fullmatch(cell) for cell in cells):
        return None, True
    return ("," if "," in row else None), False


def _read_head(path: Path, member: str | None, order: str | None) -> _Head:
    lines = head_lines(path, member)
    told, words, first = declared(lines), False, ""
    if order is None:
        found = _named(lines[:64])
        if found is None:
            raise InputError(f"{path} has no header that names the columns x, y, t, p")
        row, names, delimiter, unit = found
        if unit:
            told.setdefault("time_unit", unit)
        rows = [line for line in lines[row + 1 :] if _is_data(line)]
        cells = rows[0].rstrip(", \t").split(",") if rows and delimiter == "," else names
        if len(cells) > len(names):
            raise InputError(
                f"{path}: the header names {len(names)} columns, and the first row has {len(cells)}"
                " values: decimal commas between commas? write it anew with semicolons or points"
            )
        comma = delimiter != "," and bool(rows) and bool(_DECIMAL_COMMA.search(rows[0]))
    else:
        names = list(order)
        rows = [line for line in lines if _is_data(line)]
        sides = len(rows) > 1 and SIDES.fullmatch(rows[0].strip()) is not None
        row = lines.index(rows[0]) - (not sides)
        first, rows = rows[0].strip() if sides else "", rows[sides:]
        delimiter, comma = _dialect(rows[0])
    fields = find_columns(names)
    kinds = {}
    for key in "xytp":
        place = names.index(fields[key]) if fields else 0
        cells = [cells[place] for cells in (r.split(delimiter) for r in rows) if place < len(cells)]
        kinds[key] = "f8" if any(_FRACTION.search(cell) for cell in cells) else "i8"
        if key == "p":
            words = bool(cells) and _WORD.fullmatch(cells[0].strip().encode()) is not None
    return _Head(row + 1, names, delimiter, told, kinds, comma, words, first)


def _named(lines: list[str]) -> tuple[int, list[str], str | None, str] | None:
    """Return number, names, delimiter and unit of times of the header, if it is one."""
    for row, line in enumerate(lines):
        if not _is_data(line):
            continue
        for delimiter in (",", ";", "\t", None):
            names, units = zip(*(parted(n.strip().strip('"')) for n in line.split(delimiter)),
                               strict=True)  # fmt: skip
            fields = find_columns(names)
            if fields is not None:
                return row, list(names), delimiter, units[names.index(fields["t"])]
        return None
    return None


def _is_data(line: str) -> bool:
    return bool(line.strip()) and not is_comment(line)


def _blocks(stream: io.BufferedIOBase, skip: int, path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield blocks of whole lines, each with the number of the lines before it."""
    for _ in range(skip):
        stream.readline(_LINE)
    line, rest = skip, b""
    packed, unpacked = path.stat().st_size, 0
    while block := stream.read(_BLOCK):
        unpacked += len(block)
        check_ratio(unpacked, packed)
        cut = block.rfind(b"\n") + 1
        if not cut and len(rest) + len(block) > 2 * _BLOCK:
            raise InputError(f"{path} has a line of over {_BLOCK} bytes: not a table of events")
        whole, rest = rest + block[:cut], block[cut:] if cut else rest + block
        if cut:
            yield line, whole
            line += whole.count(b"\n")
    if rest:
        yield line, rest


def _without_cut(block: bytes, places: list[int], head: _Head, losses: Counter[str]) -> bytes:
    """Take out the last line, which has no end, if the value it ends in may have lost digits.

    A polarity cannot: it has one.
    """
    whole, _, last = block.rpartition(b"\n")
    cells = last.decode("utf-8", "replace").split(head.delimiter)
    needed, end = max(places), len(cells) - 1
    sure = end > needed or (end == places[3] == needed and cells[end].strip() in ("0", "1", "-1"))
    if sure or not last.strip() or last.startswith(b"#"):
        return block
    losses["bytes of a cut-off last line"] += len(last)
    return whole + b"\n" if whole else b""


def _parse(
    block: bytes, line: int, places: list[int], head: _Head, dtype: np.dtype, path: Path
) -> np.ndarray:
    if not _SOMETHING.search(block):
        return np.empty(0, dtype=dtype)
    if head.comma:
        block = block.replace(b",", b".")
    if head.words:
        block = _WORD.sub(lambda word: _WORDS[word[0].lower()], block)
    try:
        return np.loadtxt(
            io.BytesIO(block),
            dtype=dtype,
            delimiter=head.delimiter,
            usecols=places,
            comments="#",
            ndmin=1,
        )
    except (ValueError, UnicodeDecodeError) as error:
        if (bad := _BAD.match(str(error))) is not None:
            where = f"line {line + int(bad[2]) + 1}, column {bad[3]}"
            if b"#" in block or b"\n\n" in block:
                where = f"after line {line}, column {bad[3]}"
            raise InputError(f"{path}, {where}: {bad[1]!r} is no number") from None
        raise InputError(f"{path}, after line {line}: {error}") from None

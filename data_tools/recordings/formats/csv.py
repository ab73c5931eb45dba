"""CSV with a header that names the columns x, y, t, p, in any order, plain or gzip.

Also ``ts``, ``time``, ``timestamp(s)`` and ``pol``, ``polarity``, ``on``.  Commas, semicolons or
tabs separate; other columns are passed over.  Lines that start with ``#`` are comments; a comment
of `data_tools.recordings.convert` before the header tells the sensor's size and the unit of times.
Else times with a decimal point are seconds, and the unit of whole numbers must be said.
"""

from __future__ import annotations

import gzip
import io
import re
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_tools.files.unpack import check_ratio
from data_tools.recordings.formats import Columns, Options, Source
from data_tools.recordings.formats._columns import Converter, find_columns
from evcalib.errors import InputError

NAMES = ("csv",)

MARK = "# evcalib-events"
"""How the comment begins that `data_tools.recordings.convert` writes."""

_BLOCK = 1 << 23
_LINE = 1 << 16
_SOMETHING = re.compile(rb"^[ \t]*[^#\s]", re.MULTILINE)
_GZIP = b"\x1f\x8b"


@dataclass(frozen=True)
class _Head:
    """What the lines above the events say."""

    lines: int
    names: list[str]
    delimiter: str
    declared: dict[str, str]
    fractional: bool


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
    head = _read_head(path)
    fields = find_columns(head.names)
    if fields is None:
        raise InputError(
            f"{path}: the header must name each of x, y, t, p once, not {', '.join(head.names)}"
        )
    declared = [head.declared.get(name, "") for name in ("width", "height")]
    whole = all(re.fullmatch(r"[0-9]{1,6}", side) for side in declared)
    size = options.sensor(path, (int(declared[0]), int(declared[1])) if whole else None)
    unit = options.time_unit or head.declared.get("time_unit")
    if unit not in (None, "s", "ms", "us", "ns"):
        raise InputError(f"{path}: its time_unit is {unit[:20]!r}; say time_unit='us' or another")
    if unit is None and head.fractional:
        unit = "s"
    places = [head.names.index(fields[key]) for key in "xytp"]

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        convert = Converter(unit, unit)
        kinds = ["i8", "i8", "f8" if head.fractional else "i8", "i8"]
        dtype = np.dtype(list(zip("xytp", kinds, strict=True)))
        with _opened(path) as stream:
            for line, block in _blocks(stream, head.lines, path):
                if not block.endswith(b"\n"):
                    block = _without_cut(block, places, head, losses)
                comments = block.count(b"\n#") + block.startswith(b"#")
                if comments:
                    losses["comments between events"] += comments
                rows = _parse(block, line, places, head, dtype, path)
                yield convert(*(rows[key] for key in "xytp"))

    return Source("csv", *size, pieces)


@contextmanager
def _opened(path: Path) -> Iterator[io.BufferedIOBase]:
    try:
        with path.open("rb") as raw:
            packed = raw.read(2) == _GZIP
        with gzip.open(path, "rb") if packed else path.open("rb") as stream:
            yield stream
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise InputError(f"{path} is damaged or cut off: {error}; fetch it again") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None


def _read_head(path: Path) -> _Head:
    with _opened(path) as stream:
        lines = [stream.readline(_LINE).decode("utf-8-sig", "replace") for _ in range(64)]
    found = _named(lines)
    if found is None:
        raise InputError(f"{path} has no header that names the columns x, y, t, p")
    row, names, delimiter = found
    comments = " ".join(line for line in lines[:row] if line.startswith(MARK))
    first = next((line for line in lines[row + 1 :] if _is_data(line)), "")
    cells = first.split(delimiter)
    fields = find_columns(names)
    time = names.index(fields["t"]) if fields else 0
    fractional = time < len(cells) and bool(re.search(r"[.eE]", cells[time]))
    return _Head(row + 1, names, delimiter, dict(re.findall(r"(\w+)=(\S+)", comments)), fractional)


def _named(lines: list[str]) -> tuple[int, list[str], str] | None:
    """Return number, column names and delimiter of the header, if it is one."""
    for row, line in enumerate(lines):
        if not _is_data(line):
            continue
        for delimiter in (",", ";", "\t"):
            names = [name.strip().strip('"') for name in line.split(delimiter)]
            if find_columns(names) is not None:
                return row, names, delimiter
        return None
    return None


def _is_data(line: str) -> bool:
    return bool(line.strip()) and not line.startswith("#")


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
        raise InputError(f"{path}, after line {line}: {error}") from None

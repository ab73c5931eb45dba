"""Reader of events as text, one `t x y p` per line: plain, gzip, or inside a zip.

That is the form of the Event Camera Dataset (Mueggler et al. 2017).  Blanks, tabs and commas
separate the columns; empty lines and lines that start with ``#`` are passed over, and so is the
mark of UTF-8 at the start.  Other dialects are read by `data_tools.recordings.formats.csv`.
"""

from __future__ import annotations

import codecs
import gzip
import io
import itertools
import re
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.files.archives import open_member, opened_zip
from data_tools.files.unpack import check_ratio
from data_tools.recordings.formats import Columns, Size
from data_tools.recordings.formats import _events_text_kernels as kernels
from evcalib import checks
from evcalib._event_columns import MAX_TIME_US
from evcalib.arrays import Integers
from evcalib.errors import InputError
from evcalib.events import Events

MARK = "# evcalib-events"
"""How the comment begins that `data_tools.recordings.convert` writes."""

HEAD = 1 << 16
"""Bytes from which the dialect of a text is seen."""

_GEOMETRY = re.compile(r"%\s*geometry\s*[:=]\s*([0-9]{1,6})\s*[,x ]\s*([0-9]{1,6})\s*")
SIDES = re.compile(r"([0-9]{1,6})[ ,;\t]+([0-9]{1,6})")
"""A line of width and height."""
_POWER = {"s": 6, "ms": 3, "us": 0, "ns": -3}
_SHORTEST_LINE = len("0 0 0 0\n")


def read_events_text(
    path: str | Path,
    width: int,
    height: int,
    *,
    time_unit: str | None = None,
    origin_us: int = 0,
    member: str | None = None,
    block_bytes: int = 1 << 23,
) -> Iterator[Events]:
    """Yield the events of a text file, piece by piece, in memory of a few blocks.

    Parameters
    ----------
    path : path
        The text, plain or compressed (known by its first bytes, not by its name).
    width, height : int
        Sensor size [px].
    time_unit : {"s", "ms", "us", "ns"}, optional
        By default seconds, if the first time has a decimal point; else it must be said.  Decimal
        places are read exactly, without floats, and rounded to the nearest microsecond.
    origin_us : int
        Subtracted from every time [us], e.g. to bring Unix time down.
    member : str, optional
        Name inside a zip; by default its only file named ``events.txt``.
    block_bytes : int
        Text read at a time.

    Yields
    ------
    Events
        Not empty; polarities coded {0, 1} or {-1, 1}, the same throughout.

    Raises
    ------
    InputError
        If a line is garbled, cut off, outside the sensor or back in time (with its number), if
        the compressed data is damaged, or if there are no events.
    """
    for columns in read_text_columns(
        path,
        width,
        height,
        time_unit=time_unit,
        origin_us=origin_us,
        member=member,
        block_bytes=block_bytes,
        latest_us=MAX_TIME_US,
    ):
        yield Events(*columns, width, height)


def read_text_columns(
    path: str | Path,
    width: int,
    height: int,
    *,
    time_unit: str | None = None,
    origin_us: int = 0,
    member: str | None = None,
    block_bytes: int = 1 << 23,
    in_order: bool = True,
    latest_us: int = 1 << 61,
    losses: Counter[str] | None = None,
) -> Iterator[Columns]:
    """Yield what `read_events_text` yields as bare columns, of any time up to `latest_us`.

    Where `in_order` is False, times may step back.  Comments between events are passed over, and
    counted in `losses`.
    """
    if time_unit is not None:
        checks.one_of(time_unit, "time_unit", tuple(_POWER))
    sensor = Events.empty(width, height)
    if not isinstance(origin_us, int) or abs(origin_us) > 1 << 61 or block_bytes < 64:
        raise InputError("origin_us must be whole microseconds, and block_bytes at least 64")
    limits = np.array([sensor.width, sensor.height, origin_us, latest_us, in_order], dtype=np.int64)
    path = Path(path)
    state = np.zeros(kernels.STATE_SIZE, dtype=np.int64)
    unit = None if time_unit is None else _POWER[time_unit]
    total = 0
    with opened_text(path, member) as stream:
        for text in _whole_lines(stream, path, int(block_bytes)):
            if unit is None:
                unit = _unit_of(text, path)
            columns = _parse(text, path, 0 if unit is None else unit, limits, state)
            if losses is not None and state[kernels.PASSED]:
                losses["comments between events"] += int(state[kernels.PASSED])
                state[kernels.PASSED] = 0
            if columns.t.size:
                total += columns.t.size
                yield columns
    if not total:
        raise InputError(f"{path} holds no events")


def load_events_text(
    path: str | Path, width: int, height: int, *, time_unit: str | None = None, origin_us: int = 0
) -> Events:
    """Return all events of a text file at once; see `read_events_text`."""
    pieces = read_events_text(path, width, height, time_unit=time_unit, origin_us=origin_us)
    return Events.concatenate(list(pieces))


@contextmanager
def opened_text(path: Path, member: str | None = None) -> Iterator[io.BufferedIOBase]:
    """Open a text under its compression, without its byte-order mark and with Unix ends of lines.

    Raises
    ------
    InputError
        If it cannot be read, or the compressed data is damaged.
    """
    try:
        with path.open("rb") as file:
            start = file.read(4)
        if start[:2] == b"\x1f\x8b":
            with gzip.open(path, "rb") as stream:
                yield _plain(stream)
        elif start == b"PK\x03\x04":
            with (
                opened_zip(path) as archive,
                open_member(archive, _member(archive, path, member)) as stream,
            ):
                yield _plain(stream)
        else:
            with path.open("rb") as stream:
                yield _plain(stream)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise InputError(f"{path} is damaged or cut off: {error}; fetch it again") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None


def head_lines(path: Path, member: str | None = None) -> list[str]:
    """Return the first lines of a text, as many as fit into `HEAD`; the last one is whole."""
    with opened_text(path, member) as stream:
        text = stream.read(HEAD)
    if len(text) == HEAD:
        text = text[: text.rfind(b"\n") + 1] or text
    return text.decode("utf-8", "replace").splitlines()


def declared(lines: list[str]) -> dict[str, str]:
    """Return what is said of size and unit above the events.

    By the comment of `data_tools.recordings.convert`, by Metavision's ``%geometry:640,480`` (whose
    times are microseconds), or by a first line of two numbers, as rpg_e2vid wants it.
    """
    head = list(itertools.takewhile(lambda line: not line.strip() or is_comment(line), lines))
    marked = " ".join(line for line in head if line.startswith(MARK))
    told = {}
    if (sides := next(filter(None, map(_GEOMETRY.fullmatch, head)), None)) is not None:
        told = {"time_unit": "us"}
    elif len(head) + 1 < len(lines):
        sides = SIDES.fullmatch(lines[len(head)].strip())
    if sides is not None:
        told |= {"width": sides[1], "height": sides[2]}
    return told | dict(re.findall(r"(\w+)=(\S+)", marked))


def is_comment(line: str) -> bool:
    """Tell whether a line above the events is none of them."""
    return line.startswith(("#", "%", "//"))


def declared_size(told: dict[str, str]) -> Size | None:
    """Return the size that a comment declares, if it does."""
    sides = [told.get(name, "") for name in ("width", "height")]
    if not all(re.fullmatch(r"[0-9]{1,6}", side) for side in sides):
        return None
    return int(sides[0]), int(sides[1])


def _plain(stream: Any) -> io.BufferedIOBase:
    """Return a stream after the mark of UTF-8; a text of the old Mac's lines with ours."""
    head = stream.read(HEAD)
    stream.seek(len(codecs.BOM_UTF8) if head.startswith(codecs.BOM_UTF8) else 0)
    if b"\r" in head and b"\n" not in head:
        return io.BufferedReader(_UnixLines(stream), HEAD)
    return stream


class _UnixLines(io.RawIOBase):
    """A stream in which each carriage return is the end of a line."""

    def __init__(self, stream: io.BufferedIOBase) -> None:
        self._stream = stream

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        block = self._stream.read(len(buffer))
        buffer[: len(block)] = block.replace(b"\r", b"\n")
        return len(block)


def _member(archive: zipfile.ZipFile, path: Path, member: str | None) -> str:
    names = archive.namelist()
    if member is not None:
        if member in names:
            return member
        raise InputError(f"{path} has no member {member}, only {', '.join(names[:8])}")
    found = [name for name in names if name.rsplit("/", 1)[-1] == "events.txt"]
    if len(found) == 1:
        return found[0]
    raise InputError(
        f"{path} has {len(found)} files named events.txt; name the member, one of"
        f" {', '.join(names[:8])}"
    )


def _whole_lines(stream: io.BufferedIOBase, path: Path, size: int) -> Iterator[bytes]:
    """Yield blocks of whole lines, each with its newline."""
    rest = b""
    packed, unpacked = path.stat().st_size, 0
    while block := stream.read(size):
        unpacked += len(block)
        check_ratio(unpacked, packed)
        cut = block.rfind(b"\n") + 1
        if not cut:
            rest += block
            if len(rest) > 2 * size:
                raise InputError(f"{path} has a line of over {size} bytes: not a text of events")
            continue
        yield rest + block[:cut]
        rest = block[cut:]
    if rest:
        yield rest + b"\n"


def _unit_of(text: bytes, path: Path) -> int | None:
    """Return the power of ten of seconds if the first time is a decimal fraction."""
    for line in io.BytesIO(text):
        words = line.replace(b",", b" ").split()
        if not words or words[0].startswith(b"#"):
            continue
        if (
            re.search(rb"[.eE]", words[0]) or len(words) != 4
        ):  # other than four words: left to the parser
            return _POWER["s"]
        raise InputError(
            f"{path}: the first time, {_shown(words[0])}, has no decimal point; say time_unit='us',"
            " 's', 'ms' or 'ns' (--time-unit us)"
        )
    return None


def _parse(text: bytes, path: Path, unit: int, limits: Integers, state: Integers) -> Columns:
    room = len(text) // _SHORTEST_LINE + 1
    x, y = np.empty((2, room), dtype=np.uint16)
    t, p = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.bool_)
    n = kernels.parse_lines(np.frombuffer(text, np.uint8), unit, limits, x, y, t, p, state)
    if state[kernels.ERROR]:
        line = text[state[kernels.AT] :].split(b"\n", 1)[0]
        reason = _reason(int(state[kernels.ERROR]), limits, state)
        raise InputError(f"{path}, line {state[kernels.LINE]}: {reason}: {_shown(line)}")
    return Columns(x[:n].copy(), y[:n].copy(), t[:n].copy(), p[:n].copy())


def _reason(error: int, limits: Integers, state: Integers) -> str:
    width, height = int(limits[0]), int(limits[1])
    return {
        kernels.GARBLED: "four numbers t x y p are needed",
        kernels.OUTSIDE_X: f"x is outside the sensor (width {width})",
        kernels.OUTSIDE_Y: f"y is outside the sensor (height {height})",
        kernels.NEGATIVE: "the time is negative (after origin_us)",
        kernels.TOO_LATE: "the time is over three years; another time_unit, or origin_us?",
        kernels.BACKWARDS: f"the time is before that of the last event ({state[kernels.LAST]} us)",
        kernels.POLARITY: "the polarity must be 0 or 1, or -1 or 1",
        kernels.MIXED: (
            f"polarities mix codings (-1 in line {state[kernels.MINUS_LINE]},"
            f" 0 in line {state[kernels.ZERO_LINE]})"
        ),
    }[error]


def _shown(line: bytes) -> str:
    return repr(line[:60].decode("ascii", "backslashreplace"))

"""NumPy arrays (.npy): structured with x, y, t, p under any of their names, or n x 4 numbers.

Whole times are microseconds, unless said otherwise; the unit of fractional ones must be said.  The
array is read in pieces, never as a whole.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from data_tools.files.archives import ArrayHead, array_header
from data_tools.recordings.formats import Columns, Options, Source
from data_tools.recordings.formats._columns import Converter, find_columns
from data_tools.recordings.formats._tables import SAMPLE, column_order
from evcalib.errors import InputError

NAMES = ("npy",)

MAGIC = b"\x93NUMPY"
_ROWS = 1 << 19


def matches(path: Path, head: bytes) -> bool:
    """Tell whether the file starts with the format's bytes."""
    return head.startswith(MAGIC)


def open(path: Path, options: Options) -> Source:
    """Open an array and check its header."""
    try:
        with path.open("rb") as file:
            head = array_header(file, path.name)
            start = file.tell()
            count = _check(path, head, path.stat().st_size - start)
            sample = _rows(file, head, start, 0, min(count, SAMPLE))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except InputError as error:
        raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from None
    order: dict[str, Any]
    notes: tuple[str, ...] = ()
    if head.dtype.names is None:
        try:
            order, note = column_order(sample)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        notes = (note,)
    else:
        order = find_columns(head.dtype.names) or {}
    width, height = options.sensor(path, None)
    unit = options.time_unit

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        convert = Converter(unit or "us", unit)
        try:
            with path.open("rb") as file:
                for first in range(0, count, _ROWS):
                    rows = _rows(file, head, start, first, min(first + _ROWS, count))
                    table = rows if head.dtype.names else rows.T
                    yield convert(*(np.ascontiguousarray(table[order[k]]) for k in "xytp"))
        except OSError as error:
            raise InputError(f"cannot read {path}: {error.strerror or error}") from None

    return Source("npy", width, height, pieces, notes, guessed=None if unit else "us")


def _check(path: Path, head: ArrayHead, held: int) -> int:
    """Return the number of events of an array whose values are all there, and no more."""
    shape, names = head.shape, head.dtype.names
    if names is not None and find_columns(names) is None:
        raise InputError(f"{path} needs the fields x, y, t, p, and has {', '.join(names)[:300]}")
    if len(shape) != (2 if names is None else 1) or (names is None and 4 not in shape):
        raise InputError(f"{path} must hold rows of x, y, t, p, not an array of shape {shape}")
    if min(shape) < 0 or head.size * head.dtype.itemsize != held:
        raise InputError(
            f"{path} declares {shape} values of {head.dtype.itemsize} bytes, but has {held} bytes:"
            " it is damaged or cut off"
        )
    return shape[0] if names is not None or shape[1] == 4 else shape[1]


def _rows(file: IO[bytes], head: ArrayHead, start: int, first: int, last: int) -> NDArray:
    """Return some rows; columns may stand one after the other (Fortran's order, or 4 x n)."""
    size = head.dtype.itemsize
    if head.dtype.names is not None:
        return _values(file, head, start + first * size, last - first)
    wide = head.shape[1] != 4
    if head.fortran == wide:
        return _values(file, head, start + 4 * first * size, 4 * (last - first)).reshape(-1, 4)
    count = head.shape[1] if wide else head.shape[0]
    columns = [
        _values(file, head, start + (k * count + first) * size, last - first) for k in range(4)
    ]
    return np.column_stack(columns)


def _values(file: IO[bytes], head: ArrayHead, at: int, count: int) -> NDArray:
    file.seek(at)
    data = file.read(count * head.dtype.itemsize)
    if len(data) < count * head.dtype.itemsize:
        raise InputError("the array ends before its declared length")
    return np.frombuffer(data, head.dtype)

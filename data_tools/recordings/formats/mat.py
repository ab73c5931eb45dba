"""MATLAB's files of version 5 to 7 (.mat): x, y, t, p as variables, as fields of one, or n x 4.

They are read as a whole, by SciPy, after their compressed parts have been measured.  Those of
version 7.3 are HDF5, and read as such.  Whole times are microseconds, unless said otherwise.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools.files.unpack import check_ratio
from data_tools.recordings.formats import Columns, Options, Source
from data_tools.recordings.formats._columns import Converter, find_columns
from data_tools.recordings.formats._tables import FROM_ONE, SAMPLE, column_order
from evcalib.errors import InputError

NAMES = ("mat",)

MAGIC = b"MATLAB 5.0 MAT-file"
LARGEST = 1 << 31
"""Bytes of a file, unpacked, as it is held in memory; version 7.3 has no such bound."""

_HEADER, _COMPRESSED, _PIECE = 128, 15, 1 << 20
_ROWS = 1 << 19


def matches(path: Path, head: bytes) -> bool:
    """Tell whether the file starts with MATLAB's words for these versions."""
    return head.startswith(MAGIC)


def open(path: Path, options: Options) -> Source:
    """Open a file; `options.stream` is the variable, where several hold events."""
    tables = dict(_tables(_load(path), ()))
    name = options.stream
    if name is None and len(tables) > 1:
        raise InputError(f"{path} has events in {', '.join(tables)}: say which, stream = ...")
    name = next(iter(tables), "") if name is None else name
    if name not in tables:
        there = f"only {', '.join(tables)}" if tables else "none (x, y, t, p are needed)"
        raise InputError(f"{path} has no such events: {there}")
    columns, note = _columns(path, tables[name])
    width, height = options.sensor(path, None)
    unit = options.time_unit

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        convert = Converter(unit or "us", unit)
        for first in range(0, columns[2].size, _ROWS):
            yield convert(*(column[first : first + _ROWS] for column in columns))

    return Source("mat", width, height, pieces, (*note, FROM_ONE))


def _load(path: Path) -> dict[str, Any]:
    """Return the variables of a file."""
    from scipy.io import loadmat

    try:
        data = path.read_bytes() if path.stat().st_size <= LARGEST else None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    if data is None:
        raise InputError(f"{path} is over {LARGEST} bytes; save it as version 7.3 (-v7.3)")
    try:
        _measure(data)
        return dict(loadmat(BytesIO(data), simplify_cells=True))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except Exception as error:
        # SciPy's reader raises whatever damage leads it to.
        why = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(f"{path} is damaged or cut off: {why}") from None


def _measure(data: bytes) -> None:
    """Refuse elements that are cut off, or unpack to more than a recording may."""
    order = ">" if data[126:128] == b"MI" else "<"
    at, unpacked = _HEADER, 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        if at + 8 + size > len(data):
            raise InputError("a variable is cut off")
        if kind == _COMPRESSED:
            stream, rest = zlib.decompressobj(), data[at + 8 : at + 8 + size]
            while rest and not stream.eof:
                unpacked += len(stream.decompress(rest, _PIECE))
                rest = stream.unconsumed_tail
                check_ratio(unpacked, len(data))
            if unpacked > LARGEST:
                raise InputError(f"it unpacks to over {LARGEST} bytes; save it as version 7.3")
            if not stream.eof:
                raise InputError("a variable is cut off")
        at += 8 + size
    if at != len(data):
        raise InputError("it ends within a variable")


def _tables(content: Mapping[str, Any], above: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Yield the names and values of what may hold events."""
    names = [str(name) for name in content if not str(name).startswith("__")]
    if find_columns(names) is not None:
        yield ".".join(above) or "the variables", content
        return
    for name in names:
        value = content[name]
        if isinstance(value, Mapping) and len(above) < 4:
            yield from _tables(value, (*above, name))
        elif isinstance(value, np.ndarray) and value.ndim == 2 and 4 in value.shape:
            yield ".".join((*above, name)), value


def _columns(path: Path, table: Any) -> tuple[list[NDArray], tuple[str, ...]]:
    """Return x, y, t, p of a table, and what was taken for granted."""
    if isinstance(table, Mapping):
        fields = find_columns(list(table)) or {}
        columns = [np.atleast_1d(table[fields[key]]) for key in "xytp"]
        if len({c.shape for c in columns}) > 1 or columns[0].ndim != 1:
            shapes = ", ".join(f"{k} {c.shape}" for k, c in zip("xytp", columns, strict=True))
            raise InputError(f"{path}: the columns must be of one length, not {shapes}")
        return [_lessened(column) for column in columns], ()
    rows = table if table.shape[1] == 4 else table.T
    try:
        order, note = column_order(rows[:SAMPLE])
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return [_lessened(rows[:, order[key]]) for key in "xytp"], (note,)


def _lessened(values: NDArray) -> NDArray:
    """Return doubles that are whole numbers as such: MATLAB keeps all numbers as doubles."""
    whole = values.dtype.kind == "f" and bool(
        ((np.abs(values) < 2.0**53) & (values == np.rint(values))).all()
    )
    return np.ascontiguousarray(values.astype(np.int64) if whole else values)

"""MATLAB's files of version 5 to 7 (.mat): x, y, t, p as variables, as fields of one, or n x 4.

They are read as a whole.  Those of version 7.3 are HDF5, and read as such.  Whole times are
microseconds, unless said otherwise.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools.recordings.formats import Columns, Options, Source
from data_tools.recordings.formats._columns import Converter, find_columns
from data_tools.recordings.formats._mat5 import LARGEST, Value, read_variables
from data_tools.recordings.formats._tables import FROM_ONE, SAMPLE, column_order
from evcalib.errors import InputError

NAMES = ("mat",)

MAGIC = b"MATLAB 5.0 MAT-file"
_ROWS = 1 << 19


def matches(path: Path, head: bytes) -> bool:
    """Tell whether the file starts with MATLAB's words for these versions."""
    return head.startswith(MAGIC)


def open(path: Path, options: Options) -> Source:
    """Open a file; `options.stream` is the variable, where several hold events."""
    tables = dict(_tables(_load(path), ()))
    name = options.stream
    if name is None and len(tables) > 1:
        raise InputError(
            f"{path} has events in {', '.join(tables)}: say which, stream = ... (--stream)"
        )
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

    guessed = None if unit else "us"
    return Source("mat", width, height, pieces, (*note, FROM_ONE), guessed=guessed)


def _load(path: Path) -> dict[str, Value]:
    """Return the variables of a file."""
    try:
        data = path.read_bytes() if path.stat().st_size <= LARGEST else None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    if data is None:
        raise InputError(f"{path} is over {LARGEST} bytes; save it as version 7.3 (-v7.3)")
    try:
        return read_variables(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _tables(content: Mapping[str, Any], above: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Yield the names and values of what may hold events."""
    if find_columns(list(content)) is not None:
        yield ".".join(above) or "the variables", content
        return
    for name, value in content.items():
        if isinstance(value, Mapping):
            yield from _tables(value, (*above, name))
        elif value.ndim == 2 and 4 in value.shape:
            yield ".".join((*above, name)), value


def _columns(path: Path, table: Any) -> tuple[list[NDArray], tuple[str, ...]]:
    """Return x, y, t, p of a table, and what was taken for granted."""
    if isinstance(table, Mapping):
        fields = find_columns(list(table)) or {}
        columns = [table[fields[key]] for key in "xytp"]
        if any(isinstance(c, Mapping) for c in columns) or len({c.size for c in columns}) > 1:
            shapes = ", ".join(f"{k} {np.shape(c)}" for k, c in zip("xytp", columns, strict=True))
            raise InputError(f"{path}: the columns must be of one length, not {shapes}")
        return [_lessened(column.ravel(order="F")) for column in columns], ()
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

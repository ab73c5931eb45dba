"""NumPy archives (.npz) with the arrays x, y, t, p, of one length, or one array of events.

Other names of `Events.from_structured` do as well (``timestamps``, ``polarity``...).  Optional,
as arrays of one value: ``width``, ``height`` [px] and ``time_unit``.  Times are whole
microseconds, unless said otherwise.  The arrays are read in pieces, never as a whole; arrays of
Python objects, which could run code, are refused.  One array is structured, or n x 4 numbers, as in
a .npy file.
"""

from __future__ import annotations

import zipfile
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools.files.archives import (
    SUFFIX,
    ArrayHead,
    array_head,
    array_header,
    member_names,
    open_member,
    opened_zip,
)
from data_tools.recordings.formats import Columns, Options, Size, Source
from data_tools.recordings.formats._columns import Converter, find_columns
from data_tools.recordings.formats._tables import SAMPLE, column_order
from evcalib.errors import InputError

NAMES = ("npz",)

_ROWS = 1 << 19


def matches(path: Path, head: bytes) -> bool:
    """Tell whether the file is a zip of arrays, the four columns among them."""
    if not head.startswith(b"PK\x03\x04"):
        return False
    names = _arrays(member_names(path))
    if find_columns(names) is not None:
        return True
    try:
        with opened_zip(path) as archive:
            return bool(_tables(archive))
    except InputError:
        return False


def open(path: Path, options: Options) -> Source:
    """Open an archive and check the headers of its arrays."""
    with opened_zip(path) as archive:
        names = _arrays(archive.namelist())
        fields = find_columns(names)
        if fields is None and (tables := _tables(archive)):
            return _open_table(path, archive, tables, options)
        if fields is None:
            there = ", ".join(names) or "none"
            raise InputError(f"{path} needs the arrays x, y, t, p, and has {there}")
        lengths = {key: array_head(archive, name).shape for key, name in fields.items()}
        if len(set(lengths.values())) > 1 or any(len(shape) != 1 for shape in lengths.values()):
            raise InputError(f"{path}: the columns must be of one length, not {lengths}")
        size = options.sensor(path, _declared_size(archive))
        told = _value(archive, "time_unit")
        unit = options.unit(None if told is None else str(told))

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        convert = Converter(unit or "us", unit)
        with opened_zip(path) as archive, ExitStack() as stack:
            streams = {key: _Array(stack, archive, name) for key, name in fields.items()}
            left = lengths["t"][0]
            while left:
                count = min(left, _ROWS)
                left -= count
                yield convert(*(streams[key].read(count, last=not left) for key in "xytp"))

    return Source("npz", *size, pieces, guessed=None if unit else "us")


def _tables(archive: zipfile.ZipFile) -> dict[str, ArrayHead]:
    """Return the arrays that hold a whole event in each row."""
    found = {}
    for name in _arrays(archive.namelist()):
        try:
            head = array_head(archive, name)
        except InputError:
            continue
        fields = head.dtype.names
        if fields is not None:
            fits = len(head.shape) == 1 and find_columns(fields) is not None
        else:
            fits = len(head.shape) == 2 and head.shape[1] == 4 and not head.fortran
        if fits:
            found[name] = head
    return found


def _open_table(
    path: Path, archive: zipfile.ZipFile, tables: dict[str, ArrayHead], options: Options
) -> Source:
    """Open an archive of one array of events; `options.stream` says which of several."""
    name = options.stream if options.stream in tables else next(iter(tables))
    if len(tables) > 1 and name != options.stream:
        raise InputError(f"{path} has events in {', '.join(tables)}: say which, stream (--stream)")
    head = tables[name]
    order: dict[str, Any]
    notes: tuple[str, ...] = ()
    if head.dtype.names is not None:
        order = find_columns(head.dtype.names) or {}
    else:
        with ExitStack() as stack:
            sample = _Array(stack, archive, name).read(4 * min(head.shape[0], SAMPLE), last=False)
        order, note = column_order(sample.reshape(-1, 4))
        notes = (note,)
    size = options.sensor(path, _declared_size(archive))
    unit = options.time_unit

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        convert = Converter(unit or "us", unit)
        with opened_zip(path) as archive, ExitStack() as stack:
            stream, left = _Array(stack, archive, name), head.shape[0]
            while left:
                count = min(left, _ROWS)
                left -= count
                if head.dtype.names is not None:
                    table = stream.read(count, last=not left)
                else:
                    table = stream.read(4 * count, last=not left).reshape(-1, 4).T
                yield convert(*(np.ascontiguousarray(table[order[key]]) for key in "xytp"))

    return Source("npz", *size, pieces, notes, guessed=None if unit else "us")


def _arrays(members: list[str]) -> list[str]:
    return [name.removesuffix(SUFFIX) for name in members if name.endswith(SUFFIX)]


class _Array:
    """One array of an archive, read from its start to its end."""

    def __init__(self, stack: ExitStack, archive: zipfile.ZipFile, name: str) -> None:
        self._name = name
        self._stream = stack.enter_context(open_member(archive, name + SUFFIX))
        self._dtype = array_header(self._stream, name).dtype

    def read(self, count: int, *, last: bool) -> NDArray[Any]:
        """Return the next values; after the last, the archive's checksum is compared."""
        data = self._stream.read(count * self._dtype.itemsize)
        if len(data) < count * self._dtype.itemsize:
            raise InputError(f"the array {self._name} ends before its declared length")
        if last and self._stream.read(1):
            raise InputError(f"the array {self._name} goes on after its declared length")
        return np.frombuffer(data, dtype=self._dtype)


def _value(archive: zipfile.ZipFile, name: str) -> Any:
    """Return the single value of a small array, or None."""
    if name not in _arrays(archive.namelist()):
        return None
    head = array_head(archive, name)
    dtype = head.dtype
    if head.size != 1 or dtype.itemsize > 256:
        raise InputError(f"the array {name} must hold one value, not {head.shape}")
    with open_member(archive, name + SUFFIX) as stream:
        array_header(stream, name)
        value = np.frombuffer(stream.read(dtype.itemsize), dtype=dtype)[0].item()
        if stream.read(1):
            raise InputError(f"the array {name} goes on after its declared length")
        return value


def _declared_size(archive: zipfile.ZipFile) -> Size | None:
    width, height = _value(archive, "width"), _value(archive, "height")
    if width is None or height is None:
        return None
    if not (isinstance(width, int) and isinstance(height, int)):
        raise InputError(f"width and height must be whole numbers, not {width!r}, {height!r}")
    return width, height

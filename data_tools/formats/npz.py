"""NumPy archives (.npz) with the arrays x, y, t, p, of one length.

Other names of `Events.from_structured` do as well (``timestamps``, ``polarity``...).  Optional,
as arrays of one value: ``width``, ``height`` [px] and ``time_unit``.  Times are whole
microseconds, unless said otherwise.  The arrays are read in pieces, never as a whole; arrays of
Python objects, which could run code, are refused.
"""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from data_tools.formats import Columns, Options, Size, Source
from data_tools.formats._columns import Converter, find_columns
from evcalib.errors import InputError

NAMES = ("npz",)

_ROWS = 1 << 19
_SUFFIX = ".npy"


def matches(path: Path, head: bytes) -> bool:
    """Tell whether the file is a zip of arrays, the four columns among them."""
    if not head.startswith(b"PK\x03\x04"):
        return False
    try:
        with zipfile.ZipFile(path) as archive:
            return find_columns(_arrays(archive)) is not None
    except (OSError, zipfile.BadZipFile):
        return False


def open(path: Path, options: Options) -> Source:
    """Open an archive and check the headers of its arrays."""
    with _archive(path) as archive:
        fields = find_columns(_arrays(archive))
        if fields is None:
            there = ", ".join(_arrays(archive)) or "none"
            raise InputError(f"{path} needs the arrays x, y, t, p, and has {there}")
        heads = {key: _head_of(archive, name) for key, name in fields.items()}
        lengths = {key: shape for key, (shape, _) in heads.items()}
        if len(set(lengths.values())) > 1 or any(len(shape) != 1 for shape in lengths.values()):
            raise InputError(f"{path}: the columns must be of one length, not {lengths}")
        size = options.sensor(path, _declared_size(archive))
        unit = options.time_unit or _value(archive, "time_unit")
    if unit is not None and unit not in ("s", "ms", "us", "ns"):
        raise InputError(f"{path}: its time_unit is {unit!r}; say time_unit='us' or another")

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        convert = Converter(unit or "us", unit)
        with _archive(path) as archive, ExitStack() as stack:
            streams = {key: _Array(stack, archive, name) for key, name in fields.items()}
            left = lengths["t"][0]
            while left:
                count = min(left, _ROWS)
                yield convert(*(streams[key].read(count) for key in "xytp"))
                left -= count

    return Source("npz", *size, pieces)


@contextmanager
def _archive(path: Path) -> Iterator[zipfile.ZipFile]:
    try:
        with zipfile.ZipFile(path) as archive:
            yield archive
    except InputError as error:
        raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except (EOFError, zlib.error, zipfile.BadZipFile, NotImplementedError, RuntimeError) as error:
        raise InputError(f"{path} is damaged or cut off: {error}; fetch it again") from None


def _arrays(archive: zipfile.ZipFile) -> list[str]:
    return [name.removesuffix(_SUFFIX) for name in archive.namelist() if name.endswith(_SUFFIX)]


class _Array:
    """One array of an archive, read from its start to its end."""

    def __init__(self, stack: ExitStack, archive: zipfile.ZipFile, name: str) -> None:
        self._name = name
        self._stream = stack.enter_context(archive.open(name + _SUFFIX))
        _, self._dtype = _header(self._stream, name)

    def read(self, count: int) -> NDArray[Any]:
        """Return the next values."""
        data = self._stream.read(count * self._dtype.itemsize)
        if len(data) < count * self._dtype.itemsize:
            raise InputError(f"the array {self._name} ends before its declared length")
        return np.frombuffer(data, dtype=self._dtype)


def _head_of(archive: zipfile.ZipFile, name: str) -> tuple[tuple[int, ...], np.dtype]:
    """Return shape and type of an array whose data is really there."""
    with archive.open(name + _SUFFIX) as stream:
        shape, dtype = _header(stream, name)
        held = archive.getinfo(name + _SUFFIX).file_size - stream.tell()
    if int(np.prod(shape, dtype=object)) * dtype.itemsize > held:
        raise InputError(f"the array {name} declares {shape} values, but has {held} bytes")
    return shape, dtype


def _header(stream: IO[bytes], name: str) -> tuple[tuple[int, ...], np.dtype]:
    try:
        version = np.lib.format.read_magic(stream)
        read = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }[version]
        shape, _, dtype = read(stream)
    except (ValueError, KeyError, struct.error, SyntaxError, TypeError) as error:
        raise InputError(f"the array {name} has no usable header: {error}") from None
    if dtype.hasobject:
        raise InputError(
            f"the array {name} holds Python objects, which could run code when read; save it again"
            " as numbers: array.astype(numpy.int64)"
        )
    return shape, dtype


def _value(archive: zipfile.ZipFile, name: str) -> Any:
    """Return the single value of a small array, or None."""
    if name not in _arrays(archive):
        return None
    shape, dtype = _head_of(archive, name)
    if int(np.prod(shape, dtype=object)) != 1 or dtype.itemsize > 256:
        raise InputError(f"the array {name} must hold one value, not {shape}")
    with archive.open(name + _SUFFIX) as stream:
        _header(stream, name)
        return np.frombuffer(stream.read(dtype.itemsize), dtype=dtype)[0].item()


def _declared_size(archive: zipfile.ZipFile) -> Size | None:
    width, height = _value(archive, "width"), _value(archive, "height")
    if width is None or height is None:
        return None
    if not (isinstance(width, int) and isinstance(height, int)):
        raise InputError(f"width and height must be whole numbers, not {width!r}, {height!r}")
    return width, height

"""Zip archives, NumPy's too, of other people's making: damage in words, no bombs, no pickles."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from math import prod
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_tools.files.pipes import refuse_pipe
from data_tools.files.unpack import check_ratio
from evcalib.errors import InputError

SUFFIX = ".npy"
"""Ending of arrays in an archive."""

_DAMAGE = (
    EOFError,
    zlib.error,
    zipfile.BadZipFile,
    struct.error,
    NotImplementedError,  # a version or a method that zipfile does not know
    RuntimeError,  # a member that is encrypted
    ValueError,  # a name that is no text, a member that was asked for and is none
    LookupError,
    OverflowError,
)


@contextmanager
def opened_zip(path: Path) -> Iterator[zipfile.ZipFile]:
    """Open an archive.

    Raises
    ------
    InputError
        If it is damaged, cut off, or would unpack to more than any recording.
    """
    refuse_pipe(path)
    try:
        with zipfile.ZipFile(path) as archive:
            check_ratio(sum(info.file_size for info in archive.infolist()), path.stat().st_size)
            yield archive
    except InputError as error:
        raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except _DAMAGE as error:
        why = str(error)[:200] or type(error).__name__
        raise InputError(f"{path} is damaged or cut off: {why}; fetch it again") from None


def open_member(archive: zipfile.ZipFile, name: str) -> IO[bytes]:
    """Open a member that is stored or deflated; other methods unpack without a bound.

    Raises
    ------
    InputError
        If it is compressed in another way.
    """
    method = archive.getinfo(name).compress_type
    if method not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise InputError(f"{name} is compressed by method {method}; only deflate is read")
    return archive.open(name)


def member_names(path: Path) -> list[str]:
    """Return the names in an archive; none if it is damaged."""
    try:
        with opened_zip(path) as archive:
            return archive.namelist()
    except InputError:
        return []


class ArrayHead(NamedTuple):
    """What a .npy file says of the array that follows."""

    shape: tuple[int, ...]
    dtype: np.dtype
    fortran: bool

    @property
    def size(self) -> int:
        """Number of values; of any size, for it is a claim."""
        return prod(self.shape)


def array_head(archive: zipfile.ZipFile, name: str) -> ArrayHead:
    """Return shape and type of an array whose data is really there.

    Raises
    ------
    InputError
        If it holds Python objects, or declares more values than its member has.
    """
    with open_member(archive, name + SUFFIX) as stream:
        head = array_header(stream, name)
        held = archive.getinfo(name + SUFFIX).file_size - stream.tell()
    if min(head.shape, default=1) < 0 or head.size * head.dtype.itemsize > held:
        raise InputError(f"the array {name} declares {head.shape} values, but has {held} bytes")
    return head


def array_header(stream: IO[bytes], name: str) -> ArrayHead:
    """Read the header of an array; the values follow in the stream.

    Raises
    ------
    InputError
        If it is unusable, or says that Python objects follow, which could run code.
    """
    try:
        version = np.lib.format.read_magic(stream)
        read = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }[version]
        shape, fortran, dtype = read(stream)
    except (ValueError, KeyError, struct.error, SyntaxError, TypeError, TokenError) as error:
        why = " ".join(str(error).split())[:200]
        raise InputError(f"the array {name} has no usable header: {why}") from None
    if dtype.hasobject:
        raise InputError(
            f"the array {name} holds Python objects, which could run code when read; save it again"
            " as numbers: array.astype(numpy.int64)"
        )
    return ArrayHead(shape, dtype, fortran)


def load_array(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    """Return a whole array, its checksum compared.

    Raises
    ------
    InputError
        As `array_head`; and if the data is longer or shorter than declared.
    """
    head = array_head(archive, name)
    with open_member(archive, name + SUFFIX) as stream:
        array_header(stream, name)
        data = stream.read(head.size * head.dtype.itemsize + 1)
    if len(data) != head.size * head.dtype.itemsize:
        raise InputError(f"the array {name} is not as long as it declares")
    return np.frombuffer(data, head.dtype).reshape(head.shape, order="F" if head.fortran else "C")

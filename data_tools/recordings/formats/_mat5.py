"""The elements of MATLAB's files of version 5 to 7: numbers and structs of them, nothing else.

SciPy's reader ends the process at some damaged files.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools.files.unpack import check_ratio
from evcalib.errors import InputError

Value = dict[str, Any] | NDArray[Any]

LARGEST = 1 << 31
"""Bytes of a file, unpacked, as it is held in memory; version 7.3 has no such bound."""

_HEADER, _PIECE, _DEEPEST = 128, 1 << 20, 4
_MATRIX, _COMPRESSED = 14, 15
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4"}
_TYPES |= {7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_STRUCT, _NUMBERS = 2, range(6, 16)


def read_variables(data: bytes) -> dict[str, Value]:
    """Return the variables of a file that are numbers, or structs of one element.

    Raises
    ------
    InputError
        If it is damaged or cut off, or unpacks to more than a recording may.
    """
    order = ">" if data[126:128] == b"MI" else "<"
    found: dict[str, Value] = {}
    unpacked = 0
    for kind, content in _elements(memoryview(data)[_HEADER:], order, padded=False):
        if kind == _COMPRESSED:
            content = memoryview(_inflated(content, len(data)))
            unpacked += len(content)
            if unpacked > LARGEST:
                raise InputError(f"it unpacks to over {LARGEST} bytes; save it as version 7.3")
            kind, content = next(_elements(content, order), (0, content))
        if kind == _MATRIX:
            name, value = _matrix(content, order, 0)
            if value is not None:
                found[name] = value
    return found


def _inflated(packed: memoryview, whole: int) -> bytes:
    stream, parts, rest = zlib.decompressobj(), bytearray(), bytes(packed)
    try:
        while rest and not stream.eof:
            parts += stream.decompress(rest, _PIECE)
            rest = stream.unconsumed_tail
            check_ratio(len(parts), whole)
    except zlib.error as error:
        raise InputError(f"a variable is damaged: {error}") from None
    if not stream.eof:
        raise InputError("a variable is cut off")
    return bytes(parts)


def _elements(
    data: memoryview, order: str, *, padded: bool = True
) -> Iterator[tuple[int, memoryview]]:
    """Yield kind and content of each element; short ones have theirs in the tag itself."""
    at = 0
    while at < len(data):
        if at + 8 > len(data):
            raise InputError("a variable is cut off")
        kind, size = struct.unpack_from(f"{order}II", data, at)
        start, after = at + 8, at + 8 + size
        if kind >> 16:
            kind, size = kind & 0xFFFF, kind >> 16
            start, after = at + 4, at + 8
        if start + size > (after if size <= 4 and start == at + 4 else len(data)):
            raise InputError("a variable is cut off")
        yield kind, data[start : start + size]
        at = after if not padded else -(-after // 8) * 8


def _matrix(content: memoryview, order: str, depth: int) -> tuple[str, Value | None]:
    """Return name and value of an array; None for what is neither numbers nor a struct."""
    parts = _elements(content, order)
    flags, sides = _whole(parts, order), _whole(parts, order)
    _, name = _next(parts)
    label = bytes(name).decode("ascii", "replace")
    if not flags or not 0 < len(sides) <= 32 or min(sides) < 0:
        raise InputError(f"the variable {label[:100]!r} is damaged")
    kind, complex_numbers = flags[0] & 0xFF, flags[0] & 0x800
    if kind in _NUMBERS and not complex_numbers:
        return label, _numbers(parts, order, sides, label)
    if kind == _STRUCT and prod(sides) == 1 and depth < _DEEPEST:
        return label, _fields(parts, order, depth)
    return label, None


def _fields(parts: Iterator[tuple[int, memoryview]], order: str, depth: int) -> dict[str, Value]:
    (width, *_), (_, names) = _whole(parts, order) or [0], _next(parts)
    if width <= 0 or len(names) % width:
        raise InputError("the fields of a struct are damaged")
    found = {}
    for at in range(0, len(names), width):
        name = bytes(names[at : at + width]).split(b"\0")[0].decode("ascii", "replace")
        kind, content = _next(parts)
        value = _matrix(content, order, depth + 1)[1] if kind == _MATRIX and len(content) else None
        if value is not None:
            found[name] = value
    return found


def _numbers(
    parts: Iterator[tuple[int, memoryview]], order: str, sides: list[int], name: str
) -> NDArray[Any]:
    kind, content = _next(parts)
    dtype = np.dtype(order + _TYPES.get(kind, "u1"))
    if kind not in _TYPES or len(content) != prod(sides) * dtype.itemsize:
        raise InputError(f"the variable {name[:100]!r} has not the {sides} values that it declares")
    values = np.frombuffer(content, dtype).reshape(sides, order="F")
    return values.astype(dtype.newbyteorder("="))


def _whole(parts: Iterator[tuple[int, memoryview]], order: str) -> list[int]:
    """Return the values of an element of 32-bit numbers."""
    kind, content = _next(parts)
    if kind not in (5, 6) or len(content) % 4:
        raise InputError("a variable is damaged")
    found: list[int] = np.frombuffer(content, f"{order}i4").tolist()
    return found


def _next(parts: Iterator[tuple[int, memoryview]]) -> tuple[int, memoryview]:
    found = next(parts, None)
    if found is None:
        raise InputError("a variable is cut off")
    return found

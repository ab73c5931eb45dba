"""Prophesee's DAT files: a text header, the type and size of records, then decoded events."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from data_tools.formats import Columns, Options, Source
from data_tools.formats._blocks import read_blocks
from data_tools.formats._prophesee_header import Header, parse_header, read_header
from evcalib.errors import InputError

NAMES = ("dat",)

LARGEST_SIDE = 1 << 14
"""The records hold 14 bits of x and y."""

BLOCK_BYTES = 1 << 22

_RECORD = np.dtype([("t", "<u4"), ("place", "<u4")])
_EVENT_2D, _CD, _TRIGGER = 0x00, 0x0C, 0x0E
_HALF = 1 << 31
_LOOP = 1 << 32


def matches(path: Path, head: bytes) -> bool:
    """Tell whether there is a header of Prophesee's without an encoding."""
    header = parse_header(head)
    return header.encoding is None and not {"data", "version", "width"}.isdisjoint(header.fields)


def open(path: Path, options: Options) -> Source:
    """Open a DAT file of version 2."""
    header = read_header(path)
    version = header.fields.get("version")
    if version not in (None, "2"):
        raise InputError(f"{path} is of version {version} of the DAT format; only 2 is read")
    width, height = options.sensor(path, header.size(path, LARGEST_SIDE))
    _check_records(path, header)

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        clock = _Clock()
        for block in read_blocks(path, header.end + 2, BLOCK_BYTES):
            records = np.frombuffer(block, _RECORD, len(block) // _RECORD.itemsize)
            rest = len(block) - records.nbytes
            if rest:
                losses["bytes of a cut-off last event"] += rest
            yield _columns(records, clock)

    return Source("dat", width, height, pieces)


def _check_records(path: Path, header: Header) -> None:
    told = next(read_blocks(path, header.end, 2), b"")
    if len(told) < 2:
        raise InputError(f"{path} ends within its header: it holds no events")
    kind, size = told
    if kind == _TRIGGER:
        raise InputError(f"{path} holds external triggers, not events")
    if kind not in (_EVENT_2D, _CD) or size != _RECORD.itemsize:
        raise InputError(
            f"{path} has records of type {kind:#04x} and {size} bytes, not events of 8 bytes:"
            " is its header damaged?"
        )


class _Clock:
    """Undoes the loops of a 32-bit clock [us]: steps by more than half its range, 36 minutes."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._loops = 0

    def unwrap(self, stamps: np.ndarray) -> np.ndarray:
        t = stamps.astype(np.int64)
        if not t.size:
            return t
        steps = np.diff(t, prepend=t[0] if self._last is None else self._last)
        loops = np.cumsum((steps < -_HALF).astype(np.int64) - (steps > _HALF)) + self._loops
        self._last, self._loops = int(t[-1]), int(loops[-1])
        return t + loops * _LOOP


def _columns(records: np.ndarray, clock: _Clock) -> Columns:
    place = records["place"]
    x, y = place & 0x3FFF, (place >> 14) & 0x3FFF
    p = (place >> 28) & 1
    return Columns(
        x.astype(np.uint16), y.astype(np.uint16), clock.unwrap(records["t"]), p.astype(np.bool_)
    )

"""Prophesee's DAT files: a text header, the type and size of records, then decoded events."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from data_tools.recordings.formats import Columns, Options, Source
from data_tools.recordings.formats import _dat_kernels as kernels
from data_tools.recordings.formats._blocks import read_blocks
from data_tools.recordings.formats._prophesee_header import Header, parse_header, read_header
from evcalib.arrays import Integers
from evcalib.errors import InputError

NAMES = ("dat",)

LARGEST_SIDE = 1 << 14
"""The records hold 14 bits of x and y."""

BLOCK_BYTES = 1 << 22
RECORD_BYTES = 8

_EVENT_2D, _CD, _TRIGGER = 0x00, 0x0C, 0x0E


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
        state = np.array([-1, 0])
        for block in read_blocks(path, header.end + 2, BLOCK_BYTES):
            yield _columns(block, state)
            rest = len(block) % RECORD_BYTES
            if rest:
                losses["bytes of a cut-off last event"] += rest

    return Source("dat", width, height, pieces, fixed="us", turn_us=1 << 32)


def _check_records(path: Path, header: Header) -> None:
    told = next(read_blocks(path, header.end, 2), b"")
    if len(told) < 2:
        raise InputError(f"{path} ends within its header: it holds no events")
    kind, size = told
    if kind == _TRIGGER:
        raise InputError(f"{path} holds external triggers, not events")
    if kind not in (_EVENT_2D, _CD) or size != RECORD_BYTES:
        raise InputError(
            f"{path} has records of type {kind:#04x} and {size} bytes, not events of 8 bytes:"
            " is its header damaged?"
        )


def _columns(block: bytes, state: Integers) -> Columns:
    words = np.frombuffer(block, "<u4", len(block) // RECORD_BYTES * 2)
    records = words.astype(np.uint32, copy=False).reshape(-1, 2)
    x, y = np.empty((2, len(records)), np.uint16)
    t, p = np.empty(len(records), np.int64), np.empty(len(records), np.bool_)
    kernels.decode(records, x, y, t, p, state)
    return Columns(x, y, t, p)

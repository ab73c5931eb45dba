"""Event Stream (.es) of version 2, with the events of a DVS or an ATIS; times in microseconds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from data_tools.recordings.formats import Columns, Options, Source
from data_tools.recordings.formats import _es_kernels as kernels
from data_tools.recordings.formats._blocks import read_blocks
from evcalib.errors import InputError

NAMES = ("es",)

MAGIC = b"Event Stream"
BLOCK_BYTES = 1 << 22

_HEADER_BYTES = 20
_KINDS = {0: "generic events", 1: "dvs", 2: "atis", 3: "display events", 4: "colour events"}
_ORIGIN = "the format does not say where rows count from: row 0 was taken for the uppermost"


def matches(path: Path, head: bytes) -> bool:
    """Tell whether the file starts with the format's words."""
    return head.startswith(MAGIC)


def open(path: Path, options: Options) -> Source:
    """Open a file of version 2."""
    head = next(read_blocks(path, 0, _HEADER_BYTES), b"")
    if len(head) < _HEADER_BYTES:
        raise InputError(f"{path} ends within its header: it holds no events")
    if head[12] != 2:
        told = ".".join(map(str, head[12:15]))
        raise InputError(f"{path} is of version {told} of Event Stream; only 2 is read")
    kind = _KINDS.get(head[15], f"type {head[15]}")
    if kind not in ("dvs", "atis"):
        raise InputError(f"{path} holds {kind}, not the events of a DVS or an ATIS")
    sides = int.from_bytes(head[16:18], "little"), int.from_bytes(head[18:20], "little")
    width, height = options.sensor(path, sides)

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        state = np.zeros(3, np.int64)
        rest = b""
        for block in read_blocks(path, _HEADER_BYTES, BLOCK_BYTES):
            data = np.frombuffer(rest + block, np.uint8)
            room = data.size // 5
            x, y = np.empty((2, room), np.uint16)
            t, p = np.empty(room, np.int64), np.empty(room, np.bool_)
            rest = data[kernels.decode(data, kind == "atis", x, y, t, p, state) :].tobytes()
            yield Columns(x, y, t, p).rows(slice(state[kernels.COUNT]))
        if rest:
            losses["bytes of a cut-off last event"] += len(rest)
        if state[kernels.MEASURED]:
            losses["measurements of exposure"] += int(state[kernels.MEASURED])

    return Source("es", width, height, pieces, (_ORIGIN,), fixed="us")

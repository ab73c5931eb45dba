"""AEDAT 2.0 (jAER): a text header, then pairs of big-endian words, an address and a time [us].

What an address means depends on the chip, which the header names: DVS128, or one of the DAVIS,
whose samples of frames, and triggers, are passed over.  jAER counts columns from the right and rows
from below; here they count from the upper left, as everywhere.

A sample of a DAVIS's IMU is seven records of one time, with bits 31, 11 and 10 set: three
accelerations, the temperature and three rates (bits 28 to 30 say which), each of 16 bits from bit
12 on.  Their x points to the left and their z to the back of the camera (jAER's IMUSample: rates
count positive for tilts down, turns to the right, and rolls against the clock); here they are
turned to the camera's own axes.  A real file (a roll) agrees with its events in sign and size.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_tools.recordings.formats import Columns, Options, Samples, Source
from data_tools.recordings.formats._aedat_header import MAGIC, chip_size, read_header, version
from data_tools.recordings.formats._blocks import read_blocks
from evcalib.arrays import Integers
from evcalib.errors import InputError

NAMES = ("aedat2",)

BLOCK_BYTES = 1 << 22
RECORD_BYTES = 8

_HALF = 1 << 31
_CHIP = "# AEChip:"
_DVS128 = (128, 128)


def matches(path: Path, head: bytes) -> bool:
    """Tell whether the file starts with the format's line, of version 1 or 2."""
    return head.startswith(MAGIC) and version(head)[:1] in ("1", "2")


def open(path: Path, options: Options) -> Source:
    """Open a file of version 2.0; the size says which chip, where the header does not."""
    lines, start = read_header(path)
    told = version(lines[0].encode())
    if told != "2.0":
        raise InputError(f"{path} is of version {told} of AEDAT; 2.0, 3.1 and 4.0 are read")
    chip = next((line[len(_CHIP) :].strip() for line in lines if line.startswith(_CHIP)), "")
    size = chip_size(chip)
    if chip and size is None:
        raise InputError(f"{path} is of the chip {chip}, whose addresses are not known")
    width, height = options.sensor(path, size)
    if chip_size(chip or {_DVS128: "DVS128"}.get((width, height), "DAVIS240")) is None:
        raise InputError(f"{path}: no chip of {width}x{height} px is known")
    dvs = "DVS128" in chip.upper() if chip else (width, height) == _DVS128
    notes = () if chip else (f"the file names no chip: {'DVS128' if dvs else 'a DAVIS'} was taken",)

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        clock = Clock(32)
        for block in read_blocks(path, start, BLOCK_BYTES):
            words = np.frombuffer(block, ">u4", len(block) // RECORD_BYTES * 2)
            x, y, t, p = (_dvs128 if dvs else _davis)(words.reshape(-1, 2).astype(np.int64))
            x, y = width - 1 - x, height - 1 - y
            keep = (x >= 0) & (y >= 0)
            if not keep.all():
                losses["events outside the sensor"] += int(np.count_nonzero(~keep))
            xs, ys = x[keep].astype(np.uint16), y[keep].astype(np.uint16)
            yield Columns(xs, ys, clock(t[keep]), p[keep])
            rest = len(block) % RECORD_BYTES
            if rest:
                losses["bytes of a cut-off last event"] += rest

    return Source("aedat2", width, height, pieces, notes, fixed="us", turn_us=1 << 32)


FULL_RATE, FULL_FORCE = 1000.0, 8.0
"""Full scales [deg/s], [g] where the header names none: what jAER sets in a DAVIS."""
GRAVITY = 9.80665
AXES = "IMU: turned from the axes of a DAVIS's chip to those of the camera"
_TO_CAMERA = np.array([-1.0, 1.0, -1.0])
_IMU = 0x80000C00


def imu(path: Path, options: Options) -> Samples | None:
    """Return the samples of a DAVIS's IMU, in the axes of the camera; None where there are none."""
    lines, start = read_header(path)
    parts: list[NDArray[np.int64]] = []
    rest = np.empty((0, 2), dtype=np.int64)
    clock = Clock(32)
    for block in read_blocks(path, start, BLOCK_BYTES):
        words = np.frombuffer(block, ">u4", len(block) // RECORD_BYTES * 2).reshape(-1, 2)
        words = words[(words[:, 0] & _IMU) == _IMU].astype(np.int64)
        words[:, 1] = clock(words[:, 1])
        whole, rest = _samples(np.concatenate([rest, words]))
        parts.append(whole)
    records = np.concatenate(parts) if parts else np.empty((0, 8), dtype=np.int64)
    if not len(records):
        return None
    full = [
        _full_scale(lines, r"GyroFullScaleDegPerSec(\d+)", FULL_RATE, "deg/s"),
        _full_scale(lines, r"ImuAccelScaleG(\d+)", FULL_FORCE, "g"),
    ]
    force, rate = records[:, 1:4], records[:, 5:8]
    return Samples(
        1000 * records[:, 0].astype(np.int64),
        np.radians(full[0][0] / 32768) * rate * _TO_CAMERA,
        GRAVITY * full[1][0] / 32768 * force * _TO_CAMERA,
        (AXES, *(note for _, note in full if note)),
    )


def _samples(words: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return whole samples, the time and seven values each, and the records of one begun last."""
    which = (words[:, 0] >> 28) & 7
    first = np.flatnonzero(which == 0)
    begun = len(words) if not first.size or first[-1] + 7 <= len(words) else int(first[-1])
    first = first[first + 7 <= len(words)]
    rows = first[:, None] + np.arange(7)
    good = (which[rows] == np.arange(7)).all(axis=1) & (np.ptp(words[rows, 1], axis=1) == 0)
    rows = rows[good]
    values = ((words[rows, 0] >> 12) & 0xFFFF).astype(np.uint16).astype(np.int16)
    return np.column_stack([words[rows[:, 0], 1], values.astype(np.int64)]), words[begun:]


def _full_scale(lines: list[str], pattern: str, usual: float, unit: str) -> tuple[float, str]:
    """Return the full scale that the header names, and a note where it names none, or several."""
    named = {float(found) for line in lines for found in re.findall(pattern, line)}
    if len(named) == 1:
        return named.pop(), ""
    what = "names several full scales" if named else "names no full scale"
    return usual, f"the header {what} of the IMU: {usual:g} {unit}, which jAER sets, was taken"


class Clock:
    """Times of a clock of few bits, which starts anew when it is full, as a time that goes on."""

    def __init__(self, bits: int) -> None:
        self._loop = 1 << bits
        self._last: int | None = None
        self._added = 0

    def __call__(self, t: Integers) -> Integers:
        """Return times [us]; a step by more than half the range is a loop of the clock."""
        if not t.size:
            return t
        steps = np.diff(t, prepend=t[0] if self._last is None else self._last)
        half = self._loop // 2
        loops = np.cumsum((steps < -half).astype(np.int64) - (steps > half)) * self._loop
        self._last, added = int(t[-1]), self._added
        self._added += int(loops[-1])
        return t + loops + added


def _dvs128(records: NDArray[np.int64]) -> tuple[Integers, Integers, Integers, NDArray[np.bool_]]:
    """Return x, y, t, p: 7 bits of each above the polarity, 0 for ON; bit 15 marks a trigger."""
    address, t = records[(records[:, 0] & 0x8000) == 0].T
    return (address >> 1) & 0x7F, (address >> 8) & 0x7F, t, (address & 1) == 0


def _davis(records: NDArray[np.int64]) -> tuple[Integers, Integers, Integers, NDArray[np.bool_]]:
    """Return x, y, t, p: bit 31 marks samples of frames and the IMU, bit 10 triggers."""
    address, t = records[(records[:, 0] & 0x80000400) == 0].T
    return (address >> 12) & 0x3FF, (address >> 22) & 0x1FF, t, (address & 0x800) != 0

"""AEDAT 3.1 (cAER): a text header, then packets of events of one kind from one source.

A packet has a header of 28 bytes, with kind, source, and size and number of its events; those of
polarity take 8 bytes: bits valid, polarity, 15 of y, 15 of x, then the time [us], which goes on
from the overflow that the header counts.  Samples of an IMU (6 or 9 axes) take 36 or 48 bytes:
bits, time, three accelerations [g], three rates [deg/s], and what is passed over, as all other
kinds are.

The IMU's axes are taken to be those of the chip in a DAVIS, x to the left and z to the back, which
rpg_dvs_ros turns into the camera's by the other sign of x and z.
"""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from data_tools.recordings.formats import Columns, Options, Samples, Source
from data_tools.recordings.formats._aedat_header import MAGIC, chip_size, read_header, version
from evcalib.errors import InputError

NAMES = ("aedat3",)

LARGEST_PACKET = 1 << 28
"""Bytes of a packet."""

_POLARITY, _MOST_KINDS = 1, 32
_IMU_BYTES = {3: 36, 4: 48}
_TO_CAMERA = np.array([-1.0, 1.0, -1.0])
GRAVITY = 9.80665
AXES = "IMU: turned from the axes of a DAVIS's chip to those of the camera"
_SOURCE = re.compile(r"#\s*Source (\d+): *(.*)")
_FORMAT = re.compile(r"#\s*Format: *(.*)")


def matches(path: Path, head: bytes) -> bool:
    """Tell whether the file starts with the format's line, of version 3."""
    return head.startswith(MAGIC) and version(head)[:1] == "3"


def open(path: Path, options: Options) -> Source:
    """Open a file; `options.stream` is the number of the source, where it has several."""
    lines, start = read_header(path)
    told = version(lines[0].encode())
    if told != "3.1":
        raise InputError(f"{path} is of version {told} of AEDAT; 2.0, 3.1 and 4.0 are read")
    kind = next((found[1] for line in lines if (found := _FORMAT.match(line))), "RAW").strip()
    if kind.upper() != "RAW":
        raise InputError(f"{path} has packets of the format {kind}; only RAW is read")
    sources = {found[1]: found[2] for line in lines if (found := _SOURCE.match(line))}
    source = _chosen(path, sources, options)
    size = chip_size(sources[source]) if source is not None else None
    width, height = options.sensor(path, size)
    wanted = source if len(sources) > 1 else None

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        for overflow, words in _packets(path, start, wanted, losses, (_POLARITY,)):
            data = words[words[:, 0] & 1 == 1].astype(np.int64)
            if len(data) < len(words):
                losses["events marked invalid"] += len(words) - len(data)
            x, y = data[:, 0] >> 17, (data[:, 0] >> 2) & 0x7FFF
            t = data[:, 1] + (overflow << 31)
            yield Columns(x.astype(np.uint16), y.astype(np.uint16), t, data[:, 0] & 2 == 2)

    return Source("aedat3", width, height, pieces, fixed="us")


def imu(path: Path, options: Options) -> Samples | None:
    """Return the samples of the IMU of the source, in the axes of the camera; None without any."""
    lines, start = read_header(path)
    sources = {found[1]: found[2] for line in lines if (found := _SOURCE.match(line))}
    source = _chosen(path, sources, options) if len(sources) > 1 else None
    t, values = [], []
    for overflow, words in _packets(path, start, source, Counter(), tuple(_IMU_BYTES)):
        data = words[words[:, 0] & 1 == 1]
        t.append(data[:, 1].astype(np.int64) + (overflow << 31))
        values.append(np.ascontiguousarray(data[:, 2:8]).view("<f4").astype(np.float64))
    if not t:
        return None
    rows = np.concatenate(values)
    force, rate = GRAVITY * rows[:, :3] * _TO_CAMERA, np.radians(rows[:, 3:]) * _TO_CAMERA
    return Samples(1000 * np.concatenate(t), rate, force if force.any() else None, (AXES,))


def _chosen(path: Path, sources: dict[str, str], options: Options) -> str | None:
    told = ", ".join(f"{number} ({name})" for number, name in sources.items())
    if options.stream is not None and options.stream not in sources:
        raise InputError(f"{path} has no source {options.stream}, only {told or 'unnamed ones'}")
    if options.stream is None and len(sources) > 1:
        raise InputError(
            f"{path} has several sources: say which, stream (--stream) = one of {told}"
        )
    return options.stream or next(iter(sources), None)


def _packets(
    path: Path, start: int, source: str | None, losses: Counter[str], kinds: tuple[int, ...]
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the overflow of the clock and the words of each packet of some kinds."""
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            at = start
            while at < size:
                file.seek(at)
                head = file.read(28)
                values = struct.unpack("<hhiiiiii", head) if len(head) == 28 else None
                if values is None or at + 28 + values[2] * values[6] > size >= at:
                    if values is not None:
                        _check(path, at, values)
                    losses["bytes of a cut-off last packet"] += size - at
                    return
                _check(path, at, values)
                kind, number, each, _, overflow, _, count, _ = values
                at += 28 + each * count
                if kind in kinds and source in (None, str(number)):
                    data = file.read(each * count)
                    yield overflow, np.frombuffer(data, "<u4").reshape(count, each // 4)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None


def _check(path: Path, at: int, values: tuple[int, ...]) -> None:
    """Refuse a header of a packet that cannot be one."""
    kind, _, each, _, overflow, capacity, count, valid = values
    fits = 0 <= kind < _MOST_KINDS and 0 < each and 0 <= valid <= count == capacity
    known = {_POLARITY: 8, **_IMU_BYTES}.get(kind, each)
    if not fits or overflow < 0 or each * count > LARGEST_PACKET or each != known:
        raise InputError(f"{path} is damaged: at byte {at} there is no header of a packet")

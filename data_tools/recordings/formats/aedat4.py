"""AEDAT 4 (iniVation's DV).

Packets are read one by one, in memory of one packet.  The format has no checksums, and its writers
do not switch on those of LZ4, so a flipped bit may change an event unnoticed; but each packet must
hold as many events, from the first to the last time, as the table at the end of the file says.
DV wrote tables without counts and times until 2020: they tell where the packets are, no more.

IMU samples are in g and deg/s; their axes are taken to be those of the camera.  The accelerations
of upright cameras in real files say so (1 g against y); no public file tells the signs of the rates
beside events, so that they are checked against the events (`evcalib.heading`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from data_tools.files.unpack import unpack
from data_tools.recordings.formats import Columns, Options, Samples, Source
from data_tools.recordings.formats._aedat4_layout import (
    LARGEST_PACKET,
    MAGIC,
    Layout,
    Told,
    read_events,
    read_imu,
    read_layout,
)
from evcalib.arrays import Floats, Integers
from evcalib.errors import InputError

T = TypeVar("T")

NAMES = ("aedat4",)


def matches(path: Path, head: bytes) -> bool:
    """Tell whether the file starts with the format's line."""
    return head.startswith(MAGIC)


def open(path: Path, options: Options) -> Source:
    """Open a file; `options.stream` is the number of the event stream, where it has several."""
    layout = read_layout(path)
    number = _chosen(path, sorted(layout.sensors), options)
    width, height = options.sensor(path, layout.sensors[number])
    notes: tuple[str, ...] = ()
    if not layout.told:
        notes = ("the file has no table of its packets to check them against",)
    elif not _counts(layout):
        notes = ("the table of packets has no counts and times to check them against (DV of 2020)",)

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        if layout.cut_off:
            losses["bytes of a cut-off last packet"] += layout.cut_off
        for events in _packets(path, layout, number):
            yield Columns(events["x"], events["y"], events["t"].astype(np.int64), events["on"] == 1)

    return Source("aedat4", width, height, pieces, notes, fixed="us")


def _counts(layout: Layout) -> bool:
    """Tell whether the table has a number of events or a time of any packet."""
    return any(told.count or told.first_us or told.last_us for told in layout.told or ())


def _chosen(path: Path, numbers: list[int], options: Options) -> int:
    if not numbers:
        raise InputError(f"{path} has no stream of events")
    told = ", ".join(map(str, numbers))
    if options.stream is not None:
        if options.stream not in map(str, numbers):
            raise InputError(f"{path} has no stream of events {options.stream}, only {told}")
        return int(options.stream)
    if len(numbers) > 1:
        raise InputError(
            f"{path} has several streams of events: say which, stream (--stream) = one of {told}"
        )
    return numbers[0]


GRAVITY = 9.80665


def imu(path: Path, options: Options) -> Samples | None:
    """Return the samples of the only IMU; None where there is none."""
    layout = read_layout(path)
    if not layout.imus:
        return None
    if len(layout.imus) > 1:
        told = ", ".join(map(str, layout.imus))
        raise InputError(
            f"{path} has several IMUs (streams {told}), and nothing says which is the camera's;"
            " give its samples as a table (--imu FILE.csv)"
        )
    parts = [_imu_part(*part) for part in _contents(path, layout, layout.imus[0], read_imu)]
    if not parts:
        return None
    t, values = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    force = GRAVITY * values[:, :3]
    taken = "IMU: in the axes of the file, taken to be those of the camera"
    return Samples(1000 * t, np.radians(values[:, 3:]), force if force.any() else None, (taken,))


def _imu_part(
    place: int, told: Told | None, found: tuple[Integers, Floats]
) -> tuple[Integers, Floats]:
    if told is not None and found[0].size != told.count:
        raise InputError(
            f"packet {place} holds {found[0].size} IMU samples, not {told.count} as the table says"
        )
    return found


def _packets(path: Path, layout: Layout, stream: int) -> Iterator[NDArray[np.void]]:
    """Yield the events of each packet of a stream."""
    for place, told, events in _contents(path, layout, stream, read_events):
        try:
            _check(events, told)
        except InputError as error:
            raise InputError(f"{path} is damaged in packet {place}: {error}") from None
        yield events


def _contents(
    path: Path, layout: Layout, stream: int, read: Callable[[bytes], T]
) -> Iterator[tuple[int, Told | None, T]]:
    """Yield the number, the entry in the table and the content of each packet of a stream."""
    told = layout.told if _counts(layout) else None
    try:
        with path.open("rb") as file:
            for place, packet in enumerate(layout.packets):
                if packet.stream != stream:
                    continue
                file.seek(packet.start)
                packed = file.read(packet.size)
                try:
                    content = read(unpack(packed, layout.compression, LARGEST_PACKET))
                except InputError as error:
                    raise InputError(f"{path} is damaged in packet {place}: {error}") from None
                yield place, told[place] if told else None, content
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None


def _check(events: NDArray[np.void], told: Told | None) -> None:
    if told is None:
        return
    if events.size != told.count:
        raise InputError(f"it holds {events.size} events, not {told.count} as the table says")
    if events.size and (events["t"][0], events["t"][-1]) != (told.first_us, told.last_us):
        raise InputError("its first or last time is not that of the table")

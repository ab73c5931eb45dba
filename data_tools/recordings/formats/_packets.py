"""Messages that hold encoded events: ``event_camera_msgs/EventPacket``.

What their times mean depends on the encoding:

``evt3``
    Prophesee's EVT3 as the sensor sends it, on the sensor's clock.
``mono``
    Eight bytes per event: ``time_base`` + 32 bits of nanoseconds, on the sensor's clock.
``libcaer``, ``libcaer_cmp``
    ``time_base``, which the driver has already set to ROS time, + microseconds.

The driver does not decode EVT3, so it puts the arrival of the data at the host into
``header.stamp``; for ``mono``, the stamp is the driver's estimate of the ROS time of ``time_base``.
(README of metavision_driver and of event_camera_msgs, .msg file, headers of event_camera_codecs.)
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools.recordings.formats import Columns
from data_tools.recordings.formats._evt import Evt3Decoder
from evcalib.arrays import Integers
from evcalib.errors import InputError

TYPES = ("event_camera_msgs/msg/EventPacket", "event_array_msgs/msg/EventArray")
SENSOR_CLOCK = ("evt3", "mono")
"""Encodings whose times are not ROS times."""

TURN = 1 << 24
"""EVT3 counts microseconds so far, then starts again: every 16.8 s."""
_LOW, _HIGH = 6, 8


def stamp_us(message: Any) -> int:
    """Return the ROS time of a message's header [us], rounded."""
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000 + (int(stamp.nanosec) + 500) // 1000


def words(message: Any, size: int) -> NDArray[Any]:
    """Return the encoded events as whole words of so many bytes, in this machine's order."""
    data = np.ascontiguousarray(message.events, dtype=np.uint8)
    whole = data[: data.size // size * size]
    return whole.view(f"{'>' if message.is_bigendian else '<'}u{size}").astype(f"=u{size}")


def camera_time_us(message: Any, high: int) -> tuple[int | None, int]:
    """Return the sensor time [us] that belongs to the stamp, and the last high part of EVT3's.

    For EVT3 that is the time of the packet's last event, modulo `TURN`, because a packet cannot
    arrive before it; for mono the ``time_base``.  None if the packet does not tell.
    """
    if message.encoding == "mono":
        return (int(message.time_base) + 500) // 1000, high
    word = words(message, 2)
    code = word >> 12
    lows, highs = np.flatnonzero(code == _LOW), np.flatnonzero(code == _HIGH)
    before = highs[highs < lows[-1]] if lows.size else highs
    at_low = int(word[before[-1]] & 0xFFF) if before.size else high
    after = int(word[highs[-1]] & 0xFFF) if highs.size else high
    if not lows.size or at_low < 0:
        return None, after
    return at_low << 12 | int(word[lows[-1]] & 0xFFF), after


def decoder(encoding: str, losses: Counter[str]) -> Callable[[Any], Columns]:
    """Return a function from messages of one encoding, in their order, to events [us].

    What it cannot use is added to `losses`.

    Raises
    ------
    InputError
        If the encoding is not one of the known four.
    """
    match encoding:
        case "evt3":
            return _evt3(losses)
        case "mono":
            return _mono
        case "libcaer":
            return _libcaer
        case "libcaer_cmp":
            return _libcaer_cmp
    raise InputError(
        f"events are encoded as {encoding!r}; evt3, mono, libcaer and libcaer_cmp can be read:"
        " convert the bag with the tools of event_camera_tools"
    )


def _evt3(losses: Counter[str]) -> Callable[[Any], Columns]:
    stream = Evt3Decoder()

    def decode(message: Any) -> Columns:
        columns = stream.decode(words(message, 2).astype("<u2").tobytes())
        losses.update(stream.take_losses())
        return columns

    return decode


def _mono(message: Any) -> Columns:
    word = words(message, 8)
    nanoseconds = int(message.time_base) + (word & 0xFFFFFFFF).astype(np.int64)
    return Columns(
        (word >> 32 & 0xFFFF).astype(np.uint16),
        (word >> 48 & 0x7FFF).astype(np.uint16),
        (nanoseconds + 500) // 1000,
        (word >> 63).astype(np.bool_),
    )


def _libcaer(message: Any) -> Columns:
    pair = words(message, 4)
    data, time = pair[: pair.size // 2 * 2].reshape(-1, 2).T
    time = time.astype(np.int64)
    # The low 31 bits of the sensor's time start again after 36 minutes, also within a packet.
    turns = np.cumsum(np.diff(time, prepend=time[:1]) < 0)
    return Columns(
        (data >> 17 & 0x7FFF).astype(np.uint16),
        (data >> 2 & 0x7FFF).astype(np.uint16),
        (int(message.time_base) + 500) // 1000 + time + (turns << 31),
        (data >> 1 & 1).astype(np.bool_),
    )


def _libcaer_cmp(message: Any) -> Columns:
    """Decode words of a 4-bit code and 12 bits: columns x, then y's one by one or by eights."""
    word = words(message, 2)
    code, value = word >> 12, (word & 0xFFF).astype(np.int64)
    time = (_latest(code, value, 0) << 12 | _latest(code, value, 1)) + (
        int(message.time_base) + 500
    ) // 1000
    x = _latest(code, value, 2) & 0x7FF
    base, number = _latest(code, value, 4), _since(code, 5, 4)
    single, eights = np.flatnonzero(code == 3), np.flatnonzero(code == 5)
    bits = value[eights, None] >> np.arange(8) & 1
    at, bit = np.nonzero(bits)
    row = eights[at]
    y = np.concatenate([value[single] & 0x7FF, (base[row] & 0x7FF) + 8 * number[row] + bit])
    p = np.concatenate([value[single] >> 11, base[row] >> 11 & 1])
    rows = np.concatenate([single, row])
    order = np.argsort(rows, kind="stable")
    rows = rows[order]
    return Columns(
        x[rows].astype(np.uint16),
        y[order].astype(np.uint16),
        time[rows],
        p[order].astype(np.bool_),
    )


def _latest(code: NDArray[Any], value: Integers, wanted: int) -> Integers:
    """Return, for every word, the value of the latest word of a code (0 before the first)."""
    place = np.where(code == wanted, np.arange(code.size), -1)
    place = np.maximum.accumulate(place) if code.size else place
    return np.where(place >= 0, value[place], 0)


def _since(code: NDArray[Any], counted: int, start: int) -> Integers:
    """Return, for every word, how many words of a code precede it since the latest of another."""
    counts = np.cumsum(code == counted)
    place = np.where(code == start, np.arange(code.size), -1)
    place = np.maximum.accumulate(place) if code.size else place
    return counts - (code == counted) - np.where(place >= 0, counts[place], 0)

"""Events in ROS 1 and ROS 2 bags: `dvs_msgs`, `prophesee_event_msgs`, `event_camera_msgs`.

All times come out as ROS times, so that topics of wheels in the same bag are on the same clock.
Events of the first two kinds carry ROS times.  Packets of the third hold the times of the sensor
(for most encodings, see `_packets`) and the ROS time at which they arrived; the map from the one
clock to the other, offset and drift, is found from all packets before the first event is read
(`data_tools.bags.clock_map`).  If the driver joins what the camera sends into larger packets
(``event_message_time_threshold`` above its default), the stamp is that of their first part, and
the times come out early by up to the length of a packet: a constant, like all delays.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.bags import Bag, Topic, is_bag, open_bag
from data_tools.bags.clock_map import ClockMap, fit_clock
from data_tools.recordings.formats import (
    Columns,
    Options,
    Samples,
    Size,
    Source,
    _event_arrays,
    _packets,
)
from evcalib.arrays import Integers
from evcalib.errors import InputError

NAMES = ("rosbag",)

matches = is_bag

_NO_CAMERA_TIME = -1


@dataclass(frozen=True, eq=False)
class _Clock:
    """The map to ROS time, and the sensor time of every packet, without EVT3's turns."""

    to_ros: ClockMap
    camera_us: Integers


def open(path: Path, options: Options) -> Source:
    """Open a bag; `options.stream` is the topic."""
    with open_bag(path) as bag:
        types = _event_arrays.TYPES + _packets.TYPES
        topic = bag.choose(types, options.stream, "events")
        if topic.type in _packets.TYPES:
            return _open_packets(bag, topic, options)
        return _open_arrays(bag, topic, options)


IMU = "sensor_msgs/msg/Imu"


def imu(path: Path, options: Options) -> Samples | None:
    """Return the messages of a ``sensor_msgs/Imu`` topic, `options.stream`, or of the only one.

    Times are those of the headers.  None where there is no such topic.
    """
    with open_bag(path) as bag:
        if options.stream is None and not any(topic.type == IMU for topic in bag.topics):
            return None
        topic = bag.choose((IMU,), options.stream, "an IMU")
        t, rows, frames = [], [], set()
        for raw in bag.messages(topic):
            message = bag.decode(topic, raw)
            with bag.reading(topic):
                if message.angular_velocity_covariance[0] == -1:
                    raise InputError(f"{path}: {topic.name} says that it measures no rates")
                w, a = message.angular_velocity, message.linear_acceleration
                stamp = message.header.stamp
                t.append(int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec))
                rows.append([w.x, w.y, w.z, a.x, a.y, a.z])
                frames.add(message.header.frame_id)
        notes = [f"IMU: topic {topic.name}, in the axes of {', '.join(sorted(frames)) or 'none'}"]
        notes += [f"{count} {reason}" for reason, count in bag.losses.items() if count]
    if not t:
        return None
    values = np.array(rows, dtype=np.float64)
    force = values[:, 3:]
    return Samples(
        np.array(t, dtype=np.int64), values[:, :3], force if force.any() else None, tuple(notes)
    )


def _open_arrays(bag: Bag, topic: Topic, options: Options) -> Source:
    path, ros = bag.path, bag.ros
    order = _event_arrays.check_layout(bag, topic)
    first = next(bag.messages(topic), None)
    if first is None:
        raise InputError(f"{path}: the topic {topic.name} holds no messages")
    size = options.sensor(path, _event_arrays.read_array(first, ros, order)[0])

    def read(bag: Bag, losses: Counter[str]) -> Iterator[tuple[Size, Columns]]:
        return (_event_arrays.read_array(raw, ros, order) for raw in bag.messages(topic))

    notes = (f"topic {topic.name}",)
    return Source("rosbag", *size, _pieces(path, size, read), notes, fixed="ns")


def _open_packets(bag: Bag, topic: Topic, options: Options) -> Source:
    path = bag.path
    bag.check_known(topic)
    size, encoding, clock = _surveyed(path, _state(path), topic)
    size = options.sensor(path, size)
    _packets.decoder(encoding, Counter())

    def read(bag: Bag, losses: Counter[str]) -> Iterator[tuple[Size, Columns]]:
        decode = _packets.decoder(encoding, losses)
        following: int | None = None
        for number, raw in enumerate(bag.messages(topic)):
            with bag.reading(topic):
                message = bag.decode(topic, raw)
                _check_encoding(message, encoding, number)
                if following is not None and message.seq > following:
                    losses["packets missing by their numbers"] += int(message.seq) - following
                following = int(message.seq) + 1
                columns = decode(message)
                if clock is not None:
                    columns = _in_ros_time(columns, clock, number, encoding)
                sensor = int(message.width), int(message.height)
            yield sensor, columns

    notes = (f"topic {topic.name}, encoding {encoding}", *_clock_notes(clock))
    return Source("rosbag", *size, _pieces(path, size, read), notes, fixed="ns")


def _pieces(
    path: Path,
    size: Size,
    read: Callable[[Bag, Counter[str]], Iterator[tuple[Size, Columns]]],
) -> Callable[[Counter[str]], Iterator[Columns]]:
    """Return the function that reads all messages, each of the same sensor."""

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        with open_bag(path) as bag:
            for number, (has, columns) in enumerate(read(bag, losses)):
                if has != size:
                    raise InputError(
                        f"message {number} is of a sensor of {has[0]}x{has[1]} px, the first of"
                        f" {size[0]}x{size[1]}: two cameras on one topic?"
                    )
                yield columns
            losses.update(bag.losses)

    return pieces


def _state(path: Path) -> tuple[tuple[str, int, int], ...]:
    """Return names, sizes and times of change of the files of a bag."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    return tuple((f.name, f.stat().st_size, f.stat().st_mtime_ns) for f in files)


@lru_cache(maxsize=8)
def _surveyed(
    path: Path, state: tuple[tuple[str, int, int], ...], topic: Topic
) -> tuple[Size, str, _Clock | None]:
    """Read all packets without decoding them: sensor, encoding, and the two clocks.

    Remembered for as long as the files do not change, since it reads the whole bag.
    """
    with open_bag(path) as bag:
        try:
            with bag.reading(topic):
                return _survey(bag, topic)
        except InputError as error:
            if str(path) in str(error):
                raise
            raise InputError(f"{path}, topic {topic.name}: {error}") from None


def _survey(bag: Bag, topic: Topic) -> tuple[Size, str, _Clock | None]:
    size: Size | None = None
    encoding = ""
    stamps: list[int] = []
    times: list[int] = []
    high = -1
    for number, raw in enumerate(bag.messages(topic)):
        message = bag.decode(topic, raw)
        if size is None:
            size, encoding = (int(message.width), int(message.height)), str(message.encoding)
        _check_encoding(message, encoding, number)
        if encoding not in _packets.SENSOR_CLOCK:
            break
        time, high = _packets.camera_time_us(message, high)
        stamps.append(_packets.stamp_us(message))
        times.append(_NO_CAMERA_TIME if time is None else time)
    if size is None:
        raise InputError("there are no messages")
    return size, encoding, _clock(times, stamps, encoding) if stamps else None


def _check_encoding(message: Any, encoding: str, number: int) -> None:
    if message.encoding != encoding:
        raise InputError(
            f"packet {number} is encoded as {message.encoding!r}, the first as {encoding!r}"
        )


def _clock(times: list[int], stamps: list[int], encoding: str) -> _Clock:
    camera, host = np.array(times, dtype=np.int64), np.array(stamps, dtype=np.int64)
    known = np.flatnonzero(camera != _NO_CAMERA_TIME)
    if encoding == "evt3":
        camera[known] = _unwrapped(camera[known], host[known])
    to_ros = fit_clock(camera[known], host[known])
    # A packet that does not tell its time is near the one before it.
    near = np.searchsorted(known, np.arange(camera.size), "right") - 1
    return _Clock(to_ros, camera[known[near.clip(0)]])


def _unwrapped(camera: Integers, host: Integers) -> Integers:
    """Return EVT3's times with their turns, told apart by the times of arrival."""
    ahead = np.diff(camera) - np.diff(host)
    turns = np.cumsum(np.rint(ahead / _packets.TURN).astype(np.int64))
    return camera - _packets.TURN * np.concatenate([[0], turns])[: camera.size]


def _in_ros_time(columns: Columns, clock: _Clock, number: int, encoding: str) -> Columns:
    t = columns.t
    if encoding == "evt3" and t.size:
        t = t + _packets.TURN * round((int(clock.camera_us[number]) - int(t[-1])) / _packets.TURN)
    return columns._replace(t=clock.to_ros(t))


def _clock_notes(clock: _Clock | None) -> tuple[str, ...]:
    if clock is None:
        return ("times are ROS times as the driver set them",)
    to_ros = clock.to_ros
    return (
        f"sensor times were mapped to ROS time by {clock.camera_us.size} packets: drift"
        f" {1e6 * to_ros.drift:+.1f} ppm, arrival {to_ros.scatter / 1e3:.2f} ms (median) after the"
        " earliest",
    )

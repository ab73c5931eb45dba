"""Velocities of a vehicle from a bag: twists, odometry, or the joints of its wheels.

``geometry_msgs/TwistStamped`` and ``TwistWithCovarianceStamped``, and the twist of
``nav_msgs/Odometry`` (which is in its ``child_frame_id``), are taken for velocities of the body's
origin in the body frame.  ``sensor_msgs/JointState`` holds wheel states: positions of steering
joints [rad] and velocities of drive joints [rad/s], which a column map assigns to the wheels.
Times are those of the headers, not those of arrival.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.bags import Bag, Topic, open_bag
from data_tools.logs.column_maps import Columns, Entry, column_map
from evcalib.arrays import Flags, Floats, Integers
from evcalib.errors import InputError
from evcalib.kinematics import Vehicle, WheelLog, WheelStates
from evcalib.series import VelocitySeries

JOINTS = "sensor_msgs/msg/JointState"
_TWIST: dict[str, Callable[[Any], Any]] = {
    "geometry_msgs/msg/TwistStamped": lambda message: message.twist,
    "geometry_msgs/msg/TwistWithCovarianceStamped": lambda message: message.twist.twist,
    "nav_msgs/msg/Odometry": lambda message: message.twist.twist,
}
TYPES = (*_TWIST, JOINTS)

MAX_JUMP = 60.0
"""A step between stamps above this [s] is taken for a clock that was set."""


@dataclass(frozen=True)
class BagStream:
    """What a topic says of the motion of the vehicle.

    Attributes
    ----------
    motion : VelocitySeries or WheelLog
        Velocities of the body, or states of its wheels.
    notes : tuple of str
        Topic, and what was left out.
    """

    motion: VelocitySeries | WheelLog
    notes: tuple[str, ...]


def read_bag_motion(
    path: str | Path,
    *,
    topic: str | None = None,
    vehicle: Vehicle | None = None,
    columns: Columns | None = None,
    wheel_radius: float | None = None,
    origin_us: int = 0,
) -> BagStream:
    """Read velocities or wheel states from a topic of a bag.

    Parameters
    ----------
    path : path
        ROS 1 or ROS 2 bag.
    topic : str, optional
        Its name; by default the only one of a type that fits.
    vehicle : Swerve, Mecanum or Omni, optional
        Needed for joints.
    columns : mapping or path, optional
        For joints: map from ``speed_WHEEL`` and ``steer_WHEEL`` to names of joints.  Drive joints
        are in rad/s and need `wheel_radius`, unless an entry says otherwise.
    wheel_radius : float, optional
        Radius of the driven wheels [m].
    origin_us : int
        Subtracted from all times [us].

    Raises
    ------
    InputError
        If the bag is damaged, there is no such topic or too many, a stamp is missing, goes back or
        jumps, or joints are not those of the map.
    """
    with open_bag(path) as bag:
        chosen = bag.choose(TYPES, topic, "velocities, odometry or joints")
        if chosen.type == JOINTS:
            if vehicle is None or columns is None:
                raise InputError(
                    f"{path}: {chosen.name} holds joints; say which vehicle, and which joint is"
                    " which wheel by a column map (data_tools.logs.column_maps)"
                )
            entries = column_map(columns, wheel_radius=wheel_radius, speed_unit="rad/s")
            stamps, rows = _collected(bag, chosen, _joints(bag, chosen, entries))
        elif columns is not None:
            raise InputError(f"{path}: {chosen.name} ({chosen.type}) takes no column map")
        else:
            entries = {}
            stamps, rows = _collected(bag, chosen, _twists(bag, chosen))
        losses = dict(bag.losses)
    where = f"{path}, topic {chosen.name}"
    keep = _advancing(stamps, where)
    repeated = int(keep.size - keep.sum())
    t, rows = (stamps[keep] - origin_us * 1000) / 1e9, rows[keep]
    notes = [f"topic {chosen.name} ({chosen.type}), {t.size} messages"]
    if repeated:
        notes.append(f"{repeated} messages with the stamp of their predecessor were left out")
    notes += [f"{count} {reason}" for reason, count in losses.items() if count]
    try:
        if vehicle is not None and entries:
            return BagStream(_wheel_log(t, rows, list(entries), vehicle), tuple(notes))
        return BagStream(VelocitySeries(t, rows[:, :3], rows[:, 3]), tuple(notes))
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _twists(bag: Bag, topic: Topic) -> Iterator[tuple[Any, list[float]]]:
    get = _TWIST[topic.type]
    for raw in bag.messages(topic):
        message = bag.decode(topic, raw)
        twist = get(message)
        v = twist.linear
        yield message.header.stamp, [v.x, v.y, v.z, twist.angular.z]


def _joints(
    bag: Bag, topic: Topic, entries: Mapping[str, Entry]
) -> Iterator[tuple[Any, list[float]]]:
    """Yield the mapped joints of messages that hold them; others publish other joints there."""
    others: set[str] = set()
    found = False
    for number, raw in enumerate(bag.messages(topic)):
        message = bag.decode(topic, raw)
        place = {name: k for k, name in enumerate(message.name)}
        lacking = [e.column for e in entries.values() if e.column not in place]
        if len(lacking) == len(entries):
            others |= set(place)
            continue
        found = True
        if lacking:
            raise InputError(
                f"{bag.path}, message {number} of {topic.name} lacks the joint(s)"
                f" {', '.join(lacking)}; it has {', '.join(place) or 'none'}"
            )
        row = []
        for name, entry in entries.items():
            values = message.position if name.startswith("steer_") else message.velocity
            if place[entry.column] >= len(values):
                what = "position" if name.startswith("steer_") else "velocity"
                raise InputError(
                    f"{bag.path}, message {number} of {topic.name} has no {what} of the joint"
                    f" {entry.column}, needed for {name}"
                )
            row.append(float(values[place[entry.column]]) * entry.factor)
        yield message.header.stamp, row
    if not found:
        wanted = ", ".join(entry.column for entry in entries.values())
        raise InputError(
            f"{bag.path}: {topic.name} has none of the joints {wanted}; it has"
            f" {', '.join(sorted(others)) or 'none'}"
        )


def _collected(
    bag: Bag, topic: Topic, messages: Iterator[tuple[Any, list[float]]]
) -> tuple[Integers, Floats]:
    stamps, rows = [], []
    with bag.reading(topic):
        for stamp, row in messages:
            stamps.append(int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec))
            rows.append(row)
    if len(rows) < 2:
        raise InputError(f"{bag.path}: {topic.name} has {len(rows)} usable messages, two at least")
    return np.array(stamps, dtype=np.int64), np.array(rows, dtype=np.float64)


def _advancing(stamps: Integers, where: str) -> Flags:
    """Return which messages are later than the one before; refuse clocks that were set."""
    if (stamps == 0).any():
        row = int(np.argmax(stamps == 0))
        raise InputError(f"{where}: message {row} has no stamp (0); its times cannot be told")
    steps = np.diff(stamps)
    for bad, what in ((steps < 0, "before"), (steps > MAX_JUMP * 1e9, "after")):
        if bad.any():
            row = int(np.argmax(bad)) + 1
            raise InputError(
                f"{where}: the stamp of message {row} is {abs(steps[row - 1]) / 1e9:.3f} s {what}"
                " that of its predecessor: the clock was set; use the part before or after that"
            )
    return np.concatenate([[True], steps > 0])


def _wheel_log(t: Floats, rows: Floats, names: list[str], vehicle: Vehicle) -> WheelLog:
    kinds = ("speed", "steer") if vehicle.steered else ("speed",)
    wanted = [f"{kind}_{name}" for kind in kinds for name in vehicle.names]
    if set(wanted) != set(names):
        raise InputError(
            f"the column map must name {', '.join(wanted)}, and names {', '.join(names)}"
        )
    values = {name: rows[:, names.index(name)] for name in wanted}
    speed = np.stack([values[f"speed_{name}"] for name in vehicle.names], axis=1)
    if not vehicle.steered:
        return WheelLog(t, WheelStates(speed))
    steer = np.stack([values[f"steer_{name}"] for name in vehicle.names], axis=1)
    return WheelLog(t, WheelStates(speed, steer))

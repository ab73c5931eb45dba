"""Velocities of a vehicle from a bag: twists, odometry, or the joints of its wheels.

``geometry_msgs/TwistStamped`` and ``TwistWithCovarianceStamped``, and the twist of
``nav_msgs/Odometry``, are velocities of the body's origin, if they are in the body's frame: see
`data_tools.logs.odometry_frames`.  ``sensor_msgs/JointState`` holds wheel states: positions of
steering joints [rad] and velocities of drive joints [rad/s] (or positions, where the map says that
they are counts), which a column map assigns to the wheels.  Where there is none of these, or if it
is named, ``/tf`` tells where the body was (`data_tools.logs.pose_velocities`).  Times are those of
the headers, not those of arrival.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.bags import Bag, Topic, open_bag
from data_tools.files.row_times import MAX_JUMP, advancing
from data_tools.logs.column_maps import Columns, Entry, column_map, converted
from data_tools.logs.odometry_frames import Twists, in_body
from data_tools.logs.pose_velocities import TRANSFORMS, base_transforms, velocities_of_poses
from data_tools.logs.wheel_logs import wanted_columns, wheel_log
from evcalib.arrays import Floats, Integers
from evcalib.errors import InputError
from evcalib.kinematics import Vehicle, WheelLog
from evcalib.series import VelocitySeries

JOINTS = "sensor_msgs/msg/JointState"
ODOMETRY = "nav_msgs/msg/Odometry"
_TWIST: dict[str, Callable[[Any], Any]] = {
    "geometry_msgs/msg/TwistStamped": lambda message: message.twist,
    "geometry_msgs/msg/TwistWithCovarianceStamped": lambda message: message.twist.twist,
    ODOMETRY: lambda message: message.twist.twist,
}
TYPES = (*_TWIST, JOINTS)
_COMMANDS = re.compile(r"cmd|command|set_?point|desired|target|goal|reference", re.IGNORECASE)


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
    twist_frame: str | None = None,
) -> BagStream:
    """Read velocities or wheel states from a topic of a bag.

    Parameters
    ----------
    path : path
        ROS 1 or ROS 2 bag.
    topic : str, optional
        Its name; by default the only one of a type that fits.  ``/tf:base_link`` names a frame of
        a topic of transforms.
    vehicle : Swerve, Mecanum, Omni or Rolling, optional
        Needed for joints.
    columns : mapping or path, optional
        For joints: map from ``speed_WHEEL`` and ``steer_WHEEL`` to names of joints.  Drive joints
        are in rad/s and need `wheel_radius`, unless an entry says otherwise.
    wheel_radius : float, optional
        Radius of the driven wheels [m].
    origin_us : int
        Subtracted from all times [us].
    twist_frame : {"body", "ground"}, optional
        The frame of twists, where messages and poses do not tell it; see
        `data_tools.logs.odometry_frames`.

    Raises
    ------
    InputError
        If the bag is damaged, there is no such topic or too many, stamps are missing or a clock was
        set, joints are not those of the map, or the frame of a twist is in doubt.
    """
    with open_bag(path) as bag:
        name, _, frame = (topic or "").partition(":")
        chosen = _chosen(bag, name or None)
        if chosen.type == JOINTS:
            if vehicle is None or columns is None:
                raise InputError(
                    f"{path}: {chosen.name} holds joints; say which vehicle (--vehicle), and which"
                    " joint is which wheel by a column map (--columns, data_tools.logs.column_maps)"
                )
            entries = column_map(columns, wheel_radius=wheel_radius, speed_unit="rad/s")
            entries.pop("t", None)  # the headers tell
            _check_names(entries, vehicle)
            stamps, messages = _collected(bag, chosen, _joints(bag, chosen, entries))
        elif columns is not None:
            raise InputError(f"{path}: {chosen.name} ({chosen.type}) takes no column map")
        elif chosen.type in TRANSFORMS:
            entries = {}
            found = base_transforms(bag, chosen, frame or None)
            stamps, messages = _collected(bag, chosen, found)
        else:
            entries = {}
            stamps, messages = _collected(bag, chosen, _twists(bag, chosen))
        losses = dict(bag.losses)
    where = f"{path}, topic {chosen.name}"
    keep, late = advancing(
        stamps,
        lambda k: f"{where}, message {k}",
        per_second=1e9,
        max_jump=MAX_JUMP,
        repeats=bool(entries),
    )
    t = (stamps[keep] - origin_us * 1000) / 1e9
    messages = [message for message, kept in zip(messages, keep, strict=True) if kept]
    notes = [f"topic {chosen.name} ({chosen.type}), {t.size} messages", *late]
    notes += commanded(chosen.name)
    notes += [f"{count} {reason}" for reason, count in losses.items() if count]
    try:
        if vehicle is not None and entries:
            t, rows, joined = _joined(t, messages)
            values = dict(zip(entries, rows.T, strict=True))
            t, values, counted = converted(t, values, entries)
            log = wheel_log(t, values, entries, vehicle, lambda k: f"t = {t[k]:.3f} s")
            return BagStream(log, (*notes, *joined, *counted))
        if chosen.type in TRANSFORMS:
            series = velocities_of_poses(t, np.array([pose for _, pose in messages]))
            told = f"velocities are those of {messages[0][0]}, from its poses"
            return BagStream(series, (*notes, told))
        twists, nans = _one_frame(t, messages)
        v, yaw_rate, more = in_body(twists, twist_frame)
        return BagStream(VelocitySeries(twists.t, v, yaw_rate), (*notes, *nans, *more))
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def commanded(name: str) -> list[str]:
    """Tell of a topic that, by its name, says what was wanted, not what was."""
    if not _COMMANDS.search(name):
        return []
    return [
        f"{name} tells what was commanded, by its name: a vehicle follows late and not wholly, an"
        " error of the offset; take what was measured"
    ]


def _chosen(bag: Bag, name: str | None) -> Topic:
    """Return the topic that is named or the only one that fits, transforms last."""
    moving = [t for t in bag.topics if t.type in TRANSFORMS and not t.name.endswith("_static")]
    if name is None and len(moving) == 1 and not any(t.type in TYPES for t in bag.topics):
        return moving[0]
    types = TYPES if name is None else (*TYPES, *TRANSFORMS)
    return bag.choose(types, name, "velocities, odometry or joints")


def _twists(bag: Bag, topic: Topic) -> Iterator[tuple[Any, list[Any]]]:
    get = _TWIST[topic.type]
    for raw in bag.messages(topic):
        message = bag.decode(topic, raw)
        twist = get(message)
        v = twist.linear
        row = [v.x, v.y, v.z, twist.angular.z]
        frames = (message.header.frame_id, "")
        if topic.type == ODOMETRY:
            p, q = message.pose.pose.position, message.pose.pose.orientation
            row += [p.x, p.y, p.z, q.x, q.y, q.z, q.w]
            frames = (message.child_frame_id, message.header.frame_id)
        yield message.header.stamp, [row, frames]


def _one_frame(t: Floats, messages: list[Any]) -> tuple[Twists, list[str]]:
    """Return messages of one publisher as arrays, without those that hold no numbers."""
    frames = {names for _, names in messages}
    if len(frames) > 1:
        raise InputError(
            "its messages are of several frames ("
            + "; ".join(sorted(" in ".join(filter(None, pair)) or "none" for pair in frames)[:4])
            + "): several vehicles or drivers publish there; take another topic"
        )
    rows = np.array([row for row, _ in messages], dtype=np.float64)
    frame, ground = frames.pop()
    keep = np.isfinite(rows[:, :4]).all(axis=1)
    if keep.sum() < 2:
        raise InputError(f"only {int(keep.sum())} of {keep.size} twists are finite numbers")
    lost = int(keep.size - keep.sum())
    notes = [f"{lost} messages whose twist is no finite number were left out"] if lost else []
    t, rows = t[keep], rows[keep]
    pose = (rows[:, 4:7], rows[:, 7:]) if rows.shape[1] > 4 else (None, None)
    return Twists(t, rows[:, :3], rows[:, 3], frame, ground, *pose), notes


def _check_names(entries: Mapping[str, Entry], vehicle: Vehicle) -> None:
    wanted = wanted_columns(vehicle)[1:]
    if set(wanted) != set(entries):
        raise InputError(
            f"the column map must name {', '.join(wanted)}, and names {', '.join(entries)}"
        )


def _joints(
    bag: Bag, topic: Topic, entries: Mapping[str, Entry]
) -> Iterator[tuple[Any, list[float]]]:
    """Yield the mapped joints of messages that hold them; others publish other joints there."""
    seen: set[str] = set()
    for number, raw in enumerate(bag.messages(topic)):
        message = bag.decode(topic, raw)
        place = {name: k for k, name in enumerate(message.name)}
        seen |= set(place)
        row = []
        for name, entry in entries.items():
            if entry.column not in place:
                row.append(math.nan)
                continue
            what = "velocity" if entry.count is None and name.startswith("speed_") else "position"
            values = getattr(message, what)
            if place[entry.column] >= len(values):
                raise InputError(
                    f"{bag.path}, message {number} of {topic.name} has no {what} of the joint"
                    f" {entry.column}, needed for {name}"
                )
            row.append(float(values[place[entry.column]]))
        if np.isfinite(row).any():
            yield message.header.stamp, row
    lacking = [str(e.column) for e in entries.values() if e.column not in seen]
    if lacking:
        raise InputError(
            f"{bag.path}: {topic.name} lacks the joint(s) {', '.join(lacking)} of the column map;"
            f" it has {', '.join(sorted(seen)) or 'none'}"
        )


def _joined(t: Floats, messages: list[list[float]]) -> tuple[Floats, Floats, list[str]]:
    """Return rows of all joints, where each message may hold some of them (else NaN).

    A row stands at each stamp of the joint that comes most often and leaves the others least old;
    those have the latest of their values.
    """
    values = np.array(messages, dtype=np.float64)
    known = np.isfinite(values)
    last = np.where(known, np.arange(len(t))[:, None], -1)
    last = np.maximum.accumulate(last, axis=0)
    # of messages with one stamp, the last knows what all of them said
    starts = np.flatnonzero(np.append(True, np.diff(t) > 0))
    final = np.append(starts[1:], len(t)) - 1
    fresh, latest, t_row = np.logical_or.reduceat(known, starts), last[final], t[final]
    complete = (latest >= 0).all(axis=1)
    age = t_row - t[np.maximum(latest, 0)].min(axis=1)
    counts = (fresh & complete[:, None]).sum(axis=0)
    if counts.max() < 2:
        raise InputError("the joints of the column map come together in fewer than two messages")
    often = np.flatnonzero(counts >= 0.9 * counts.max())
    lag = [np.median(age[fresh[:, joint] & complete]) for joint in often]
    rows = fresh[:, often[int(np.argmin(lag))]] & complete
    notes = []
    if not fresh[rows].all():
        notes.append(
            "joints come in several messages: each row takes the latest of every joint, up to"
            f" {age[rows].max():.3g} s old"
        )
    return t_row[rows], values[latest[rows], np.arange(values.shape[1])], notes


def _collected(
    bag: Bag, topic: Topic, messages: Iterator[tuple[Any, Any]]
) -> tuple[Integers, list[Any]]:
    stamps, rows = [], []
    with bag.reading(topic):
        for stamp, row in messages:
            stamps.append(int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec))
            rows.append(row)
    if len(rows) < 2:
        raise InputError(f"{bag.path}: {topic.name} has {len(rows)} usable messages, two at least")
    if stamps.count(0) > 1:
        raise InputError(
            f"{bag.path}, topic {topic.name}: message {stamps.index(0)} has no stamp (0); its times"
            " cannot be told"
        )
    return np.array(stamps, dtype=np.int64), rows

"""Velocities of a body from where it was: transforms of a bag (``/tf``) of a base that moves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from data_tools.bags import Bag, Topic
from data_tools.logs.odometry_frames import stands
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.series import VelocitySeries

TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
SPAN = 0.1
"""Poses are compared over this time [s].  A choice: drives of ours change little within it."""
STANDS = 0.25
"""A pose that stays the same for a shorter time [s] is one that is published again and again until
the next one is known; for a longer time the body stands.  A choice: poses come at 4 Hz and more."""
LONGEST = 0.5
"""Across a longer gap [s] no velocity is taken: that of its middle would be a mean."""


def base_transforms(
    bag: Bag, topic: Topic, child: str | None
) -> Iterator[tuple[Any, tuple[str, list[float]]]]:
    """Yield stamp, name and pose (x, y, z, qx, qy, qz, qw) of the frame that moves.

    Parameters
    ----------
    bag, topic
        An opened bag, and its topic of transforms.
    child : str, optional
        The frame; by default the only one whose parent stands still (odom, map and the like).

    Raises
    ------
    InputError
        If there is no such frame, or more than one.
    """
    bases: dict[str, str] = {}
    others: set[str] = set()
    for raw in bag.messages(topic):
        for one in bag.decode(topic, raw).transforms:
            parent, name = one.header.frame_id.strip("/"), one.child_frame_id.strip("/")
            others.add(name)
            if (child is not None and name == child.strip("/")) or (
                child is None and stands(parent) and not stands(name)
            ):
                bases[name] = parent
            else:
                continue
            move, turn = one.transform.translation, one.transform.rotation
            pose = [move.x, move.y, move.z, turn.x, turn.y, turn.z, turn.w]
            yield one.header.stamp, (f"{name} in {parent}", pose)
    if not bases:
        raise InputError(
            f"{bag.path}: {topic.name} has no frame {child or 'that moves in odom or map'}; it has"
            f" {', '.join(sorted(others)) or 'none'}: name that of the body, as in --topic"
            f" {topic.name}:base_link"
        )
    if len(bases) > 1:
        raise InputError(
            f"{bag.path}: {topic.name} has several frames that move in that of the ground:"
            f" {', '.join(sorted(bases))}; name that of the body, as in --topic"
            f" {topic.name}:{min(bases)}"
        )


def velocities_of_poses(t: Floats, poses: Floats) -> VelocitySeries:
    """Return the velocity of a body, in its own frame, from its poses in a frame that stands still.

    Each is the way over `SPAN` and stands in its middle, in the frame that the body has there.  A
    pose that is repeated counts from its first time on.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times [s], increasing.
    poses : ndarray, shape (n, 7)
        Position [m] and quaternion (x, y, z, w).

    Raises
    ------
    InputError
        If a pose is unusable, or none are near enough in time.
    """
    length = np.linalg.norm(poses[:, 3:], axis=1)
    if not np.isfinite(poses).all() or np.abs(length - 1).max() > 0.01:
        row = int(np.argmax(~np.isfinite(poses).all(axis=1) | (np.abs(length - 1) > 0.01)))
        raise InputError(f"pose {row} has no position, or no quaternion of length 1")
    starts = np.flatnonzero(np.append(True, (np.diff(poses, axis=0) != 0).any(axis=1)))
    ends = np.append(starts[1:], t.size) - 1
    keep = np.repeat(t[ends] - t[starts] > STANDS, ends - starts + 1)
    keep[starts] = True
    t, poses = t[keep], poses[keep]
    last = np.searchsorted(t, t + SPAN - 1e-6)
    first = np.flatnonzero(last < t.size)
    last = last[first]
    step = t[last] - t[first]
    near = step <= LONGEST
    first, last, step = first[near], last[near], step[near]
    if first.size < 2:
        raise InputError(f"no two poses are within {LONGEST:g} s of each other")
    R = Rotation.from_quat(poses[:, 3:])
    turn = (R[first].inv() * R[last]).as_rotvec()
    middle = R[first] * Rotation.from_rotvec(turn / 2)
    way = poses[last, :3] - poses[first, :3]
    v = middle.inv().apply(way) / step[:, None]
    return VelocitySeries((t[first] + t[last]) / 2, v, turn[:, 2] / step)

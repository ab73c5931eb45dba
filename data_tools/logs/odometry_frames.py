"""In which frame a twist stands: what its message says, held against what its pose does.

``nav_msgs/Odometry`` wants its twist in ``child_frame_id``, the frame of the body.  Many drivers
leave it in the frame of the ground, which turns every direction by the yaw of the robot, and
nothing downstream can see it.  The pose of the same message can: its position changes by
the twist if that is in the ground's frame, and by the twist turned by the orientation if it is in
the body's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

from evcalib import checks
from evcalib.arrays import Floats
from evcalib.errors import InputError

GROUND = {
    *("map", "odom", "odom_combined", "world", "earth", "utm", "enu", "global", "local"),
    *("local_origin", "local_enu", "camera_init", "mocap"),
}
"""Last words of names of frames that stand still (REP 105, MAVROS and other common drivers)."""
TWIST_FRAMES = ("body", "ground")

WINDOW = 0.5
"""Displacements are compared over this time [s], against the noise of single poses."""
WARN, REFUSE = 1 / 10, 1 / 3
"""Shares of the way by which pose and twist may part before that is told, and before it is refused:
the same as for the slip of wheels, see `evcalib.kinematics.body_velocities`."""
CLEARLY = 0.5
"""A reading holds if it misses the pose by less than this share of what the other one misses."""

ALIKE = 0.9
"""Correlation of two yaws over which a factor between them is one of units: a choice, that noise
of a pose which does not turn along cannot reach."""

_GIVE = "or say which it is (--twist-frame body, or ground)"


@dataclass(frozen=True, eq=False)
class Twists:
    """Messages of one topic.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times [s].
    v : ndarray, shape (n, 3)
        Linear velocity [m/s], in whichever frame.
    yaw_rate : ndarray, shape (n,) or None
        Rotation rate about z [rad/s].
    frame : str
        Frame in which the message says the twist is; ``""`` where it says nothing.
    ground : str
        Frame of the pose.
    position, quaternion : ndarray, shape (n, 3) and (n, 4), optional
        The pose [m], (x, y, z, w), if the message has one.
    """

    t: Floats
    v: Floats
    yaw_rate: Floats | None
    frame: str
    ground: str = ""
    position: Floats | None = None
    quaternion: Floats | None = None


def in_body(twists: Twists, given: str | None = None) -> tuple[Floats, Floats | None, list[str]]:
    """Return the linear velocities in the body frame, the yaw rate, and what was found.

    Parameters
    ----------
    twists : Twists
        Messages of one topic.
    given : {"body", "ground"}, optional
        The frame of the twist, against what messages say.

    Raises
    ------
    InputError
        If the twist is in the frame of the ground and cannot be turned, message and pose contradict
        each other, or all twists are zero while the pose moves.
    """
    if given is not None:
        checks.one_of(given, "twist_frame", TWIST_FRAMES)
    frame = _bare(twists.frame)
    if twists.position is None or twists.quaternion is None:
        if given == "ground" or (given is None and stands(frame)):
            raise InputError(
                f"its twist is in {frame or 'the ground'!r}, the frame of the ground, and it has no"
                " pose to turn it by: take a topic in the frame of the vehicle (base_link), or one"
                f" of nav_msgs/Odometry{'' if given else ', ' + _GIVE.replace(', or ground', '')}"
            )
        return twists.v, twists.yaw_rate, [f"twist in the frame {frame or '(not named)'}"]
    same = frame == _bare(twists.ground)
    if given is None and stands(frame) and not same:
        raise InputError(
            f"its twist is in {frame!r} (child_frame_id), the frame of the ground, and so its pose"
            f" is not that of the vehicle: take a topic of the vehicle's own odometry, {_GIVE}"
        )
    found = _Comparison.of(twists)
    if found.all_zero:
        raise InputError(
            f"all {len(twists.v)} twists are zero while the pose moves by {found.way:.3g} m: the"
            " driver leaves the twist empty; take another topic, or the wheels"
        )
    declared = "ground" if same and frame else "body" if frame else ""
    chosen = given or _judged(declared, frame, found)
    notes = _notes(chosen, declared, found)
    yaw_rate, more = _yaw_rate(twists, found)
    v = found.turned if chosen == "ground" else twists.v
    if v is None:
        raise InputError("its twist is in the frame of the ground, and its pose has no orientation")
    return v, yaw_rate, notes + more


def _bare(name: str) -> str:
    return name.strip().strip("/")


def stands(name: str) -> bool:
    """Tell whether a frame is one of the ground, by its name."""
    return name.rsplit("/", 1)[-1].lower() in GROUND


@dataclass(frozen=True, eq=False)
class _Comparison:
    """How far both readings of the twist miss the way of the pose, as shares of that way."""

    body: float
    ground: float
    apart: float
    checked: bool
    all_zero: bool
    way: float
    turned: Floats | None
    yaw: tuple[Floats, Floats]

    @classmethod
    def of(cls, twists: Twists) -> _Comparison:
        t, v, p, q = twists.t, twists.v, twists.position, twists.quaternion
        assert p is not None
        assert q is not None
        usable = np.isfinite(p).all() and np.isfinite(q).all() and np.linalg.norm(q, axis=1).min()
        if not usable or not np.isfinite(v).all():
            return cls(0.0, 0.0, 0.0, False, False, 0.0, None, (np.zeros(0), np.zeros(0)))
        R = Rotation.from_quat(q)
        edges = np.searchsorted(t, np.arange(t[0], t[-1] - WINDOW / 2, WINDOW))
        edges = np.unique(np.concatenate([[0], edges, [t.size - 1]]))
        keep = np.diff(t[edges]) <= max(4 * WINDOW, 3 * float(np.median(np.diff(t))))
        way, body, ground = (
            np.diff(path[edges], axis=0)[keep] for path in (p, _way(t, R.apply(v)), _way(t, v))
        )
        yaw = np.unwrap(R.as_euler("ZYX")[:, 0])
        turn = np.zeros_like(t) if twists.yaw_rate is None else twists.yaw_rate
        turns = np.diff(yaw[edges])[keep], np.diff(_way(t, turn)[edges])[keep]
        if not len(way):
            return cls(0.0, 0.0, 0.0, False, False, 0.0, R.inv().apply(v), turns)
        usual = float(np.percentile(np.linalg.norm(way, axis=1), 90))
        told = float(np.percentile(np.linalg.norm(ground, axis=1), 90))
        moves = np.linalg.norm(way, axis=1) > 0.1 * usual
        total = float(np.ptp(p, axis=0).max())
        all_zero = not v.any() and total > 0.01
        checked = usual > 0.01 * told and bool(moves.any())
        length = float(np.median(np.linalg.norm(way[moves], axis=1))) if checked else 1.0

        def share(a: Floats, b: Floats) -> float:
            return float(np.median(np.linalg.norm((a - b)[moves], axis=1))) / length

        shares = (
            (share(way, body), share(way, ground), share(body, ground)) if checked else (0.0,) * 3
        )
        return cls(*shares, checked, all_zero, total, R.inv().apply(v), turns)

    @property
    def holds(self) -> str:
        """The reading that the pose confirms, if it does so clearly."""
        if not self.checked or self.apart < WARN:
            return ""
        if self.ground < min(CLEARLY * self.body, REFUSE):
            return "ground"
        return "body" if self.body < min(CLEARLY * self.ground, REFUSE) else ""

    @property
    def words(self) -> str:
        return (
            f"read in the body's frame it misses the way of the pose by {100 * self.body:.0f} %,"
            f" read in the ground's by {100 * self.ground:.0f} %"
        )


def _way(t: Floats, v: Floats) -> Floats:
    """Return the integral of v over t, zero at the start."""
    return cumulative_trapezoid(v, t, axis=0, initial=0.0)


def _judged(declared: str, frame: str, found: _Comparison) -> str:
    """Return the frame of the twist; refuse where message and pose do not agree on one."""
    other = {"body": "ground", "ground": "body"}.get(declared, "")
    if found.holds and found.holds == other:
        says = "the ground's, as frame_id is" if declared == "ground" else "the body's"
        raise InputError(
            f"message and pose contradict each other: child_frame_id {frame!r} says that the twist"
            f" is in {says}, but {found.words}: the driver publishes it in the {found.holds}'s"
            f" frame; mend the driver, or say --twist-frame {found.holds}"
        )
    if declared == "ground" and not found.checked:
        raise InputError(
            f"child_frame_id {frame!r} is the frame of the pose, so the twist is in that of the"
            " ground, and the pose, which does not move along, cannot turn it; take another topic,"
            f" {_GIVE}"
        )
    least = found.ground if declared == "ground" else found.body
    if not declared:
        least = min(found.body, found.ground)
    if least > REFUSE:
        raise InputError(
            f"twist and pose contradict each other in any frame: {found.words}; look for another"
            f" unit, a swapped sign, or a pose of another source, {_GIVE}"
        )
    return declared or found.holds or "body"


def _notes(chosen: str, declared: str, found: _Comparison) -> list[str]:
    if chosen == "ground":
        why = "child_frame_id is that of the pose" if declared == "ground" else found.words
        return [f"the twist is in the frame of the ground ({why}) and was turned by the pose"]
    if not found.checked:
        return ["the pose does not move or is empty: the frame of the twist could not be checked"]
    if not declared:
        return [f"no child_frame_id: the twist is taken to be in the body's frame ({found.words})"]
    if found.body > WARN:
        return [
            f"pose and twist part by {100 * found.body:.0f} % of the way: directions may be off by"
            " as much; look at the odometry"
        ]
    return []


def _yaw_rate(twists: Twists, found: _Comparison) -> tuple[Floats | None, list[str]]:
    """Hold the yaw rate against the yaw of the pose."""
    turned, told = found.yaw
    if twists.yaw_rate is None or not turned.any():
        return twists.yaw_rate, []
    ratio = float(turned @ told / (turned @ turned))
    alike = abs(turned @ told) > ALIKE * np.linalg.norm(turned) * np.linalg.norm(told)
    turns = np.abs(turned).max() >= 0.1
    if turns and not told.any():
        return None, ["all yaw rates are zero while the pose turns: they are taken to be unknown"]
    if (turns or alike) and 40 < abs(ratio) < 80:
        raise InputError(
            f"its yaw rate is {ratio:.0f} times that of its pose: degrees per second in place of"
            " radians per second; mend the driver, or take another topic"
        )
    if turns and abs(ratio - 1) > REFUSE:
        return twists.yaw_rate, [
            f"the yaw rate is {ratio:.2f} times that of the pose; look at the odometry"
        ]
    return twists.yaw_rate, []

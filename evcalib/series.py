"""The two streams that a calibration aligns: body velocities and camera headings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from evcalib import checks
from evcalib.arrays import Flags, Floats, Integers
from evcalib.display import Shown
from evcalib.errors import InputError
from evcalib.geometry import turned_by_yaw

MAX_SPEED = 100.0
"""Speeds above this [m/s] are taken for a mistake of units.

A choice: no wheeled vehicle of ours is as fast, and mm/s of one that walks are 1000.
"""

MAX_YAW_RATE = 4 * np.pi
"""Yaw rates above two turns per second [rad/s] are taken for degrees.

A choice: no vehicle of ours turns as fast, and 13 deg/s told as they are do.
"""

QUARTER, MOST_HOURS = 900.0, 26.0
"""Time zones are multiples of this [s], and the clocks of two at most so many hours apart."""
UNIX = 3e8
"""Clocks farther apart than this [s], ten years, do not count from one origin."""

_TOUCH = 1e-5
"""Times [s] may lie so far outside their interval, by rounding.

A choice: ten microseconds, of which files of six decimals round away a half.
"""

UNIT_TOLERANCE = 0.05
"""Lengths of headings within this of 1 are rounding, and are normalised.

A choice: it lets two decimals pass, and refuses velocities and pixels, whose lengths differ.
"""


def _optional(values: object, name: str, n: int) -> Floats | None:
    if values is None:
        return None
    return checks.floats(values, name, (n,))  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class VelocitySeries(Shown):
    """Linear velocity of the body over time.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times [s] on the odometry clock, strictly increasing.
    v : ndarray, shape (n, 3)
        Velocity [m/s] in `frame`.
    yaw_rate : ndarray, shape (n,), optional
        Rotation rate about the body's Z axis [rad/s].
    frame : str
        Name of the frame, ``"body"`` by default.
    direction_sd : float
        Standard deviation [rad] of an error that all directions may share, such as wheels leave
        that contradict each other; no average takes it away.

    Raises
    ------
    InputError
        If a shape, a time or a value is unusable.

    Examples
    --------
    >>> VelocitySeries(t=[0.0, 0.1], v=[[1.0, 0.0, 0.0], [0.6, 0.8, 0.0]]).speed
    array([1., 1.])
    """

    t: Floats
    v: Floats
    yaw_rate: Floats | None = None
    frame: str = "body"
    direction_sd: float = 0.0

    def __post_init__(self) -> None:
        t = checks.times(self.t, "velocity t")
        _set(self, "t", t)
        _set(self, "v", checks.floats(self.v, "velocity v", (t.size, 3)))
        _set(self, "yaw_rate", _optional(self.yaw_rate, "yaw_rate", t.size))
        checks.at_least_zero(self.direction_sd, "velocity direction_sd")
        turn = 0.0 if self.yaw_rate is None else np.abs(self.yaw_rate)
        if np.max(turn, initial=0.0) > MAX_YAW_RATE:
            row = int(np.argmax(turn))
            raise InputError(
                f"velocity row {row} has a yaw rate of {np.max(turn):.3g} rad/s, above"
                f" {MAX_YAW_RATE:.3g} rad/s; is it in degrees per second? (a column map reads them:"
                " yaw_rate: {column: NAME, unit: deg/s})"
            )
        speed = self.speed
        if speed.size and speed.max() > MAX_SPEED:
            row = int(speed.argmax())
            raise InputError(
                f"velocity row {row} has a speed of {speed[row]:.0f} m/s, above"
                f" {MAX_SPEED:.0f} m/s; are the values in metres per second?"
            )

    def __len__(self) -> int:
        return int(self.t.size)

    @property
    def speed(self) -> Floats:
        """Length of each velocity [m/s], shape (n,)."""
        return np.linalg.norm(self.v, axis=1)

    @property
    def turning(self) -> float:
        """Root mean square yaw rate [rad/s]; 0 where it is not known."""
        return 0.0 if self.yaw_rate is None else float(np.sqrt(np.mean(self.yaw_rate**2)))

    def select(self, mask: Flags) -> VelocitySeries:
        """Return the rows where `mask` (shape (n,)) is True."""
        yaw_rate = _rows(self.yaw_rate, mask)
        return replace(self, t=self.t[mask], v=self.v[mask], yaw_rate=yaw_rate)


@dataclass(frozen=True, eq=False)
class HeadingSeries(Shown):
    """Direction of the camera's own motion over time.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times [s] on the camera clock, strictly increasing.
    v : ndarray, shape (n, 3)
        Unit directions in `frame`.  Lengths within 5 % of 1 are normalised; others are refused.
    t_start, t_end : ndarray, shape (n,), optional
        Interval [s] over which each heading was measured; both or neither.
    weight : ndarray, shape (n,), optional
        Non-negative weights.
    sd : ndarray, shape (n,), optional
        Standard deviation of each direction [rad], per tangent axis.
    inliers : ndarray, shape (n,), optional
        Number of correspondences behind each heading.
    valid : ndarray of bool, shape (n,), optional
        False where a row must not be used.
    frame : str
        Name of the frame, ``"cam"`` by default.

    Raises
    ------
    InputError
        If a shape, a time, a length or a value is unusable.

    Examples
    --------
    >>> headings = HeadingSeries(t=[0.0, 0.1], v=[[0, 0, 1], [0, 0.6, 0.8]], sd=[0.02, 0.05])
    >>> len(headings), headings.v[1]
    (2, array([0. , 0.6, 0.8]))
    """

    t: Floats
    v: Floats
    t_start: Floats | None = None
    t_end: Floats | None = None
    weight: Floats | None = None
    sd: Floats | None = None
    inliers: Floats | None = None
    valid: Flags | None = None
    frame: str = "cam"

    def __post_init__(self) -> None:
        t = checks.times(self.t, "heading t")
        n = t.size
        _set(self, "t", t)
        _set(self, "v", _unit(checks.floats(self.v, "heading v", (n, 3))))
        for name in ("t_start", "t_end", "weight", "sd", "inliers"):
            _set(self, name, _optional(getattr(self, name), f"heading {name}", n))
        if (self.t_start is None) != (self.t_end is None):
            raise InputError("heading t_start and t_end must be given together")
        if self.t_start is not None and (self.t_end < self.t_start).any():  # type: ignore[operator]
            row = int(np.argmax(self.t_end < self.t_start))  # type: ignore[operator]
            raise InputError(f"heading row {row} ends (t_end) before it starts (t_start)")
        if self.t_start is not None:
            outside = (t < self.t_start - _TOUCH) | (t > self.t_end + _TOUCH)  # type: ignore[operator]
            if outside.any():
                row = int(np.argmax(outside))
                raise InputError(
                    f"heading row {row}: t ({t[row]:.6f} s) is not within t_start and t_end"
                    f" ({self.t_start[row]:.6f} to {self.t_end[row]:.6f} s)"  # type: ignore[index]
                )
        for name in ("weight", "sd", "inliers"):
            values = getattr(self, name)
            if values is not None and (values < 0).any():
                raise InputError(f"heading {name} is negative in row {int(np.argmax(values < 0))}")
        if self.valid is not None:
            valid = np.asarray(self.valid)
            if valid.shape != (n,) or valid.dtype != np.bool_:
                raise InputError(f"heading valid must be {n} booleans")
            _set(self, "valid", valid)

    def __len__(self) -> int:
        return int(self.t.size)

    def select(self, mask: Flags) -> HeadingSeries:
        """Return the rows where `mask` (shape (n,)) is True."""
        optional = ("t_start", "t_end", "weight", "sd", "inliers", "valid")
        kept = {name: _rows(getattr(self, name), mask) for name in optional}
        return HeadingSeries(self.t[mask], self.v[mask], **kept, frame=self.frame)

    def usable(self) -> HeadingSeries:
        """Return the rows that are valid and carry weight."""
        mask = np.ones(len(self), dtype=bool) if self.valid is None else self.valid.copy()
        if self.weight is not None:
            mask &= self.weight > 0
        return self if mask.all() else self.select(mask)


def _unit(v: Floats) -> Floats:
    length = np.linalg.norm(v, axis=1)
    bad = np.abs(length - 1.0) > UNIT_TOLERANCE
    if bad.any():
        row = int(np.argmax(bad))
        raise InputError(
            f"heading row {row} has length {length[row]:.4g}, not 1: headings are unit directions;"
            " normalise them, and remove rows without motion"
        )
    return v / length[:, None]


def _rows(values: NDArray | None, mask: Flags) -> NDArray | None:
    return None if values is None else values[mask]


def _set(instance: object, name: str, value: object) -> None:
    object.__setattr__(instance, name, value)


BORDER = 1e-6
"""Times this close [s] to a border lie on it: events count whole microseconds."""


def dead_reckon(velocities: VelocitySeries) -> Floats:
    """Integrate body velocities and yaw rates to positions [m], shape (n, 3) (paper Eq. 13).

    The trapezoidal rule is used, where the paper has a rectangle; the heading starts at zero.
    """
    world = turned_by_yaw(velocities.v, yaw_angles(velocities))
    return cumulative_trapezoid(world, velocities.t, axis=0, initial=0.0)


def yaw_angles(velocities: VelocitySeries) -> Floats:
    """Integrate the yaw rate to angles [rad], shape (n,), from zero; zeros where it is not told."""
    if velocities.yaw_rate is None:
        return np.zeros(len(velocities))
    return cumulative_trapezoid(velocities.yaw_rate, velocities.t, initial=0.0)


def segments(t: Floats, gap: float) -> Integers:
    """Return the number of the segment between gaps longer than `gap` [s] that each time is in."""
    return np.concatenate([[0], np.cumsum(np.diff(t) > gap + BORDER)])


def bins(since: Floats, width: float) -> Integers:
    """Return the number of the bin of `width` [s] that each time since a start [s] lies in.

    Counted in whole microseconds, so that rounding moves no time across a border.
    """
    return np.rint(np.asarray(since) / BORDER).astype(np.int64) // max(round(width / BORDER), 1)


def clocks_apart(camera: tuple[float, float], body: tuple[float, float]) -> str:
    """Say what may have set the clocks of two streams apart, and how to bring them together.

    Parameters
    ----------
    camera, body : tuple of (float, float)
        First and last time [s] on each clock.

    Returns
    -------
    str
        To be put behind a message that they do not overlap.
    """
    gap = body[0] - camera[0]
    hours = round(gap / QUARTER) * QUARTER / 3600
    longest = max(camera[1] - camera[0], body[1] - body[0], 1.0)
    if 0 < abs(hours) <= MOST_HOURS and abs(gap - 3600 * hours) <= longest:
        return (
            f"; the starts are {gap:.3f} s apart, about {abs(hours):g} h: a time zone? then shift"
            f" the motion's times (--clock-shift {-3600 * hours:g})"
        )
    if abs(gap) > UNIX:
        return (
            f"; one clock counts from 1970, the other one does not: shift the motion's times, by"
            f" {-gap:.3f} s if both logs start together (--clock-shift)"
        )
    return (
        f"; the starts are {gap:.3f} s apart: if both logs start together, shift the motion's times"
        f" (--clock-shift {-gap:.3f})"
    )

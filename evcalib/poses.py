"""Trajectories: poses of a camera or a body over time, for the methods that align trajectories."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation, Slerp

from evcalib import checks
from evcalib.arrays import Floats, Integers
from evcalib.display import Shown
from evcalib.errors import InputError
from evcalib.series import segments

MIN_POSES = 3
"""Fewest poses of a trajectory: two motions."""

UNIT_TOLERANCE = 0.01
"""Lengths of quaternions within this of 1 are rounding, and are normalised.

A choice: numbers of two decimals pass; columns in the wrong order, a time among them, do not.
"""

GAP = 5.0
"""Steps longer than this many median steps are gaps.

A choice, that of `velocity_track` too: a lost sample or three are interpolated, a halt of the
recorder is not.
"""


@dataclass(frozen=True, eq=False)
class PoseSeries(Shown):
    """Poses over time: where a sensor was in a world of its own, and how it was turned.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times [s] on the sensor's clock, strictly increasing, n >= 3.
    position : ndarray, shape (n, 3)
        Position in the trajectory's world, in metres or (monocular) in any unit of length.
    rotation : ndarray, shape (n, 3, 3)
        Rotations R_world_sensor; given so, or as unit quaternions (w, x, y, z), shape (n, 4), or
        not at all for a sensor that does not turn.
    max_gap : float, optional
        Longest step [s] to interpolate across; five times the median step if not given.

    Raises
    ------
    InputError
        If there are fewer than three poses, or a shape, time, value, quaternion or matrix is
        unusable.
    """

    t: Floats
    position: Floats
    rotation: Floats | None = None
    max_gap: float | None = None

    def __post_init__(self) -> None:
        t = checks.times(self.t, "pose t")
        if t.size < MIN_POSES:
            raise InputError(
                f"a trajectory of {t.size} pose(s) is too short: at least {MIN_POSES} are needed"
            )
        position = checks.floats(self.position, "pose position", (t.size, 3))
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "position", position)
        object.__setattr__(self, "rotation", _rotations(self.rotation, t.size))
        checks.positive(self.gap, "max_gap", "seconds")

    def __len__(self) -> int:
        return int(self.t.size)

    @cached_property
    def gap(self) -> float:
        """Longest step [s] that is interpolated across."""
        return GAP * float(np.median(np.diff(self.t))) if self.max_gap is None else self.max_gap

    @cached_property
    def turns(self) -> bool:
        """Whether any pose is turned against the first one."""
        return bool(np.any(self.matrices != self.matrices[0]))

    @property
    def matrices(self) -> Floats:
        """Rotations R_world_sensor, shape (n, 3, 3)."""
        return np.asarray(self.rotation, dtype=np.float64)

    def segment_at(self, t: ArrayLike) -> Integers:
        """Return the number of the segment between gaps that holds each time [s], of any shape.

        It is -1 outside the trajectory and in gaps.
        """
        t = np.asarray(t, dtype=np.float64)
        number = segments(self.t, self.gap)
        after = np.clip(np.searchsorted(self.t, t), 1, len(self) - 1)
        before = np.where(t == self.t[after], after, after - 1)
        joined = (number[before] == number[after]) | (t == self.t[before])
        return np.where((t >= self.t[0]) & (t <= self.t[-1]) & joined, number[before], -1)

    def at(self, t: ArrayLike) -> tuple[Floats, Floats]:
        """Return positions (m, 3) and rotations (m, 3, 3) at covered times (m,).

        Positions are linear and rotations turn at a constant rate (slerp) between the poses.

        Raises
        ------
        InputError
            If a time is outside the trajectory or in a gap: nothing is extrapolated.
        """
        times = checks.floats(t, "t", (None,))
        missing = self.segment_at(times) < 0
        if missing.any():
            raise InputError(
                f"the trajectory ({self.t[0]:.3f} to {self.t[-1]:.3f} s) does not cover"
                f" {int(missing.sum())} of {times.size} times, the first of them"
                f" {times[missing][0]:.3f} s: it is outside, or in a gap"
            )
        position = np.stack(
            [np.interp(times, self.t, column) for column in self.position.T], axis=1
        )
        if not self.turns:
            return position, np.broadcast_to(self.matrices[0], (times.size, 3, 3))
        return position, self._slerp(times).as_matrix()

    @cached_property
    def _slerp(self) -> Slerp:
        return Slerp(self.t, Rotation.from_matrix(self.matrices))


def _rotations(given: ArrayLike | None, n: int) -> Floats:
    """Return rotation matrices (n, 3, 3) of matrices, of quaternions (w, x, y, z) or of none."""
    if given is None:
        return np.tile(np.eye(3), (n, 1, 1))
    if np.ndim(given) == 2:
        wxyz = checks.floats(given, "pose quaternion (w, x, y, z)", (n, 4))
        off = np.abs(np.linalg.norm(wxyz, axis=1) - 1.0)
        if off.max() > UNIT_TOLERANCE:
            row = int(np.argmax(off > UNIT_TOLERANCE))
            raise InputError(
                f"pose {row} has a quaternion of length {np.linalg.norm(wxyz[row]):.4g}, not 1:"
                " is it a unit quaternion, in the right columns?"
            )
        return Rotation.from_quat(wxyz[:, [1, 2, 3, 0]]).as_matrix()
    return checks.rotations(given, "pose rotation", n)


KEYFRAMES = 50
"""Poses that are taken, evenly spread: every pair of them is a motion.

A choice: the 1225 pairs are searched anew at each offset, and the time grows with their number.
"""


@dataclass(frozen=True, eq=False)
class Motions(Shown):
    """Poses of the camera and of the body at the same instants.

    Attributes
    ----------
    camera, body : ndarray, shape (n, 3)
        Positions, each in a world of its own.
    camera_turn, body_turn : ndarray, shape (n, 3, 3)
        Rotations R_world_sensor.
    """

    camera: Floats
    camera_turn: Floats
    body: Floats
    body_turn: Floats


def associate(
    camera: PoseSeries, body: PoseSeries, offsets: Floats, *, keyframes: int = KEYFRAMES
) -> Floats:
    """Return camera times, evenly spread over those that the body's poses cover at all offsets.

    Offsets between the smallest and the largest count too: no time moves across a gap.

    Raises
    ------
    InputError
        If fewer than three are covered.
    """
    low, high = float(offsets.min()), float(offsets.max())
    first, last = body.segment_at(camera.t + low), body.segment_at(camera.t + high)
    t = camera.t[(first >= 0) & (first == last)]
    if t.size < MIN_POSES:
        raise InputError(
            f"trajectories: the camera's ({camera.t[0]:.3f} to {camera.t[-1]:.3f} s) and the"
            f" body's ({body.t[0]:.3f} to {body.t[-1]:.3f} s) share {t.size} pose(s) at offsets of"
            f" {low:g} to {high:g} s, and {MIN_POSES} are needed; check the clocks,"
            " or search less far"
        )
    return t[np.unique(np.linspace(0, t.size - 1, min(keyframes, t.size)).round().astype(int))]


def motions(camera: PoseSeries, body: PoseSeries, t: Floats, offset: float) -> Motions:
    """Return both poses at camera times `t` [s], the body's by interpolation at t + offset."""
    return Motions(*camera.at(t), *body.at(t + offset))

"""What a drive will tell, before anyone drives it: the best precision that any method can reach.

The bounds are Cramer and Rao's, for a simple picture of what a camera measures: each corner shows
the camera's displacements as vectors, in units of its unknown distance.  A heading shows less, a
displacement without any length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evcalib import checks
from evcalib.alignment.verdict import SEARCH_LESS, SPREAD_MORE, TURN_MORE
from evcalib.arrays import Floats
from evcalib.display import Shown
from evcalib.errors import InputError
from evcalib.joint import SYSTEMATIC
from evcalib.series import VelocitySeries

STEP = 0.05
"""Time from one observation of a corner to the next [s]: that of headings at 20 Hz."""

OBSERVATIONS = 12
"""A corner is seen so often after its first observation: for 0.6 s."""

REPEATS = 0.97
"""A drive that is so like itself, some time later, may be taken for itself.

Zigzags and curves that repeat themselves within the search come to 1.00, the course's other drives
to 0.90 at most (`Prediction.likeness`; test_a_fast_zigzag_repeats_itself_half_a_period_on).
"""

ROTATION_GATE = float(np.radians(5.0))
"""An axis about which the rotation stays less sure than this [rad] counts as not shown.  A choice:
a third of what a calibration calls undetermined, as a bound is never reached."""

SHARP = 0.9
"""What is less like itself than this in between is another peak.  A choice: a peak then stands out
by more than `REPEATS` asks for."""


@dataclass(frozen=True)
class Viewing:
    """What the camera makes of a drive.

    Attributes
    ----------
    focal : float
        Pixels per radian.
    noise : float
        Standard deviation of an observation per axis [px].
    corners : float
        Corners in view whose errors are independent.
    distance : float
        Their distance [m].
    """

    focal: float = 200.0
    noise: float = 0.3
    corners: float = 20.0
    distance: float = 2.5

    @property
    def step_sd(self) -> float:
        """Standard deviation of a displacement per axis [m], from all corners."""
        return self.noise / self.focal * self.distance / float(np.sqrt(self.corners))


@dataclass(frozen=True, eq=False)
class Prediction(Shown):
    """The best precision that a drive allows.

    Attributes
    ----------
    offset_sd : float
        Standard deviation of the offset [s].
    rotation_sd : ndarray, shape (3,)
        Standard deviations of the rotation about the body's X, Y and Z axis [rad].
    covariance : ndarray, shape (4, 4)
        Of the rotation vector in the body frame [rad] and the offset [s].
    shifts, likeness : ndarray, shape (m,)
        How like itself the drive is, some time [s] later; see `self_likeness`.
    repeats : bool
        Whether it repeats itself within the search.
    max_offset : float
        Half width of the search [s].
    """

    offset_sd: float
    rotation_sd: Floats
    covariance: Floats
    shifts: Floats
    likeness: Floats
    repeats: bool
    max_offset: float

    @property
    def offset_determined(self) -> bool:
        """Whether the drive will show the offset: a sharp peak, and only one."""
        return self.offset_sd < self.max_offset / 4 and not self.repeats

    @property
    def rotation_determined(self) -> bool:
        """Whether it will show the rotation about every axis."""
        return self.worst_axis_sd < ROTATION_GATE

    @property
    def worst_axis_sd(self) -> float:
        """Standard deviation of the rotation about the axis that shows least [rad]."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:3, :3])[-1]))

    @property
    def summary(self) -> str:
        """The verdict in a sentence."""
        offset = "the offset" if self.offset_determined else "not the offset"
        rotation = "the rotation" if self.rotation_determined else "not the whole rotation"
        if self.offset_determined and self.rotation_determined:
            return "This drive will show the offset and the rotation."
        if not (self.offset_determined or self.rotation_determined):
            return "This drive will show neither the offset nor the whole rotation."
        shown, hidden = (offset, rotation) if self.offset_determined else (rotation, offset)
        return f"This drive will show {shown}, but {hidden}."

    @property
    def advice(self) -> tuple[str, ...]:
        """What to change."""
        found = []
        if self.offset_sd >= self.max_offset / 4:
            found.append(TURN_MORE)
        elif self.repeats:
            found.append(SEARCH_LESS)
        if np.sqrt(self.covariance[0, 0] + self.covariance[1, 1]) > ROTATION_GATE:
            found.append(SPREAD_MORE)
        return tuple(found)


def predict(
    velocities: VelocitySeries,
    *,
    viewing: Viewing = Viewing(),
    speed: bool = True,
    max_offset: float = 1.0,
) -> Prediction:
    """Predict how well a drive determines offset and rotation.

    Parameters
    ----------
    velocities : VelocitySeries
        The drive as planned, or the log of an earlier one.
    viewing : Viewing
        What the camera makes of it.
    speed : bool
        Use how displacements of the same corner compare in length, as
        `evcalib.joint.refine_jointly` does; without it directions alone count, as in
        `evcalib.align`.
    max_offset : float
        Half width of the search [s].

    Returns
    -------
    Prediction
        With what all observations share (`evcalib.joint.SYSTEMATIC`) added.

    Raises
    ------
    InputError
        If this is no drive, or it is shorter than corners live, or does not move.

    Examples
    --------
    >>> t = np.arange(0, 20, 0.02)
    >>> straight = VelocitySeries(t, np.tile([0.5, 0.0, 0.0], (t.size, 1)))
    >>> predict(straight).summary
    'This drive will show neither the offset nor the whole rotation.'

    Notes
    -----
    Cramer & Rao's bound of the model ``y_i = d_i / Z + mean + noise``: displacements ``d_i`` since
    the first observation, an unknown distance ``Z`` and mean for each corner.  The rotation is
    known to half a turn beforehand, the offset to the width of the search.  The camera keeps its
    heading; yaw rates are not looked at.
    """
    checks.instance(velocities, "velocities", VelocitySeries)
    checks.positive(max_offset, "max_offset", "seconds")
    information = _information(velocities, viewing.step_sd, speed)
    information += np.diag([np.pi**-2] * 3 + [max_offset**-2])
    covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
    covariance += np.diag([SYSTEMATIC.rotation_sd**2] * 3 + [SYSTEMATIC.time_sd**2])
    shifts = np.linspace(-max_offset, max_offset, 1 + 2 * max(round(max_offset / 0.02), 1))
    likeness = self_likeness(velocities, shifts, speed=speed)
    return Prediction(
        offset_sd=float(np.sqrt(covariance[3, 3])),
        rotation_sd=np.sqrt(np.diag(covariance)[:3]),
        covariance=covariance,
        shifts=shifts,
        likeness=likeness,
        repeats=_repeats(shifts, likeness),
        max_offset=float(max_offset),
    )


def self_likeness(velocities: VelocitySeries, shifts: Floats, *, speed: bool = True) -> Floats:
    """Return how like itself a planar drive is, some time later and turned at will.

    1 where a shifted drive cannot be told from the drive, whatever the rotation.  With the
    velocities as complex numbers v, it is the larger of ``|sum v* v'|`` (the drive turned about the
    vertical) and ``|sum v v'|`` (turned over about a horizontal axis, which exchanges left and
    right), over ``sqrt(sum |v|^2 sum |v'|^2)``.

    Parameters
    ----------
    velocities : VelocitySeries
        The drive.
    shifts : ndarray, shape (m,)
        Times [s].
    speed : bool
        Compare velocities; otherwise directions alone.

    Returns
    -------
    ndarray, shape (m,)
        Likeness, 0 to 1.
    """
    t = np.arange(velocities.t[0], velocities.t[-1], 0.5 * STEP)
    # Times outside the drive stand still, and count for neither side.
    later = np.add.outer(checks.floats(shifts, "shifts", (None,)), t)
    inside = (later >= velocities.t[0]) & (later <= velocities.t[-1])
    a = np.where(inside, _planar(velocities, t, speed), 0.0)
    b = np.where(inside, _planar(velocities, later, speed), 0.0)
    turned = np.abs(np.sum(np.conj(a) * b, axis=1))
    over = np.abs(np.sum(a * b, axis=1))
    size = np.sqrt(np.sum(np.abs(a) ** 2, axis=1) * np.sum(np.abs(b) ** 2, axis=1))
    return np.maximum(turned, over) / np.maximum(size, 1e-12)


def _planar(velocities: VelocitySeries, t: Floats, speed: bool) -> NDArray[np.complex128]:
    v = np.interp(t, velocities.t, velocities.v[:, 0]) + 1j * np.interp(
        t, velocities.t, velocities.v[:, 1]
    )
    if speed:
        return v
    length = np.abs(v)
    still = 0.1 * length.max(initial=0.0)
    return np.where(length > still, v / np.maximum(length, 1e-12), 0.0)


def _repeats(shifts: Floats, likeness: Floats) -> bool:
    """Tell whether there is another peak as high as the one at zero, apart from it."""
    middle = int(np.argmin(np.abs(shifts)))
    for side in (likeness[middle:], likeness[middle::-1]):
        apart = np.flatnonzero(side < SHARP)
        if apart.size and side[apart[0] :].max() > REPEATS:
            return True
    return False


def _information(velocities: VelocitySeries, sd: float, speed: bool) -> Floats:
    """Return the information (4, 4) on the rotation vector and the offset."""
    t = np.arange(velocities.t[0], velocities.t[-1] + 1e-9, STEP)
    if t.size < 2 * OBSERVATIONS:
        raise InputError(
            f"the drive lasts {velocities.t[-1] - velocities.t[0]:.2f} s; at least"
            f" {2 * OBSERVATIONS * STEP:g} s are needed"
        )
    v = np.stack([np.interp(t, velocities.t, column) for column in velocities.v.T], axis=1)
    if not np.any(v):
        raise InputError("the drive does not move")
    path = np.zeros_like(v)
    path[1:] = np.cumsum(0.5 * (v[1:] + v[:-1]) * STEP, axis=0)
    rows = np.add.outer(np.arange(t.size - OBSERVATIONS), np.arange(OBSERVATIONS + 1))
    d = path[rows] - path[rows[:, :1]]
    # How each displacement changes with rotation (of the camera), offset and scale.
    slopes = [np.cross(d, axis) for axis in np.eye(3)] + [v[rows] - v[rows[:, :1]], d]
    J = np.stack(slopes, axis=-1)
    if not speed:
        length = np.maximum(np.linalg.norm(d, axis=-1, keepdims=True), 1e-9)
        ahead = (d / length)[..., None]
        J = J - ahead * np.sum(ahead * J, axis=-2, keepdims=True)
    J = J - J.mean(axis=1, keepdims=True)
    whole = np.einsum("nkci,nkcj->nij", J, J) / sd**2
    scale = whole[:, 4:, 4:]
    share = whole[:, :4, 4:] / np.maximum(scale, 1e-12)
    # A new corner comes into view when an old one leaves it.
    return (whole[:, :4, :4] - share * whole[:, 4:, :4]).sum(axis=0) / OBSERVATIONS

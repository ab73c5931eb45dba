"""What a drive will tell, before anyone drives it: the best precision that any method can reach.

The bounds are Cramer and Rao's, for what a camera sees of corners around it while it moves and
turns (`evcalib.design._information`).  A heading shows less, a displacement without any length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evcalib import checks
from evcalib.alignment.verdict import SEARCH_LESS, SPREAD_MORE, TURN_MORE
from evcalib.arrays import Floats
from evcalib.design._information import (
    OFFSET,
    POSITION,
    ROTATION,
    STEP,
    TOGETHER,
    USUAL,
    Viewing,
    information,
)
from evcalib.display import Shown
from evcalib.joint import SYSTEMATIC, Systematic
from evcalib.series import VelocitySeries

REPEATS = 0.97
"""A drive that is so like itself, some time later, may be taken for itself.

Zigzags and curves that repeat themselves within the search come to 1.00, the course's other drives
to 0.90 at most (`Prediction.likeness`; test_a_fast_zigzag_repeats_itself_half_a_period_on).
"""

ROTATION_GATE = float(np.radians(5.0))
"""An axis about which the rotation stays less sure than this [rad] counts as not shown.  A choice:
a third of what a calibration calls undetermined, as a bound is never reached."""

TURNING = 0.02
"""Root mean square yaw rate [rad/s] over which a body turns on purpose: a choice, 1 deg/s."""

POSITION_PRIOR = 1.0
"""Standard deviation of the camera's position beforehand [m], per axis."""

POSITION_GATE = 0.05
"""A position that stays less sure than this [m] counts as not shown.  A choice: what a tape measure
finds."""

SHARP = 0.9
"""What is less like itself than this in between is another peak.  A choice: a peak then stands out
by more than `REPEATS` asks for."""


@dataclass(frozen=True, eq=False)
class Prediction(Shown):
    """The best precision that a drive allows.

    Attributes
    ----------
    offset_sd : float
        Standard deviation of the offset [s].
    rotation_sd : ndarray, shape (3,)
        Standard deviations of the rotation about the body's X, Y and Z axis [rad].
    position_sd : ndarray, shape (2,)
        Standard deviations of the camera's x and y in the body frame [m]; its z is never shown.
    covariance : ndarray, shape (6, 6)
        Of the rotation vector in the body frame [rad], the offset [s], and x and y [m].
    turns : bool
        Whether the body turns.
    shifts, likeness : ndarray, shape (m,)
        How like itself the drive is, some time [s] later; see `self_likeness`.
    repeats : bool
        Whether it repeats itself within the search.
    max_offset : float
        Half width of the search [s].
    """

    offset_sd: float
    rotation_sd: Floats
    position_sd: Floats
    covariance: Floats
    turns: bool
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
    def position_determined(self) -> bool:
        """Whether it will show where the camera is, x and y."""
        return float(self.position_sd.max()) < POSITION_GATE

    @property
    def worst_axis_sd(self) -> float:
        """Standard deviation of the rotation about the axis that shows least [rad]."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:3, :3])[-1]))

    @property
    def summary(self) -> str:
        """The verdict in a sentence."""
        parts = {
            "the offset": self.offset_determined,
            "the rotation": self.rotation_determined,
        }
        if self.turns:
            parts["the camera's position"] = self.position_determined
        shown = [name for name, is_shown in parts.items() if is_shown]
        whole = {"the rotation": "the whole rotation"}
        hidden = [whole.get(name, name) for name in parts if name not in shown]
        if not hidden:
            return f"This drive will show {_listed(shown, 'and')}."
        if not shown:
            return f"This drive will show neither {_listed(hidden, 'nor')}."
        return f"This drive will show {_listed(shown, 'and')}, but not {_listed(hidden, 'nor')}."

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
        if self.turns and not self.position_determined:
            found.append(TURN_BOTH_WAYS)
        return tuple(found)


TURN_BOTH_WAYS = (
    "Drive curves to both sides at changing speed (figure-eights), turning by 90 deg and more: a"
    " constant circle takes the camera's position for a rotation."
)


def _listed(names: list[str], word: str) -> str:
    return f" {word} ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def predict(
    velocities: VelocitySeries,
    *,
    viewing: Viewing = USUAL,
    speed: bool = True,
    max_offset: float = 1.0,
    systematic: Systematic = SYSTEMATIC,
) -> Prediction:
    """Predict how well a drive determines offset, rotation and the camera's position.

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
    systematic : Systematic
        What all observations of a drive share.

    Returns
    -------
    Prediction
        With what all observations share added.

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
    Cramer & Rao's bound of what `evcalib.joint.refine_jointly` fits, for a camera about where
    `viewing` has it.  The rotation is known to half a turn beforehand, the offset to the width of
    the search, the position to a metre.  Without a yaw rate the body is taken to keep its heading,
    nearly.
    """
    checks.instance(velocities, "velocities", VelocitySeries)
    checks.positive(max_offset, "max_offset", "seconds")
    known = information(velocities, viewing, systematic, speed)
    known[ROTATION, ROTATION] += np.pi**-2 * np.eye(3)
    known[OFFSET, OFFSET] += max_offset**-2
    known[POSITION, POSITION] += POSITION_PRIOR**-2 * np.eye(2)
    places = np.r_[np.arange(TOGETHER)[ROTATION], OFFSET, np.arange(TOGETHER)[POSITION]]
    covariance = np.asarray(np.linalg.inv(known)[np.ix_(places, places)], dtype=np.float64)
    floor = [systematic.rotation_sd**2] * 3 + [systematic.time_sd**2]
    covariance += np.diag([*floor, 0.0, 0.0])
    shifts = np.linspace(-max_offset, max_offset, 1 + 2 * max(round(max_offset / 0.02), 1))
    likeness = self_likeness(velocities, shifts, speed=speed)
    return Prediction(
        offset_sd=float(np.sqrt(covariance[3, 3])),
        rotation_sd=np.sqrt(np.diag(covariance)[:3]),
        position_sd=np.sqrt(np.diag(covariance)[4:]),
        covariance=covariance,
        turns=velocities.turning > TURNING,
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

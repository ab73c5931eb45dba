"""Where the camera sits on the body, and each unknown of a calibration with how sure it is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import stats

from evcalib.joint import SURE, JointRefinement
from evcalib.pipeline._assessment import RefinedCalibration
from evcalib.pipeline._turning import TURNS

MAX_POSITION_SD = 0.1
"""A coordinate less sure than this [m] counts as not determined: a choice, about what the eye tells
of a mounting, as `MAX_ROTATION_SD` is for angles."""

TAPE = 0.01
"""Standard deviation of a position that was given [m], per axis: a choice, of a tape measure and an
optical centre that nobody sees."""

FIGURE_EIGHTS = (
    "Drive figure-eights or a slalom at a changing speed, turning by 30 degrees per second and more"
    " to either side: they show the rotation, the offset and where the camera sits (x, y)."
)

HEIGHT = "Measure the height and give it (camera_height, --camera-height)."


class Told(NamedTuple):
    """What the user says of the camera's place on the body [m]; None where nothing."""

    position: tuple[float, float] | None = None
    height: float | None = None

    @property
    def lever(self) -> tuple[float, float, float]:
        """Where to expect the camera: at the origin, where nothing is said."""
        x, y = self.position or (0.0, 0.0)
        return x, y, self.height or 0.0


@dataclass(frozen=True)
class Unknown:
    """One of the unknowns, and whether the motion determines it.

    Attributes
    ----------
    name : str
        ``rotation``, ``offset``, ``x``, ``y`` or ``z``; the last three are the camera's position.
    determined : bool
        Whether the motion determines it.
    sd : float
        Standard deviation, in `unit`; inf where it is not known at all.
    unit : str
        ``deg``, ``s`` or ``m``.
    reason : str
        Why it is or is not determined.
    advice : str
        What motion would tell, or nothing.
    """

    name: str
    determined: bool
    sd: float
    unit: str
    reason: str
    advice: str = ""

    def __str__(self) -> str:
        exact = f" (sd {self.sd:.3g} {self.unit})" if np.isfinite(self.sd) else ""
        answer = "determined" if self.determined else "not determined"
        return " ".join(f"{self.name} {answer}{exact}: {self.reason} {self.advice}".split())


def contradicts(joint: JointRefinement, told: Told) -> bool:
    """Tell whether a refinement's own position contradicts the one that was given."""
    if told.position is None:
        return False
    apart = joint.position[:2] - told.position
    covariance = joint.covariance[4:6, 4:6] + TAPE**2 * np.eye(2)
    square = float(apart @ np.linalg.solve(covariance, apart))
    # As rare as SURE standard deviations of one number.
    return square > stats.chi2.isf(2 * stats.norm.sf(SURE), 2)


def positioned(
    found: RefinedCalibration,
    told: Told,
    turning: float,
    free: JointRefinement | None,
    *,
    trusted: bool = True,
) -> RefinedCalibration:
    """Return a calibration with the camera's position and a verdict on each unknown.

    Parameters
    ----------
    found : RefinedCalibration
        With its rotation and offset judged.
    told : Told
        What the user says.
    turning : float
        Yaw rate of the body beyond noise [rad/s], root mean square.
    free : JointRefinement, optional
        The refinement that estimated the position; None where none did.
    trusted : bool
        Whether its position may count as determined.
    """
    place, sd = np.array([*(told.position or (np.nan, np.nan)), np.nan]), np.full(3, np.inf)
    if told.height is not None:
        place[2] = told.height
    known = np.zeros(3, dtype=np.bool_)
    if free is not None:
        sd[:2] = np.sqrt(np.diag(free.covariance)[4:6])
        known[:2] = trusted & (sd[:2] <= MAX_POSITION_SD)
        own = known[:2] & (told.position is None or contradicts(free, told))
        place[:2] = np.where(own, free.position[:2], place[:2])
    unknowns = (
        _rotation(found),
        _offset(found),
        *(_coordinate(k, found, told, turning, sd[k], bool(known[k])) for k in range(2)),
        _height(told),
    )
    verdict = found.verdict
    if turning > TURNS:
        said = tuple(one.reason for one in unknowns[2:4])
        more = () if known[:2].all() else (FIGURE_EIGHTS,)
        verdict = replace(
            verdict,
            reasons=(*verdict.reasons, *dict.fromkeys(said)),
            advice=tuple(dict.fromkeys((*verdict.advice, *more))),
        )
    if free is not None and contradicts(free, told):
        verdict = verdict.doubted(_contradiction(free, told))
    return replace(
        found,
        position=place,
        position_sd=sd,
        position_observable=(bool(known[0]), bool(known[1])),
        unknowns=unknowns,
        verdict=verdict,
    )


def _contradiction(free: JointRefinement, told: Told) -> str:
    assert told.position is not None
    sd = np.sqrt(np.diag(free.covariance)[4:6])
    there, given = free.position[:2], np.asarray(told.position)
    return (
        f"The camera sits {100 * np.hypot(*(there - given)):.1f} cm from where it was said to be:"
        f" at x = {there[0]:.3f} +- {sd[0]:.3f} m, y = {there[1]:.3f} +- {sd[1]:.3f} m in the body,"
        f" not at ({given[0]:g}, {given[1]:g}); that is used. Look at the position given, and at"
        " which point of the body the velocities are of."
    )


def _rotation(found: RefinedCalibration) -> Unknown:
    sd = float(np.degrees(found.rotation_sd))
    if found.rotation_observable:
        radius = np.degrees(found.rotation_radius)
        return Unknown("rotation", True, sd, "deg", f"error below {radius:.2f} deg (95 %)")
    if found.unknown_axis is not None:
        x, y, z = found.unknown_axis
        reason = f"unknown about the body axis ({x:.2f}, {y:.2f}, {z:.2f})"
    else:
        reason = "depends on the offset, which is not determined"
    return Unknown("rotation", False, sd, "deg", reason, FIGURE_EIGHTS)


def _offset(found: RefinedCalibration) -> Unknown:
    sd = float(found.offset_sd)
    low, high = found.offset_interval
    if found.offset_observable:
        return Unknown("offset", True, sd, "s", f"from {low:+.4f} to {high:+.4f} s (95 %)")
    reason = "the motion changes too little to tell it"
    return Unknown("offset", False, sd, "s", reason, FIGURE_EIGHTS)


def _coordinate(
    k: int, found: RefinedCalibration, told: Told, turning: float, sd: float, known: bool
) -> Unknown:
    name = "xy"[k]
    if known:
        reason = f"Turning shows where the camera sits: {name} to {100 * sd:.1f} cm (sd)."
        return Unknown(name, True, sd, "m", reason)
    given = "" if told.position is None else "; taken as given"
    if turning <= TURNS:
        reason = f"The body does not turn, so that all places on it move alike{given}."
    elif not found.rotation_observable:
        reason = (
            "The body turns about one point all the time, or at a constant rate: the camera's"
            f" position trades with its yaw{given}."
        )
    else:
        reason = (
            f"The motion does not show the camera's {name} (sd {min(sd, 99.0):.2g} m): it turns too"
            f" little, or nearly about one point{given}."
        )
    return Unknown(name, False, sd, "m", reason, FIGURE_EIGHTS)


def _height(told: Told) -> Unknown:
    given = "" if told.height is None else "; taken as given"
    reason = f"Motion in a plane does not show the height of the camera{given}."
    return Unknown("z", False, np.inf, "m", reason, "" if told.height is not None else HEIGHT)

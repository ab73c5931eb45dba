"""The verdict in words: what was found, what the motion could not tell, and what drive would."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evcalib.alignment.observability import FOLLOW_GATE, RATE_GATE, DirectionSpread, axis_name
from evcalib.alignment.rotation import Mixture
from evcalib.arrays import Floats
from evcalib.display import Shown
from evcalib.uncertainty import NoiseModel

TURN_MORE = (
    "Drive curves whose rate of turning changes: S-curves or fingers with the direction of travel"
    " swinging by 30 degrees or more within a few seconds. Straight lines and arcs at a constant"
    " rate cannot show the offset."
)

MAX_TURNING = 0.05
"""Yaw rate of the body [rad/s] above which the verdict warns."""

SEARCH_FURTHER = "Search further: raise max_offset (--max-offset)."

SEARCH_LESS = (
    "Search less far (max_offset, --max-offset: below half the period of the motion), or drive"
    " curves that do not repeat themselves."
)

SPREAD_MORE = (
    "Drive in at least two directions 30 degrees or more apart (an omni-directional vehicle can do"
    " so without turning its body)."
)


@dataclass(frozen=True, eq=False)
class Diagnostics(Shown):
    """What the verdict rests on.

    Attributes
    ----------
    heading_rate_z : float
        Variation of the body's heading rate in standard deviations.
    follows_z : float
        Standard errors by which the headings prefer the real track to one that turns steadily.
    spread : DirectionSpread
        Spread of the body directions.
    mixture : Mixture
        Noise of the headings per tangent axis [rad], and shares of inliers, flips and outliers.
    noise : NoiseModel
        Correlation of the residuals over time.
    independent_headings : float
        Effective number of independent headings.
    second_peak_ratio : float
        Height of the curve's second peak over the first.
    plausible : ndarray, shape (k,)
        Offsets [s] on the grid that the data cannot tell from the best one.
    offset_matters : float
        Largest change of the rotation [rad] over the plausible offsets.
    offset_sensitivity : float
        Change of the rotation per second of offset [rad/s].
    agrees : bool
        Whether the headings agree with the odometry beyond what chance would do.
    body_turns : float
        Root mean square yaw rate of the body [rad/s]; 0 where the velocities do not tell it.
    at_edge : bool
        Whether the best offset lies on the border of the search.
    sharp_turns : bool
        Whether the motion has instant turns, so that errors are bootstrapped.
    """

    heading_rate_z: float
    follows_z: float
    spread: DirectionSpread
    mixture: Mixture
    noise: NoiseModel
    independent_headings: float
    second_peak_ratio: float
    plausible: Floats
    offset_matters: float
    offset_sensitivity: float
    agrees: bool
    body_turns: float
    at_edge: bool
    sharp_turns: bool


@dataclass(frozen=True)
class Verdict:
    """The result in words.

    Attributes
    ----------
    summary : str
        One sentence.
    reasons : tuple of str
        What it rests on.
    advice : tuple of str
        What drive would tell what is unknown.
    doubts : tuple of str
        Those of the reasons that speak against the model: the answer may be farther from the truth
        than its error bars.
    """

    summary: str
    reasons: tuple[str, ...]
    advice: tuple[str, ...]
    doubts: tuple[str, ...] = ()

    def __str__(self) -> str:
        return " ".join((self.summary, *self.reasons, *self.advice))


def judge(
    diagnostics: Diagnostics,
    *,
    offset_observable: bool,
    rotation_observable: bool,
    offset_sd: float,
    offset_interval: tuple[float, float],
    unknown_axis: Floats | None,
    searched: float | None,
    given: float | None,
    used: float,
    estimate: float,
) -> Verdict:
    """Put the diagnostics into words.

    Parameters
    ----------
    diagnostics : Diagnostics
        What was measured.
    offset_observable, rotation_observable : bool
        What is determined.
    offset_sd : float
        Standard deviation of the offset [s].
    offset_interval : tuple of (float, float)
        95 % interval of the offset [s].
    unknown_axis : ndarray, shape (3,), optional
        Body axis about which the rotation is unknown.
    searched : float, optional
        Half width of the search [s]; None if there was none.
    given : float, optional
        Offset [s] that the user gave.
    used : float
        Offset [s] that the rotation is for.
    estimate : float
        Offset [s] of the best score.
    """
    reasons: list[str] = []
    advice: list[str] = []
    if not diagnostics.agrees:
        reasons.append(
            "The headings agree with the odometry no better than chance would let a few of any"
            f" headings do ({diagnostics.independent_headings:.1f} independent ones agree)."
        )
        advice.append("Look at the headings, and at which log belongs to which drive.")
    if not offset_observable:
        reason, remedy = _why_not_observable(diagnostics, offset_sd, searched, estimate)
        reasons.append(reason)
        advice.extend(remedy)
        reasons.append(_what_offset_does(diagnostics, rotation_observable, given, used))
    elif given is not None and not offset_interval[0] <= given <= offset_interval[1]:
        low, high = offset_interval
        reasons.append(
            f"The offset of {given:g} s that was given is not used: the motion determines it, from"
            f" {low:.4f} to {high:.4f} s (95 %)."
        )
    if unknown_axis is not None:
        spread = np.degrees(diagnostics.spread.spread)
        reasons.append(
            f"The directions of travel spread by only {spread:.1f} deg (rms) around"
            f" {axis_name(diagnostics.spread.axis)}, so the rotation about"
            f" {axis_name(unknown_axis)} is unknown."
        )
        advice.append(SPREAD_MORE)
    if diagnostics.body_turns > MAX_TURNING:
        reasons.append(
            f"The body turns at {diagnostics.body_turns:.2f} rad/s (rms): a camera away from its"
            " origin then moves in another direction, which these error bars do not count."
        )
        advice.append("Remove the rows that turn (evcalib velocities --max-yaw-rate).")
    if diagnostics.mixture.flipped > 0.2:
        share = 100 * diagnostics.mixture.flipped
        reasons.append(f"{share:.0f} % of the headings point backwards: check their sign.")
    if diagnostics.mixture.inliers < 0.3:
        share = 100 * diagnostics.mixture.inliers
        reasons.append(f"Only {share:.0f} % of the headings agree with the result.")
    if not diagnostics.agrees:
        summary = "The headings do not agree with the odometry: nothing is determined."
    else:
        summary = _summary(offset_observable, rotation_observable, searched, unknown_axis)
    return Verdict(summary, tuple(reasons), tuple(advice))


def _summary(
    offset: bool, rotation: bool, searched: float | None, unknown_axis: NDArray | None
) -> str:
    if rotation and offset:
        return "The motion determines the rotation and the offset."
    if rotation and searched is None:
        return "The rotation is determined, with the offset as given."
    if rotation:
        return "The motion determines the rotation; the offset is not observable."
    if offset:
        return "The motion determines the offset, but not the whole rotation."
    if unknown_axis is not None:
        return "The motion determines neither the offset nor the whole rotation."
    return "The motion determines neither the offset nor the rotation, which depends on it."


def _why_not_observable(
    diagnostics: Diagnostics, offset_sd: float, searched: float | None, estimate: float
) -> tuple[str, list[str]]:
    """Return the reason, and what would help."""
    if searched is None:
        return "The offset was not searched.", []
    if diagnostics.heading_rate_z < RATE_GATE:
        return (
            "The offset is not observable: the direction of travel does not turn at a changing rate"
            f" (z = {diagnostics.heading_rate_z:.1f}, {RATE_GATE:g} is needed)."
        ), [TURN_MORE]
    if diagnostics.at_edge:
        return (
            "The offset is not observable: the best score lies on the border of the search"
            f" (+-{searched:g} s); the true offset may lie outside."
        ), [SEARCH_FURTHER]
    if diagnostics.follows_z < FOLLOW_GATE:
        return (
            "The offset is not observable: the headings do not follow the turns of the odometry any"
            f" better than a steady turn (z = {diagnostics.follows_z:.1f}, {FOLLOW_GATE:g} needed)."
        ), [TURN_MORE]
    if offset_sd >= searched / 4:
        return (
            "The offset is not observable: the direction of travel turns too little for the noise"
            f" (standard deviation {offset_sd:.2g} s within a search of +-{searched:g} s)."
        ), [TURN_MORE]
    low = diagnostics.plausible.min(initial=estimate)
    high = diagnostics.plausible.max(initial=estimate)
    return (
        f"The offset is not observable: offsets from {low:.2f} to {high:.2f} s fit about as"
        f" well as the best ({estimate:.3f} s), as they do where a motion repeats itself."
    ), [SEARCH_LESS]


def _what_offset_does(
    diagnostics: Diagnostics, rotation: bool, given: float | None, used: float
) -> str:
    change = np.degrees(diagnostics.offset_matters)
    rate = np.degrees(diagnostics.offset_sensitivity)
    if given is not None:
        return (
            f"The offset of {given:g} s that was given is used; each 10 ms of error in it turns the"
            f" rotation by {0.01 * rate:.2g} deg."
        )
    if rotation:
        return (
            "This does not matter to the rotation, which changes by at most"
            f" {change:.1f} deg over the plausible offsets; {used:g} s is used."
        )
    return (
        f"The rotation changes by up to {change:.1f} deg over the plausible offsets; {used:g} s is"
        " used: give the offset, if it is known."
    )

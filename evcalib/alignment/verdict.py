"""The verdict in words: what was found, what the motion could not tell, and what drive would."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from evcalib.alignment._answers import OffsetAnswer, RotationAnswer
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
"""Yaw rate of the body [rad/s] above which the verdict warns: a camera 0.3 m from the origin then
moves by 1.7 degrees otherwise than the body, at 0.5 m/s."""

MANY_FLIPPED, FEW_INLIERS = 0.2, 0.3
"""Shares beyond which the verdict warns: search and rotation were tried with up to 40 % of the
signs turned and 60 % of outliers (`tests/montecarlo.py`)."""

SEARCH_FURTHER = "Search further: raise max_offset (--max-offset)."

SEARCH_LESS = (
    "Search less far (max_offset, --max-offset: below half the period of the motion), or drive"
    " curves that do not repeat themselves."
)

SPREAD_MORE = (
    "Drive in at least two directions 30 degrees or more apart (an omni-directional vehicle can do"
    " so without turning its body)."
)

TURN_OTHERWISE = (
    "Drive figure-eights or a slalom at a changing speed, turning to either side: constant circles"
    " and turns in place hide the rest."
)

DISAGREE = "The headings do not agree with the odometry: nothing is determined."

CONTRADICTED = "Headings and sightings contradict each other: nothing is determined."

BUT = "But the data contradict the model."

NO_CAUSE = (
    "No cause shows: another unit of one speed and another frame of the velocities were tried. Look"
    " at the headings, at the camera file, and whether both logs are of one drive."
)

PIXEL_DELAY = (
    "The pixels' own delay is part of the offset and cannot be told from it: about 2 ms at a"
    " bandwidth of 200 Hz, 9 ms at 50 Hz, 22 ms at 20 Hz (dim light, low bias currents)."
)
"""What no drive can tell; the figures are those of pixels as low-pass filters of first order in a
simulated room."""


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
    turning_counted : bool
        Whether rotation and error bars take account of the turning of the body.
    cause : str
        What would make headings agree that do not, as advice; nothing where none was found.
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
    turning_counted: bool = False
    cause: str = ""


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

    def doubted(self, *doubts: str) -> Verdict:
        """Return the verdict with more doubts, which are reasons too."""
        if not doubts:
            return self
        plain = bool(self.doubts) or self.summary in (DISAGREE, CONTRADICTED)
        summary = self.summary if plain else f"{self.summary} {BUT}"
        reasons = (*self.reasons, *doubts)
        return replace(self, summary=summary, reasons=reasons, doubts=(*self.doubts, *doubts))

    def __str__(self) -> str:
        return " ".join((self.summary, *self.reasons, *self.advice))


def judge(diagnostics: Diagnostics, offset: OffsetAnswer, rotation: RotationAnswer) -> Verdict:
    """Put what was found into words.

    Parameters
    ----------
    diagnostics : Diagnostics
        What was measured.
    offset, rotation : OffsetAnswer, RotationAnswer
        What is determined, and how well.

    Returns
    -------
    Verdict
        Without doubts, which come from later stages.
    """
    agreement = _about_agreement(diagnostics)
    if diagnostics.cause and not diagnostics.agrees:
        # What else does not fit follows from the same cause.
        return Verdict(DISAGREE, *(tuple(some) for some in agreement))
    said = (
        agreement,
        _about_offset(diagnostics, offset, rotation.determined),
        _about_axis(diagnostics, rotation.unknown_axis),
        _about_body(diagnostics),
        _about_shares(diagnostics),
    )
    reasons = tuple(reason for some, _ in said for reason in some)
    advice = tuple(remedy for _, some in said for remedy in some)
    if not diagnostics.agrees:
        summary = DISAGREE
    else:
        summary = _summary(offset, rotation)
    return Verdict(summary, reasons, advice)


Said = tuple[list[str], list[str]]
"""Reasons, and advice."""


def _about_agreement(diagnostics: Diagnostics) -> Said:
    if diagnostics.agrees:
        return [], []
    return [
        "The headings agree with the odometry no better than chance would let a few of any"
        f" headings do ({diagnostics.independent_headings:.1f} independent ones agree)."
    ], [diagnostics.cause or NO_CAUSE]


def _about_offset(diagnostics: Diagnostics, offset: OffsetAnswer, rotation: bool) -> Said:
    if not offset.observable:
        reason, remedy = _why_not_observable(diagnostics, offset)
        return [reason, _what_offset_does(diagnostics, offset, rotation)], remedy
    low, high = offset.interval
    if offset.given is None or low <= offset.given <= high:
        return [], []
    return [
        f"The offset of {offset.given:g} s that was given is not used: the motion determines it,"
        f" from {low:.4f} to {high:.4f} s (95 %)."
    ], []


def _about_axis(diagnostics: Diagnostics, unknown_axis: Floats | None) -> Said:
    if unknown_axis is None:
        return [], []
    if diagnostics.turning_counted and diagnostics.body_turns > MAX_TURNING:
        return [
            f"The motion does not show the rotation about {axis_name(unknown_axis)}: the body turns"
            " always alike, or about one point."
        ], [TURN_OTHERWISE]
    return [
        f"The directions of travel spread by only {np.degrees(diagnostics.spread.spread):.1f} deg"
        f" (rms) around {axis_name(diagnostics.spread.axis)}, so the rotation about"
        f" {axis_name(unknown_axis)} is unknown."
    ], [SPREAD_MORE]


def _about_body(diagnostics: Diagnostics) -> Said:
    if diagnostics.turning_counted or diagnostics.body_turns <= MAX_TURNING:
        return [], []
    return [
        f"The body turns at {diagnostics.body_turns:.2f} rad/s (rms): a camera away from its"
        " origin then moves in another direction, which these error bars do not count."
    ], ["Calibrate from the recording itself (evcalib calibrate): that takes account of turning."]


def _about_shares(diagnostics: Diagnostics) -> Said:
    reasons = []
    if diagnostics.mixture.flipped > MANY_FLIPPED:
        share = 100 * diagnostics.mixture.flipped
        reasons.append(f"{share:.0f} % of the headings point backwards: check their sign.")
    if diagnostics.mixture.inliers < FEW_INLIERS:
        share = 100 * diagnostics.mixture.inliers
        reasons.append(f"Only {share:.0f} % of the headings agree with the result.")
    return reasons, []


def _summary(offset: OffsetAnswer, rotation: RotationAnswer) -> str:
    if rotation.determined and offset.observable:
        return "The motion determines the rotation and the offset."
    if rotation.determined and offset.searched is None:
        return "The rotation is determined, with the offset as given."
    if rotation.determined:
        return "The motion determines the rotation; the offset is not observable."
    if offset.observable:
        return "The motion determines the offset, but not the whole rotation."
    if rotation.unknown_axis is not None:
        return "The motion determines neither the offset nor the whole rotation."
    return "The motion determines neither the offset nor the rotation, which depends on it."


def _why_not_observable(diagnostics: Diagnostics, offset: OffsetAnswer) -> tuple[str, list[str]]:
    """Return the reason, and what would help."""
    searched, estimate = offset.searched, offset.estimate
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
    if offset.fit_sd >= searched / 4:
        return (
            "The offset is not observable: the direction of travel turns too little for the noise"
            f" (standard deviation {offset.fit_sd:.2g} s within a search of +-{searched:g} s)."
        ), [TURN_MORE]
    low = diagnostics.plausible.min(initial=estimate)
    high = diagnostics.plausible.max(initial=estimate)
    return (
        f"The offset is not observable: offsets from {low:.2f} to {high:.2f} s fit about as"
        f" well as the best ({estimate:.3f} s), as they do where a motion repeats itself."
    ), [SEARCH_LESS]


def _what_offset_does(diagnostics: Diagnostics, offset: OffsetAnswer, rotation: bool) -> str:
    given, used = offset.given, offset.used
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

"""The calibration after the joint refinement, judged anew."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from evcalib.alignment import (
    Calibration,
    OffsetAnswer,
    RotationAnswer,
    StreamPair,
    one_answer,
    unknown_axis,
)
from evcalib.alignment.observability import (
    RATE_GATE,
    direction_spread,
    heading_rate_test,
    speed_test,
)
from evcalib.alignment.registration import Residuals, Solution
from evcalib.alignment.verdict import CONTRADICTED, Verdict, judge
from evcalib.arrays import Floats
from evcalib.display import Rows
from evcalib.joint import SURE, JointRefinement
from evcalib.kinematics.velocity_track import VelocityTrack
from evcalib.pipeline._stage_agreement import STRAINED, StageAgreement, strain
from evcalib.pipeline._turning import yaw_rate_changes
from evcalib.series import HeadingSeries, VelocitySeries
from evcalib.uncertainty import UNKNOWN, rotation_sd, t_quantile

ENOUGH = 0.3
"""Least share of the observations that a refinement must meet to be believed.

With half of the observations false, 0.37 is met; with the odometry of another drive, 0.11 to 0.37,
of which the sharpness of the offset must refuse the rest (measured on the drives of
tests/test_joint.py).
"""

TURNING = 0.02
"""Yaw rate [rad/s], rms, that the odometry may leave untold.  1.1 deg/s, just above the least that
the campaign hides from the wheels (1 to 6 deg/s): 60 of 97 such drives are doubted, and none of the
37 that are not lies outside its 99 % interval (tests/campaign.csv, `not told`)."""


MAJORITY = 0.5
"""Share of the observations that a refinement must meet where the headings agree with the odometry
no better than chance.  With the odometry of another drive at most 0.37 are met (`ENOUGH`); of 100
simulated drives seven had such headings, all of bodies that turn: 0.69 to 0.97 were met, and all
answers right."""


@dataclass(frozen=True, eq=False)
class RefinedCalibration(Calibration):
    """A calibration after the joint refinement.

    Attributes
    ----------
    joint : JointRefinement, optional
        The refinement; None where there was none, or it was not believed.
    agreement : StageAgreement, optional
        How far it is from the alignment.
    position : ndarray, shape (3,)
        Where the camera sits in the body frame [m]: as the turning of the body shows it, else as it
        was given, else NaN.  No motion in a plane shows z.
    position_sd : ndarray, shape (3,)
        Standard deviations [m]; inf where the motion shows nothing.
    position_observable : tuple of bool
        Whether the motion determines x and y.
    unknowns : tuple of Unknown
        Rotation, offset, x, y and z: each with its error bar, why it is known or not, and what
        motion would tell.
    """

    joint: JointRefinement | None = None
    agreement: StageAgreement | None = None
    position: Floats = field(default_factory=lambda: np.full(3, np.nan))
    position_sd: Floats = field(default_factory=lambda: np.full(3, np.inf))
    position_observable: tuple[bool, bool] = (False, False)
    unknowns: tuple[Any, ...] = ()

    @property
    def covariance(self) -> Floats:
        """Covariance (6, 6) of rotation vector [rad], offset [s], x and y [m].

        Diagonals are those of the error bars, inf where nothing is known; correlations are those
        that the refinement found.
        """
        sd = np.sqrt(np.append(np.diag(self.rotation_covariance), self.offset_sd**2))
        sd = np.append(sd, self.position_sd[:2])
        correlation = np.eye(6)
        if self.joint is not None:
            own = np.sqrt(np.diag(self.joint.covariance))
            scale = np.where(own > 0, own, np.inf)
            correlation = self.joint.covariance / np.outer(scale, scale)
            correlation[np.diag_indices(6)] = 1.0
        known = np.isfinite(sd)
        out = np.diag(sd**2)
        block = np.ix_(known, known)
        out[block] = correlation[block] * np.outer(sd[known], sd[known])
        out[:3, :3] = self.rotation_covariance
        return out

    def _shown_rows(self) -> Rows:
        """Return the rows of a calibration, and the position."""
        own = {"position", "position_sd", "position_observable", "unknowns"}
        rows = [row for row in super()._shown_rows() if row[0] not in own]
        names = [row[0] for row in rows]
        at = names.index("mounting") + 1 if "mounting" in names else len(rows)
        return [*rows[:at], ("position", position_text(self)), *rows[at:]]

    @property
    def samples(self) -> float:
        """Independent stretches of motion behind the error bars."""
        if self.joint is None or not self.offset_observable:
            return super().samples
        return self.joint.samples

    @classmethod
    def after(cls, aligned: Calibration, **changes: Any) -> RefinedCalibration:
        """Return an alignment's answer with what the refinement changed."""
        kept = {f.name: getattr(aligned, f.name) for f in fields(Calibration)}
        return cls(**{**kept, **changes})


def position_text(found: RefinedCalibration) -> str:
    """Return the camera's position in words, a coordinate each.

    Parameters
    ----------
    found : RefinedCalibration
        With its position.

    Returns
    -------
    str
        Value and standard deviation, or "as given", or "not seen".
    """
    words = []
    for name, value, sd, seen in zip(
        "xyz", found.position, found.position_sd, (*found.position_observable, False), strict=True
    ):
        if seen:
            words.append(f"{name} {value:+.3f} +- {sd:.3f} m (sd)")
        elif np.isfinite(value):
            words.append(f"{name} {value:+.3f} m as given")
        else:
            words.append(f"{name} not seen")
    return ", ".join(words)


def offset_observable(
    joint: JointRefinement,
    track: VelocityTrack,
    max_offset: float,
    velocities: VelocitySeries | None = None,
) -> bool:
    """Tell whether the tracks determine the offset: one peak, inside the search, and sharp.

    And whether the motion changes at all: among many candidates of an unchanging one, noise of the
    odometry makes one stand out.  Of `velocities` the yaw rate may change, too.
    """
    if joint.curve is None or joint.curve.at_edge or joint.inlier_share < ENOUGH:
        return False
    if not motion_changes(joint, track, velocities):
        return False
    widest = max_offset / 4
    sharp = float(np.sqrt(joint.covariance[3, 3])) < widest
    return sharp and one_answer(joint.plausible, joint.offset, widest)


def motion_changes(
    joint: JointRefinement, track: VelocityTrack, velocities: VelocitySeries | None = None
) -> bool:
    """Tell whether speed, or the rate of turning, changes beyond the odometry's noise."""
    part = joint.span[0] + joint.offset, joint.span[1] + joint.offset
    yaw = 0.0 if velocities is None else yaw_rate_changes(velocities, track, *part)
    return max(heading_rate_test(track, *part), speed_test(track, *part), yaw) >= RATE_GATE


def finish(
    aligned: Calibration,
    joint: JointRefinement,
    headings: HeadingSeries,
    track: VelocityTrack,
    max_offset: float,
    *,
    turning: float = 0.0,
) -> RefinedCalibration:
    """Put a refinement that determines the offset in the place of the alignment's answer.

    Parameters
    ----------
    aligned : Calibration
        From `evcalib.align`.
    joint : JointRefinement
        From `evcalib.joint.refine_jointly`, with the offset estimated.
    headings, track
        What was aligned; residuals and agreement are those of the headings at the refined values.
    max_offset : float
        Half width of the search [s].
    turning : float
        Yaw rate of the body [rad/s], rms, where turning leads: what it shows of the rotation, the
        spread of directions does not tell.

    Returns
    -------
    RefinedCalibration
        The refinement's answer, with a verdict of its own.
    """
    solution = Solution.at(StreamPair.of(headings, track), joint.offset, "tukey")
    spread = direction_spread(solution.residuals.direction, track)
    covariance = joint.covariance[:3, :3]
    unknown = unknown_axis(covariance, replace(spread, spread=np.pi) if turning else spread)
    if unknown is not None:
        covariance = covariance + UNKNOWN * np.outer(unknown, unknown)
    seen = solution.R if solution.agrees else None
    given_offset = solution.covariance.rotation_given_offset
    # The offset of headings whose turning was taken out at the refinement's is no second opinion.
    apart = None if turning else aligned
    agreement = StageAgreement.of(seen, given_offset, joint, spread, apart)
    # Turns that the odometry tells move a camera as the headings' alignment does not count.
    backed = solution.agrees or joint.inlier_share >= MAJORITY
    believed = backed and not agreement.gross
    rotation = RotationAnswer(
        joint.R_body_cam, covariance, joint.samples, unknown, unknown is None and believed
    )
    sd = float(np.sqrt(joint.covariance[3, 3]))
    half = t_quantile(joint.samples) * sd
    offset = OffsetAnswer(
        used=joint.offset,
        estimate=joint.offset,
        sd=sd,
        interval=_interval(aligned, joint.offset, half, believed),
        observable=believed,
        fit_sd=sd,
        searched=max_offset,
        given=aligned.settings.get("offset"),
    )
    diagnostics = replace(
        aligned.diagnostics,
        spread=spread,
        mixture=solution.mixture,
        noise=solution.noise,
        independent_headings=solution.covariance.samples,
        second_peak_ratio=joint.curve.second_peak_ratio if joint.curve else 0.0,
        plausible=joint.plausible,
        agrees=backed,
        at_edge=False,
        offset_matters=0.0,
        body_turns=turning or aligned.diagnostics.body_turns,
        turning_counted=True,
    )
    how = _how(joint, diagnostics.heading_rate_z, turning)
    verdict = judge(diagnostics, offset, rotation)
    if agreement.gross:
        verdict = Verdict(CONTRADICTED, (), ())
    verdict = replace(verdict, reasons=(how, *verdict.reasons))
    found = RefinedCalibration.of(
        offset,
        rotation,
        diagnostics,
        _residuals(solution.residuals, headings, joint.R_body_cam),
        curve=joint.curve,
        verdict=verdict.doubted(*doubts_of(joint, headings, agreement)),
        settings=aligned.settings,
        joint=joint,
        agreement=agreement,
    )
    return _with_distortion(found, joint)


def _interval(
    aligned: Calibration, offset: float, half: float, believed: bool
) -> tuple[float, float]:
    """Return the interval of the offset [s]; that of the alignment too, where none is believed."""
    low, high = offset - half, offset + half
    if believed:
        return low, high
    return min(low, aligned.offset_interval[0]), max(high, aligned.offset_interval[1])


def _with_distortion(found: RefinedCalibration, joint: JointRefinement) -> RefinedCalibration:
    """Count what directions of travel differ by as an error that all of them may share.

    The two numbers of the distortion are two of many: errors of slip, focal length and principal
    point change the mean direction about as much as its course, and only the latter shows.  What
    noise explains is taken off.
    """
    if not np.isfinite(joint.distortion.covariance).all():
        return found
    square = np.sum(joint.distortion.values**2) - np.trace(joint.distortion.covariance)
    sd = float(np.sqrt(max(square, 0.0)))
    return found.widened(
        sd,
        because=f"Directions of travel differ by {np.degrees(sd):.1f} deg between camera and"
        " odometry, beyond noise: the rotation may be off by as much (sd).",
    )


def doubts_of(
    joint: JointRefinement, headings: HeadingSeries, agreement: StageAgreement
) -> tuple[str, ...]:
    """Return what the observations say against the model, in words."""
    doubts = [*agreement.doubts()]
    if joint.drift.z > SURE:
        ppm, sd = 1e6 * joint.drift.values[0], 1e6 * joint.drift.sd[0]
        half = 0.5 * float(np.ptp(headings.t))
        doubts.append(
            f"The clocks drift apart by {ppm:.0f} +- {sd:.0f} ppm: the offset holds in the middle"
            f" of the drive, and is {1e3 * half * abs(1e-6 * ppm):.1f} ms off at its ends."
        )
    if joint.distortion.z > SURE:
        most = np.degrees(np.hypot(*joint.distortion.values))
        doubts.append(
            f"Directions of travel differ by up to {most:.1f} deg between camera and odometry,"
            " whatever the rotation: check the camera's focal length and principal point, and"
            " whether wheels slip to one side."
        )
    if joint.turning > TURNING:
        doubts.append(
            f"The body turns by {np.degrees(joint.turning):.1f} deg/s (rms) that the odometry"
            " does not tell."
        )
    if not doubts and strain(joint, agreement, TURNING) > STRAINED:
        doubts.append(
            "Clocks, directions, turning, lag and headings each speak a little against the model,"
            " and together more than one drive in 300 does by chance."
        )
    return tuple(doubts)


def keep(
    aligned: Calibration, joint: JointRefinement, headings: HeadingSeries
) -> RefinedCalibration:
    """Take the rotation of a refinement at the alignment's offset; what is unknown stays so."""
    covariance, samples = aligned.rotation_covariance, aligned.diagnostics.independent_headings
    if np.trace(joint.covariance[:3, :3]) > np.trace(covariance):
        covariance, samples = joint.covariance[:3, :3], joint.samples
    rotation = RotationAnswer(joint.R_body_cam, covariance, samples)
    found = RefinedCalibration.after(
        aligned,
        R_body_cam=joint.R_body_cam,
        rotation_covariance=covariance,
        rotation_sd=rotation_sd(covariance),
        rotation_radius=rotation.radius,
        residuals=_residuals(aligned.residuals, headings, joint.R_body_cam),
        joint=joint,
    )
    return _with_distortion(compared(found, aligned, headings), joint)


def compared(
    found: RefinedCalibration, aligned: Calibration, headings: HeadingSeries
) -> RefinedCalibration:
    """Doubt what a refinement found at the alignment's own offset, or take it back."""
    joint, before = found.joint, aligned.diagnostics
    assert joint is not None
    seen = aligned.R_body_cam if before.agrees else None
    agreement = StageAgreement.of(seen, aligned.rotation_covariance, joint, before.spread)
    found = replace(found, agreement=agreement)
    if agreement.gross:
        found = replace(
            found,
            rotation_observable=False,
            offset_observable=False,
            verdict=Verdict(CONTRADICTED, found.verdict.reasons, ()),
        )
    return found.doubted(*doubts_of(joint, headings, agreement))


def _residuals(before: Residuals, headings: HeadingSeries, R: Floats) -> Residuals:
    """Return the residuals of the same headings under another rotation."""
    turned = headings.v[np.isin(headings.t, before.t)] @ R.T
    angle = 2 * np.arcsin(np.clip(0.5 * np.linalg.norm(turned - before.direction, axis=1), 0, 1))
    return replace(before, turned=turned, angle=angle)


def _how(joint: JointRefinement, rate_z: float, turning: float) -> str:
    shows = "the changes of speed" if rate_z < RATE_GATE else "turns and changes of speed"
    if turning:
        shows = "the turning of the body, and changes of speed"
    return (
        f"Refined on {joint.observations} sightings of {joint.tracks} corners"
        f" ({100 * joint.inlier_share:.0f} % followed, {joint.noise:.2f} px each): the offset shows"
        f" in {shows}."
    )

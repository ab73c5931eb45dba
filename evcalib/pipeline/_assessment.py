"""The calibration after the joint refinement, judged anew."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
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
from evcalib.joint import SURE, JointRefinement
from evcalib.kinematics.velocity_track import VelocityTrack
from evcalib.pipeline._agreement import STRAINED, Agreement, strain
from evcalib.series import HeadingSeries
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
    agreement : Agreement, optional
        How far it is from the alignment.
    """

    joint: JointRefinement | None = None
    agreement: Agreement | None = None

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


def offset_observable(joint: JointRefinement, track: VelocityTrack, max_offset: float) -> bool:
    """Tell whether the tracks determine the offset: one peak, inside the search, and sharp.

    And whether the motion changes at all: among many candidates of an unchanging one, noise of the
    odometry makes one stand out.
    """
    if joint.curve is None or joint.curve.at_edge or joint.inlier_share < ENOUGH:
        return False
    if not motion_changes(joint, track):
        return False
    widest = max_offset / 4
    sharp = float(np.sqrt(joint.covariance[3, 3])) < widest
    return sharp and one_answer(joint.plausible, joint.offset, widest)


def motion_changes(joint: JointRefinement, track: VelocityTrack) -> bool:
    """Tell whether speed, or the rate of turning, changes beyond the odometry's noise."""
    part = joint.span[0] + joint.offset, joint.span[1] + joint.offset
    return max(heading_rate_test(track, *part), speed_test(track, *part)) >= RATE_GATE


def finish(
    aligned: Calibration,
    joint: JointRefinement,
    headings: HeadingSeries,
    track: VelocityTrack,
    max_offset: float,
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

    Returns
    -------
    RefinedCalibration
        The refinement's answer, with a verdict of its own.
    """
    solution = Solution.at(StreamPair.of(headings, track), joint.offset, "tukey")
    spread = direction_spread(solution.residuals.direction, track)
    covariance = joint.covariance[:3, :3]
    unknown = unknown_axis(covariance, spread)
    if unknown is not None:
        covariance = covariance + UNKNOWN * np.outer(unknown, unknown)
    seen = solution.R if solution.agrees else None
    given_offset = solution.covariance.rotation_given_offset
    agreement = Agreement.of(seen, given_offset, joint, spread, aligned)
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
    )
    how = _how(joint, diagnostics.heading_rate_z)
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
    joint: JointRefinement, headings: HeadingSeries, agreement: Agreement
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
            f"The body turns by {np.degrees(joint.turning):.1f} deg/s (rms) that the odometry does"
            " not tell."
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
    before = aligned.diagnostics
    seen = aligned.R_body_cam if before.agrees else None
    agreement = Agreement.of(seen, aligned.rotation_covariance, joint, before.spread)
    verdict, contradicted = aligned.verdict, {}
    if agreement.gross:
        verdict = Verdict(CONTRADICTED, verdict.reasons, ())
        contradicted = {"rotation_observable": False, "offset_observable": False}
    found = RefinedCalibration.after(
        aligned,
        R_body_cam=joint.R_body_cam,
        rotation_covariance=covariance,
        rotation_sd=rotation_sd(covariance),
        rotation_radius=rotation.radius,
        residuals=_residuals(aligned.residuals, headings, joint.R_body_cam),
        verdict=verdict.doubted(*doubts_of(joint, headings, agreement)),
        joint=joint,
        agreement=agreement,
        **contradicted,
    )
    return _with_distortion(found, joint)


def _residuals(before: Residuals, headings: HeadingSeries, R: Floats) -> Residuals:
    """Return the residuals of the same headings under another rotation."""
    turned = headings.v[np.isin(headings.t, before.t)] @ R.T
    angle = 2 * np.arcsin(np.clip(0.5 * np.linalg.norm(turned - before.direction, axis=1), 0, 1))
    return replace(before, turned=turned, angle=angle)


def _how(joint: JointRefinement, rate_z: float) -> str:
    shows = "the changes of speed" if rate_z < RATE_GATE else "turns and changes of speed"
    return (
        f"Refined on {joint.observations} sightings of {joint.tracks} corners"
        f" ({100 * joint.inlier_share:.0f} % followed, {joint.noise:.2f} px each): the offset shows"
        f" in {shows}."
    )

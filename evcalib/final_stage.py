"""The calibration after the joint refinement, judged anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evcalib import uncertainty
from evcalib.calibration import one_answer, unknown_axis
from evcalib.joint import JointRefinement
from evcalib.observability import RATE_GATE, direction_spread
from evcalib.results import Calibration
from evcalib.series import HeadingSeries
from evcalib.solution import Residuals, Solution
from evcalib.track import VelocityTrack
from evcalib.verdict import judge

Floats = NDArray[np.float64]

ENOUGH = 0.3
"""Least share of the sightings that a refinement must follow to be believed."""


def offset_observable(joint: JointRefinement, max_offset: float) -> bool:
    """Tell whether the tracks determine the offset: one peak, inside the search, and sharp."""
    if joint.curve is None or joint.curve.at_edge or joint.inlier_share < ENOUGH:
        return False
    widest = max_offset / 4
    sharp = float(np.sqrt(joint.covariance[3, 3])) < widest
    return sharp and one_answer(joint.plausible, joint.offset, widest)


def finish(
    aligned: Calibration,
    joint: JointRefinement,
    headings: HeadingSeries,
    track: VelocityTrack,
    max_offset: float,
) -> Calibration:
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
    """
    solution = Solution.at(headings.usable(), track, joint.offset, "tukey")
    spread = direction_spread(solution.residuals.direction, track)
    covariance = joint.covariance[:3, :3]
    unknown = unknown_axis(covariance, spread)
    if unknown is not None:
        covariance = covariance + uncertainty.UNKNOWN * np.outer(unknown, unknown)
    determined = unknown is None
    sd = float(np.sqrt(joint.covariance[3, 3]))
    half = uncertainty.t_quantile(joint.samples) * sd
    interval = joint.offset - half, joint.offset + half
    diagnostics = replace(
        aligned.diagnostics,
        spread=spread,
        mixture=solution.mixture,
        noise=solution.noise,
        independent_headings=solution.covariance.samples,
        second_peak_ratio=joint.curve.second_peak_ratio if joint.curve else 0.0,
        plausible=joint.plausible,
        # One sharp peak over the offsets is agreement enough.
        agrees=True,
        at_edge=False,
        offset_matters=0.0,
    )
    verdict = judge(
        diagnostics,
        offset_observable=True,
        rotation_observable=determined,
        offset_sd=sd,
        offset_interval=interval,
        unknown_axis=unknown,
        searched=max_offset,
        given=aligned.settings.get("offset"),
        used=joint.offset,
        estimate=joint.offset,
    )
    return replace(
        aligned,
        R_body_cam=joint.R_body_cam,
        offset=joint.offset,
        offset_sd=sd,
        offset_interval=interval,
        offset_observable=True,
        rotation_sd=uncertainty.rotation_sd(covariance),
        rotation_covariance=covariance,
        rotation_radius=uncertainty.rotation_radius(covariance, samples=joint.samples),
        rotation_observable=determined,
        unknown_axis=unknown,
        inlier_share=solution.mixture.inliers,
        curve=joint.curve,
        residuals=_residuals(solution.residuals, headings, joint.R_body_cam),
        diagnostics=diagnostics,
        verdict=replace(
            verdict, reasons=(_how(joint, diagnostics.heading_rate_z), *verdict.reasons)
        ),
        joint=joint,
    )


def keep(aligned: Calibration, joint: JointRefinement, headings: HeadingSeries) -> Calibration:
    """Take the rotation of a refinement at the alignment's offset; what is unknown stays so."""
    covariance = aligned.rotation_covariance
    if np.trace(joint.covariance[:3, :3]) > np.trace(covariance):
        covariance = joint.covariance[:3, :3]
    return replace(
        aligned,
        R_body_cam=joint.R_body_cam,
        rotation_covariance=covariance,
        rotation_sd=uncertainty.rotation_sd(covariance),
        residuals=_residuals(aligned.residuals, headings, joint.R_body_cam),
        joint=joint,
    )


def _residuals(before: Residuals, headings: HeadingSeries, R: Floats) -> Residuals:
    """Return the residuals of the same headings under another rotation."""
    turned = headings.v[np.isin(headings.t, before.t)] @ R.T
    angle = 2 * np.arcsin(np.clip(0.5 * np.linalg.norm(turned - before.direction, axis=1), 0, 1))
    return replace(before, turned=turned, angle=angle)


def _how(joint: JointRefinement, rate_z: float) -> str:
    shows = "the changes of speed" if rate_z < RATE_GATE else "turns and changes of speed"
    return (
        f"Refined on {joint.sightings} sightings of {joint.tracks} corners"
        f" ({100 * joint.inlier_share:.0f} % followed, {joint.noise:.2f} px each): the offset shows"
        f" in {shows}."
    )

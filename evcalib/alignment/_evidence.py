"""What speaks for or against an offset, and what that leaves unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evcalib.alignment._stream_pair import intervals
from evcalib.alignment.observability import (
    FOLLOW_GATE,
    HEADING_BIAS,
    MAX_ROTATION_SD,
    RATE_GATE,
    DirectionSpread,
    heading_rate_test,
    steady_turning,
)
from evcalib.alignment.offset import STEP, OffsetCurve, candidate_offsets
from evcalib.alignment.offset_refinement import (
    RefinedOffset,
    plausible_offsets,
    preference,
)
from evcalib.alignment.registration import Solution, has_sharp_turns
from evcalib.arrays import Floats
from evcalib.kinematics.velocity_track import VelocityTrack
from evcalib.series import HeadingSeries
from evcalib.uncertainty import t_quantile

APART = 0.1
"""Plausible offsets with implausible ones of so much time [s] in between are different answers."""


@dataclass(frozen=True, eq=False)
class _Evidence:
    """What speaks for or against the best offset."""

    heading_rate_z: float
    follows_z: float
    plausible: Floats
    at_edge: bool
    sharp_turns: bool
    offset: float
    offset_sd: float
    observable: bool


def _weigh(
    headings: HeadingSeries,
    track: VelocityTrack,
    curve: OffsetCurve | None,
    refined: RefinedOffset,
    found: Solution,
    max_offset: float,
) -> _Evidence:
    """Ask whether the motion determines the offset; every question must be answered with yes."""
    inflation = found.residuals.t.size / found.independent
    offsets = candidate_offsets(max_offset)
    plausible = offsets[plausible_offsets(headings, track, offsets, refined, inflation=inflation)]
    begin, end = intervals(headings)
    part = float(begin.min()) + refined.offset, float(end.max()) + refined.offset
    turns = heading_rate_test(track, *part)
    steady = steady_turning(track, *part)
    follows = preference(headings, track, steady, refined, inflation=inflation)
    sd = float(np.sqrt(found.covariance.full[3, 3]))
    at_edge = curve is not None and (curve.at_edge or abs(refined.offset) > max_offset)
    observable = bool(
        curve is not None
        and found.agrees
        and not at_edge
        and refined.curvature < 0
        and turns >= RATE_GATE
        and follows >= FOLLOW_GATE
        and sd < max_offset / 4
        and one_answer(plausible, refined.offset, max_offset / 4)
    )
    sharp = has_sharp_turns(track, found, refined.offset)
    return _Evidence(turns, follows, plausible, at_edge, sharp, refined.offset, sd, observable)


def one_answer(plausible: Floats, best: float, widest: float) -> bool:
    """Tell whether the plausible offsets lie around the best one [s], without holes."""
    near = np.sort(np.append(plausible, best))
    return bool(np.abs(near - best).max() < widest and np.diff(near).max(initial=0.0) < APART)


def _near(offset: float, plausible: Floats) -> bool:
    return plausible.size == 0 or bool(np.abs(plausible - offset).min() <= 2 * STEP)


def unknown_axis(covariance: Floats, spread: DirectionSpread) -> Floats | None:
    """Return the body axis about which the rotation is not determined, if there is one."""
    bias = HEADING_BIAS / max(spread.spread, 1e-9)
    along = float(spread.axis @ covariance @ spread.axis)
    if np.hypot(np.sqrt(max(along, 0.0)), bias) > MAX_ROTATION_SD:
        return spread.axis
    values, vectors = np.linalg.eigh(covariance)
    return vectors[:, -1] if values[-1] > MAX_ROTATION_SD**2 else None


def _offset_interval(
    evidence: _Evidence, sd: float, samples: float, max_offset: float
) -> tuple[float, float]:
    if evidence.observable:
        half = t_quantile(samples) * sd
        return evidence.offset - half, evidence.offset + half
    if evidence.plausible.size == 0:
        return -max_offset, max_offset
    return float(evidence.plausible.min()), float(evidence.plausible.max())

"""What speaks for or against an offset, and what that leaves unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evcalib.alignment._stream_pair import StreamPair
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
from evcalib.alignment.offset_refinement import RefinedOffset, plausible_offsets, preference
from evcalib.alignment.registration import Solution, has_sharp_turns
from evcalib.arrays import Floats
from evcalib.uncertainty import t_quantile

APART = 0.1
"""Plausible offsets with implausible ones of so much time [s] in between are different answers: a
choice of ten steps of the search, over which noise of the odometry makes no hole
(`tests/test_align.py`)."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """What speaks for or against the best offset.

    `heading_rate_z`, `follows_z`, `plausible`, `at_edge` and `sharp_turns` are those of
    `Diagnostics`; `offset` and its `sd` [s] are of the fit; `observable` is the answer.
    """

    heading_rate_z: float
    follows_z: float
    plausible: Floats
    at_edge: bool
    sharp_turns: bool
    offset: float
    sd: float
    observable: bool

    @classmethod
    def of(
        cls,
        pair: StreamPair,
        curve: OffsetCurve | None,
        refined: RefinedOffset,
        found: Solution,
        max_offset: float,
    ) -> Evidence:
        """Ask whether the motion determines the offset; all questions must be answered with yes."""
        headings, track = pair.headings, pair.track
        noise = found.noise
        offsets = candidate_offsets(max_offset)
        alike = plausible_offsets(headings, track, offsets, refined, noise=noise)
        plausible, part = offsets[alike], pair.span(refined.offset)
        turns = heading_rate_test(track, *part)
        steady = steady_turning(track, *part)
        follows = preference(headings, track, steady, refined, noise=noise)
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
        return cls(turns, follows, plausible, at_edge, sharp, refined.offset, sd, observable)

    def allows(self, offset: float) -> bool:
        """Tell whether an offset [s] is among the plausible ones, or there are none to ask."""
        near = np.abs(self.plausible - offset) <= 2 * STEP
        return self.plausible.size == 0 or bool(near.any())

    def interval(self, sd: float, samples: float, max_offset: float) -> tuple[float, float]:
        """Return the 95 % interval of the offset [s]: of the fit, or of what is plausible."""
        if self.observable:
            half = t_quantile(samples) * sd
            return self.offset - half, self.offset + half
        if self.plausible.size == 0:
            return -max_offset, max_offset
        return float(self.plausible.min()), float(self.plausible.max())


def one_answer(plausible: Floats, best: float, widest: float) -> bool:
    """Tell whether the plausible offsets lie around the best one, without holes.

    Parameters
    ----------
    plausible : ndarray, shape (k,)
        Offsets [s] that the data cannot tell from the best one.
    best : float
        The best one [s].
    widest : float
        How far [s] they may lie from it.

    Returns
    -------
    bool
        Whether they are one answer.
    """
    near = np.sort(np.append(plausible, best))
    return bool(np.abs(near - best).max() < widest and np.diff(near).max(initial=0.0) < APART)


def unknown_axis(covariance: Floats, spread: DirectionSpread) -> Floats | None:
    """Return the body axis about which the rotation is not determined, if there is one.

    Parameters
    ----------
    covariance : ndarray, shape (3, 3)
        Of the rotation vector [rad^2].
    spread : DirectionSpread
        Of the body directions.

    Returns
    -------
    ndarray, shape (3,), or None
        Unit vector in the body frame.
    """
    bias = HEADING_BIAS / max(spread.spread, 1e-9)
    along = float(spread.axis @ covariance @ spread.axis)
    if np.hypot(np.sqrt(max(along, 0.0)), bias) > MAX_ROTATION_SD:
        return spread.axis
    values, vectors = np.linalg.eigh(covariance)
    return vectors[:, -1] if values[-1] > MAX_ROTATION_SD**2 else None

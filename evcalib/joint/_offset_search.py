"""The search over the offset: how well tracks are met at each candidate, and which fit alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evcalib.alignment import MIN_OVERLAP
from evcalib.alignment.offset import OffsetCurve, second_peak_ratio
from evcalib.arrays import Flags, Floats, Integers
from evcalib.joint._solver import LAG, OFFSET, Problem, begin, linearise, step

MOST_SEARCHED = 6_000
"""Observations that enter the search over all offsets.  A choice of speed: the fit begins at its
best candidate and uses more."""

FEWEST = 50
"""Tracks without which there is no joint refinement.  A choice: five corners in view give some 270
in nine seconds (tests/unchanged.py, few and bad), so that less is hardly a drive."""

STRETCH = 0.5
"""Losses are compared over stretches of time [s], about as long as corners are seen, so that only
neighbours share any."""

GATE = 2.0
"""Standard errors within which another offset fits as well: those of 95 % of a normal error."""


@dataclass(frozen=True, eq=False)
class Search:
    """Losses of some tracks over the candidate offsets.

    `losses` (k, m) [rad^2], NaN where the odometry does not cover a track; `length` (k,) counts
    observations; `stretch` (k,) numbers the stretch of time that each starts in.
    """

    offsets: Floats
    losses: Floats
    length: Floats
    stretch: Integers

    @property
    def mean(self) -> Floats:
        """Mean loss of an observation at each candidate; NaN where few are covered."""
        known = np.isfinite(self.losses)
        count = self.length @ known
        total = np.where(known, self.losses, 0.0).sum(axis=0)
        enough = (count >= MIN_OVERLAP * count.max()) & (count > 0)
        return np.where(enough, total / np.maximum(count, 1), np.nan)

    def as_good(self, offset: float) -> Floats:
        """Return the candidates that fit as well as that next to `offset` (Vuong 1989)."""
        more, gate = self._excess(offset)
        return self.offsets[(more <= gate) & np.isfinite(self.mean)]

    def _excess(self, offset: float) -> tuple[Floats, Floats]:
        """Return by how much the candidates fit worse than `offset`, and how much noise may do."""
        best = int(np.argmin(np.abs(self.offsets - offset)))
        more = self.losses - self.losses[:, [best]]
        known = np.isfinite(more)
        sums = np.zeros((int(self.stretch.max()) + 1, self.offsets.size))
        np.add.at(sums, self.stretch, np.where(known, more, 0.0))
        total = sums.sum(axis=0)
        spread = np.sum((sums - total / len(sums)) ** 2, axis=0)
        # Neighbouring stretches share corners.
        return total, GATE * np.sqrt(2.0 * spread)

    def half_width(self, offset: float) -> float:
        """Return how far offsets that fit as well reach from `offset`, either way on average.

        Less a step: how sharp the optimum itself is, the covariance tells better.  A side on which
        all fit as well up to the last candidate counts as the other one.
        """
        sides = self.reach(offset)
        ended = [side for side in sides if np.isfinite(side)] or [float(self.offsets.size)]
        return max(float(np.mean(ended)) - 1.0, 0.0) * float(self.offsets[1] - self.offsets[0])

    def reach(self, offset: float) -> tuple[float, float]:
        """Return up to how many steps later and earlier ones fit as well; inf if no end shows."""
        more, gate = self._excess(offset)
        known = np.isfinite(self.mean)
        best = int(np.argmin(np.abs(self.offsets - offset)))
        later, earlier = slice(best, None), slice(best, None, -1)
        return (
            _reach(more[later], gate[later], known[later]),
            _reach(more[earlier], gate[earlier], known[earlier]),
        )


def _reach(more: Floats, gate: Floats, known: Flags) -> float:
    """Return how many candidates from the first on, the best, fit as well, a fraction counted."""
    good = np.flatnonzero((more <= gate) & known)
    after = int(good[-1]) + 1 if good.size else more.size
    if after == more.size or not known[after]:
        return np.inf
    # The loss grows with the square of the distance, its noise with the distance itself.
    return float(np.clip(after * gate[after] / more[after], after - 1, after))


def search_offsets(
    problem: Problem,
    R: Floats,
    offsets: Floats,
    loss_scale: float,
    free: Flags,
    most: int = MOST_SEARCHED,
) -> Search | None:
    """Compare offsets by the losses of some tracks at each.

    With the best rotation there, and the best position if it is among the `free` unknowns.
    """
    tracks, t = problem.tracks.thinned(most), problem.motion.t
    covered = np.add.outer(tracks.start, offsets) >= t[0]
    covered &= np.add.outer(tracks.end, offsets) <= t[-1]
    if covered.sum(axis=0).max() < FEWEST:
        return None
    part, free = problem.part(tracks), free.copy()
    free[[OFFSET, LAG]] = False
    losses = np.full(covered.shape, np.nan)
    for k, offset in enumerate(offsets):
        if not covered[:, k].any():
            continue
        fit = begin(part, R, float(offset), loss_scale)
        for _ in range(2):
            linearise(part, fit)
            step(part, fit, free)
        linearise(part, fit)
        losses[:, k] = np.where(covered[:, k], fit.losses, np.nan)
    return Search(offsets, losses, tracks.length.astype(np.float64), tracks.stretch(STRETCH))


def curve_of(search: Search, found: float, max_offset: float, worst: float) -> OffsetCurve:
    """Return the search as an objective: 1 where all is met, 0 where all are outliers."""
    objective = 1.0 - search.mean / worst
    count = search.length @ np.isfinite(search.losses)
    return OffsetCurve(
        method="tracks",
        offsets=search.offsets,
        score=objective,
        overlap=count / max(float(search.length.sum()), 1.0),
        offset=found,
        second_peak_ratio=second_peak_ratio(objective, int(np.nanargmax(objective))),
        at_edge=abs(found) > max_offset,
    )

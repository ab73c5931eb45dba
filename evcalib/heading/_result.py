"""What the estimation of headings returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evcalib.arrays import Floats
from evcalib.display import Shown
from evcalib.filters import Noise
from evcalib.heading._correspondences import CorrespondenceKeeper, Correspondences
from evcalib.heading._keyframes import Counts
from evcalib.heading._snapshot import EventRate, Snapshot
from evcalib.heading._window_fit import Fit
from evcalib.series import HeadingSeries


@dataclass(frozen=True)
class Gap:
    """A window without heading.

    Attributes
    ----------
    t : float
        Middle of the window [s].
    reason : str
        Why there is none.
    """

    t: float
    reason: str


@dataclass(frozen=True, eq=False)
class HeadingEstimate(Shown):
    """Headings of a recording and what became of the rest.

    Attributes
    ----------
    headings : HeadingSeries
        One row per heading found.  `t`, `t_start` and `t_end` are the mean middle, start and end
        of its own inliers, weighted by squared displacement; `sd` is per tangent axis [rad].
    covariance : ndarray, shape (n, 3, 3)
        Of each direction [rad^2].
    gaps : tuple of Gap
        The windows without heading, and why.
    counts : Counts
        Events, corners, keypoints and what was left out of them.
    correspondences : Correspondences or None
        Where asked for.
    inlier_share : ndarray, shape (n,), optional
        Share of the matches of each heading's window that agree with one direction, over all
        spans.
    event_rate : EventRate, optional
        Events over time.
    snapshot : Snapshot, optional
        Two keyframes and their matches, from near the middle; None without headings.
    noise : Noise, optional
        What was left out of the events as the sensor's own; None where they were taken as they are.
    """

    headings: HeadingSeries
    covariance: Floats
    gaps: tuple[Gap, ...]
    counts: Counts
    correspondences: Correspondences | None = None
    inlier_share: Floats | None = None
    event_rate: EventRate | None = None
    snapshot: Snapshot | None = None
    noise: Noise | None = None

    @property
    def found(self) -> float:
        """Share of windows with a heading; 0 without windows."""
        n = len(self.headings)
        return n / max(n + len(self.gaps), 1)


@dataclass(frozen=True, eq=False)
class Found:
    """What is kept of a window's fit; its matches are not."""

    t: float
    t_start: float
    t_end: float
    v: Floats
    covariance: Floats
    sd: float
    inliers: int
    share: float

    @classmethod
    def of(cls, fit: Fit) -> Found:
        """Take what is kept out of a fit."""
        return cls(
            t=fit.t,
            t_start=fit.t_start,
            t_end=fit.t_end,
            v=fit.translation.direction,
            covariance=fit.translation.covariance,
            sd=fit.translation.sd,
            inliers=fit.inliers,
            share=float(fit.agreeing.mean()),
        )


def collected(
    found: list[Found],
    gaps: list[Gap],
    counts: Counts,
    kept: CorrespondenceKeeper | None,
) -> HeadingEstimate:
    """Return the result of a whole stream."""
    t, t_start, t_end, sd, inliers, share = (
        np.array([getattr(one, name) for one in found], dtype=np.float64)
        for name in ("t", "t_start", "t_end", "sd", "inliers", "share")
    )
    v = np.array([one.v for one in found]).reshape(-1, 3)
    return HeadingEstimate(
        headings=HeadingSeries(t, v, t_start=t_start, t_end=t_end, sd=sd, inliers=inliers),
        covariance=np.array([one.covariance for one in found]).reshape(-1, 3, 3),
        gaps=tuple(gaps),
        counts=counts,
        correspondences=None if kept is None else kept.result(),
        inlier_share=share,
    )

"""What the estimation of headings returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evcalib._heading_fit import Fit, Matches
from evcalib._keyframes import Counts
from evcalib._recording import EventRate, Snapshot, SnapshotKeeper
from evcalib.series import HeadingSeries

Floats = NDArray[np.float64]


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
class Correspondences:
    """Matches behind the headings.  Every keyframe pair appears once.

    Attributes
    ----------
    r1, r2 : ndarray, shape (n, 3)
        Unit bearings in the camera frame.
    t1, t2 : ndarray, shape (n,)
        Times of the corners themselves [s].
    inlier : ndarray of bool, shape (n,)
        Whether they agree with one direction over all spans of their window.
    pair : ndarray of int64, shape (n,)
        Number of the keyframe pair, from 0.
    heading : ndarray of int64, shape (n,)
        Row of the heading.
    """

    r1: Floats
    r2: Floats
    t1: Floats
    t2: Floats
    inlier: NDArray[np.bool_]
    pair: NDArray[np.int64]
    heading: NDArray[np.int64]

    def __len__(self) -> int:
        return int(self.t1.size)


@dataclass(frozen=True, eq=False)
class HeadingEstimate:
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
    """

    headings: HeadingSeries
    covariance: Floats
    gaps: tuple[Gap, ...]
    counts: Counts
    correspondences: Correspondences | None = None
    inlier_share: Floats | None = None
    event_rate: EventRate | None = None
    snapshot: Snapshot | None = None

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
    kept: list[tuple[Matches, NDArray[np.bool_]]] | None,
    rate: EventRate,
    snapshots: SnapshotKeeper,
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
        correspondences=None if kept is None else joined(kept),
        inlier_share=share,
        event_rate=rate,
        snapshot=snapshots.result(float(rate.t[0]), float(rate.t[-1]) + rate.width),
    )


def joined(kept: list[tuple[Matches, NDArray[np.bool_]]]) -> Correspondences:
    """Join the matches of all headings."""
    if not kept:
        none = np.empty(0)
        rows = np.empty((0, 3))
        whole = np.empty(0, dtype=np.int64)
        return Correspondences(rows, rows, none, none, whole > 0, whole, whole)
    matches = Matches.pooled([m for m, _ in kept])
    return Correspondences(
        r1=matches.r1,
        r2=matches.r2,
        t1=matches.t1,
        t2=matches.t2,
        inlier=np.concatenate([inliers for _, inliers in kept]),
        pair=np.unique(matches.pair, return_inverse=True)[1].astype(np.int64),
        heading=np.repeat(np.arange(len(kept)), [len(m) for m, _ in kept]),
    )

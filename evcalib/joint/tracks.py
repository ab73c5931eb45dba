"""Tracks: corners that are seen again and again, from the correspondences behind headings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from evcalib.arrays import Flags, Floats, Integers
from evcalib.display import Shown
from evcalib.heading import Correspondences
from evcalib.series import bins

SHORTEST = 2
"""Fewest observations after the first: two displacements of one corner can be compared."""


STRETCH = 0.05
"""Time [s] between the knots of the unknown turning.  A choice: that between keyframes, so that
each turns by itself, and shorter than a track by far."""


@dataclass(frozen=True, eq=False)
class Tracks(Shown):
    """Corners at a first time and at later ones.

    Attributes
    ----------
    first : ndarray of int64, shape (k + 1,)
        Track j has the rows from first[j] up to first[j + 1].
    r1, r2 : ndarray, shape (n, 3)
        Unit bearings at the first time, the same throughout a track, and at the later one.
    t1, t2 : ndarray, shape (n,)
        Times [s] on the camera clock.
    """

    first: Integers
    r1: Floats
    r2: Floats
    t1: Floats
    t2: Floats

    def __len__(self) -> int:
        return int(self.first.size) - 1

    @property
    def length(self) -> Integers:
        """Observations of each after the first, shape (k,)."""
        return np.diff(self.first)

    @property
    def start(self) -> Floats:
        """First time of each [s], shape (k,)."""
        return self.t1[self.first[:-1]]

    @property
    def end(self) -> Floats:
        """Last time of each [s], shape (k,)."""
        return np.maximum.reduceat(self.t2, self.first[:-1]) if len(self) else np.empty(0)

    def stretch(self, width: float) -> Integers:
        """Return the number of the stretch of `width` [s] that each starts in, shape (k,)."""
        return bins(self.start - self.start[:1].sum(), width)

    def select(self, chosen: Flags) -> Tracks:
        """Return some of the tracks, by a mask."""
        rows = np.repeat(chosen, self.length)
        first = np.concatenate([[0], np.cumsum(self.length[chosen])]).astype(np.int64)
        return Tracks(first, self.r1[rows], self.r2[rows], self.t1[rows], self.t2[rows])

    def on_clock(self, rate: float) -> Tracks:
        """Return the tracks on a clock that gains `rate` [s/s] on this one, from the middle on."""
        middle = 0.5 * (self.start[0] + self.start[-1])
        t1, t2 = (t + rate * (t - middle) for t in (self.t1, self.t2))
        return replace(self, t1=t1, t2=t2)

    def thinned(self, most: int) -> Tracks:
        """Return a share of the tracks, evenly over time: about so many observations."""
        n = int(self.first[-1])
        if n <= most:
            return self
        # A track is kept where the running share of what may be kept passes a whole number.
        share = np.floor(np.arange(len(self) + 1) * (most / n))
        return self.select(np.diff(share) > 0)


def tracks_of(correspondences: Correspondences, *, shortest: int = SHORTEST) -> Tracks:
    """Gather correspondences that start at one corner.

    Parameters
    ----------
    correspondences : Correspondences
        All of a recording, inliers or not.
    shortest : int
        Corners with fewer correspondences are left out.

    Returns
    -------
    Tracks
        In order of their first time.
    """
    c = correspondences
    order = np.lexsort((c.t2, c.r1[:, 1], c.r1[:, 0], c.t1))
    t1, r1 = c.t1[order], c.r1[order]
    new = np.ones(len(c), dtype=np.bool_)
    new[1:] = (t1[1:] != t1[:-1]) | (r1[1:] != r1[:-1]).any(axis=1)
    first = np.append(np.flatnonzero(new), len(c))
    whole = Tracks(first, r1, c.r2[order], t1, c.t2[order])
    return whole.select(whole.length >= shortest)

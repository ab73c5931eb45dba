"""What a report shows of a recording: its event rate, and one pair of keyframes to look at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evcalib.arrays import Flags, Floats, Integers
from evcalib.display import Shown
from evcalib.events import Events
from evcalib.heading._keyframes import Keyframe
from evcalib.heading._matches import KeyframeMatches
from evcalib.heading._options import MAX_STEPS
from evcalib.heading._window_fit import Fit
from evcalib.surfaces.quality import grey

BIN_US = 100_000
"""Width of a bin of the event rate [us]."""

CANDIDATES = 12
"""Most pairs that are held until the end of the recording, and with it its middle, is known."""

MIDDLE = 1.0 / 6.0
"""A pair within this part of the duration from the middle counts as near it."""


@dataclass(frozen=True, eq=False)
class EventRate(Shown):
    """Events per bin of time.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Start of each bin [s], ascending; bins without events are left out.
    count : ndarray of int64, shape (n,)
        Events in it.
    width : float
        Width of a bin [s].
    """

    t: Floats
    count: Integers
    width: float


@dataclass(frozen=True, eq=False)
class Snapshot(Shown):
    """Two keyframes and their matches, from near the middle of a recording.

    Attributes
    ----------
    t1, t2 : float
        Times of the two [s].
    image1, image2 : ndarray of uint8, shape (height, width)
        Their surfaces, scaled to 255.
    corners1, corners2 : ndarray, shape (n, 2)
        All their keypoints [px].
    xy1, xy2 : ndarray, shape (m, 2)
        Those that match [px].
    inlier : ndarray of bool, shape (m,)
        Whether a match agrees with the heading of its window.
    direction : ndarray, shape (3,)
        That heading, in the camera frame.
    """

    t1: float
    t2: float
    image1: NDArray[np.uint8]
    image2: NDArray[np.uint8]
    corners1: Floats
    corners2: Floats
    xy1: Floats
    xy2: Floats
    inlier: Flags
    direction: Floats


class RateCounter:
    """Counts events in bins; its memory grows with the bins that hold events."""

    def __init__(self) -> None:
        self._bins: list[Integers] = []
        self._counts: list[Integers] = []

    def update(self, events: Events) -> None:
        """Take in the next events of the stream."""
        if not len(events):
            return
        bins = events.t // BIN_US
        first = np.flatnonzero(np.diff(bins, prepend=bins[0] - 1))
        self._bins.append(bins[first])
        self._counts.append(np.diff(first, append=bins.size))

    def result(self) -> EventRate:
        """Return the counts so far; there must be events."""
        bins, where = np.unique(np.concatenate(self._bins), return_inverse=True)
        count = np.zeros(bins.size, dtype=np.int64)
        np.add.at(count, where, np.concatenate(self._counts))
        return EventRate(1e-6 * (BIN_US * bins).astype(np.float64), count, 1e-6 * BIN_US)


@dataclass(frozen=True, eq=False)
class _Candidate:
    worth: float
    before: Keyframe
    after: Keyframe
    matches: KeyframeMatches
    inlier: Flags
    direction: Floats

    @property
    def t(self) -> float:
        return 0.5 * (self.before.t + self.after.t)


class SnapshotKeeper:
    """Keeps the pair to look at.

    The middle of a stream is known at its end only.  Until then the best pair of each slot of
    time is held; the slots grow with the stream, so that there are never more than a few.
    """

    def __init__(self) -> None:
        self._width = 0.5
        self._best: dict[int, _Candidate] = {}

    def offer(self, keyframes: Sequence[Keyframe], matches: KeyframeMatches, fit: Fit) -> None:
        """Take the pair of a window whose agreeing matches moved farthest in all.

        Parameters
        ----------
        keyframes : sequence of Keyframe
            Those of the window, with numbers that follow each other.
        matches : KeyframeMatches
            All matches of the window.
        fit : Fit
            What was found in them.
        """
        pair, which = np.unique(matches.pair, return_inverse=True)
        way = np.bincount(which, matches.shift * fit.agreeing)
        best = int(np.argmax(way))
        rows = which == best
        first, span = divmod(int(pair[best]), MAX_STEPS)
        first -= keyframes[0].number
        candidate = _Candidate(
            worth=float(way[best]),
            before=keyframes[first],
            after=keyframes[first + span],
            matches=matches[rows],
            inlier=fit.agreeing[rows],
            direction=fit.translation.direction,
        )
        self._put(int(candidate.t // self._width), candidate)
        while len(self._best) > CANDIDATES:
            self._merge()

    def _put(self, slot: int, candidate: _Candidate) -> None:
        held = self._best.get(slot)
        if held is None or candidate.worth > held.worth:
            self._best[slot] = candidate

    def _merge(self) -> None:
        """Double the slots."""
        self._width *= 2.0
        narrow, self._best = self._best, {}
        for slot, candidate in narrow.items():
            self._put(slot // 2, candidate)

    def result(self, start: float, end: float) -> Snapshot | None:
        """Return the best pair near the middle of a stream [s], or the one nearest to it."""
        if not self._best:
            return None
        middle, reach = 0.5 * (start + end), MIDDLE * (end - start)
        held = list(self._best.values())
        near = [c for c in held if abs(c.t - middle) <= reach]
        if near:
            return _snapshot(max(near, key=lambda c: c.worth))
        return _snapshot(min(held, key=lambda c: abs(c.t - middle)))


def _snapshot(chosen: _Candidate) -> Snapshot:
    before, after, matches = chosen.before, chosen.after, chosen.matches
    return Snapshot(
        t1=before.t,
        t2=after.t,
        image1=grey(before.surface),
        image2=grey(after.surface),
        corners1=before.keypoints.xy,
        corners2=after.keypoints.xy,
        xy1=matches.xy1,
        xy2=matches.xy2,
        inlier=chosen.inlier,
        direction=chosen.direction,
    )

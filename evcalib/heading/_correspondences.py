"""Correspondences that are kept beside the headings, in bounded memory."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from evcalib.arrays import Flags, Floats, Integers
from evcalib.heading._matches import KeyframeMatches

MOST = 400_000
"""Most correspondences that are kept; 16 s of lively motion give about as many."""

NO_HEADING = -1
"""In place of the row of a heading, for matches of windows that have none."""

_ODD = np.uint64(0x9E3779B97F4A7C15)


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Matches of all windows, with a heading or without.  Every keyframe pair appears once.

    Of long recordings only every second corner is kept, or every fourth, and so on, with all
    matches that start there.

    Attributes
    ----------
    r1, r2 : ndarray, shape (n, 3)
        Unit bearings in the camera frame; where a gyro told how the camera turns, `r2` as seen by a
        camera that has not turned since `t1`.
    t1, t2 : ndarray, shape (n,)
        Times of the corners themselves [s].
    inlier : ndarray of bool, shape (n,)
        Whether they agree with one direction over all spans of their window.
    pair : ndarray of int64, shape (n,)
        Number of the keyframe pair, from 0.
    heading : ndarray of int64, shape (n,)
        Row of the heading; -1 where the window has none, as where the camera turns.
    """

    r1: Floats
    r2: Floats
    t1: Floats
    t2: Floats
    inlier: Flags
    pair: Integers
    heading: Integers

    def __len__(self) -> int:
        return int(self.t1.size)

    def select(self, chosen: Flags) -> Correspondences:
        """Return some of them, by a mask."""
        return Correspondences(*(getattr(self, f.name)[chosen] for f in fields(self)))


class CorrespondenceKeeper:
    """Keeps the matches of some corners, the fewer the longer a stream is.

    Which corners stay depends on their bearings alone, not on how the stream was cut.
    """

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self._thinning = 0
        self._count = 0
        self._kept: list[tuple[KeyframeMatches, Flags, int]] = []

    def add(self, matches: KeyframeMatches, agreeing: Flags, heading: int) -> None:
        """Keep matches of a heading."""
        self._keep(matches, agreeing, heading)
        while self._count > self._most:
            self._thinning += 1
            before, self._kept, self._count = self._kept, [], 0
            for part in before:
                self._keep(*part)

    def _keep(self, matches: KeyframeMatches, agreeing: Flags, heading: int) -> None:
        chosen = _lot(matches.r1) >> np.uint64(64 - self._thinning) == 0 if self._thinning else None
        if chosen is not None:
            matches, agreeing = matches[chosen], agreeing[chosen]
        self._kept.append((matches, agreeing, heading))
        self._count += len(matches)

    def result(self) -> Correspondences:
        """Return all that was kept."""
        if not self._count:
            none = np.empty(0)
            rows = np.empty((0, 3))
            whole = np.empty(0, dtype=np.int64)
            return Correspondences(rows, rows, none, none, whole > 0, whole, whole)
        matches = KeyframeMatches.pooled([part for part, _, _ in self._kept])
        sizes = [len(part) for part, _, _ in self._kept]
        return Correspondences(
            r1=matches.r1,
            r2=matches.r2,
            t1=matches.t1,
            t2=matches.t2,
            inlier=np.concatenate([agreeing for _, agreeing, _ in self._kept]),
            pair=np.unique(matches.pair, return_inverse=True)[1].astype(np.int64),
            heading=np.repeat([heading for _, _, heading in self._kept], sizes),
        )


def _lot(r1: Floats) -> NDArray[np.uint64]:
    """Return a number per bearing that is as good as drawn, equal for equal bearings."""
    bits = np.ascontiguousarray(r1).view(np.uint64)
    mixed = (bits[:, 0] ^ (bits[:, 1] << np.uint64(1))) * _ODD
    mixed ^= mixed >> np.uint64(29)
    return mixed * _ODD

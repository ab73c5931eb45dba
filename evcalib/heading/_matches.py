"""Matched keypoints of keyframe pairs, and how far they moved."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from evcalib.arrays import Floats, Integers
from evcalib.features import align, match
from evcalib.heading._keyframes import Keyframe

CELL_PX = 8
"""Correspondences whose midpoints share a cell of this side [px] see the same corner."""

MAX_STEPS = 128
"""Spans of keyframe pairs stay below this number of steps."""


@dataclass(frozen=True, eq=False)
class Matches:
    """Matched keypoints of one or more keyframe pairs, one per row.

    Attributes
    ----------
    r1, r2 : ndarray, shape (n, 3)
        Unit bearings.
    xy1, xy2 : ndarray, shape (n, 2)
        Pixels.
    t1, t2 : ndarray, shape (n,)
        Times of the keypoints [s].
    pair : ndarray of int64, shape (n,)
        Number of the keyframe pair, 128 times its earlier keyframe plus its span.
    cell : ndarray of int64, shape (n,)
        Number of the cell of the midpoint: equal for sightings of one corner.
    """

    r1: Floats
    r2: Floats
    xy1: Floats
    xy2: Floats
    t1: Floats
    t2: Floats
    pair: Integers
    cell: Integers

    def __len__(self) -> int:
        return int(self.t1.size)

    def __getitem__(self, rows: NDArray) -> Matches:
        return replace(self, **{f.name: getattr(self, f.name)[rows] for f in fields(self)})

    @classmethod
    def pooled(cls, parts: list[Matches]) -> Matches:
        """Return the rows of all parts; there is at least one part."""
        return cls(
            *(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(cls))
        )

    @property
    def shift(self) -> Floats:
        """Displacement of each [px]."""
        return np.hypot(*(self.xy2 - self.xy1).T)

    @property
    def span(self) -> Integers:
        """Keyframe steps between the two of each."""
        return self.pair % MAX_STEPS

    @property
    def middle(self) -> Integers:
        """Sum of the two keyframe numbers: twice the middle."""
        return 2 * (self.pair // MAX_STEPS) + self.span


def match_keyframes(
    before: Keyframe, after: Keyframe, reach: float, *, aligned: bool = True
) -> Matches | None:
    """Match two keyframes; None without matches.

    Parameters
    ----------
    before, after : Keyframe
        The two.
    reach : float
        Largest displacement [px].
    aligned : bool
        Measure the displacements between their event images, all at the times of these;
        otherwise take keypoints and their times as they are.
    """
    i, j = match(before.keypoints, after.keypoints, reach=reach).T
    if not i.size:
        return None
    if aligned:
        return _aligned(before, after, i, j)
    return _collected(
        before,
        after,
        (before.keypoints.xy[i], after.keypoints.xy[j]),
        (before.bearings[i], after.bearings[j]),
        (before.keypoints.t[i], after.keypoints.t[j]),
    )


def _aligned(before: Keyframe, after: Keyframe, i: Integers, j: Integers) -> Matches | None:
    """Measure matches of keypoints on the event images; None if none can be."""
    first, second = before.image, after.image
    if first is None or second is None or first.end > second.start:
        return None
    xy1, xy2 = before.keypoints.xy[i], after.keypoints.xy[j]
    speed = (xy2 - xy1) / (after.keypoints.t[j] - before.keypoints.t[i])[:, None]
    start = np.rint(xy1)
    found = align(first, second, start, start + speed * (second.t - first.t))
    found = found[np.isfinite(found[:, 0])]
    places = found[:, :2], found[:, 2:]
    bearings = before.table(places[0]), after.table(places[1])
    seen = np.isfinite(bearings[0][:, 0]) & np.isfinite(bearings[1][:, 0])
    if not seen.any():
        return None
    return _collected(
        before,
        after,
        (places[0][seen], places[1][seen]),
        (bearings[0][seen], bearings[1][seen]),
        (np.full(seen.sum(), first.t), np.full(seen.sum(), second.t)),
    )


def _collected(
    before: Keyframe,
    after: Keyframe,
    xy: tuple[Floats, Floats],
    bearings: tuple[Floats, Floats],
    t: tuple[Floats, Floats],
) -> Matches:
    """Return matches of two keyframes, numbered by pair and cell."""
    columns, rows = ((xy[0] + xy[1]) / (2 * CELL_PX)).astype(np.int64).T
    pair = before.number * MAX_STEPS + after.number - before.number
    return Matches(
        r1=bearings[0],
        r2=bearings[1],
        xy1=xy[0],
        xy2=xy[1],
        t1=t[0],
        t2=t[1],
        pair=np.full(len(rows), pair),
        cell=rows * (before.width // CELL_PX + 1) + columns,
    )

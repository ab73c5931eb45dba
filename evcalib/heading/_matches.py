"""Matched bearings of two views, and those of keyframe pairs with how far they moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from evcalib.arrays import Floats, Integers
from evcalib.errors import InputError
from evcalib.features import align_patches, match
from evcalib.heading._keyframes import Keyframe, Numbered
from evcalib.heading._options import MAX_STEPS
from evcalib.kernels.heading import pairs as kernels

CELL_PX = 8
"""Matches whose midpoints share a cell of this side [px] see the same corner.  A choice: the width
of a keypoint.  Half or double of it gives the same heading (`tests/test_heading_thresholds.py`)."""


@dataclass(frozen=True, eq=False)
class Matches:
    """Points that are seen twice, one per row.

    Attributes
    ----------
    xy1, xy2 : ndarray, shape (n, 2)
        Pixels before and after.
    r1, r2 : ndarray, shape (n, 3)
        Unit bearings.
    """

    xy1: Floats
    xy2: Floats
    r1: Floats
    r2: Floats

    def __len__(self) -> int:
        return len(self.r1)

    def __getitem__(self, rows: NDArray) -> Self:
        return replace(self, **{f.name: getattr(self, f.name)[rows] for f in fields(self)})

    @classmethod
    def pooled(cls, parts: Sequence[Self]) -> Self:
        """Return the rows of all parts, of which there must be one at least."""
        if not parts:
            raise InputError("there are no matches to pool")
        return cls(
            *(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(cls))
        )

    @property
    def shift(self) -> Floats:
        """Displacement of each [px]."""
        return np.hypot(*(self.xy2 - self.xy1).T)

    @property
    def groups(self) -> Integers:
        """Equal numbers for matches that see the same corner, shape (n,); see `two_point`."""
        cells = np.floor((self.xy1 + self.xy2) / (2 * CELL_PX))
        return np.unique(cells, axis=0, return_inverse=True)[1].ravel().astype(np.int64)


@dataclass(frozen=True, eq=False)
class KeyframeMatches(Matches):
    """Matches of one or more keyframe pairs, with the attributes of `Matches` and these.

    Attributes
    ----------
    t1, t2 : ndarray, shape (n,)
        Times of the points [s].
    pair : ndarray of int64, shape (n,)
        Number of the keyframe pair, 128 times its earlier keyframe plus its span.
    """

    t1: Floats
    t2: Floats
    pair: Integers

    @property
    def groups(self) -> Integers:
        """Numbers as in `Matches`, counted without sorting: a window asks for them often."""
        columns, rows = ((self.xy1 + self.xy2) / (2 * CELL_PX)).astype(np.int64).T
        return rows * (columns.max(initial=0) + 1) + columns

    @property
    def span(self) -> Integers:
        """Keyframe steps between the two of each."""
        return self.pair % MAX_STEPS

    @property
    def middle(self) -> Integers:
        """Sum of the two keyframe numbers: twice the middle."""
        return 2 * (self.pair // MAX_STEPS) + self.span

    @classmethod
    def between(
        cls,
        before: Numbered,
        after: Numbered,
        xy: tuple[Floats, Floats],
        r: tuple[Floats, Floats],
        t: tuple[Floats, Floats],
    ) -> Self:
        """Return the matches of two keyframes from pixels, bearings and times in both."""
        pair = before.number * MAX_STEPS + after.number - before.number
        return cls(*xy, *r, *t, np.full(len(t[0]), pair))


def match_keyframes(
    before: Keyframe, after: Keyframe, reach: float, *, aligned: bool = True
) -> KeyframeMatches | None:
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
    pairs = match(before.keypoints, after.keypoints, reach=reach)
    if not len(pairs):
        return None
    if aligned:
        return _aligned(before, after, pairs)
    i, j = pairs.T
    return KeyframeMatches.between(
        before,
        after,
        (before.keypoints.xy[i], after.keypoints.xy[j]),
        (before.bearings[i], after.bearings[j]),
        (before.keypoints.t[i], after.keypoints.t[j]),
    )


def _aligned(before: Keyframe, after: Keyframe, pairs: Integers) -> KeyframeMatches | None:
    """Measure matches of keypoints on the event images; None if none can be."""
    first, second = before.image, after.image
    if first is None or second is None or first.end > second.start:
        return None
    places = [kernels.Places(k.keypoints.xy, k.keypoints.t) for k in (before, after)]
    found = align_patches(first, second, *kernels.expected(*places, pairs, second.t - first.t))
    xy1, xy2, r1, r2 = kernels.seen(found, before.table.grid, before.table.step)
    if not len(xy1):
        return None
    t = np.full(len(xy1), first.t), np.full(len(xy1), second.t)
    return KeyframeMatches.between(before, after, (xy1, xy2), (r1, r2), t)

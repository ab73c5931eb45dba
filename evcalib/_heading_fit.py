"""One heading from the pooled correspondences of a window, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from evcalib._event_image import align
from evcalib._keyframes import Keyframe
from evcalib.epipolar import Translation, five_point, turn_explains, two_point
from evcalib.features import match

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]

TOO_FEW = "too few corners"
STILL = "standing still, or too little motion"
DISAGREE = "matches disagree"
NO_PARALLAX = "no parallax: a turn explains the matches"
UNCERTAIN = "direction uncertain"
NOT_NEWER = "not newer than the heading before"

STILL_PX = 2.0
"""A median displacement [px] below this over the longer spans is localisation noise."""

CELL_PX = 8
"""Correspondences whose midpoints share a cell of this side [px] see the same corner."""

SURVIVAL = 0.5
"""A pair is kept if its share of inliers is at least this part of the best pair's."""

SHARE = 0.3
"""Least share of inliers; a strip of the threshold's width around random flow holds a tenth."""

MAX_STEPS = 128
"""Spans of keyframe pairs stay below this number of steps."""

SHORTEN = 0.75
"""Part of the longest span that is left where a heading is certain enough."""

CELLS = 8
"""Fewest cells that inliers come from."""

_SOLVERS: dict[str, Callable[..., Translation | None]] = {
    "two_point": two_point,
    "five_point": five_point,
}
SOLVERS = tuple(_SOLVERS)


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
    pair: NDArray[np.int64]
    cell: NDArray[np.int64]

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
    def span(self) -> NDArray[np.int64]:
        """Keyframe steps between the two of each."""
        return self.pair % MAX_STEPS

    @property
    def middle(self) -> NDArray[np.int64]:
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


def _aligned(before: Keyframe, after: Keyframe, i: Rows, j: Rows) -> Matches | None:
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


@dataclass(frozen=True)
class FitOptions:
    """What `fit` needs to know: threshold, max_sd and enough_sd in radians."""

    solver: str
    threshold: float
    min_inliers: int
    max_sd: float
    enough_sd: float
    seed: int


@dataclass(frozen=True, eq=False)
class Fit:
    """A heading: direction, the matches that agree over all spans, and what it was made of.

    `inliers` counts the matches behind the direction, the times are theirs.
    """

    translation: Translation
    agreeing: NDArray[np.bool_]
    inliers: int
    t: float
    t_start: float
    t_end: float


def fit(matches: Matches, options: FitOptions) -> Fit | str:
    """Return the heading of a window's matches, or why there is none."""
    if len(matches) < options.min_inliers:
        return TOO_FEW
    longer = matches.span >= np.median(matches.span)
    if np.median(matches.shift[longer]) < STILL_PX:
        return STILL
    rows = np.ones(len(matches), dtype=np.bool_)
    if options.solver == "five_point":
        rows = _one_pair(matches)
    translation = _solve(matches, rows, options)
    if translation is None:
        return DISAGREE
    kept = _surviving(matches.pair[rows], translation.inliers)
    if not kept.all():
        rows[rows] = kept
        translation = _solve(matches, rows, options)
        if translation is None:
            return DISAGREE
    reason = _objection(matches, rows, translation, options)
    if reason:
        return reason
    agreeing = _spread(rows, translation.inliers)
    rows, translation = _shortened(matches, rows, translation, options)
    inliers = _spread(rows, translation.inliers)
    return Fit(translation, agreeing, int(inliers.sum()), *_mean_times(matches, inliers))


def _shortened(
    matches: Matches, rows: NDArray[np.bool_], translation: Translation, options: FitOptions
) -> tuple[NDArray[np.bool_], Translation]:
    """Leave out the longest spans as long as the direction stays certain enough.

    A heading is an average over its spans: the shorter they are, the better it follows a turn of
    the motion.
    """
    while options.solver == "two_point" and translation.sd < options.enough_sd:
        shorter = rows & (matches.span <= SHORTEN * matches.span[rows].max())
        if shorter.sum() < options.min_inliers:
            break
        trial = _solve(matches, shorter, options)
        if trial is None or trial.sd > options.enough_sd:
            break
        rows, translation = shorter, trial
    return rows, translation


def _spread(rows: NDArray[np.bool_], values: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the values of the chosen rows in their places, False elsewhere."""
    out = np.zeros_like(rows)
    out[rows] = values
    return out


def _solve(matches: Matches, rows: NDArray[np.bool_], options: FitOptions) -> Translation | None:
    return _SOLVERS[options.solver](
        matches.r1[rows],
        matches.r2[rows],
        threshold=options.threshold,
        seed=options.seed,
        groups=matches.cell[rows],
    )


def _objection(
    matches: Matches, rows: NDArray[np.bool_], translation: Translation, options: FitOptions
) -> str | None:
    """Return what speaks against a heading that was fitted to some rows."""
    inliers, cell, span = translation.inliers, matches.cell[rows], matches.span[rows]
    if inliers.sum() < options.min_inliers or np.count_nonzero(np.bincount(cell[inliers])) < CELLS:
        return TOO_FEW
    if inliers.mean() < SHARE:
        return DISAGREE
    # Parallax grows with the span, and so does the evidence against a turn.
    long = span >= np.median(span)
    some = np.flatnonzero(rows)[long]
    if turn_explains(
        matches.r1[some],
        matches.r2[some],
        matches.t2[some] - matches.t1[some],
        translation.select(long),
        seed=options.seed,
        groups=cell[long],
    ):
        return NO_PARALLAX
    if not translation.sd <= options.max_sd:
        return UNCERTAIN
    return None


def _surviving(pair: NDArray[np.int64], inliers: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which rows belong to pairs whose matches survived the time between them."""
    number = _numbered(pair)
    count = np.bincount(number)
    share = np.bincount(number, inliers) / count
    best = share[count >= min(8, count.max())].max()
    return (share >= SURVIVAL * best)[number]


def _one_pair(matches: Matches) -> NDArray[np.bool_]:
    """Tell which rows belong to the longest central pair with at least half as many as the best.

    Pairs about the very middle of the window keep the times of the headings apart.
    """
    middle = matches.middle == int(np.median(matches.middle))
    count = np.bincount(matches.span, middle)
    return middle & (matches.span == np.flatnonzero(count >= 0.5 * count.max())[-1])


def _numbered(pair: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the number of the run of equal values that each row is in, from 0."""
    return np.cumsum(np.append(0, pair[1:] != pair[:-1]))


def _mean_times(matches: Matches, rows: NDArray[np.bool_]) -> tuple[float, float, float]:
    """Return mean time, mean start and mean end, each match weighted by its information."""
    weight = matches.shift[rows] ** 2
    start, end = (float(np.average(t[rows], weights=weight)) for t in (matches.t1, matches.t2))
    return 0.5 * (start + end), start, end

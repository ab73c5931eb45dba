"""One heading from the pooled correspondences of a window, or the reason why there is none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evcalib.arrays import Flags, Integers
from evcalib.heading._matches import KeyframeMatches
from evcalib.heading._options import SOLVERS, HeadingOptions
from evcalib.heading._translation import Translation
from evcalib.heading.epipolar import turn_explains

TOO_FEW = "too few corners"
STILL = "standing still, or too little motion"
DISAGREE = "matches disagree"
NO_PARALLAX = "no parallax: a turn explains the matches"
UNCERTAIN = "direction uncertain"
NOT_NEWER = "not newer than the heading before"
NO_ATTITUDE = "the IMU does not cover it"

# What follows are choices, none of them fitted to data.  Half or double of each gives the same
# heading of a simulated drive (tests/test_heading_thresholds.py); that standing still, noise and
# lost matches are refused is tested in tests/test_heading.py.

STILL_PX = 2.0
"""A median displacement [px] below this over the longer spans is localisation noise: a few times
the 0.1 to 0.5 px by which matches scatter."""

SURVIVAL = 0.5
"""A pair is kept if its share of inliers is at least this part of the best pair's.  Higher, and
good pairs go by chance; lower, and pairs stay whose matches are mostly false."""

SHARE = 0.3
"""Least share of inliers; a strip of the threshold's width around random flow holds a tenth."""

SHORTEN = 0.75
"""Part of the longest span that is left where a heading is certain enough; each step is a fit."""

CELLS = 8
"""Fewest cells that inliers come from: many matches of few corners do not fix a direction."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A heading: direction, the matches that agree over all spans, and what it was made of.

    `inliers` counts the matches behind the direction, the times are theirs.
    """

    translation: Translation
    agreeing: Flags
    inliers: int
    t: float
    t_start: float
    t_end: float


def fit(matches: KeyframeMatches, options: HeadingOptions, focal: float) -> Fit | str:
    """Return the heading of a window's matches, or why there is none; `focal` in pixels."""
    if len(matches) < options.min_inliers:
        return TOO_FEW
    longer = matches.span >= np.median(matches.span)
    if np.median(matches.shift[longer]) < STILL_PX:
        return STILL
    rows = np.ones(len(matches), dtype=np.bool_)
    if options.solver == "five_point":
        rows = _one_pair(matches)
    translation = _solve(matches, rows, options, focal)
    if translation is None:
        return DISAGREE
    kept = _surviving(matches.pair[rows], translation.inliers)
    if not kept.all():
        rows[rows] = kept
        translation = _solve(matches, rows, options, focal)
        if translation is None:
            return DISAGREE
    reason = _objection(matches, rows, translation, options)
    if reason:
        return reason
    agreeing = _spread(rows, translation.inliers)
    rows, translation = _shortened(matches, rows, translation, options, focal)
    inliers = _spread(rows, translation.inliers)
    return Fit(translation, agreeing, int(inliers.sum()), *_mean_times(matches, inliers))


def _shortened(
    matches: KeyframeMatches,
    rows: Flags,
    translation: Translation,
    options: HeadingOptions,
    focal: float,
) -> tuple[Flags, Translation]:
    """Leave out the longest spans as long as the direction stays certain enough.

    A heading is an average over its spans: the shorter they are, the better it follows a turn of
    the motion.
    """
    enough = np.deg2rad(options.enough_sd)
    while options.solver == "two_point" and translation.sd < enough:
        shorter = rows & (matches.span <= SHORTEN * matches.span[rows].max())
        if shorter.sum() < options.min_inliers:
            break
        trial = _solve(matches, shorter, options, focal)
        if trial is None or trial.sd > enough:
            break
        rows, translation = shorter, trial
    return rows, translation


def _spread(rows: Flags, values: Flags) -> Flags:
    """Return the values of the chosen rows in their places, False elsewhere."""
    out = np.zeros_like(rows)
    out[rows] = values
    return out


def _solve(
    matches: KeyframeMatches, rows: Flags, options: HeadingOptions, focal: float
) -> Translation | None:
    return SOLVERS[options.solver](
        matches.r1[rows],
        matches.r2[rows],
        threshold=options.threshold / focal,
        seed=options.seed,
        groups=matches.groups[rows],
    )


def _objection(
    matches: KeyframeMatches, rows: Flags, translation: Translation, options: HeadingOptions
) -> str | None:
    """Return what speaks against a heading that was fitted to some rows."""
    inliers, span = translation.inliers, matches.span[rows]
    cell = matches.groups[rows]
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
    if not translation.sd <= np.deg2rad(options.max_sd):
        return UNCERTAIN
    return None


def _surviving(pair: Integers, inliers: Flags) -> Flags:
    """Tell which rows belong to pairs whose matches survived the time between them."""
    number = _numbered(pair)
    count = np.bincount(number)
    share = np.bincount(number, inliers) / count
    best = share[count >= min(8, count.max())].max()
    return (share >= SURVIVAL * best)[number]


def _one_pair(matches: KeyframeMatches) -> Flags:
    """Tell which rows belong to the longest central pair with at least half as many as the best.

    Pairs about the very middle of the window keep the times of the headings apart.
    """
    middle = matches.middle == int(np.median(matches.middle))
    count = np.bincount(matches.span, middle)
    return middle & (matches.span == np.flatnonzero(count >= 0.5 * count.max())[-1])


def _numbered(pair: Integers) -> Integers:
    """Return the number of the run of equal values that each row is in, from 0."""
    return np.cumsum(np.append(0, pair[1:] != pair[:-1]))


def _mean_times(matches: KeyframeMatches, rows: Flags) -> tuple[float, float, float]:
    """Return mean time, mean start and mean end, each match weighted by its information."""
    weight = matches.shift[rows] ** 2
    start, end = (float(np.average(t[rows], weights=weight)) for t in (matches.t1, matches.t2))
    return 0.5 * (start + end), start, end

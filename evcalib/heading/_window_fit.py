"""One heading from the pooled correspondences of a window, or the reason why there is none."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
TO_AND_FRO = "matches move to and fro along the direction"
ONE_PLACE = "only a small part of the image moves"
UNCERTAIN = "direction uncertain"
NOT_NEWER = "not newer than the heading before"
NO_ATTITUDE = "the IMU does not cover it"

# What follows are choices.  Half or double of most gives the same heading of a simulated drive
# (tests/test_heading_thresholds.py names them); that standing still, noise and lost matches are
# refused is tested in tests/test_heading.py, that real turns and moving things are in
# tests/test_heading_real.py.

STILL_PX = 2.0
"""A median displacement [px] below this over the longer spans is localisation noise: a few times
the 0.1 to 0.5 px by which matches scatter."""

SURVIVAL = 0.5
"""A pair is kept if its share of inliers is at least this part of the best pair's.  Higher, and
good pairs go by chance; lower, and pairs stay whose matches are mostly false."""

SHARE = 0.4
"""Least share of inliers among all matches of a window: what is seen must move as one.  On real
translations it is 0.94 and more, on a roll before spokes, along which corners slide, 0.1 to 0.4."""

BACK = 0.1
"""Most matches that may move towards the direction, of those that move along the lines through it.
Translations have up to 0.02, with some that move against each other (a roll before spokes, several
things before a camera at rest) it is 0.15 to 0.5: then the sign is one of chance."""

SPREAD = 0.2
"""Least area over which moving inliers spread (root of the determinant of their covariance), in
parts of that of an evenly filled image.  Less may be one moving thing before a camera at rest: a
car that passes fills up to 0.17, a window of a quarter of the image 0.16; real translations 0.21 to
0.7."""

FLOOR_PX = 0.15
"""Differences from a turn below this [px] are no parallax: no lens is known better.  It is about
the least noise of real windows, 0.15 to 0.4."""

SHARED = 1.5
"""What the standard deviation of a heading is multiplied by for errors that matches of a window
share, which their scatter does not show: edges seen late, the shape of corners, the choice of the
spans that scatter least.  Without it errors of simulated drives are 1.3 to 1.6 standard deviations
(2.1 with pixels of 100 Hz), and so they are about their mean on slider_depth, 1.5 to 2.2
(`tests/heading_figures.py`)."""

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


def fit(
    matches: KeyframeMatches,
    options: HeadingOptions,
    focal: float,
    size: tuple[int, int] | None = None,
) -> Fit | str:
    """Return the heading of a window's matches, or why there is none.

    `focal` is in pixels, and so is `size`, width and height of the sensor; without it, it is not
    asked where in the image the matches are.
    """
    if len(matches) < options.min_inliers:
        return TOO_FEW
    longer = matches.span >= np.median(matches.span)
    if np.median(matches.shift[longer]) < STILL_PX:
        return STILL
    rows = np.ones(len(matches), dtype=np.bool_)
    if options.solver == "five_point":
        rows = _one_pair(matches)
    asked = rows.sum()
    translation = _solve(matches, rows, options, focal)
    if translation is None:
        return DISAGREE
    kept = _surviving(matches.pair[rows], translation.inliers)
    if not kept.all():
        rows[rows] = kept
        translation = _solve(matches, rows, options, focal)
        if translation is None:
            return DISAGREE
    if translation.inliers.sum() < SHARE * asked:
        return DISAGREE
    reason = _objection(matches, rows, translation, options, focal)
    if reason is None and size is not None and _spread(matches, rows, translation, size) < SPREAD:
        reason = ONE_PLACE
    if reason:
        return reason
    agreeing = _placed(rows, translation.inliers)
    rows, translation = _shortened(matches, rows, translation, options, focal)
    inliers = _placed(rows, translation.inliers)
    translation = replace(translation, covariance=SHARED**2 * translation.covariance)
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


def _placed(rows: Flags, values: Flags) -> Flags:
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
    matches: KeyframeMatches,
    rows: Flags,
    translation: Translation,
    options: HeadingOptions,
    focal: float,
) -> str | None:
    """Return what speaks against a heading that was fitted to some rows."""
    inliers = translation.inliers
    cell = matches.groups[rows]
    if inliers.sum() < options.min_inliers or np.count_nonzero(np.bincount(cell[inliers])) < CELLS:
        return TOO_FEW
    if _moving_back(matches, rows, translation, options.threshold / focal) > BACK:
        return TO_AND_FRO
    if _turned(matches, rows, translation, options.seed, FLOOR_PX / focal):
        return NO_PARALLAX
    if not SHARED * translation.sd <= np.deg2rad(options.max_sd):
        return UNCERTAIN
    return None


def _turned(
    matches: KeyframeMatches, rows: Flags, translation: Translation, seed: int, floor: float
) -> bool:
    """Tell whether a turn explains the matches of the longer spans.

    Parallax grows with the span, and so does the evidence against a turn.
    """
    span = matches.span[rows]
    long = (span >= np.median(span)) & (matches.t2 > matches.t1)[rows]
    some = np.flatnonzero(rows)[long]
    t1, t2 = matches.t1[some], matches.t2[some]
    return turn_explains(
        matches.r1[some],
        matches.r2[some],
        t2 - t1,
        translation.select(long),
        middles=0.5 * (t1 + t2),
        floor=floor,
        seed=seed,
        groups=matches.groups[some],
    )


def _moving_back(
    matches: KeyframeMatches, rows: Flags, translation: Translation, threshold: float
) -> float:
    """Return the share that moves towards the direction, of what moves along lines through it."""
    angle1, angle2 = (
        np.arccos(np.clip(r[rows] @ translation.direction, -1.0, 1.0))
        for r in (matches.r1, matches.r2)
    )
    along = (angle2 - angle1)[np.abs(translation.residuals) < threshold]
    away, back = (along > 0.5 * threshold).sum(), (along < -0.5 * threshold).sum()
    return float(back / max(away + back, 1))


def _spread(
    matches: KeyframeMatches, rows: Flags, translation: Translation, size: tuple[int, int]
) -> float:
    """Return the area over which moving inliers spread, in parts of that of a full image."""
    moving = _placed(rows, translation.inliers) & (matches.shift >= 0.5 * STILL_PX)
    if moving.sum() < 3:
        return 0.0
    middle = 0.5 * (matches.xy1[moving] + matches.xy2[moving])
    area = np.sqrt(max(float(np.linalg.det(np.cov(middle.T))), 0.0))
    return float(area / (size[0] * size[1] / 12.0))


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

"""Loops over the matches of two keyframes."""

from typing import NamedTuple

import numpy as np

from evcalib.kernels.heading.bearings import interpolate
from evcalib.kernels.jit import jit


class Places(NamedTuple):
    """Keypoints of a keyframe."""

    xy: np.ndarray  # (n, 2) [px]
    t: np.ndarray  # (n,) [s]


@jit
def expected(before, after, pairs, span):
    """Return where matches start, rounded, and where they are after `span` [s] at their speed."""
    centres, guesses = np.empty((len(pairs), 2)), np.empty((len(pairs), 2))
    for k in range(len(pairs)):
        i, j = pairs[k]
        for c in range(2):
            speed = (after.xy[j, c] - before.xy[i, c]) / (after.t[j] - before.t[i])
            centres[k, c] = np.rint(before.xy[i, c])
            guesses[k, c] = centres[k, c] + speed * span
    return centres, guesses


@jit
def seen(found, grid, step):
    """Return pixels and bearings before and after, of those that were found and have bearings.

    Parameters
    ----------
    found : ndarray of float64, shape (n, 4)
        Pixels before and after, or NaN.
    grid, step
        As in `interpolate`.
    """
    n = len(found)
    xy1, xy2 = np.empty((n, 2)), np.empty((n, 2))
    kept = 0
    for k in range(n):
        if np.isfinite(found[k, 0]):
            xy1[kept], xy2[kept] = found[k, :2], found[k, 2:]
            kept += 1
    xy1, xy2 = xy1[:kept], xy2[:kept]
    r1, r2 = np.empty((kept, 3)), np.empty((kept, 3))
    interpolate(grid, step, xy1, r1)
    interpolate(grid, step, xy2, r2)
    both = np.isfinite(r1[:, 0]) & np.isfinite(r2[:, 0])
    if both.all():
        return xy1, xy2, r1, r2
    return xy1[both], xy2[both], r1[both], r2[both]

"""Loops of event images: drawing them, and aligning patches of two."""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from evcalib.kernels.features.patch_sums import compare_sums
from evcalib.kernels.jit import jit

_ONE = np.uint64(1)

_TOLERANCE = 0.01
"""A patch rests when a step is shorter than this [px]."""


class PatchLimits(NamedTuple):
    """What is asked of the place of a patch in another image."""

    steps: int  # most iterations
    farthest: float  # from the guess [px]
    least: float  # correlation


@jit
def draw(events, start, end, last, following, image):
    """Add up the polarities of the events from `start` up to before `end`.

    Parameters
    ----------
    events : EventColumns
        The events; those from `end` on tell what follows.
    start, end : int
        Times [us].
    last : float
        Weight of an event that the other polarity follows at its pixel; half way to 1 if nothing
        follows.
    following : ndarray of int8, shape (height, width)
        Zeros; holds the sign of the next event of each pixel.
    image : ndarray of float32, shape (height, width)
        Output, zeros before.
    """
    for i in range(events.t.size - 1, -1, -1):
        if events.t[i] < start:
            break
        x, y = np.int64(events.x[i]), np.int64(events.y[i])
        sign = 1 if events.p[i] else -1
        if events.t[i] < end:
            after = following[y, x]
            weight = 1.0 if after == sign else (last if after == -sign else 0.5 * (1.0 + last))
            image[y, x] += sign * weight
        following[y, x] = sign


@lru_cache
def patch_aligner(radius: int) -> Callable[..., Any]:
    """Return what aligns patches of 2 radius + 1 pixels a side, a constant in its loops."""
    side = 2 * radius + 1

    @jit
    def cut(image, x, y, patch):
        """Copy the square around a pixel: its values, then their slopes along x and y."""
        left, top = np.uint64(x - radius), np.uint64(y - radius)
        for i in range(side):
            row = top + np.uint64(i)
            for j in range(side):
                k = left + np.uint64(j)
                patch[0, i, j] = image[row, k]
                patch[1, i, j] = 0.5 * (image[row, k + _ONE] - image[row, k - _ONE])
                patch[2, i, j] = 0.5 * (image[row + _ONE, k] - image[row - _ONE, k])

    @jit
    def moments(patch):
        """Return sums of gx gx, gx gy, gy gy, value value, gx value, gy value, and the centroid."""
        xx = xy = yy = vv = xv = yv = cx = cy = 0.0
        for i in range(side):
            for j in range(side):
                value, gx, gy = patch[0, i, j], patch[1, i, j], patch[2, i, j]
                xx += gx * gx
                xy += gx * gy
                yy += gy * gy
                vv += value * value
                xv += gx * value
                yv += gy * value
                cx += (gx * gx + gy * gy) * (j - radius)
                cy += (gx * gx + gy * gy) * (i - radius)
        return xx, xy, yy, vv, xv, yv, cx, cy

    @jit
    def compare(patch, image, x, y):
        """Return sums of value v, gx v, gy v and v v, where v is the image around (x, y)."""
        col, row = math.floor(x), math.floor(y)
        one, a, b = np.float32(1.0), np.float32(x - col), np.float32(y - row)
        weights = ((one - a) * (one - b), a * (one - b), (one - a) * b, a * b)
        width = image.shape[1]
        start = (int(row) - radius) * width + int(col) - radius
        return compare_sums(patch, image, start, width, weights, side)

    @jit
    def align_patches(first, second, centres, guesses, limits, out):
        """Find where patches of one image lie in another: Lucas and Kanade's inverse iteration.

        The patches may differ by a factor.

        Parameters
        ----------
        first, second : ndarray of float32, shape (height, width)
            The images, contiguous.
        centres : ndarray of int64, shape (n, 2)
            Columns x, y: middles of the patches in the first image.
        guesses : ndarray of float64, shape (n, 2)
            Where they are about in the second.
        limits : PatchLimits
            What counts as found.
        out : ndarray of float64, shape (n, 4)
            Output: centroid of the patch, weighted by its squared slopes, in the first image, and
            where it is in the second.  NaN where the patch leaves an image, has structure in one
            direction only, correlates too little or does not come to rest near the guess.
        """
        height, width = first.shape
        patch = np.empty((3, side, side), dtype=np.float32)
        for k in range(len(centres)):
            out[k] = math.nan
            cx, cy = centres[k]
            if min(cx, cy) <= radius or cx >= width - 1 - radius or cy >= height - 1 - radius:
                continue
            cut(first, cx, cy, patch)
            xx, xy, yy, vv, xv, yv, mx, my = moments(patch)
            determinant = xx * yy - xy * xy
            if determinant <= 1e-3 * (xx + yy) ** 2:
                continue
            mx, my = mx / (xx + yy), my / (xx + yy)
            x, y = guesses[k]
            for _ in range(limits.steps):
                inside = radius <= x < width - 1 - radius and radius <= y < height - 1 - radius
                if not inside or math.hypot(x - guesses[k, 0], y - guesses[k, 1]) > limits.farthest:
                    break
                v, gx, gy, square = compare(patch, second, x, y)
                if v <= 0.0:
                    break
                gx, gy = gx * vv / v - xv, gy * vv / v - yv
                dx = (yy * gx - xy * gy) / determinant
                dy = (xx * gy - xy * gx) / determinant
                x, y = x - dx, y - dy
                if dx * dx + dy * dy < _TOLERANCE**2:
                    if v > limits.least * math.sqrt(vv * square):
                        out[k] = (cx + mx, cy + my, x + mx, y + my)
                    break

    return align_patches

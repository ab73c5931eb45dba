"""Loops of event images: drawing them, and aligning patches of two."""

import math
from typing import NamedTuple

import numpy as np

from evcalib.kernels.jit import jit

_TOLERANCE = 0.01
"""A patch rests when a step is shorter than this [px]."""


class PatchLimits(NamedTuple):
    """What a patch is, and what is asked of its place in another image."""

    radius: int  # [px]
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


@jit
def _cut(image, x, y, patch):
    """Copy the square around a pixel: its values, then their slopes along x and y."""
    n = patch.shape[1]
    left, top = x - n // 2, y - n // 2
    for i in range(n):
        above, row, below = image[top + i - 1], image[top + i], image[top + i + 1]
        for j in range(n):
            k = left + j
            patch[0, i, j] = row[k]
            patch[1, i, j] = 0.5 * (row[k + 1] - row[k - 1])
            patch[2, i, j] = 0.5 * (below[k] - above[k])


@jit
def _moments(patch):
    """Return sums of gx gx, gx gy, gy gy, value value, gx value, gy value, and the centroid."""
    n = patch.shape[1]
    xx = xy = yy = vv = xv = yv = cx = cy = 0.0
    for i in range(n):
        for j in range(n):
            value, gx, gy = patch[0, i, j], patch[1, i, j], patch[2, i, j]
            xx += gx * gx
            xy += gx * gy
            yy += gy * gy
            vv += value * value
            xv += gx * value
            yv += gy * value
            cx += (gx * gx + gy * gy) * (j - n // 2)
            cy += (gx * gx + gy * gy) * (i - n // 2)
    return xx, xy, yy, vv, xv, yv, cx, cy


@jit
def _compare(patch, image, x, y, sums):
    """Return sums of value v, gx v, gy v and v v, where v is the image around (x, y).

    The inner loop runs over columns with a sum for each, so that it becomes vector code.
    """
    n = patch.shape[1]
    col, row = math.floor(x), math.floor(y)
    a, b = np.float32(x - col), np.float32(y - row)
    one = np.float32(1.0)
    w00, w01, w10, w11 = (one - a) * (one - b), a * (one - b), (one - a) * b, a * b
    left, top = int(col) - n // 2, int(row) - n // 2
    sums[:] = 0.0
    for i in range(n):
        upper, lower = image[top + i, left : left + n + 1], image[top + i + 1, left : left + n + 1]
        value, gx, gy = patch[0, i], patch[1, i], patch[2, i]
        for j in range(n):
            v = w00 * upper[j] + w01 * upper[j + 1] + w10 * lower[j] + w11 * lower[j + 1]
            sums[0, j] += value[j] * v
            sums[1, j] += gx[j] * v
            sums[2, j] += gy[j] * v
            sums[3, j] += v * v
    return sums[0].sum(), sums[1].sum(), sums[2].sum(), sums[3].sum()


@jit
def align_patches(first, second, centres, guesses, limits, out):
    """Find where patches of one image lie in another: Lucas and Kanade's inverse iteration.

    The patches may differ by a factor.

    Parameters
    ----------
    first, second : ndarray of float32, shape (height, width)
        The images.
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
    radius = limits.radius
    height, width = first.shape
    side = 2 * radius + 1
    patch = np.empty((3, side, side), dtype=np.float32)
    sums = np.empty((4, side), dtype=np.float32)
    for k in range(len(centres)):
        out[k] = math.nan
        cx, cy = centres[k]
        if min(cx, cy) <= radius or cx >= width - 1 - radius or cy >= height - 1 - radius:
            continue
        _cut(first, cx, cy, patch)
        xx, xy, yy, vv, xv, yv, mx, my = _moments(patch)
        determinant = xx * yy - xy * xy
        if determinant <= 1e-3 * (xx + yy) ** 2:
            continue
        mx, my = mx / (xx + yy), my / (xx + yy)
        x, y = guesses[k]
        for _ in range(limits.steps):
            inside = radius <= x < width - 1 - radius and radius <= y < height - 1 - radius
            if not inside or math.hypot(x - guesses[k, 0], y - guesses[k, 1]) > limits.farthest:
                break
            v, gx, gy, square = _compare(patch, second, x, y, sums)
            if v <= 0.0:
                break
            gx, gy = gx * vv / v - xv, gy * vv / v - yv
            dx = (yy * gx - xy * gy) / determinant
            dy = (xx * gy - xy * gx) / determinant
            x, y = x - dx, y - dy
            if dx * dx + dy * dy < _TOLERANCE**2:
                if v > limits.least * math.sqrt(vv * square):
                    out[k, 0], out[k, 1], out[k, 2], out[k, 3] = cx + mx, cy + my, x + mx, y + my
                break

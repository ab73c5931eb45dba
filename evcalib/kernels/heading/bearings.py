"""Bearings between the nodes of a grid."""

import math

import numpy as np

from evcalib.kernels.jit import jit


@jit
def interpolate(grid, step, xy, out):
    """Fill in unit bearings at pixels, bilinear between the nodes of a grid.

    Parameters
    ----------
    grid : ndarray of float64, shape (rows, columns, 3)
        Bearings at pixels (step * column, step * row).
    step : int
        Distance of the nodes [px].
    xy : ndarray of float64, shape (n, 2)
        Pixels within the grid.
    out : ndarray of float64, shape (n, 3)
        Output; NaN next to nodes of NaN.
    """
    rows, columns, _ = grid.shape
    for i in range(len(xy)):
        u, v = xy[i, 0] / step, xy[i, 1] / step
        col, row = min(max(np.int64(u), 0), columns - 2), min(max(np.int64(v), 0), rows - 2)
        a, b = u - col, v - row
        square = 0.0
        for k in range(3):
            upper = (1.0 - a) * grid[row, col, k] + a * grid[row, col + 1, k]
            lower = (1.0 - a) * grid[row + 1, col, k] + a * grid[row + 1, col + 1, k]
            out[i, k] = (1.0 - b) * upper + b * lower
            square += out[i, k] ** 2
        for k in range(3):
            out[i, k] /= math.sqrt(square)

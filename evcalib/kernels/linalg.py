"""Products of vectors in three dimensions, without temporaries."""

import math

import numpy as np

from evcalib.kernels.jit import jit


@jit
def cross(a, b):
    """Return the cross product as a tuple."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@jit
def dot(a, b):
    """Return the dot product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit
def tangent_basis(t):
    """Return two unit vectors that make a right-handed frame with the unit vector t."""
    basis = np.zeros((2, 3))
    axis = 0
    for k in range(1, 3):
        if abs(t[k]) < abs(t[axis]):
            axis = k
    basis[0, axis] = 1.0
    basis[0] -= t[axis] * t
    basis[0] /= math.sqrt(dot(basis[0], basis[0]))
    basis[1, 0], basis[1, 1], basis[1, 2] = cross(t, basis[0])
    return basis

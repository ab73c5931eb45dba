"""Loops of the rival model: a camera that turns steadily and does not translate.

A turn through the angle a about the unit axis k takes the bearing r1 to r2 with r2 - r1 =
tan(a / 2) k x (r1 + r2) (Cayley).  With g = half the turn rate and `span` the time between the two
bearings the right side is span g x (r1 + r2), up to the third order of the angle.
"""

from typing import NamedTuple

import numpy as np

from evcalib.kernels.jit import jit
from evcalib.kernels.linalg import cross, dot
from evcalib.kernels.splitmix import draw


class TimedBearings(NamedTuple):
    """The same points before and after."""

    r1: np.ndarray  # (n, 3) unit rows
    r2: np.ndarray  # (n, 3)
    spans: np.ndarray  # (n,) time between the two


@jit
def _solve_turn(normal, right):
    """Solve a symmetric system of 3 x 3 by Cramer's rule; zeros if it is singular."""
    c0 = cross(normal[1], normal[2])
    det = dot(normal[0], c0)
    turn = np.zeros(3)
    trace = normal[0, 0] + normal[1, 1] + normal[2, 2]
    if abs(det) <= 1e-12 * trace**3:
        return turn
    turn[0] = dot(right, c0) / det
    turn[1] = dot(right, cross(normal[2], normal[0])) / det
    turn[2] = dot(right, cross(normal[0], normal[1])) / det
    return turn


@jit
def _add_turn(r1, r2, span, weight, normal, right):
    """Add one correspondence to the least squares of (r2 - r1) = span g x (r1 + r2)."""
    m = (r1[0] + r2[0], r1[1] + r2[1], r1[2] + r2[2])
    d = (r2[0] - r1[0], r2[1] - r1[1], r2[2] - r1[2])
    moment = cross(m, d)
    square = dot(m, m)
    for row in range(3):
        right[row] += weight * span * moment[row]
        for col in range(3):
            normal[row, col] -= weight * span * span * m[row] * m[col]
        normal[row, row] += weight * span * span * square


@jit
def _squared_residual(g, r1, r2, span):
    """Squared residual of one correspondence under the turn g [rad^2], per point of the pair."""
    c = cross(g, (r1[0] + r2[0], r1[1] + r2[1], r1[2] + r2[2]))
    total = 0.0
    for k in range(3):
        total += (r2[k] - r1[k] - span * c[k]) ** 2
    return 0.5 * total


@jit
def turn_ransac(bearings, threshold, trials, seed):
    """Return the steady turn g that explains the correspondences best, refined on its inliers."""
    r1, r2, spans = bearings.r1, bearings.r2, bearings.spans
    n = len(r1)
    limit = threshold * threshold
    state = np.uint64(seed)
    best, found = np.inf, np.zeros(3)
    for _ in range(trials):
        normal, right = np.zeros((3, 3)), np.zeros(3)
        state, i = draw(state, n)
        state, j = draw(state, n)
        _add_turn(r1[i], r2[i], spans[i], 1.0, normal, right)
        _add_turn(r1[j], r2[j], spans[j], 1.0, normal, right)
        g = _solve_turn(normal, right)
        cost = 0.0
        for i in range(n):
            cost += min(_squared_residual(g, r1[i], r2[i], spans[i]), limit)
            if cost > best:
                break
        if cost < best:
            best, found = cost, g
    for _ in range(5):
        normal, right = np.zeros((3, 3)), np.zeros(3)
        for i in range(n):
            ratio = _squared_residual(found, r1[i], r2[i], spans[i]) / (4.0 * limit)
            if ratio < 1.0:
                _add_turn(r1[i], r2[i], spans[i], (1.0 - ratio) ** 2, normal, right)
        found = _solve_turn(normal, right)
    return found


@jit
def squared_residuals(g, bearings, squares):
    """Fill in the squared residual of each correspondence under the turn g [rad^2]."""
    r1, r2, spans = bearings.r1, bearings.r2, bearings.spans
    for i in range(len(r1)):
        squares[i] = _squared_residual(g, r1[i], r2[i], spans[i])

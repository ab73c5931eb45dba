"""Loops of the rival model at its most able: a camera that turns unsteadily behind a wrong lens.

The picture of a lens that is known badly is displaced: what is said to come from the bearing m
comes from m + (z m - e_z) (k0 + k1 q + k2 q^2) + k3 (e_x - x m) + k4 (e_y - y m), with m = (x, y,
z) and q = 2 (1 - z), near the squared angle from the optical axis.  k0 is an error of the focal
length, k1 and k2 are radial distortion, k3 and k4 an error of the centre.  A turn moves the
displaced bearing; what is seen of it is that motion, taken back through the displacement.
"""

import math
from typing import NamedTuple

import numpy as np

from evcalib.kernels.jit import jit
from evcalib.kernels.linalg import cross, dot, tangent_basis

LENS = 5
"""Numbers that a displacement has."""

RATES = 9
"""Numbers that an unsteady turn has: rate, its change, and the change of that, about three axes."""


class Flow(NamedTuple):
    """Displacements of points between two times."""

    middle: np.ndarray  # (n, 3) unit rows halfway between the bearings before and after
    basis: np.ndarray  # (n, 2, 3) tangents there
    moved: np.ndarray  # (n, 2) difference of the bearings along these
    times: np.ndarray  # (n, 3) integrals over the time between them of 1, t and t^2 / 2


class Lens(NamedTuple):
    """How well a lens is known."""

    sd: np.ndarray  # (LENS,) standard deviations of the displacement
    most: float  # bound of each of them


@jit
def flow(r1, r2, spans, middles):
    """Return the displacements of bearings (n, 3), with times about the median middle."""
    n = len(r1)
    middle, basis = np.empty((n, 3)), np.empty((n, 2, 3))
    moved, times = np.empty((n, 2)), np.empty((n, 3))
    centre = np.median(middles)
    for i in range(n):
        middle[i] = r1[i] + r2[i]
        middle[i] /= math.sqrt(dot(middle[i], middle[i]))
        basis[i] = tangent_basis(middle[i])
        for k in range(2):
            moved[i, k] = dot(basis[i, k], r2[i]) - dot(basis[i, k], r1[i])
        late = middles[i] - centre
        times[i, 0] = spans[i]
        times[i, 1] = spans[i] * late
        times[i, 2] = spans[i] * (0.5 * late * late + spans[i] * spans[i] / 24.0)
    return Flow(middle, basis, moved, times)


@jit
def _displaced(m, lens, out):
    """Fill in the displaced bearing of m, of any length."""
    q = 2.0 * (1.0 - m[2])
    radial = lens[0] + q * (lens[1] + q * lens[2])
    along = 1.0 + m[2] * radial - lens[3] * m[0] - lens[4] * m[1]
    out[0] = along * m[0] + lens[3]
    out[1] = along * m[1] + lens[4]
    out[2] = along * m[2] - radial


@jit
def _stretched(m, b, lens, out):
    """Fill in the derivative of the displaced bearing of m along its tangent b."""
    q = 2.0 * (1.0 - m[2])
    radial = lens[0] + q * (lens[1] + q * lens[2])
    slope = -2.0 * b[2] * (lens[1] + 2.0 * q * lens[2])
    along = 1.0 + m[2] * radial - lens[3] * m[0] - lens[4] * m[1]
    change = b[2] * radial + m[2] * slope - lens[3] * b[0] - lens[4] * b[1]
    for k in range(3):
        out[k] = along * b[k] + change * m[k]
    out[2] -= slope


@jit
def seen_turns(m, basis, lens, out):
    """Fill in the flow along the tangents per unit turn about x, y and z, shape (2, 3)."""
    o, d0, d1 = np.empty(3), np.empty(3), np.empty(3)
    _displaced(m, lens, o)
    _stretched(m, basis[0], lens, d0)
    _stretched(m, basis[1], lens, d1)
    square = dot(o, o)
    f0, f1 = dot(o, d0) / square, dot(o, d1) / square
    for k in range(3):
        d0[k] -= f0 * o[k]
        d1[k] -= f1 * o[k]
    a, b, c = dot(d0, d0), dot(d0, d1), dot(d1, d1)
    det = max(a * c - b * b, 1e-12)
    # dot(e x o, d) = dot(e, o x d): the motion of a turn about each axis at once.
    u, v = cross(o, d0), cross(o, d1)
    for axis in range(3):
        out[0, axis] = (c * u[axis] - b * v[axis]) / det
        out[1, axis] = (a * v[axis] - b * u[axis]) / det


@jit
def _rate(times, rates, out):
    """Fill in the turn between the two times of a displacement."""
    for axis in range(3):
        out[axis] = 0.0
        for order in range(3):
            out[axis] += times[order] * rates[3 * order + axis]


@jit
def squared_residuals(rates, lens, flow, squares):
    """Fill in the squared residuals [rad^2], per point of a pair."""
    seen, turn = np.empty((2, 3)), np.empty(3)
    for i in range(len(flow.middle)):
        seen_turns(flow.middle[i], flow.basis[i], lens, seen)
        _rate(flow.times[i], rates, turn)
        e0 = flow.moved[i, 0] - dot(seen[0], turn)
        e1 = flow.moved[i, 1] - dot(seen[1], turn)
        squares[i] = 0.5 * (e0 * e0 + e1 * e1)


@jit
def _slopes(i, rates, lens, flow, row):
    """Fill in the derivatives (2, RATES + LENS) of one displacement; return its residuals."""
    seen, turn, changed = np.empty((2, 3)), np.empty(3), np.empty((2, 3))
    step = 1e-4
    m, basis, times = flow.middle[i], flow.basis[i], flow.times[i]
    seen_turns(m, basis, lens, seen)
    _rate(times, rates, turn)
    for k in range(2):
        for order in range(3):
            for axis in range(3):
                row[k, 3 * order + axis] = seen[k, axis] * times[order]
    p0, p1 = dot(seen[0], turn), dot(seen[1], turn)
    for j in range(LENS):
        kept = lens[j]
        lens[j] = kept + step
        seen_turns(m, basis, lens, changed)
        lens[j] = kept
        row[0, RATES + j] = (dot(changed[0], turn) - p0) / step
        row[1, RATES + j] = (dot(changed[1], turn) - p1) / step
    return flow.moved[i, 0] - p0, flow.moved[i, 1] - p1


@jit
def fit_turn(start, flow, scale, known, steps):
    """Return rates and displacement that explain the flow best, from a steady turn.

    Gauss-Newton on Tukey's loss, whose scale [rad] starts with the residuals as they are and ends
    as given.  The displacement is held by its standard deviations, which count as one observation
    each of the scale.
    """
    n, size = len(flow.middle), RATES + LENS
    rates, lens = np.zeros(RATES), np.zeros(LENS)
    rates[:3] = start
    squares, row = np.empty(n), np.empty((2, size))
    wide = 4.0
    for _ in range(steps):
        squared_residuals(rates, lens, flow, squares)
        width = max(scale, min(1.5 * math.sqrt(np.median(squares)), wide * scale))
        wide *= 0.6
        normal, right = np.zeros((size, size)), np.zeros(size)
        for i in range(n):
            ratio = squares[i] / (9.0 * width * width)
            if ratio >= 1.0:
                continue
            e0, e1 = _slopes(i, rates, lens, flow, row)
            weight = (1.0 - ratio) ** 2
            for a in range(size):
                w0, w1 = weight * row[0, a], weight * row[1, a]
                right[a] += w0 * e0 + w1 * e1
                for b in range(a + 1):
                    normal[a, b] += w0 * row[0, b] + w1 * row[1, b]
        for j in range(LENS):
            hold = (scale / known.sd[j]) ** 2
            normal[RATES + j, RATES + j] += hold
            right[RATES + j] -= hold * lens[j]
        trace = 0.0
        for a in range(size):
            trace += normal[a, a]
            for b in range(a):
                normal[b, a] = normal[a, b]
        if trace <= 0.0:
            break
        scaled = np.empty(size)
        for a in range(size):
            scaled[a] = 1.0 / math.sqrt(normal[a, a] + 1e-12 * trace)
        for a in range(size):
            for b in range(size):
                normal[a, b] *= scaled[a] * scaled[b]
            normal[a, a] += 1e-9
        change = np.linalg.solve(normal, right * scaled) * scaled
        rates += change[:RATES]
        for j in range(LENS):
            lens[j] = min(max(lens[j] + change[RATES + j], -known.most), known.most)
    return rates, lens

"""Directions of a sampled velocity at any time: interpolated, integrated, smoothed.

A velocity is linear between samples and undefined between segments, so that nothing is ever
interpolated across a gap or extrapolated.  Undefined directions are zero vectors.
"""

from typing import NamedTuple

import numpy as np

from evcalib.kernels.jit import jit

INSTANT = 1e-6
"""Intervals shorter than this [s] are instants: a mean over less is lost in rounding.  At a path of
1 km, whose last bit is 1e-13 m, the mean over it is still right to 1e-7 m/s."""


class Samples(NamedTuple):
    """A velocity at n samples."""

    t: np.ndarray  # (n,) [s]
    v: np.ndarray  # (n, 3) [m/s]
    slope: np.ndarray  # (n - 1, 3), see `slopes`
    path: np.ndarray  # (n, 3), see `integrate`
    segment: np.ndarray  # (n,) int64, number of the segment between gaps


class Limits(NamedTuple):
    """Where a sampled velocity has a direction."""

    min_speed: float  # lowest mean speed with a direction [m/s]
    hold: float  # time [s] for which the sample at either end of a segment holds beyond it


@jit
def integrate(t, v, segment):
    """Return the running integral of v [m] at each sample (trapezoids, from 0 in each segment)."""
    path = np.zeros_like(v)
    for j in range(1, t.size):
        if segment[j] == segment[j - 1]:
            half = 0.5 * (t[j] - t[j - 1])
            for a in range(3):
                path[j, a] = path[j - 1, a] + half * (v[j - 1, a] + v[j, a])
    return path


@jit
def slopes(t, v):
    """Return the slope of v [m/s^2] from each sample to the next, shape (n - 1, 3)."""
    out = np.empty((t.size - 1, 3))
    for j in range(t.size - 1):
        for a in range(3):
            out[j, a] = (v[j + 1, a] - v[j, a]) / (t[j + 1] - t[j])
    return out


@jit
def directions(start, end, offset, samples, limits, out):
    """Fill `out` with the unit direction of the mean velocity over each shifted [start, end].

    start, end : (n,) in any order, fastest where neighbours are near.  Where they are less than
        `INSTANT` apart, the velocity at the start is used.
    offset : added to both.
    samples, limits : `Samples` of the velocity and `Limits`.
    out : (3, n); zero where the interval leaves a segment or the mean speed is too low.
    """
    t, v, slope = samples.t, samples.v, samples.slope
    path, segment = samples.path, samples.segment
    min_speed, hold = limits.min_speed, limits.hold
    j = k = 0
    last = t.size - 2
    for i in range(start.size):
        a, b = start[i] + offset, end[i] + offset
        while j > 0 and a < t[j]:
            j -= 1
        while j < last and a >= t[j + 1]:
            j += 1
        if end[i] - start[i] < INSTANT:
            u = a - t[j]
            if u >= 0.0 and a <= t[j + 1] and segment[j] == segment[j + 1]:
                for c in range(3):
                    out[c, i] = v[j, c] + u * slope[j, c]
                continue
            nearest = j + 1 if t[j + 1] - a < u else j
            held = abs(a - t[nearest]) <= hold
            for c in range(3):
                out[c, i] = v[nearest, c] if held else 0.0
            continue
        while k > 0 and b <= t[k]:
            k -= 1
        while k < last and b > t[k + 1]:
            k += 1
        inside = a >= t[j] and b <= t[k + 1] and segment[j] == segment[k + 1]
        u, w, span = a - t[j], b - t[k], b - a
        for c in range(3):
            at_a = path[j, c] + u * (v[j, c] + 0.5 * u * slope[j, c])
            at_b = path[k, c] + w * (v[k, c] + 0.5 * w * slope[k, c])
            out[c, i] = (at_b - at_a) / span if inside else 0.0
    for i in range(start.size):
        speed = np.sqrt(out[0, i] ** 2 + out[1, i] ** 2 + out[2, i] ** 2)
        gain = 1.0 / speed if speed > 0.0 and speed >= min_speed else 0.0
        for c in range(3):
            out[c, i] *= gain


@jit
def smooth(t, v, segment, half_widths, sigma, gate):
    """Return v smoothed by local parabolas, each over the widest window that shows no bias.

    half_widths : (k,) window half widths [s], ascending.
    sigma : (3,) standard deviation of the noise per axis [m/s].
    gate : windows grow as long as the intervals estimate +- gate * sd of all of them share a point
        (the rule of intersecting confidence intervals, Goldenshluger and Nemirovski 1997).
    """
    n = t.size
    out = v.copy()
    for axis in range(3):
        if sigma[axis] == 0:
            continue
        for j in range(n):
            low, high = v[j, axis] - gate * sigma[axis], v[j, axis] + gate * sigma[axis]
            a = b = j
            for width in half_widths:
                while a > 0 and segment[a - 1] == segment[j] and t[j] - t[a - 1] <= width:
                    a -= 1
                while b < n - 1 and segment[b + 1] == segment[j] and t[b + 1] - t[j] <= width:
                    b += 1
                if b - a < 4:
                    continue
                value, gain = _parabola(t, v, axis, a, b, t[j])
                sd = sigma[axis] * np.sqrt(gain)
                low, high = max(low, value - gate * sd), min(high, value + gate * sd)
                if low > high:
                    break
                out[j, axis] = value
    return out


@jit
def _parabola(t, v, axis, a, b, centre):
    """Return the value at `centre` of the parabola through samples a..b, and its variance gain."""
    m0 = m1 = m2 = m3 = m4 = 0.0
    y0 = y1 = y2 = 0.0
    for i in range(a, b + 1):
        u = t[i] - centre
        y = v[i, axis]
        m0 += 1.0
        m1 += u
        m2 += u * u
        m3 += u * u * u
        m4 += u * u * u * u
        y0 += y
        y1 += u * y
        y2 += u * u * y
    c0 = m2 * m4 - m3 * m3
    c1 = m2 * m3 - m1 * m4
    c2 = m1 * m3 - m2 * m2
    det = m0 * c0 + m1 * c1 + m2 * c2
    return (c0 * y0 + c1 * y1 + c2 * y2) / det, c0 / det

"""Slow twins of the back end's kernels: the definitions, a sample at a time or by dense algebra."""

import math
from itertools import pairwise

import numpy as np
from scipy.integrate import trapezoid
from scipy.spatial.transform import Rotation


def segments(t, max_gap):
    """Number the runs of samples between gaps."""
    numbers = [0]
    for before, after in pairwise(t):
        numbers.append(numbers[-1] + (after - before > max_gap))
    return np.array(numbers)


def interpolated(t, v, max_gap, time):
    """Return the velocity on the straight line between the two samples around `time`, or None."""
    for k in range(len(t) - 1):
        if t[k] <= time <= t[k + 1] and t[k + 1] - t[k] <= max_gap:
            share = (time - t[k]) / (t[k + 1] - t[k])
            return (1 - share) * v[k] + share * v[k + 1]
    return None


def mean_velocity(t, v, max_gap, start, end):
    """Return the mean over [start, end] by trapezoids between all corners, or None."""
    corners = [start, *t[(t > start) & (t < end)], end]
    values = [interpolated(t, v, max_gap, corner) for corner in corners]
    gap = any(b - a > max_gap for a, b in pairwise(t) if a < end and b > start)
    if gap or any(value is None for value in values):
        return None
    return trapezoid(np.array(values), corners, axis=0) / (end - start)


def direction(t, v, max_gap, min_speed, start, end):
    """Return the unit direction over [start, end], or zeros."""
    if start == end:
        mean = interpolated(t, v, max_gap, start)
    else:
        mean = mean_velocity(t, v, max_gap, start, end)
    if mean is None or np.linalg.norm(mean) < min_speed:
        return np.zeros(3)
    return mean / np.linalg.norm(mean)


def smooth(t, v, segment, half_widths, sigma, gate):
    """Smooth each sample by the widest parabola whose interval meets all narrower ones."""
    out = v.copy()
    for axis in range(3):
        for j in range(len(t)):
            intervals = [(v[j, axis] - gate * sigma[axis], v[j, axis] + gate * sigma[axis])]
            for width in half_widths:
                near = (np.abs(t - t[j]) <= width) & (segment == segment[j])
                if near.sum() < 5:
                    continue
                row = np.linalg.pinv(np.vander(t[near] - t[j], 3, increasing=True))[0]
                value, margin = row @ v[near, axis], gate * sigma[axis] * np.linalg.norm(row)
                intervals.append((value - margin, value + margin))
                if max(low for low, _ in intervals) > min(high for _, high in intervals):
                    break
                out[j, axis] = value
    return out


def tukey(e, d, weight, R, reach):
    """Return the weights w (1 - u / reach)^2 and the score, the sum of w (1 - u / reach)^3."""
    weights, score = [], 0.0
    for a, b, w in zip(e, d, weight, strict=True):
        rest = max(0.0, 1 - (1 - b @ R @ a) / reach)
        weights.append(w * rest**2)
        score += w * rest**3
    return np.array(weights), score


def aligned(e, d, weight):
    """Return SciPy's best rotation of e onto d."""
    return Rotation.align_vectors(d, e, weights=weight)[0].as_matrix()


def profile(e, directions, weight, reaches):
    """Return score, weight and rotation of one candidate; `directions` are zero where undefined."""
    known = np.any(directions != 0, axis=1)
    e, d, w = e[known], directions[known], weight[known]
    R = aligned(e, d, w)
    for reach in reaches:
        R = aligned(e, d, tukey(e, d, w, R, reach)[0])
    return tukey(e, d, w, R, reaches[-1])[1] / w.sum(), w.sum(), R


def correlation(t, share, memory):
    """Return the matrix of correlations of white plus Ornstein-Uhlenbeck noise at times t."""
    n = len(t)
    out = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            out[i, j] = 1.0 if i == j else share * math.exp(-abs(t[i] - t[j]) / memory)
    return out


def log_likelihood(t, noise, share, memory):
    """Return the Gaussian log-likelihood with the best scale, up to a constant, by Cholesky."""
    n, columns = noise.shape
    L = np.linalg.cholesky(correlation(t, share, memory))
    square = np.sum(np.linalg.solve(L, noise) ** 2) / (n * columns)
    return -0.5 * n * columns * np.log(square) - columns * np.log(np.diag(L)).sum()


def restricted_likelihood(t, noise, fitted, share, memory):
    """Return the same of the combinations of samples that columns (orthonormal) do not touch."""
    n, p = fitted.shape
    untouched = np.linalg.svd(fitted)[0][:, p:]
    L = np.linalg.cholesky(untouched.T @ correlation(t, share, memory) @ untouched)
    columns = noise.shape[1]
    square = np.sum(np.linalg.solve(L, untouched.T @ noise) ** 2) / ((n - p) * columns)
    return -0.5 * (n - p) * columns * np.log(square) - columns * np.log(np.diag(L)).sum()


def correlated_information(t, scores, share, memory):
    """Return sum_ij k(t_i - t_j) s_i s_j^T, a pair at a time."""
    k = correlation(t, share, memory)
    pairs = ((i, j) for i in range(len(t)) for j in range(len(t)))
    return sum(k[i, j] * scores[i].T @ scores[j] for i, j in pairs)

"""Loops of the epipolar solver for a camera that translates and does not turn.

Bearings r1, r2 are unit rows of the same point before and after.  A translation along t obeys
t . (r1 x r2) = 0; its Sampson residual [rad] is t . (r1 x r2) / sqrt(|t x r1|^2 + |t x r2|^2).
"""

import math
from typing import NamedTuple

import numpy as np

from evcalib.kernels.jit import jit
from evcalib.kernels.linalg import cross, dot, tangent_basis
from evcalib.kernels.median import median
from evcalib.kernels.splitmix import draw


class Bearings(NamedTuple):
    """The same points before and after."""

    r1: np.ndarray  # (n, 3) unit rows
    r2: np.ndarray  # (n, 3)
    normals: np.ndarray  # (n, 3) r1 x r2


@jit
def _sampson(t, r1, r2, normal):
    """Sampson residual [rad] of a unit translation t, and the slope that scaled it."""
    before, after = dot(t, r1), dot(t, r2)
    slope = math.sqrt(max(2.0 - before * before - after * after, 1e-12))
    return dot(t, normal) / slope, after - before, slope


@jit
def sampson(t, bearings, residuals, rises):
    """Fill in residuals [rad], and by how much each cosine to t rises (it falls if t is right)."""
    r1, r2, normals = bearings.r1, bearings.r2, bearings.normals
    for i in range(len(r1)):
        residuals[i], rises[i], _ = _sampson(t, r1[i], r2[i], normals[i])


@jit
def normals(r1, r2):
    """Return r1 x r2, row by row."""
    out = np.empty_like(r1)
    for i in range(len(r1)):
        out[i, 0], out[i, 1], out[i, 2] = cross(r1[i], r2[i])
    return out


@jit
def first_not_unit(r, tolerance):
    """Return the first row whose length is not 1, or -1."""
    for i in range(len(r)):
        if not abs(math.sqrt(dot(r[i], r[i])) - 1.0) <= tolerance:
            return i
    return -1


@jit
def evenly(bearings, most):
    """Return the bearings, or if they are more than so many, these evenly taken."""
    n = len(bearings.r1)
    if n <= most:
        return bearings
    rows = np.empty(most, dtype=np.int64)
    step = (n - 1) / max(most - 1, 1)
    for k in range(most):
        rows[k] = np.int64(k * step)
    rows[most - 1] = n - 1 if most > 1 else 0
    return Bearings(bearings.r1[rows], bearings.r2[rows], bearings.normals[rows])


@jit
def judge(t, bearings, threshold, inliers):
    """Fill in which are inliers of t; return the residuals [rad] and the inliers' median size."""
    n = len(bearings.r1)
    residuals, rises, sizes = np.empty(n), np.empty(n), np.empty(n)
    sampson(t, bearings, residuals, rises)
    count = 0
    for i in range(n):
        inliers[i] = abs(residuals[i]) < threshold and rises[i] < threshold
        sizes[count] = abs(residuals[i])
        count += inliers[i]
    return residuals, median(sizes[:count]) if count > 2 else -1.0


@jit
def _truncated_cost(t, bearings, threshold, best):
    """MSAC cost of t; points that flow towards t count as outliers.  Stops above best."""
    r1, r2, normals = bearings.r1, bearings.r2, bearings.normals
    limit = threshold * threshold
    cost = 0.0
    for i in range(len(r1)):
        residual, rise, _ = _sampson(t, r1[i], r2[i], normals[i])
        cost += min(residual * residual, limit) if rise < threshold else limit
        if cost > best:
            break
    return cost


@jit
def _needed_trials(inlier_share, confidence):
    """Return how many samples of two hold one without outliers, with the given confidence."""
    miss = 1.0 - inlier_share * inlier_share
    if miss <= 1e-12:
        return 1.0
    return math.log(1.0 - confidence) / math.log(min(miss, 1.0 - 1e-12))


@jit
def two_point_ransac(bearings, threshold, trials, seed):
    """Return the translation of least truncated cost among those through two correspondences.

    Its sign makes the points of the sample flow away from it; samples that disagree are left.
    """
    r1, r2, normals = bearings.r1, bearings.r2, bearings.normals
    n = len(r1)
    state = np.uint64(seed)
    best = np.inf
    found = np.zeros(3)
    t = np.empty(3)
    needed = np.inf
    for trial in range(trials):
        if trial >= needed:
            break
        state, i = draw(state, n)
        state, j = draw(state, n)
        t[0], t[1], t[2] = cross(normals[i], normals[j])
        length = math.sqrt(dot(t, t))
        if length < 1e-14:
            continue
        t /= length
        rise_i, rise_j = dot(t, r2[i]) - dot(t, r1[i]), dot(t, r2[j]) - dot(t, r1[j])
        if rise_i * rise_j < 0.0:
            continue
        if rise_i + rise_j > 0.0:
            t *= -1.0
        cost = _truncated_cost(t, bearings, threshold, best)
        if cost < best:
            best = cost
            found[:] = t
            share = max(0.0, 1.0 - cost / (n * threshold * threshold))
            needed = _needed_trials(share, 0.999)
    return found


@jit
def slope_of_sampson(t, r1, r2, normal, basis):
    """Return the residual, the rise, and the two derivatives along the tangent basis."""
    residual, rise, slope = _sampson(t, r1, r2, normal)
    before, after = dot(t, r1), dot(t, r2)
    turn = residual / (slope * slope)
    j0 = dot(basis[0], normal) / slope + turn * (
        before * dot(basis[0], r1) + after * dot(basis[0], r2)
    )
    j1 = dot(basis[1], normal) / slope + turn * (
        before * dot(basis[1], r1) + after * dot(basis[1], r2)
    )
    return residual, rise, j0, j1


@jit
def tame_leverage(t, bearings):
    """Return weights that bound the pull of correspondences next to t.

    A correspondence pulls with its displacement over its distance from t, which for a point of
    the scene is the inverse of its distance: a false match beside t would outweigh all others.
    """
    r1, r2, normals = bearings.r1, bearings.r2, bearings.normals
    pull = np.empty(len(r1))
    for i in range(len(r1)):
        pull[i] = math.sqrt(dot(normals[i], normals[i])) / _sampson(t, r1[i], r2[i], normals[i])[2]
    limit = 3.0 * median(pull.copy())
    for i in range(len(r1)):
        pull[i] = min(1.0, limit * limit / max(pull[i] * pull[i], 1e-300))
    return pull


@jit
def refine(t, bearings, scale, steps):
    """Refine t in place by Gauss-Newton on Tukey's loss: no weight above 3 loss scales [rad].

    Correspondences that flow towards t by more than the loss scale get no weight.
    """
    r1, r2, normals = bearings.r1, bearings.r2, bearings.normals
    tame = tame_leverage(t, bearings)
    for _ in range(steps):
        basis = tangent_basis(t)
        a, b, c, u, v = 1e-18, 0.0, 1e-18, 0.0, 0.0
        for i in range(len(r1)):
            residual, rise, j0, j1 = slope_of_sampson(t, r1[i], r2[i], normals[i], basis)
            ratio = residual / (3.0 * scale)
            if abs(ratio) >= 1.0 or rise > scale:
                continue
            weight = tame[i] * (1.0 - ratio * ratio) ** 2
            a += weight * j0 * j0
            b += weight * j0 * j1
            c += weight * j1 * j1
            u += weight * j0 * residual
            v += weight * j1 * residual
        det = a * c - b * b
        if det <= 1e-12 * a * c:
            return
        s0, s1 = (b * v - c * u) / det, (b * u - a * v) / det
        length = math.sqrt(s0 * s0 + s1 * s1)
        shrink = min(1.0, 0.1 / max(length, 1e-300))
        for k in range(3):
            t[k] += shrink * (s0 * basis[0, k] + s1 * basis[1, k])
        t /= math.sqrt(dot(t, t))
        if length < 1e-10:
            return


@jit
def normal_equations(t, bearings, scale, groups):
    """Return the 2 x 2 information of t, and the gradients summed by group.

    `groups` holds numbers from 0; weights are those of `refine`.  The information takes the mean
    second derivative of the loss for all (Huber 1981, section 7.6), which cannot turn negative
    through one correspondence.
    """
    r1, r2, normals = bearings.r1, bearings.r2, bearings.normals
    tame = tame_leverage(t, bearings)
    basis = tangent_basis(t)
    information = np.zeros((2, 2))
    gradients = np.zeros((groups.max() + 1, 2))
    used = np.zeros(len(gradients), dtype=np.bool_)
    curve, total = 0.0, 0.0
    for i in range(len(r1)):
        residual, rise, j0, j1 = slope_of_sampson(t, r1[i], r2[i], normals[i], basis)
        ratio = residual / (3.0 * scale)
        if abs(ratio) >= 1.0 or rise > scale:
            continue
        keep = 1.0 - ratio * ratio
        curve += keep * (1.0 - 5.0 * ratio * ratio)
        total += 1.0
        information[0, 0] += tame[i] * j0 * j0
        information[0, 1] += tame[i] * j0 * j1
        information[1, 1] += tame[i] * j1 * j1
        pull = tame[i] * keep * keep * residual
        gradients[groups[i], 0] += pull * j0
        gradients[groups[i], 1] += pull * j1
        used[groups[i]] = True
    information[1, 0] = information[0, 1]
    information *= max(curve, 0.0) / max(total, 1.0)
    return information, gradients[used]


@jit
def refine_swinging(t, bearings, times, scale, steps):
    """Return residuals and rises of a direction that swings about t, at its best.

    The direction of each correspondence is t plus a change in the tangent plane that is linear in
    the columns of `times` (n, 3), refined as in `refine`.
    """
    r1, r2, normals = bearings.r1, bearings.r2, bearings.normals
    n = len(r1)
    basis, tame = tangent_basis(t), tame_leverage(t, bearings)
    change = np.zeros(6)
    residuals, rises = np.empty(n), np.empty(n)
    at, row = np.empty(3), np.empty(6)
    for step in range(steps + 1):
        normal, right = np.zeros((6, 6)), np.zeros(6)
        for i in range(n):
            for k in range(3):
                at[k] = t[k]
                for c in range(3):
                    at[k] += times[i, c] * (
                        change[2 * c] * basis[0, k] + change[2 * c + 1] * basis[1, k]
                    )
            at /= math.sqrt(dot(at, at))
            residuals[i], rises[i], slope = _sampson(at, r1[i], r2[i], normals[i])
            ratio = residuals[i] / (3.0 * scale)
            if abs(ratio) >= 1.0 or rises[i] > scale:
                continue
            weight = tame[i] * (1.0 - ratio * ratio) ** 2
            for c in range(3):
                row[2 * c] = times[i, c] * dot(basis[0], normals[i]) / slope
                row[2 * c + 1] = times[i, c] * dot(basis[1], normals[i]) / slope
            for a in range(6):
                right[a] -= weight * row[a] * residuals[i]
                for b in range(6):
                    normal[a, b] += weight * row[a] * row[b]
        trace = np.trace(normal)
        if step == steps or trace <= 0.0:
            break
        # Where the times hardly differ a swing cannot be told, and is left at nothing.
        for a in range(6):
            normal[a, a] += 1e-6 * trace
        change += np.linalg.solve(normal, right)
    return residuals, rises

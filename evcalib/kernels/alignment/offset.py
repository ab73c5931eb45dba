"""Correlation curves over candidate offsets."""

from typing import NamedTuple

import numpy as np

from evcalib.kernels.alignment.rotation import best_rotation, tukey_pass
from evcalib.kernels.jit import jit
from evcalib.kernels.kinematics.velocity_track import directions


class Headings(NamedTuple):
    """Headings as columns: times (n,) from `start` to `end`, directions e (3, n), weight (n,)."""

    start: np.ndarray
    end: np.ndarray
    e: np.ndarray
    weight: np.ndarray


@jit
def profile(headings, offsets, track, limits, loss_scales):
    """Return the robust rigid profile: at each offset, the score under its best rotation.

    track, limits : `Samples` and `Limits` of the velocities.
    loss_scales : (k,) scales of Tukey's loss, descending: it is first wide, then narrow, so that
        each candidate finds its rotation from a plain start (graduated non-convexity).
    Returns scores (m,), weights of the usable pairs (m,), rotations (m, 3, 3).
    """
    e, weight = headings.e, headings.weight
    m, n = offsets.size, weight.size
    scores, totals = np.zeros(m), np.zeros(m)
    rotations = np.zeros((m, 3, 3))
    d, work, usable = np.empty((3, n)), np.empty((3, n)), np.empty(n)
    for k in range(m):
        directions(headings.start, headings.end, offsets[k], track, limits, d)
        for i in range(n):
            defined = d[0, i] != 0.0 or d[1, i] != 0.0 or d[2, i] != 0.0
            usable[i] = weight[i] if defined else 0.0
            totals[k] += usable[i]
        R = best_rotation((d * usable) @ e.T)
        score = 0.0
        for scale in loss_scales:
            H, score = tukey_pass(e, d, usable, R, scale, work)
            if score > 0.0:
                R = best_rotation(H)
        H, score = tukey_pass(e, d, usable, R, loss_scales[-1], work)
        scores[k] = score / totals[k] if totals[k] > 0.0 else 0.0
        rotations[k] = R
    return scores, totals, rotations


@jit
def moments(headings, offsets, track, limits):
    """Return weighted covariances S_ee, S_oo, S_oe (m, 3, 3) and weights (m,) at each offset."""
    e, weight = headings.e, headings.weight
    m, n = offsets.size, weight.size
    S_ee, S_oo, S_oe = np.zeros((m, 3, 3)), np.zeros((m, 3, 3)), np.zeros((m, 3, 3))
    totals = np.zeros(m)
    d, usable = np.empty((3, n)), np.empty(n)
    for k in range(m):
        directions(headings.start, headings.end, offsets[k], track, limits, d)
        for i in range(n):
            defined = d[0, i] != 0.0 or d[1, i] != 0.0 or d[2, i] != 0.0
            usable[i] = weight[i] if defined else 0.0
            totals[k] += usable[i]
        if totals[k] <= 0.0:
            continue
        x, y = e.copy(), d.copy()
        for a in range(3):
            x[a] -= (x[a] * usable).sum() / totals[k]
            y[a] -= (y[a] * usable).sum() / totals[k]
        S_ee[k] = (x * usable) @ x.T / totals[k]
        S_oo[k] = (y * usable) @ y.T / totals[k]
        S_oe[k] = (y * usable) @ x.T / totals[k]
    return S_ee, S_oo, S_oe, totals


@jit
def turning_correlation(at, rate, half, offsets, track, limits):
    """Correlate `rate` with how far directions turn from `half` before to `half` after each time.

    at, rate : (n,) times and turns; half : [s].
    Returns the correlation (m,), 0 where it is undefined, and the number of pairs (m,).
    """
    m, n = offsets.size, at.size
    score, totals = np.zeros(m), np.zeros(m)
    before, after = np.empty((3, n)), np.empty((3, n))
    x, y = np.empty(n), np.empty(n)
    for k in range(m):
        directions(at, at, offsets[k] - half, track, limits, before)
        directions(at, at, offsets[k] + half, track, limits, after)
        count = 0
        for i in range(n):
            known_before = before[0, i] != 0.0 or before[1, i] != 0.0 or before[2, i] != 0.0
            known_after = after[0, i] != 0.0 or after[1, i] != 0.0 or after[2, i] != 0.0
            if known_before and known_after:
                turn = 0.0
                for a in range(3):
                    turn += (after[a, i] - before[a, i]) ** 2
                x[count], y[count] = rate[i], np.sqrt(turn)
                count += 1
        totals[k] = count
        if count > 2:
            p, q = x[:count] - x[:count].mean(), y[:count] - y[:count].mean()
            spread = np.sqrt((p * p).sum() * (q * q).sum())
            if spread > 0.0:
                score[k] = (p * q).sum() / spread
    return score, totals


class Peak(NamedTuple):
    """At the best offset: scores (n,), negative where not usable; directions (n, 3), as seen."""

    scores: np.ndarray
    directions: np.ndarray


@jit
def contrast(headings, offsets, track, limits, rotations, loss_scale, peak, memory):
    """Return mean and variance, over pairs, of the score at the peak less that at each offset.

    peak : `Peak`; memory : (share, time constant [s]) of the noise, as in `log_likelihood`.
    Returns mean (m,), variance (m,), pairs (m,) over those usable at both, and by how much the
    memory raises the variance of the mean (m,), 1 at least: noise counts only where the two
    directions that a heading is compared with differ, and as they do.
    """
    e, weight = headings.e, headings.weight
    share, constant = memory
    m, n = offsets.size, weight.size
    mean, variance, pairs, inflation = np.zeros(m), np.zeros(m), np.zeros(m), np.ones(m)
    d, carried, apart = np.empty((3, n)), np.empty(3), np.empty(3)
    for k in range(m):
        directions(headings.start, headings.end, offsets[k], track, limits, d)
        R = rotations[k]
        total = first = second = alone = shared = 0.0
        carried[:] = 0.0
        last = headings.start[0]
        for i in range(n):
            undefined = d[0, i] == 0.0 and d[1, i] == 0.0 and d[2, i] == 0.0
            if undefined or peak.scores[i] < 0.0 or weight[i] == 0.0:
                continue
            fit = 0.0
            for a in range(3):
                seen = d[0, i] * R[0, a] + d[1, i] * R[1, a] + d[2, i] * R[2, a]
                fit += seen * e[a, i]
                apart[a] = weight[i] * (seen - peak.directions[i, a])
            decay = np.exp(-max(headings.start[i] - last, 0.0) / constant)
            last = headings.start[i]
            for a in range(3):
                carried[a] *= decay
                alone += apart[a] * apart[a]
                shared += 2.0 * share * apart[a] * carried[a]
                carried[a] += apart[a]
            rest = max(0.0, 1.0 - (1.0 - fit) / loss_scale)
            gap = peak.scores[i] - rest * rest * rest
            total += weight[i]
            first += weight[i] * gap
            second += weight[i] * gap * gap
            pairs[k] += 1.0
        if total > 0.0:
            mean[k] = first / total
            variance[k] = max(second / total - mean[k] ** 2, 0.0)
        if alone > 0.0:
            inflation[k] = max(1.0 + shared / alone, 1.0)
    return mean, variance, pairs, inflation

"""Correlated noise: white plus Ornstein-Uhlenbeck, on irregular times."""

import numpy as np

from evcalib.kernels.jit import jit


@jit
def log_likelihood(t, noise, share, memory):
    """Return the profile log-likelihood of `noise` under a white + Ornstein-Uhlenbeck model.

    The covariance between times i and j is s^2 [(1 - share) [i = j] + share exp(-|t_i - t_j| /
    memory)] for each column; s^2 is maximised out.

    t : (n,) [s]; noise : (n, k).
    """
    return restricted_likelihood(t, noise, np.empty((t.size, 0)), share, memory)


@jit
def restricted_likelihood(t, noise, fitted, share, memory):
    """Return `log_likelihood` of what is left of `noise` after a fit of columns (restricted).

    The likelihood of those combinations of the samples that the fit does not touch (Patterson and
    Thompson 1971), so that noise as slow as the columns is not missed.

    t : (n,) [s]; noise : (n, k); fitted : (n, p), none a sum of the others.
    """
    n, k = noise.shape
    products, logs = _whitened_products(t, np.hstack((fitted, noise)), share, memory)
    p = fitted.shape[1]
    for j in range(p):
        pivot = products[j, j]
        logs += np.log(pivot)
        row = products[j].copy()
        for a in range(j + 1, p + k):
            for b in range(j + 1, p + k):
                products[a, b] -= row[a] * row[b] / pivot
    squares = 0.0
    for c in range(p, p + k):
        squares += products[c, c]
    count = k * (n - p)
    if squares <= 0.0 or count <= 0:
        return 0.0
    return -0.5 * (count * np.log(squares / count) + k * logs)


@jit
def _whitened_products(t, columns, share, memory):
    """Return X^T V^-1 X of columns X, and log |V|, V being the correlation of the noise.

    A Kalman filter makes this O(n), exact for any times and gaps.
    """
    n, k = columns.shape
    white = 1.0 - share
    mean, innovation = np.zeros(k), np.zeros(k)
    products = np.zeros((k, k))
    variance = share
    logs = 0.0
    for i in range(n):
        if i > 0:
            decay = np.exp(-(t[i] - t[i - 1]) / memory)
            variance = decay * decay * variance + share * (1.0 - decay * decay)
            mean *= decay
        total = variance + white
        gain = variance / total
        logs += np.log(total)
        for c in range(k):
            innovation[c] = columns[i, c] - mean[c]
            mean[c] += gain * innovation[c]
        for a in range(k):
            for b in range(k):
                products[a, b] += innovation[a] * innovation[b] / total
        variance *= 1.0 - gain
    return products, logs


@jit
def correlated_information(t, scores, share, memory):
    """Return sum_ij k(t_i - t_j) s_i s_j^T with the correlation k of `log_likelihood`, (p, p).

    t : (n,) ascending; scores : (n, c, p), summed over the c components of each sample.
    """
    n, components, p = scores.shape
    total = np.zeros((p, p))
    carried = np.zeros((components, p))
    for i in range(n):
        if i > 0:
            carried *= np.exp(-(t[i] - t[i - 1]) / memory)
        for c in range(components):
            for a in range(p):
                for b in range(p):
                    s, past = scores[i, c, a], scores[i, c, b]
                    total[a, b] += s * past
                    total[a, b] += share * (s * carried[c, b] + carried[c, a] * past)
            for a in range(p):
                carried[c, a] += scores[i, c, a]
    return total

"""Correlated noise: white plus Ornstein-Uhlenbeck, on irregular times."""

import numpy as np

from evcalib.kernels.jit import jit


@jit
def log_likelihood(t, noise, share, memory):
    """Return the profile log-likelihood of `noise` under a white + Ornstein-Uhlenbeck model.

    The covariance between times i and j is s^2 [(1 - share) [i = j] + share exp(-|t_i - t_j| /
    memory)] for each column; s^2 is maximised out.  A Kalman filter makes this O(n), exact for any
    times and gaps.

    t : (n,) [s]; noise : (n, k).
    """
    n, columns = noise.shape
    white = 1.0 - share
    mean = np.zeros(columns)
    variance = share
    logs = squares = 0.0
    for i in range(n):
        if i > 0:
            decay = np.exp(-(t[i] - t[i - 1]) / memory)
            variance = decay * decay * variance + share * (1.0 - decay * decay)
            mean *= decay
        total = variance + white
        gain = variance / total
        logs += np.log(total)
        for c in range(columns):
            innovation = noise[i, c] - mean[c]
            squares += innovation * innovation / total
            mean[c] += gain * innovation
        variance *= 1.0 - gain
    if squares <= 0.0:
        return 0.0
    return -0.5 * columns * (n * np.log(squares / (n * columns)) + logs)


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

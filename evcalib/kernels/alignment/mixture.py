"""Inliers, flips and uniform outliers among residuals, by expectation-maximisation."""

import numpy as np

from evcalib.kernels.jit import jit


@jit
def fit_mixture(u, weight, sigma, min_sigma):
    """Return the log-likelihood and (sigma, inliers, flipped, outliers) reached from `sigma`.

    Densities over residuals u in [0, 2], with s = sigma^2 and c = 1 - exp(-2 / s):
    inliers exp(-u / s) / (s c), flipped exp(-(2 - u) / s) / (s c), outliers 1 / 2.
    """
    inliers, flipped, outliers = 0.6, 0.05, 0.35
    total = weight.sum()
    likelihood = -np.inf
    for _ in range(200):
        scale = max(sigma, min_sigma) ** 2
        norm = scale * -np.expm1(-2.0 / scale)
        before, likelihood = likelihood, 0.0
        members_in = members_flip = members_out = spread = 0.0
        for i in range(u.size):
            p_in = inliers * np.exp(-u[i] / scale) / norm
            p_flip = flipped * np.exp(-(2.0 - u[i]) / scale) / norm
            p_out = 0.5 * outliers
            density = max(p_in + p_flip + p_out, 1e-300)
            likelihood += weight[i] * np.log(density)
            share = weight[i] / density
            members_in += share * p_in
            members_flip += share * p_flip
            members_out += share * p_out
            spread += share * (p_in * u[i] + p_flip * (2.0 - u[i]))
        # One pair's worth of outliers is always allowed for, so that no share sticks at zero.
        everyone = members_in + members_flip + members_out + 0.2
        inliers, flipped = members_in / everyone, (members_flip + 0.1) / everyone
        outliers = (members_out + 0.1) / everyone
        sigma = min(np.sqrt(spread / max(members_in + members_flip, 1e-12)), 1.0)
        if likelihood - before < 1e-9 * total:
            break
    return likelihood, (max(sigma, min_sigma), inliers, flipped, outliers)

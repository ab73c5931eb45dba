"""How noise scatters, and how long it remembers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import optimize, stats

from evcalib.arrays import Floats, Integers
from evcalib.kernels.uncertainty import noise as kernel


@dataclass(frozen=True)
class NoiseModel:
    """White noise plus an Ornstein-Uhlenbeck process.

    The correlation of two samples `lag` seconds apart is ``share * exp(-lag / memory)``.

    Attributes
    ----------
    share : float
        Share of the variance that is correlated, 0 to 1.
    memory : float
        Its time constant [s].
    """

    share: float
    memory: float

    def correlation(self, lag: float) -> float:
        """Return the correlation of two samples `lag` [s] apart."""
        return self.share * float(np.exp(-lag / self.memory))

    def inflation(self, t: Floats) -> float:
        """Return the variance of the mean over times `t`, relative to that of white noise."""
        return t.size / self.independent(t, np.ones(t.size))

    def inflation_of(self, t: Floats, weights: Floats) -> float:
        """Return the variance of a weighted sum of noise, relative to that of white noise.

        `weights` (n, k) are those of k columns of noise at the times `t`; 1 at least is returned.
        """
        alone = float(np.sum(weights**2))
        if alone == 0:
            return 1.0
        return max(self._spread(t, weights) / alone, 1.0)

    def independent(self, t: Floats, weight: Floats) -> float:
        """Return how many independent samples the weighted mean over times `t` is worth."""
        return float(weight.sum()) ** 2 / max(self._spread(t, weight[:, None]), 1e-300)

    def _spread(self, t: Floats, weights: Floats) -> float:
        """Return the variance of a weighted sum of noise of variance 1."""
        scores = np.ascontiguousarray(weights[:, :, None], dtype=np.float64)
        shared = kernel.correlated_information(t, scores, self.share, self.memory)
        return float(shared[0, 0])


WHITE = NoiseModel(0.0, 1.0)
"""Noise without memory."""


def fit_noise(t: Floats, noise: Floats, fitted: Floats | None = None) -> NoiseModel:
    """Fit white plus Ornstein-Uhlenbeck noise by restricted maximum likelihood.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times [s], ascending; gaps and irregular steps are fine.
    noise : ndarray, shape (n, k)
        k independent columns of zero mean, of common variance and correlation.
    fitted : ndarray, shape (n, p), optional
        Columns that were fitted to each of them, which took away what noise looks like them; a
        constant if not given.

    Returns
    -------
    NoiseModel
        Without memory where there are fewer than eight samples.
    """
    noise = np.ascontiguousarray(noise)
    if t.size < 8 or not np.any(noise):
        return WHITE
    fitted = np.ones((t.size, 1)) if fitted is None else fitted
    basis, sizes, _ = np.linalg.svd(fitted, full_matrices=False)
    basis = np.ascontiguousarray(basis[:, sizes > 1e-9 * sizes[0]])
    span, step = float(t[-1] - t[0]), float(np.median(np.diff(t)))
    shortest, longest = 0.3 * step, max(min(0.5 * span, 60.0), step)

    def loss(share: float, log_memory: float) -> float:
        memory = float(np.exp(log_memory))
        return -float(kernel.restricted_likelihood(t, noise, basis, share, memory))

    logs = np.linspace(np.log(shortest), np.log(longest), 9)
    bounds = (logs[0], logs[-1])
    start = min(logs, key=lambda log_memory: loss(1.0, log_memory))
    near = (max(start - np.diff(logs)[0], bounds[0]), min(start + np.diff(logs)[0], bounds[1]))
    pure = optimize.minimize_scalar(lambda x: loss(1.0, x), bounds=near, method="bounded")
    share, memory, best = 1.0, float(np.exp(pure.x)), float(pure.fun)

    starts = [(share, log_memory) for share in (0.05, 0.25, 0.75) for log_memory in logs]
    mixed = optimize.minimize(
        lambda x: loss(float(x[0]), float(x[1])),
        min(starts, key=lambda x: loss(*x)),
        method="Nelder-Mead",
        bounds=[(0.0, 1.0), bounds],
        options={"xatol": 0.01, "fatol": 1e-3, "maxiter": 200},
    )
    # A white part makes the noise look shorter: it must show at the 95 % level to be believed.
    if best - mixed.fun > 0.5 * stats.chi2.ppf(0.95, 1):
        share, memory, best = float(mixed.x[0]), float(np.exp(mixed.x[1])), float(mixed.fun)
    if best > loss(0.0, 0.0):
        return WHITE
    return NoiseModel(share, memory)


LEAST_NOISE = 1e-6
"""Noise [rad] below which residuals are rounding, not measurement."""


def robust_sd(residuals: Floats) -> float:
    """Return the standard deviation of a normal distribution with this median magnitude.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
        Residuals [rad].

    Returns
    -------
    float
        `LEAST_NOISE` at least.
    """
    return sd_of_median(float(np.median(np.abs(residuals))))


def sd_of_median(size: float) -> float:
    """Return the standard deviation of a normal distribution with this median magnitude.

    Parameters
    ----------
    size : float
        Median magnitude [rad].

    Returns
    -------
    float
        `LEAST_NOISE` at least.
    """
    return max(1.4826 * size, LEAST_NOISE)


SLOW = 0.03
"""Odometry with longer steps [s] does not show the memory of its noise: four of them take as long
as a fast turn (`tests/test_observability.py`)."""


def coloured_noise(v: Floats, segment: Integers, step: float = 0.02) -> tuple[Floats, float]:
    """Return the standard deviation per axis of AR(1) noise on a smooth signal, and its rho.

    Second differences over h samples have the variance sigma^2 (6 - 8 rho^h + 2 rho^2h); those over
    1 and 4 samples give both unknowns.  Where 4 samples take long, motion would pass for memory:
    then the noise is taken for white.

    Parameters
    ----------
    v : ndarray, shape (n, k)
        Samples.
    segment : ndarray of int, shape (n,)
        Segments between gaps.
    step : float
        Time from one sample to the next [s].

    Returns
    -------
    ndarray, shape (k,)
        Standard deviation per axis.
    float
        Correlation from one sample to the next.
    """
    if step > SLOW:
        return white_noise(v, segment), 0.0
    near, far = (white_noise(v, segment, lag, order=2) for lag in (1, 4))
    moving = near > 0
    if not moving.any():
        return near, 0.0
    ratio = float(np.sqrt(np.mean(far[moving] ** 2) / np.mean(near[moving] ** 2)))
    rho = np.linspace(0.0, 0.95, 96)
    expected = np.sqrt(_second_difference(rho**4) / _second_difference(rho))
    rho_hat = float(rho[np.argmin(np.abs(expected - ratio))])
    return near * np.sqrt(6.0 / _second_difference(rho_hat)), rho_hat


def _second_difference(rho: Any) -> Any:
    return 6 - 8 * rho + 2 * rho**2


def white_noise(v: Floats, segment: Integers, lag: int = 1, *, order: int = 4) -> Floats:
    """Return the standard deviation of white noise per axis, from differences of the samples.

    Fourth differences hardly see a smooth motion, also where it is sampled slowly.  Those beyond
    three times their median-based scale, turns and outliers, do not count.

    Parameters
    ----------
    v : ndarray, shape (n, k)
        Samples.
    segment : ndarray of int, shape (n,)
        Differences do not reach from one segment into another.
    lag : int
        Distance of the differences in samples.
    order : {2, 4}
        Order of the differences.

    Returns
    -------
    ndarray, shape (k,)
        Standard deviation per axis.
    """
    weights = {2: (1, -2, 1), 4: (1, -4, 6, -4, 1)}[order]
    left = len(v) - order * lag
    if left < 8:
        return np.zeros(v.shape[1])
    total = sum(w * v[k * lag : k * lag + left] for k, w in enumerate(weights))
    parts = np.asarray(total)[segment[order * lag :] == segment[:left]]
    if len(parts) < 8:
        return np.zeros(v.shape[1])
    rough = np.median(np.abs(parts), axis=0) / 0.6745
    inside = np.abs(parts) <= 3 * rough
    square = np.sum(np.where(inside, parts, 0.0) ** 2, axis=0) / np.maximum(inside.sum(axis=0), 1)
    # A normal variable cut off at three standard deviations keeps 97.33 % of its variance.
    return np.sqrt(square / (0.9733 * np.sum(np.square(weights))))

"""Whether independent answers agree within their error bars."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from evcalib.arrays import Floats
from evcalib.display import Shown

LEAST_WEIGHT = 0.2
"""Least share of its weight that an answer keeps whose covariance rests on few samples.  A choice:
with fewer than p + 1 degrees of freedom the mean of the inverse does not exist."""


@dataclass(frozen=True, eq=False)
class Agreement(Shown):
    """How well k answers to one question of p numbers agree.

    Attributes
    ----------
    pooled : ndarray, shape (p,)
        Their mean, each weighted by its information.
    covariance : ndarray, shape (p, p)
        Of the pooled answer, if they agree; that its weights were estimated is counted in.
    p_value : float
        Probability of contradicting each other as much, or more, by chance.
    without : ndarray, shape (k,)
        The same probability for each answer against the mean of the others.
    """

    pooled: Floats
    covariance: Floats
    p_value: float
    without: Floats

    @property
    def odd(self) -> int:
        """Number of the answer that fits the others least."""
        return int(np.argmin(self.without))


def agreement(values: Floats, covariances: Floats, dof: Floats) -> Agreement:
    """Compare answers whose covariances were estimated, each from few independent samples.

    A plain chi-square takes the covariances as known, and cries wolf; this is Welch's test for
    unequal variances, in p dimensions.

    Parameters
    ----------
    values : ndarray, shape (k, p)
        The answers, k >= 2.
    covariances : ndarray, shape (k, p, p)
        Of each; their errors are independent of one another.
    dof : ndarray, shape (k,)
        Degrees of freedom behind each covariance; infinite where it is known.

    Returns
    -------
    Agreement
        The pooled answer, and the probabilities.

    References
    ----------
    Welch 1951 (p = 1); Johansen 1980.
    """
    pooled, _ = _pooled(values, covariances)
    everyone = np.arange(len(values))
    without = np.empty(len(values))
    for k in everyone:
        rest = everyone != k
        mean, spread = _pooled(values[rest], covariances[rest])
        pair = np.stack([values[k], mean]), np.stack([covariances[k], spread])
        # The mean of the others is as well known as all of them together.
        without[k] = _chance(*pair, np.array([dof[k], dof[rest].sum()]))
    wider = _with_estimated_weights(covariances, dof)
    return Agreement(pooled, wider, _chance(values, covariances, dof), without)


def _pooled(values: Floats, covariances: Floats) -> tuple[Floats, Floats]:
    """Return the weighted mean and its covariance."""
    weights = np.linalg.inv(covariances)
    covariance = np.linalg.inv(weights.sum(axis=0))
    return covariance @ np.einsum("kab,kb->a", weights, values), covariance


def _with_estimated_weights(covariances: Floats, dof: Floats) -> Floats:
    """Return the covariance of a weighted mean whose weights are of Wishart covariances.

    Their inverses W are too large by dof / (dof - p - 1) on average; what else the noise of the
    weights adds is, to first order in 1 / dof,
    C sum_k [(p + 1 - 2 tr A) W - 2 W A] C / dof, with C the inverse of their sum and A = C W.
    """
    p = covariances.shape[1]
    weights = np.linalg.inv(covariances)
    fair = weights * np.maximum(1 - (p + 1) / dof, LEAST_WEIGHT)[:, None, None]
    covariance = np.linalg.inv(fair.sum(axis=0))
    share = covariance @ fair
    free = p + 1 - 2 * np.trace(share, axis1=1, axis2=2)
    more = ((free / dof)[:, None, None] * fair - 2 * fair @ share / dof[:, None, None]).sum(axis=0)
    return np.asarray(covariance + covariance @ more @ covariance)


def _chance(values: Floats, covariances: Floats, dof: Floats) -> float:
    """Return how probable it is that such answers are as far apart (Johansen 1980)."""
    k, p = values.shape
    mean, covariance = _pooled(values, covariances)
    weights = np.linalg.inv(covariances)
    off = values - mean
    statistic = float(np.einsum("ka,kab,kb->", off, weights, off))
    share = np.eye(p) - covariance @ weights
    traces = np.trace(share @ share, axis1=1, axis2=2) + np.trace(share, axis1=1, axis2=2) ** 2
    A = 0.5 * float(np.sum(traces / dof))
    first = p * (k - 1)
    scale = first + 2 * A - 6 * A / (first + 2)
    # SciPy's F has no infinite degrees of freedom.
    second = min(first * (first + 2) / max(3 * A, 1e-300), 1e9)
    return float(stats.f.sf(statistic / scale, first, second))

"""The optimum over all tracks, and how sure it is: Gauss-Newton on a loss that narrows down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evcalib.geometry import rotation_vector_to_matrix
from evcalib.kernels import joint as kernel
from evcalib.tracks import Tracks

Floats = NDArray[np.float64]

REACH = 5.0
"""Reach of the loss in standard deviations of a sighting, per axis."""

BIN, MEMORY = 0.1, 2.5
"""Scores are summed over bins [s]; sums up to so far apart [s] count as dependent: corners live
for most of a second, and so does the error of the odometry's integral."""

PASSES = 40
"""Most passes over the tracks."""


@dataclass(frozen=True, eq=False)
class Problem:
    """What stays the same in a fit; lengths in radians."""

    tracks: Tracks
    motion: tuple[NDArray, ...]
    lever: tuple[float, float, float]
    slowest: float
    lag: float
    lag_sd: float


@dataclass(eq=False)
class Fit:
    """The unknowns, and what the last pass over the tracks gave."""

    R: Floats
    offset: float
    lag: float
    reach: float
    residuals: Floats
    weights: Floats
    distances: Floats
    scores: Floats
    losses: Floats
    information: Floats
    noise: float = 0.0
    converged: bool = False


def begin(problem: Problem, R: Floats, offset: float, reach: float) -> Fit:
    n, k = int(problem.tracks.first[-1]), len(problem.tracks)
    return Fit(
        R=np.ascontiguousarray(R),
        offset=offset,
        lag=problem.lag,
        reach=reach,
        residuals=np.zeros((n, 2)),
        weights=np.zeros(n),
        distances=np.zeros(k),
        scores=np.zeros((k, kernel.UNKNOWNS)),
        losses=np.zeros(k),
        information=np.zeros((kernel.UNKNOWNS, kernel.UNKNOWNS)),
    )


def follow(problem: Problem, fit: Fit) -> None:
    """Run over all tracks with the unknowns as they are."""
    fit.information = kernel.follow(
        problem.tracks.arrays,
        fit.R,
        (fit.offset, fit.lag),
        problem.motion,
        (fit.reach, problem.slowest, problem.lever),
        (fit.residuals, fit.weights, fit.distances, fit.scores, fit.losses),
    )


def step(problem: Problem, fit: Fit, free: NDArray[np.bool_]) -> Floats | None:
    """Take a Gauss-Newton step in the free unknowns; return it, or None if they are not fixed."""
    information, score = _posterior(problem, fit)
    chosen = np.ix_(free, free)
    scale = np.sqrt(np.maximum(np.diag(information)[free], 1e-300))
    values, vectors = np.linalg.eigh(information[chosen] / np.outer(scale, scale))
    if not values[-1] > 0 or not np.isfinite(values).all():
        return None
    known = values > 1e-6 * values[-1]
    part = vectors[:, known]
    change = np.zeros(kernel.UNKNOWNS)
    change[free] = -(part @ ((part.T @ (score[free] / scale)) / values[known])) / scale
    fit.R = rotation_vector_to_matrix(change[:3]) @ fit.R
    fit.offset += float(change[3])
    fit.lag += float(change[4])
    return change


def _posterior(problem: Problem, fit: Fit) -> tuple[Floats, Floats]:
    """Return information and score with the lag's prior."""
    information, score = fit.information.copy(), fit.scores.sum(axis=0)
    weight = (max(fit.noise, 1e-6) / problem.lag_sd) ** 2
    information[4, 4] += weight
    score[4] += weight * (fit.lag - problem.lag)
    return information, score


def _noise(problem: Problem, fit: Fit) -> float:
    """Return the standard deviation of a sighting per axis, from the median residual [rad]."""
    length = problem.tracks.length
    # A track of m sightings and its anchor leaves 2 m - 1 of 2 (m + 1) residuals free.
    spread = np.repeat(np.sqrt((length + 1) / (length - 0.5)), length)
    used = fit.weights > 0
    if not used.any():
        return 0.0
    return float(np.median(np.hypot(*fit.residuals[used].T) * spread[used]) / 1.1774)


def solve(
    problem: Problem, R: Floats, offset: float, free: NDArray[np.bool_], widest: float
) -> Fit | None:
    """Iterate to the optimum, the loss narrowing down to what the noise asks for."""
    fit = begin(problem, R, offset, widest)
    for k in range(PASSES):
        follow(problem, fit)
        fit.noise = _noise(problem, fit)
        if fit.noise == 0:
            return None
        change = step(problem, fit, free)
        if change is None:
            return None
        small = bool(np.abs(change[:3]).max() < 1e-5 and abs(change[3]) < 1e-4)
        if k >= 3 and small:
            wanted = float(np.clip(REACH * fit.noise, 0.25 * widest, widest))
            fit.converged = wanted > 0.9 * fit.reach
            if fit.converged:
                break
        if k >= 3:
            fit.reach = float(np.clip(REACH * fit.noise, 0.7 * fit.reach, fit.reach))
    follow(problem, fit)
    return fit


def covariance_of(problem: Problem, fit: Fit, free: NDArray[np.bool_]) -> tuple[Floats, float]:
    """Return the covariance (5, 5) and how many stretches of motion count as independent."""
    information, _ = _posterior(problem, fit)
    start = problem.tracks.start
    row = ((start - start.min()) / BIN).astype(np.int64)
    sums = np.zeros((int(row.max()) + 1, kernel.UNKNOWNS))
    np.add.at(sums, row, fit.scores)
    scatter = sums.T @ sums
    width = round(MEMORY / BIN)
    for lag in range(1, min(width, len(sums))):
        across = sums[lag:].T @ sums[:-lag]
        scatter += (1.0 - lag / width) * (across + across.T)
    scatter[4, 4] += (fit.noise**2 / problem.lag_sd) ** 2
    samples = max(np.count_nonzero(sums.any(axis=1)) * BIN / MEMORY, 1.0)
    # Four unknowns were fitted to two numbers, a direction, per stretch.
    lost = max(1.0 - 2.0 / samples, 0.25)
    inverse = np.zeros((kernel.UNKNOWNS, kernel.UNKNOWNS))
    inverse[np.ix_(free, free)] = np.linalg.pinv(
        information[np.ix_(free, free)], rcond=1e-12, hermitian=True
    )
    return inverse @ scatter @ inverse / lost, samples

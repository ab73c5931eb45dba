"""The optimum over all tracks, and how sure it is: Gauss-Newton on a loss that narrows down."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from evcalib.arrays import Flags, Floats, Integers
from evcalib.geometry import rotation_vector_to_matrix, unit
from evcalib.joint.tracks import Tracks
from evcalib.kernels.joint import observations as kernel
from evcalib.kernels.joint.observation_model import WorldMotion
from evcalib.series import bins

OFFSET, LAG, YAW_RATE = 3, kernel.LAG, kernel.YAW_RATE
POSITION = slice(kernel.POSITION, kernel.POSITION + 2)

LOSS_SCALE = 5.0
"""Scale of Tukey's loss in standard deviations of an observation, per axis.

At 5 it keeps 94 % of the efficiency of least squares under normal noise in two dimensions (at 3,
68 %; at 6, 97 %), from its integrals E[psi']^2 / E[psi^2].
"""

BIN, MEMORY = 0.1, 2.5
"""Gradients are summed over bins [s]; sums up to so far apart [s] count as dependent: corners live
for most of a second, and so does the error of the odometry's integral.  A choice, three times that;
that intervals hold the truth is shown by test_the_stated_intervals_hold_the_truth and by
tests/campaign.csv (2.2 % of confident results outside 95 %: rather too wide)."""

STRETCH = 0.5
"""A stretch of so much time [s] counts where any track starts in it.  A choice: gaps shorter than
this do not lessen the samples."""

PASSES = 100
"""Most passes over the tracks: a bound on time; `Fit.converged` tells whether it was met."""

SMALL = 5e-6
"""Largest of the last steps [rad, s]: a hundredth of what the data can tell.  A drive and the same
one backwards in time then agree to 0.2 mrad (tests/test_invariances.py)."""

NEAR = 1e-4
"""Largest of the last steps of the position [m]: a hundredth of what the data can tell, too."""

FARTHEST = 0.3
"""Largest step [rad, s, m].  A choice: so far a linearisation still points the right way."""


TRIED = 0.1
"""Part of the gyro's error by which its effect is tried: the loss bends under all of it."""


@dataclass(frozen=True, eq=False)
class Problem:
    """What stays the same in a fit; lengths in radians, times in seconds.

    `group` numbers the stretch of time that each track starts in; `lever` is where the camera is
    expected on the body, by `lever_sd` sure, if that is unknown; `yaw_rate_sd` is how far the yaw
    rate of the odometry may be off over a track.  Where a gyro turned later bearings back,
    `gyro_sd` [rad/s] is how far its rates may be off all the time, about any axis, and
    `yaw_rate_sd` is about the body's z, over a track.
    """

    tracks: Tracks
    group: Integers
    motion: WorldMotion
    lever: tuple[float, float, float]
    lever_sd: float
    slowest: float
    lag: float
    lag_sd: float
    yaw_rate_sd: float
    gyro_sd: float | None = None

    def part(self, tracks: Tracks) -> Problem:
        """Return the same problem for other tracks."""
        return replace(self, tracks=tracks, group=tracks.group)


@dataclass(eq=False)
class Fit:
    """The unknowns, and what the last pass over the tracks gave."""

    R: Floats
    offset: float
    lag: float
    position: Floats
    yaw_rate_bias: Floats
    loss_scale: float
    residuals: Floats
    weights: Floats
    distances: Floats
    gradients: Floats
    losses: Floats
    information: Floats
    noise: float = 0.0
    converged: bool = False


def begin(problem: Problem, R: Floats, offset: float, loss_scale: float) -> Fit:
    """Return the unknowns to start from."""
    n, k = int(problem.tracks.first[-1]), len(problem.tracks)
    groups = int(problem.group[-1]) + 1
    return Fit(
        R=np.ascontiguousarray(R),
        offset=offset,
        lag=problem.lag,
        position=np.array(problem.lever),
        yaw_rate_bias=np.zeros(groups),
        loss_scale=loss_scale,
        residuals=np.zeros((n, 2)),
        weights=np.zeros(n),
        distances=np.zeros(k),
        gradients=np.zeros((k, kernel.UNKNOWNS)),
        losses=np.zeros(k),
        information=np.zeros((groups, kernel.UNKNOWNS, kernel.UNKNOWNS)),
    )


def linearise(problem: Problem, fit: Fit) -> None:
    """Run over all tracks with the unknowns as they are."""
    t = problem.tracks
    fit.information = kernel.linearise(
        kernel.Observations(t.first, problem.group, t.r1, t.r2, t.t1, t.t2),
        fit.R,
        kernel.Unknowns(fit.offset, fit.lag, tuple(fit.position), fit.yaw_rate_bias),
        problem.motion,
        kernel.Options(fit.loss_scale, problem.slowest, problem.gyro_sd is not None),
        kernel.Linearisation(fit.residuals, fit.weights, fit.distances, fit.gradients, fit.losses),
    )


@dataclass(frozen=True, eq=False)
class Reduced:
    """The equations without the yaw-rate biases, solved for group by group (Schur complement).

    `parts` (groups, 7, 7), their sum `information` (7, 7), and `gradients` (groups, 7) of the other
    unknowns, their priors left out; `gain` (groups, 7) and `own` (groups,) give a group's bias:
    -own - gain . change.
    """

    parts: Floats
    information: Floats
    gradients: Floats
    gain: Floats
    own: Floats

    @classmethod
    def of(cls, problem: Problem, fit: Fit) -> Reduced:
        gradients = np.zeros((fit.yaw_rate_bias.size, kernel.UNKNOWNS))
        np.add.at(gradients, problem.group, fit.gradients)
        # Observations of one corner share their error: a track counts once.
        weight = problem.tracks.length.mean() * (max(fit.noise, 1e-6) / problem.yaw_rate_sd) ** 2
        across = fit.information[:, :YAW_RATE, YAW_RATE]
        inside = fit.information[:, YAW_RATE, YAW_RATE] + weight
        own = (gradients[:, YAW_RATE] + weight * fit.yaw_rate_bias) / inside
        gain = across / inside[:, None]
        parts = fit.information[:, :YAW_RATE, :YAW_RATE] - gain[:, :, None] * across[:, None, :]
        return cls(
            parts=parts,
            information=parts.sum(axis=0),
            gradients=gradients[:, :YAW_RATE] - own[:, None] * across,
            gain=gain,
            own=own,
        )


def step(problem: Problem, fit: Fit, free: Flags) -> Floats | None:
    """Take a Gauss-Newton step in the free unknowns; return it, or None if they are not fixed."""
    reduced = Reduced.of(problem, fit)
    information, gradient = _posterior(problem, fit, reduced)
    chosen = np.ix_(free, free)
    scale = np.sqrt(np.maximum(np.diag(information)[free], 1e-300))
    values, vectors = np.linalg.eigh(information[chosen] / np.outer(scale, scale))
    if not values[-1] > 0 or not np.isfinite(values).all():
        return None
    known = values > 1e-6 * values[-1]
    part = vectors[:, known]
    change = np.zeros(YAW_RATE)
    change[free] = -(part @ ((part.T @ (gradient[free] / scale)) / values[known])) / scale
    # What the tracks do not hold must not run away.
    largest = max(np.abs(change[: OFFSET + 1]).max(), np.abs(change[POSITION]).max())
    change *= min(1.0, FARTHEST / max(float(largest), 1e-300))
    fit.R = rotation_vector_to_matrix(change[:3]) @ fit.R
    fit.offset += float(change[OFFSET])
    fit.lag += float(change[LAG])
    fit.position[:2] += change[POSITION]
    fit.yaw_rate_bias -= reduced.own + reduced.gain @ change
    return change


def _posterior(problem: Problem, fit: Fit, reduced: Reduced) -> tuple[Floats, Floats]:
    """Return information and gradient with the priors of lag and position."""
    information, gradient = reduced.information.copy(), reduced.gradients.sum(axis=0)
    weight = (max(fit.noise, 1e-6) / _prior_sd(problem)) ** 2
    information += np.diag(weight)
    gradient[LAG] += weight[LAG] * (fit.lag - problem.lag)
    gradient[POSITION] += weight[POSITION] * (fit.position[:2] - problem.lever[:2])
    return information, gradient


def _prior_sd(problem: Problem) -> Floats:
    """Return the standard deviation of what is expected of each unknown, inf where nothing is."""
    sd = np.full(YAW_RATE, np.inf)
    sd[LAG], sd[POSITION] = problem.lag_sd, problem.lever_sd
    return sd


def _noise(problem: Problem, fit: Fit) -> float:
    """Return the standard deviation of an observation per axis, from the median residual [rad]."""
    length = problem.tracks.length
    # A track of m observations and its anchor leaves 2 m - 1 of 2 (m + 1) residuals free.
    spread = np.repeat(np.sqrt((length + 1) / (length - 0.5)), length)
    used = fit.weights > 0
    if not used.any():
        return 0.0
    return float(np.median(np.hypot(*fit.residuals[used].T) * spread[used]) / 1.1774)


def solve(problem: Problem, R: Floats, offset: float, free: Flags, widest: float) -> Fit | None:
    """Iterate to the optimum, the loss narrowing down to what the noise asks for."""
    fit = begin(problem, R, offset, widest)
    for k in range(PASSES):
        linearise(problem, fit)
        fit.noise = _noise(problem, fit)
        if fit.noise == 0:
            return None
        change = step(problem, fit, free)
        if change is None:
            return None
        small = bool(np.abs(change[: OFFSET + 1]).max() < SMALL)
        small &= bool(np.abs(change[POSITION]).max() < NEAR)
        if k >= 3 and small:
            wanted = float(np.clip(LOSS_SCALE * fit.noise, 0.25 * widest, widest))
            fit.converged = wanted > 0.9 * fit.loss_scale
            if fit.converged:
                break
        if k >= 3:
            fit.loss_scale = float(
                np.clip(LOSS_SCALE * fit.noise, 0.7 * fit.loss_scale, fit.loss_scale)
            )
    linearise(problem, fit)
    return fit


def covariance_of(problem: Problem, fit: Fit, free: Flags) -> tuple[Floats, float]:
    """Return the covariance (7, 7) and how many stretches of motion count as independent."""
    reduced = Reduced.of(problem, fit)
    information, _ = _posterior(problem, fit, reduced)
    scatter, samples = long_run(problem, fit, reduced.gradients)
    scatter += np.diag((fit.noise**2 / _prior_sd(problem)) ** 2)
    # Four unknowns were fitted to two numbers, a direction, per stretch.
    lost = max(1.0 - 2.0 / samples, 0.25)
    inverse, chosen = np.zeros((YAW_RATE, YAW_RATE)), np.ix_(free, free)
    # Units differ: a prior of the position must not pass for rounding beside the rotation.
    size = np.sqrt(np.maximum(np.diag(information)[free], 1e-300))
    scale = np.outer(size, size)
    inverse[chosen] = (
        np.linalg.pinv(information[chosen] / scale, rcond=1e-12, hermitian=True) / scale
    )
    return inverse @ scatter @ inverse / (lost * slope_of_loss(fit) ** 2), samples


def by_gyro(problem: Problem, fit: Fit, free: Flags) -> Floats:
    """Return what a steady error of the gyro adds to the covariance (7, 7).

    The change of the gradient under an error about each axis, and the step that answers it.
    """
    added = np.zeros((YAW_RATE, YAW_RATE))
    if problem.gyro_sd is None:
        return added
    t = problem.tracks
    reduced = Reduced.of(problem, fit)
    information, _ = _posterior(problem, fit, reduced)
    chosen, before = np.ix_(free, free), reduced.gradients.sum(axis=0)
    size = np.sqrt(np.maximum(np.diag(information)[free], 1e-300))
    scale = np.outer(size, size)
    inverse = np.linalg.pinv(information[chosen] / scale, rcond=1e-12, hermitian=True) / scale
    for axis in np.eye(3):
        r2 = t.r2 + TRIED * problem.gyro_sd * (t.t2 - t.t1)[:, None] * np.cross(axis, t.r2)
        turned = problem.part(replace(t, r2=unit(r2)))
        again = replace(
            fit,
            residuals=fit.residuals.copy(),
            weights=fit.weights.copy(),
            distances=fit.distances.copy(),
            gradients=fit.gradients.copy(),
            losses=fit.losses.copy(),
        )
        linearise(turned, again)
        change = np.zeros(YAW_RATE)
        after = Reduced.of(turned, again).gradients.sum(axis=0)
        change[free] = inverse @ (after - before)[free] / (TRIED * slope_of_loss(fit))
        added += np.outer(change, change)
    return added


def group_times(problem: Problem, fit: Fit) -> Floats:
    """Return the start of each group [s], counted from the first; 0 for empty groups."""
    start = problem.tracks.start
    place = np.zeros(fit.yaw_rate_bias.size)
    place[problem.group] = start - start[0]
    return place


def long_run(problem: Problem, fit: Fit, gradients: Floats) -> tuple[Floats, float]:
    """Return the covariance of a sum of gradients (groups, k), and how many stretches add to it."""
    place = group_times(problem, fit)
    row = bins(place, BIN)
    sums = np.zeros((int(row.max()) + 1, gradients.shape[1]))
    np.add.at(sums, row, gradients)
    scatter = sums.T @ sums
    width = round(MEMORY / BIN)
    for lag in range(1, min(width, len(sums))):
        across = sums[lag:].T @ sums[:-lag]
        scatter += (1.0 - lag / width) * (across + across.T)
    told = np.unique(bins(place[problem.group], STRETCH)).size * STRETCH
    return scatter, max(told / MEMORY, 1.0)


def slope_of_loss(fit: Fit) -> float:
    """Return the mean slope of the loss's derivative over its mean weight.

    The sum of weighted squares is steeper than the loss itself: of psi = w r, with w = (1 - u)^2
    and u = r^2 / scale^2 of both axes, the slope is w + u w', a mean over the directions of r.
    """
    used = fit.weights > 0
    u = np.minimum(np.sum(fit.residuals[used] ** 2, axis=1) / fit.loss_scale**2, 1.0)
    slope = (1.0 - u) * (1.0 - 3.0 * u)
    return max(float(slope.sum() / fit.weights[used].sum()), 0.2)

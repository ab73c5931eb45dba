"""What a fit says of errors of the model: clocks that drift, turns untold, directions distorted.

Each is a change of rotation or offset that goes with time or with the direction of travel.  The
gradients of the fit, weighed so, tell how large it is without fitting anew (Rao's score test, its
variance that of Newey and West as for the fit itself).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from evcalib.arrays import Flags, Floats
from evcalib.joint._solver import (
    OFFSET,
    YAW_RATE,
    Fit,
    Problem,
    Reduced,
    group_times,
    long_run,
    slope_of_loss,
    solve,
)
from evcalib.series import bins

ABOUT_Z = 2
"""Row of the rotation about the body's Z axis."""

SURE = 3.0
"""Standard deviations by which an error of the model must show to be told.

Chance goes beyond in one test of 370.  Of 410 simulated drives without such an error one had a
doubt, of 303 with slip, focal length or principal point up to 5 % off 31 had: it tells large errors
and cries no wolf (tests/campaign.csv: determined less confident).
"""

TURNS = 1.0
"""Yaw rates are averaged over so much time [s].  A choice: over less, noise hides small ones; over
more, turns to and fro cancel."""

TRIES = 4
"""Most fits that take an error of the model in: a bound on time."""


@dataclass(frozen=True, eq=False)
class ModelError:
    """An error of the model: values, their covariance, and how sure it is that there is any.

    `z` is the standard normal deviate that is as rare as these values without one.
    """

    values: Floats
    covariance: Floats
    z: float

    @property
    def sd(self) -> Floats:
        """Standard deviation of each value."""
        return np.sqrt(np.diag(self.covariance))


NONE = ModelError(np.zeros(1), np.full((1, 1), np.inf), 0.0)
"""Where there is nothing to tell from."""


def drift(problem: Problem, fit: Fit, free: Flags) -> ModelError:
    """Return how fast the offset grows [s/s]; the fit's offset holds where the tracks tell most."""
    if not free[OFFSET]:
        return NONE
    reduced = Reduced.of(problem, fit)
    t = group_times(problem, fit)
    weight = np.maximum(reduced.parts[:, OFFSET, OFFSET], 0.0)
    if not weight.sum() > 0:
        return NONE
    return _modulated(
        problem, fit, reduced, free, OFFSET, (t - np.average(t, weights=weight))[None]
    )


def distortion(problem: Problem, fit: Fit, free: Flags) -> ModelError:
    """Return how directions of travel are distorted [rad]: as cos and sin of twice their angle.

    A camera that only translates within a plane shows of wrong intrinsics what they do to
    directions in this plane: a linear map.  Its rotation passes for the camera's, its scale for the
    distances'; two numbers are left, and wheels that slip to one side change the same two.
    """
    reduced = Reduced.of(problem, fit)
    direction = _directions(problem, fit)
    waves = np.stack([np.cos(2 * direction), np.sin(2 * direction)])
    return _modulated(problem, fit, reduced, free, ABOUT_Z, waves)


def turning(problem: Problem, fit: Fit) -> float:
    """Return the yaw rate that the tracks see and the odometry does not tell [rad/s], rms.

    Noise is taken off, so that 0 means none that shows.
    """
    information = fit.information[:, YAW_RATE, YAW_RATE]
    gradients = np.zeros(fit.yaw_rate_bias.size)
    np.add.at(gradients, problem.group, fit.gradients[:, YAW_RATE])
    # What each group says by itself, the prior left out.
    alone = information * fit.yaw_rate_bias - gradients
    block = bins(group_times(problem, fit), TURNS)
    total = np.bincount(block, information)
    rate = np.bincount(block, alone) / np.maximum(total, 1e-300)
    known = total > 0.2 * np.median(total[total > 0]) if (total > 0).any() else total > 0
    if known.sum() < 4:
        return 0.0
    # Observations of one corner share their error: a track counts once.
    noise = problem.tracks.length.mean() * fit.noise**2 / total[known]
    return float(np.sqrt(max(np.mean(rate[known] ** 2 - noise), 0.0)))


def with_turning(problem: Problem, fit: Fit, free: Flags, widest: float) -> tuple[Problem, Fit]:
    """Fit anew with as much turning as the tracks show, if it is more than was expected."""
    for _ in range(TRIES):
        seen = turning(problem, fit)
        if seen < problem.yaw_rate_sd:
            break
        problem = replace(problem, yaw_rate_sd=1.2 * seen)
        again = solve(problem, fit.R, fit.offset, free, widest)
        if again is None:
            break
        fit = again
    return problem, fit


def without_drift(
    problem: Problem, fit: Fit, free: Flags, widest: float
) -> tuple[Problem, Fit, ModelError]:
    """Fit anew on a clock without drift, if there is one, and return the drift."""
    found = drift(problem, fit, free)
    total, left = 0.0, found
    for _ in range(TRIES):
        if left.z < SURE:
            break
        rate = float(left.values[0])
        straight = replace(problem, tracks=problem.tracks.on_clock(rate))
        again = solve(straight, fit.R, fit.offset, free, widest)
        if again is None:
            break
        problem, fit, total = straight, again, total + rate
        left = drift(problem, fit, free)
    if total:
        found = replace(left, values=left.values + total, z=found.z)
    return problem, fit, found


def _directions(problem: Problem, fit: Fit) -> Floats:
    """Return the angle of the camera's travel in the body frame as each group starts [rad]."""
    motion = problem.motion
    at = problem.tracks.start[0] + group_times(problem, fit) + fit.offset
    rate = np.gradient(motion.yaw, motion.t)
    x, y, turned, rate = (
        np.interp(at, motion.t, values) for values in (*motion.velocity.T[:2], motion.yaw, rate)
    )
    c, s = np.cos(turned), np.sin(turned)
    p, q = fit.position[:2]
    return np.arctan2(c * y - s * x + rate * p, c * x + s * y - rate * q)


def _modulated(
    problem: Problem,
    fit: Fit,
    reduced: Reduced,
    free: Flags,
    row: int,
    waves: Floats,
) -> ModelError:
    """Return how far an unknown follows the waves (k, groups), the others fitted along."""
    parts, gradients = reduced.parts, reduced.gradients
    inside = np.einsum("ag,bg,g->ab", waves, waves, parts[:, row, row])
    across = waves @ parts[:, row, :][:, free]
    scale = np.sqrt(np.maximum(np.diag(reduced.information)[free], 1e-300))
    whole = reduced.information[np.ix_(free, free)] / np.outer(scale, scale)
    share = (np.linalg.pinv(whole, rcond=1e-6, hermitian=True) @ (across / scale).T).T / scale
    information = inside - across @ share.T
    size = np.sqrt(np.diag(inside))
    if not (size > 0).all() or not _held(information / np.outer(size, size)):
        return NONE
    inverse = np.linalg.inv(information)

    def efficient(gradients: Floats) -> Floats:
        return gradients[:, row, None] * waves.T - gradients[:, free] @ share.T

    values = -inverse @ efficient(gradients).sum(axis=0)
    # What is left once the error is made up for is noise.
    change = np.zeros((waves.shape[1], YAW_RATE))
    change[:, free] = -values @ share
    change[:, row] += values @ waves
    left = gradients + np.einsum("gab,gb->ga", parts, change)
    scatter, samples = long_run(problem, fit, efficient(left))
    dof = max(samples - len(values), 1.0)
    bend = slope_of_loss(fit)
    values = values / bend
    covariance = inverse @ scatter @ inverse * (samples / dof / bend**2)
    square = float(values @ np.linalg.pinv(covariance, hermitian=True) @ values) / len(values)
    rare = np.exp(stats.f.logsf(square, len(values), dof))
    return ModelError(values, covariance, float(stats.norm.isf(max(rare, 1e-300) / 2)))


def _held(correlation: Floats) -> bool:
    """Tell whether the data hold all the waves."""
    return bool(np.linalg.eigvalsh(correlation)[0] > 1e-3)

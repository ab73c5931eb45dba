"""The optimum over all tracks, and how sure it is: Gauss-Newton on a loss that narrows down."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from evcalib.arrays import Flags, Floats
from evcalib.geometry import rotation_vector_to_matrix
from evcalib.joint._turning import Turning
from evcalib.joint.tracks import Tracks
from evcalib.kernels.joint import observations as kernel
from evcalib.kernels.joint.observation_model import WorldMotion
from evcalib.series import bins

OFFSET, LAG, UNKNOWNS = kernel.TIME, kernel.LAG, kernel.UNKNOWNS
POSITION, TILT = slice(kernel.PLACE, kernel.TILT), slice(kernel.TILT, UNKNOWNS)

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

PASSES = 60
"""Most passes over the tracks: a bound on time; `Fit.converged` tells whether it was met."""

NEGLIGIBLE = 0.02
"""Last step, in standard deviations of independent noise, that ends the passes.  A choice: what is
left is then within a tenth of one, also where steps shrink by no more than a fifth."""

SMALL = 5e-7
"""Or this last step [rad, s], where there is no noise."""

CONVERGED = 0.1
"""Last step, in stated standard deviations, of a fit that counts as converged."""

FARTHEST = 0.3
"""Largest step [rad, s, m].  A choice: so far a linearisation still points the right way."""


@dataclass(frozen=True, eq=False)
class Problem:
    """What stays the same in a fit; lengths in radians, times in seconds.

    `prior` and `prior_sd` (9,) are what is known of the unknowns beforehand, infinite where
    nothing; `lever` is the camera's position to begin with.
    """

    tracks: Tracks
    motion: WorldMotion
    lever: tuple[float, float, float]
    slowest: float
    prior: Floats
    prior_sd: Floats
    turning: Turning
    stabilised: bool = False

    def part(self, tracks: Tracks) -> Problem:
        """Return the same problem for other tracks."""
        return replace(self, tracks=tracks)


@dataclass(eq=False)
class Fit:
    """The unknowns, and what the last pass over the tracks gave.

    `spread` (3,) is the standard deviation of a knot's change, as taken from the tracks.
    """

    R: Floats
    values: Floats
    knots: Floats
    spread: Floats
    loss_scale: float
    residuals: Floats
    weights: Floats
    distances: Floats
    losses: Floats
    gradients: Floats
    slopes: Floats
    information: Floats
    across: Floats
    band: Floats
    noise: float = 0.0
    step: Floats | None = None

    @property
    def offset(self) -> float:
        """``t_body = t_cam + offset`` [s]."""
        return float(self.values[OFFSET])

    @property
    def lag(self) -> float:
        """How far corners trail [rad]."""
        return float(self.values[LAG])


def begin(
    problem: Problem, R: Floats, offset: float, loss_scale: float, like: Fit | None = None
) -> Fit:
    """Return the unknowns to start from, those but rotation and offset as in another fit."""
    n, k = int(problem.tracks.first[-1]), len(problem.tracks)
    values = (problem.prior if like is None else like.values).copy()
    values[OFFSET] = offset
    none = np.zeros(0)
    return Fit(
        R=np.ascontiguousarray(R),
        values=values,
        knots=problem.turning.rest() if like is None else like.knots.copy(),
        spread=problem.turning.widest.copy() if like is None else like.spread.copy(),
        loss_scale=loss_scale,
        residuals=np.zeros((n, 2)),
        weights=np.zeros(n),
        distances=np.zeros(k),
        losses=np.zeros(k),
        gradients=none,
        slopes=none,
        information=none,
        across=none,
        band=none,
    )


def linearise(problem: Problem, fit: Fit, everything: bool = True) -> None:
    """Run over all tracks with the unknowns as they are; derivatives by all, or the rotation."""
    t, knots = problem.tracks, problem.turning.knots
    reach = 3 * (knots.span(t) + 2) if everything else 0
    fit.gradients = np.zeros((knots.count, UNKNOWNS))
    fit.slopes = np.zeros((knots.count, reach))
    fit.information = np.zeros((knots.count, UNKNOWNS, UNKNOWNS))
    fit.across = np.zeros((knots.count, UNKNOWNS, reach))
    fit.band = np.zeros((3 * knots.count, reach))
    place, tilt = fit.values[POSITION], fit.values[TILT]
    kernel.linearise(
        kernel.Observations(t.first, t.r1, t.r2, t.t1, t.t2),
        fit.R,
        kernel.Unknowns(
            fit.offset,
            fit.lag,
            (float(place[0]), float(place[1]), float(problem.lever[2])),
            (float(tilt[0]), float(tilt[1])),
            fit.knots,
        ),
        problem.motion,
        kernel.Options(
            fit.loss_scale,
            problem.slowest,
            problem.stabilised,
            knots.start,
            knots.spacing,
            everything,
        ),
        kernel.Linearisation(
            fit.residuals,
            fit.weights,
            fit.distances,
            fit.losses,
            fit.gradients,
            fit.slopes,
            fit.information,
            fit.across,
            fit.band,
        ),
    )
    upper = np.triu(fit.information, 1)
    fit.information = fit.information + upper.transpose(0, 2, 1)


@dataclass(frozen=True, eq=False)
class Reduced:
    """The equations without the knots (Schur complement), the globals' priors left out.

    `parts` (knots, 9, 9), their sum `information` (9, 9), and `gradients` (knots, 9) of the
    globals; the knots change by ``-own - gain @ change``, and `turning` gives the spread that they
    show.
    """

    parts: Floats
    information: Floats
    gradients: Floats
    gain: Floats
    own: Floats
    turning: Turning
    spread: Floats

    @classmethod
    def of(cls, problem: Problem, fit: Fit) -> Reduced:
        n, reach = fit.slopes.shape
        turning = problem.turning
        # Observations of one corner share their error: a track counts once.
        noise = np.sqrt(problem.tracks.length.mean()) * max(fit.noise, 1e-6)
        pull = turning.pull(fit.knots, fit.spread, noise)
        across, slope = np.zeros((n + reach // 3, 3, UNKNOWNS)), np.zeros((n + reach // 3, 3))
        for k in range(reach // 3):
            columns = slice(3 * k, 3 * k + 3)
            across[k : k + n] += fit.across[:, :, columns].transpose(0, 2, 1)
            slope[k : k + n] += fit.slopes[:, columns]
        right = np.concatenate([across[:n], (slope[:n] + pull)[:, :, None]], axis=2)
        factor = turning.factor(fit.band, fit.spread, noise)
        solved = factor.solve(right.reshape(3 * n, UNKNOWNS + 1))
        gain, own = solved[:, :UNKNOWNS].reshape(n, 3, UNKNOWNS), solved[:, UNKNOWNS].reshape(n, 3)
        parts, gradients = fit.information.copy(), fit.gradients.copy()
        gradients -= np.einsum("ka,kag->kg", pull, gain)
        padded = np.concatenate([gain, np.zeros((reach // 3, 3, UNKNOWNS))])
        for k in range(reach // 3):
            columns = slice(3 * k, 3 * k + 3)
            parts -= np.einsum("kga,kah->kgh", fit.across[:, :, columns], padded[k : k + n])
            gradients -= np.einsum("ka,kag->kg", fit.slopes[:, columns], padded[k : k + n])
        parts = 0.5 * (parts + parts.transpose(0, 2, 1))
        return cls(
            parts=parts,
            information=parts.sum(axis=0),
            gradients=gradients,
            gain=gain,
            own=own,
            turning=turning,
            spread=turning.shown(fit.knots - own, fit.spread, factor, noise),
        )


def step(problem: Problem, fit: Fit, reduced: Reduced, free: Flags) -> Floats | None:
    """Take a Gauss-Newton step in the free unknowns; return it, or None if they are not fixed."""
    information, gradient = _posterior(problem, fit, reduced)
    change = _solved(information, gradient, free)
    if change is None:
        return None
    # What the tracks do not hold must not run away.
    far = np.abs(np.concatenate([change[: OFFSET + 1], change[POSITION]])).max()
    change *= min(1.0, FARTHEST / max(float(far), 1e-300))
    fit.R = rotation_vector_to_matrix(change[:3]) @ fit.R
    fit.values[3:] += change[3:]
    fit.knots = fit.knots - reduced.own - reduced.gain @ change
    return change


def turn(fit: Fit) -> bool:
    """Take a step in the rotation alone, the last pass being one of its derivatives."""
    rotation = np.arange(UNKNOWNS) < 3
    change = _solved(fit.information.sum(axis=0), fit.gradients.sum(axis=0), rotation)
    if change is not None:
        change *= min(1.0, FARTHEST / max(float(np.abs(change).max()), 1e-300))
        fit.R = rotation_vector_to_matrix(change[:3]) @ fit.R
    return change is not None


def _solved(information: Floats, gradient: Floats, free: Flags) -> Floats | None:
    """Return the step that the information holds."""
    scale = np.sqrt(np.maximum(np.diag(information)[free], 1e-300))
    chosen = information[np.ix_(free, free)] / np.outer(scale, scale)
    if not np.isfinite(chosen).all():
        return None
    values, vectors = np.linalg.eigh(chosen)
    if not values[-1] > 0:
        return None
    known = values > 1e-6 * values[-1]
    part = vectors[:, known]
    change = np.zeros(UNKNOWNS)
    change[free] = -(part @ ((part.T @ (gradient[free] / scale)) / values[known])) / scale
    return change


def _posterior(problem: Problem, fit: Fit, reduced: Reduced) -> tuple[Floats, Floats]:
    """Return information and gradient with what is known beforehand."""
    weight = _prior_weight(problem, fit)
    information = reduced.information + np.diag(weight)
    off = np.where(weight > 0, fit.values - problem.prior, 0.0)
    return information, reduced.gradients.sum(axis=0) + weight * off


def _prior_weight(problem: Problem, fit: Fit) -> Floats:
    return np.asarray((max(fit.noise, 1e-6) / problem.prior_sd) ** 2)


def _noise(problem: Problem, fit: Fit) -> float:
    """Return the standard deviation of an observation per axis, from the median residual [rad]."""
    length = problem.tracks.length
    # A track of m observations and its anchor leaves 2 m - 1 of 2 (m + 1) residuals free.
    spread = np.repeat(np.sqrt((length + 1) / (length - 0.5)), length)
    used = fit.weights > 0
    if not used.any():
        return 0.0
    return float(np.median(np.hypot(*fit.residuals[used].T) * spread[used]) / 1.1774)


def solve(problem: Problem, fit: Fit, free: Flags, widest: float) -> Fit | None:
    """Iterate to the optimum, the loss narrowing down to what the noise asks for."""
    for k in range(PASSES):
        linearise(problem, fit)
        fit.noise = _noise(problem, fit)
        if fit.noise == 0:
            return None
        reduced = Reduced.of(problem, fit)
        change = step(problem, fit, reduced, free)
        if change is None:
            return None
        fit.step = change
        settled = _settled(problem, fit, reduced, free, change)
        if k >= 3:
            settled &= bool((np.abs(np.log(reduced.spread / fit.spread)) < 0.1).all())
            wanted = float(np.clip(LOSS_SCALE * fit.noise, 0.25 * widest, widest))
            if settled and wanted > 0.9 * fit.loss_scale:
                break
            fit.loss_scale = float(np.clip(wanted, 0.7 * fit.loss_scale, fit.loss_scale))
            fit.spread = reduced.spread
    linearise(problem, fit)
    return fit


def _settled(problem: Problem, fit: Fit, reduced: Reduced, free: Flags, change: Floats) -> bool:
    """Tell whether a step is negligible against what independent noise would do."""
    information, _ = _posterior(problem, fit, reduced)
    sd = fit.noise * np.sqrt(np.diag(_inverse(information, free)))
    return bool((np.abs(change) <= np.maximum(NEGLIGIBLE * sd, SMALL))[free].all())


def _inverse(information: Floats, free: Flags) -> Floats:
    """Return the inverse among the free unknowns, whatever their units; zero elsewhere."""
    scale = np.sqrt(np.maximum(np.diag(information)[free], 1e-300))
    whole = np.zeros((UNKNOWNS, UNKNOWNS))
    whole[np.ix_(free, free)] = np.linalg.pinv(
        information[np.ix_(free, free)] / np.outer(scale, scale), rcond=1e-12, hermitian=True
    ) / np.outer(scale, scale)
    return whole


def covariance_of(problem: Problem, fit: Fit, free: Flags) -> tuple[Floats, float]:
    """Return the covariance (9, 9) and how many stretches of motion count as independent."""
    reduced = Reduced.of(problem, fit)
    information, _ = _posterior(problem, fit, reduced)
    scatter, samples = long_run(problem, reduced.gradients)
    # What is known beforehand scatters as much as it says.
    scatter += np.diag(fit.noise**2 * _prior_weight(problem, fit))
    # As many unknowns as are free were fitted to two numbers, a direction, per stretch.
    fitted = int(free[:3].sum() + free[OFFSET] + free[POSITION].sum())
    lost = max(1.0 - 0.5 * fitted / samples, 0.25)
    inverse = _inverse(information, free)
    return inverse @ scatter @ inverse / (lost * slope_of_loss(fit) ** 2), samples


def long_run(problem: Problem, gradients: Floats) -> tuple[Floats, float]:
    """Return the covariance of a sum of gradients (knots, k), and how many stretches add to it."""
    knots = problem.turning.knots
    row = bins(knots.times, BIN)
    sums = np.zeros((int(row.max()) + 1, gradients.shape[1]))
    np.add.at(sums, row, gradients)
    scatter = sums.T @ sums
    width = round(MEMORY / BIN)
    for lag in range(1, min(width, len(sums))):
        across = sums[lag:].T @ sums[:-lag]
        scatter += (1.0 - lag / width) * (across + across.T)
    told = np.unique(bins(knots.times[knots.of(problem.tracks.start)], STRETCH)).size * STRETCH
    return scatter, max(told / MEMORY, 1.0)


def converged(fit: Fit, covariance: Floats, free: Flags) -> bool:
    """Tell whether the last step is small against the standard deviations."""
    sd = np.sqrt(np.diag(covariance))
    assert fit.step is not None
    return bool((np.abs(fit.step) <= np.maximum(CONVERGED * sd, SMALL))[free].all())


def slope_of_loss(fit: Fit) -> float:
    """Return the mean slope of the loss's derivative over its mean weight.

    The sum of weighted squares is steeper than the loss itself: of psi = w r, with w = (1 - u)^2
    and u = r^2 / scale^2 of both axes, the slope is w + u w', a mean over the directions of r.
    """
    used = fit.weights > 0
    u = np.minimum(np.sum(fit.residuals[used] ** 2, axis=1) / fit.loss_scale**2, 1.0)
    slope = (1.0 - u) * (1.0 - 3.0 * u)
    return max(float(slope.sum() / fit.weights[used].sum()), 0.2)

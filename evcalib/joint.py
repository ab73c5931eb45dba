"""Rotation and offset from all sightings of all corners at once.

Headings tell only which way the camera went.  A corner that is seen again and again tells more: by
how much further it moves from one sighting to the next, up to its unknown distance.  So not only
turns of the motion show the offset, but every change of speed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evcalib import _check
from evcalib.geometry import rotation_vector_to_matrix
from evcalib.kernels import joint as kernel
from evcalib.kernels import track as track_kernel
from evcalib.offset import candidate_offsets
from evcalib.series import VelocitySeries
from evcalib.track import VelocityTrack
from evcalib.tracks import Tracks

Floats = NDArray[np.float64]

MOST = 200_000
"""Sightings that enter the fit; more lessen the error of the corners, not that of the motion."""

MOST_SEARCHED = 12_000
"""Sightings that enter the search over the offsets."""

WIDEST = 2.0
"""Reach of the loss [px] at the start."""

REACH = 5.0
"""Reach of the loss in standard deviations of a sighting, per axis."""

SLOWEST = 2.0
"""Flow [px/s] below which a corner has no direction to trail along."""

BIN, MEMORY = 0.1, 1.5
"""Scores are summed over bins [s]; sums up to so far apart [s] count as dependent: corners live
for most of a second, and so does the error of the odometry's integral."""

FEWEST = 50
"""Tracks without which there is no joint refinement."""

GATE = 2.0
"""Standard errors within which another offset fits as well."""


@dataclass(frozen=True)
class Lag:
    """How far corners trail their true place along their flow, before a fit.

    Attributes
    ----------
    mean, sd : float
        Of the lag [px].
    time_sd : float
        Standard deviation of what remains as a delay [s], whatever the flow.
    """

    mean: float = 0.2
    sd: float = 0.15
    time_sd: float = 0.002


@dataclass(frozen=True, eq=False)
class JointRefinement:
    """Rotation and offset from all tracks.

    Attributes
    ----------
    R_body_cam : ndarray, shape (3, 3)
        Rotation.
    offset : float
        ``t_body = t_cam + offset`` [s].
    lag : float
        How far corners trail [px].
    lag_sd : float
        Its standard deviation [px].
    covariance : ndarray, shape (4, 4)
        Of the rotation vector in the body frame [rad] and of the offset [s], the lag's uncertainty
        and the dependence of sightings counted in.
    samples : float
        Stretches of motion that count as independent.
    noise : float
        Standard deviation of a sighting per axis [px].
    inlier_share : float
        Share of the sightings that the fit follows.
    tracks, sightings : int
        What entered.
    offsets, loss : ndarray, shape (m,)
        Candidates [s], and the mean loss of a sighting there [px^2], each with its best rotation.
    plausible : ndarray, shape (k,)
        Candidates that fit as well as the best.
    offset_estimated : bool
        Whether the offset was estimated, or kept as given.
    converged : bool
        Whether the last step was small.
    """

    R_body_cam: Floats
    offset: float
    lag: float
    lag_sd: float
    covariance: Floats
    samples: float
    noise: float
    inlier_share: float
    tracks: int
    sightings: int
    offsets: Floats
    loss: Floats
    plausible: Floats
    offset_estimated: bool
    converged: bool


@dataclass(frozen=True, eq=False)
class _Problem:
    """What stays the same in a fit; lengths in radians."""

    tracks: Tracks
    motion: tuple[NDArray, ...]
    lever: tuple[float, float, float]
    slowest: float
    lag: float
    lag_sd: float


@dataclass(eq=False)
class _Fit:
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


def refine_jointly(
    tracks: Tracks,
    velocities: VelocitySeries,
    track: VelocityTrack,
    R_body_cam: Floats,
    offset: float,
    *,
    focal: float,
    estimate_offset: bool = True,
    max_offset: float = 1.0,
    lag: Lag = Lag(),
    lever: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> JointRefinement | None:
    """Refine rotation and offset on all sightings of all corners.

    Each sighting has its own time, the odometry is integrated from the first sighting to it, its
    yaw included, and the distance of each corner is solved for along with the rest.  The loss is
    Tukey's.  The trailing of corners along their flow is estimated too, from `lag` as a prior.

    Parameters
    ----------
    tracks : Tracks
        From `evcalib.tracks.tracks_of`.
    velocities : VelocitySeries
        Its yaw rate is used, where there is one.
    track : VelocityTrack
        The same velocities, prepared.
    R_body_cam : ndarray, shape (3, 3)
        Rotation to start from.
    offset : float
        Offset to start from, or to keep [s].
    focal : float
        Pixels per radian, to speak of pixels.
    estimate_offset : bool
        Or only the rotation, at the given offset.
    max_offset : float
        Offsets from -max_offset to max_offset [s] are compared, if it is estimated.
    lag : Lag
        What is known of the trailing of corners.
    lever : tuple of float
        Position of the camera in the body frame [m].

    Returns
    -------
    JointRefinement or None
        None if there are too few tracks.

    Notes
    -----
    The change of the flow's direction with the unknowns is left out of the derivatives: the lag is
    a small part of a displacement.

    References
    ----------
    The paper has no such stage.  Variable projection: Golub & Pereyra 1973; the covariance is that
    of Newey & West 1987.
    """
    _check.positive(focal, "focal", "pixels per radian")
    tracks = tracks.thinned(MOST)
    if len(tracks) < FEWEST:
        return None
    problem = _Problem(
        tracks,
        world_motion(velocities, track),
        lever,
        SLOWEST / focal,
        lag.mean / focal,
        lag.sd / focal,
    )
    free = np.array([True, True, True, estimate_offset, True])
    grid, loss, plausible = np.empty(0), np.empty(0), np.empty(0)
    start = offset
    if estimate_offset:
        grid, loss = _search(problem, R_body_cam, candidate_offsets(max_offset), focal)
        start = float(grid[np.argmin(loss.sum(axis=0))]) if grid.size else offset
    fit = _solve(problem, R_body_cam, start, free, WIDEST / focal)
    if fit is None:
        return None
    covariance, samples = _covariance(problem, fit, free)
    if estimate_offset and grid.size:
        plausible = grid[_as_good(loss, int(np.argmin(np.abs(grid - fit.offset))))]
    covariance[3, 3] += lag.time_sd**2 if estimate_offset else 0.0
    return JointRefinement(
        R_body_cam=fit.R,
        offset=fit.offset,
        lag=fit.lag * focal,
        lag_sd=float(np.sqrt(covariance[4, 4])) * focal,
        covariance=covariance[:4, :4],
        samples=samples,
        noise=fit.noise * focal,
        inlier_share=float(np.mean(fit.weights > 0)),
        tracks=len(tracks),
        sightings=int(tracks.first[-1]),
        offsets=grid,
        loss=loss.mean(axis=0) * focal**2 if grid.size else loss,
        plausible=plausible,
        offset_estimated=estimate_offset,
        converged=fit.converged,
    )


def world_motion(velocities: VelocitySeries, track: VelocityTrack) -> tuple[NDArray, ...]:
    """Return time, velocity in the world, its slope and integral, yaw and segment, per sample.

    The world's axes are the body's at the first sample.
    """
    yaw = np.zeros(track.t.size)
    if velocities.yaw_rate is not None:
        rate = velocities.yaw_rate
        yaw[1:] = np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(track.t))
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, z = track.v.T
    v = np.stack([c * x - s * y, s * x + c * y, z], axis=1)
    slope, path = track_kernel.slopes(track.t, v), track_kernel.integrate(track.t, v, track.segment)
    return track.t, v, slope, path, yaw, track.segment


def _begin(problem: _Problem, R: Floats, offset: float, reach: float) -> _Fit:
    n, k = int(problem.tracks.first[-1]), len(problem.tracks)
    return _Fit(
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


def _follow(problem: _Problem, fit: _Fit) -> None:
    """Run over all tracks with the unknowns as they are."""
    fit.information = kernel.follow(
        problem.tracks.arrays,
        fit.R,
        (fit.offset, fit.lag),
        problem.motion,
        (fit.reach, problem.slowest, problem.lever),
        (fit.residuals, fit.weights, fit.distances, fit.scores, fit.losses),
    )


def _step(problem: _Problem, fit: _Fit, free: NDArray[np.bool_]) -> Floats | None:
    """Take a Gauss-Newton step in the free unknowns; return it, or None if they are not fixed."""
    information, score = _posterior(problem, fit)
    chosen = np.ix_(free, free)
    scale = np.sqrt(np.maximum(np.diag(information)[free], 1e-300))
    values, vectors = np.linalg.eigh(information[chosen] / np.outer(scale, scale))
    if not values[-1] > 0 or not np.isfinite(values).all():
        return None
    known = values > 1e-6 * values[-1]
    part = vectors[:, known]
    step = np.zeros(kernel.UNKNOWNS)
    step[free] = -(part @ ((part.T @ (score[free] / scale)) / values[known])) / scale
    fit.R = rotation_vector_to_matrix(step[:3]) @ fit.R
    fit.offset += float(step[3])
    fit.lag += float(step[4])
    return step


def _posterior(problem: _Problem, fit: _Fit) -> tuple[Floats, Floats]:
    """Return information and score with the lag's prior."""
    information, score = fit.information.copy(), fit.scores.sum(axis=0)
    weight = (max(fit.noise, 1e-6) / problem.lag_sd) ** 2
    information[4, 4] += weight
    score[4] += weight * (fit.lag - problem.lag)
    return information, score


def _noise(problem: _Problem, fit: _Fit) -> float:
    """Return the standard deviation of a sighting per axis, from the median residual [rad]."""
    length = problem.tracks.length
    # A track of m sightings and its anchor leaves 2 m - 1 of 2 (m + 1) residuals free.
    spread = np.repeat(np.sqrt((length + 1) / (length - 0.5)), length)
    used = fit.weights > 0
    if not used.any():
        return 0.0
    return float(np.median(np.hypot(*fit.residuals[used].T) * spread[used]) / 1.1774)


def _solve(
    problem: _Problem, R: Floats, offset: float, free: NDArray[np.bool_], widest: float
) -> _Fit | None:
    """Iterate to the optimum, the loss narrowing down to what the noise asks for."""
    fit = _begin(problem, R, offset, widest)
    for k in range(40):
        _follow(problem, fit)
        fit.noise = _noise(problem, fit)
        if fit.noise == 0:
            return None
        step = _step(problem, fit, free)
        if step is None:
            return None
        small = bool(np.abs(step[:3]).max() < 1e-5 and abs(step[3]) < 1e-4)
        if k >= 3 and small:
            wanted = float(np.clip(REACH * fit.noise, 0.25 * widest, widest))
            fit.converged = wanted > 0.9 * fit.reach
            if fit.converged:
                break
        if k >= 3:
            fit.reach = float(np.clip(REACH * fit.noise, 0.7 * fit.reach, fit.reach))
    _follow(problem, fit)
    return fit


def _covariance(problem: _Problem, fit: _Fit, free: NDArray[np.bool_]) -> tuple[Floats, float]:
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
    lost = max(1.0 - 4.0 / samples, 0.25)
    inverse = np.zeros((kernel.UNKNOWNS, kernel.UNKNOWNS))
    inverse[np.ix_(free, free)] = np.linalg.pinv(
        information[np.ix_(free, free)], rcond=1e-12, hermitian=True
    )
    return inverse @ scatter @ inverse / lost, samples


def _search(problem: _Problem, R: Floats, offsets: Floats, focal: float) -> tuple[Floats, Floats]:
    """Return candidates, and the loss [rad^2] at each, shape (stretches, candidates)."""
    tracks, t = problem.tracks, problem.motion[0]
    offsets = offsets[::2]
    covered = (tracks.start + offsets[0] >= t[0]) & (tracks.end + offsets[-1] <= t[-1])
    if np.count_nonzero(covered) < FEWEST:
        return np.empty(0), np.empty((0, 0))
    part = replace(problem, tracks=tracks.select(covered).thinned(MOST_SEARCHED))
    free = np.array([True, True, True, False, False])
    start = part.tracks.start
    stretch = ((start - start.min()) / 0.5).astype(np.int64)
    loss = np.zeros((int(stretch.max()) + 1, offsets.size))
    for k, offset in enumerate(offsets):
        fit = _begin(part, R, float(offset), WIDEST / focal)
        for _ in range(2):
            _follow(part, fit)
            _step(part, fit, free)
        _follow(part, fit)
        np.add.at(loss[:, k], stretch, fit.losses / part.tracks.first[-1])
    return offsets, loss


def _as_good(loss: Floats, best: int) -> NDArray[np.bool_]:
    """Tell which candidates fit as well as the best (Vuong 1989), stretch by stretch."""
    more = loss - loss[:, [best]]
    error = np.sqrt(2.0 * np.sum((more - more.mean(axis=0)) ** 2, axis=0))
    return np.asarray(more.sum(axis=0) <= GATE * error)

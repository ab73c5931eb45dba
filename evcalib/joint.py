"""Rotation and offset from all sightings of all corners at once.

Headings tell only which way the camera went.  A corner that is seen again and again tells more: by
how much further it moves from one sighting to the next, up to its unknown distance.  So not only
turns of the motion show the offset, but every change of speed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evcalib import _check
from evcalib import _joint_checks as checks
from evcalib._joint_checks import Departure
from evcalib._joint_fit import Problem, covariance_of, solve
from evcalib._joint_search import FEWEST, GATE, Search, curve_of, search_offsets
from evcalib.kernels import track as track_kernel
from evcalib.offset import OffsetCurve, candidate_offsets
from evcalib.series import VelocitySeries
from evcalib.track import VelocityTrack, smoothed, white_noise
from evcalib.tracks import Tracks

Floats = NDArray[np.float64]

MOST = 100_000
"""Sightings that enter the fit; more lessen the error of the corners, not that of the motion."""

MOST_NEAR = 40_000
"""Sightings that enter the search near the optimum."""

WIDEST = 2.0
"""Reach of the loss [px] at the start."""

SLOWEST = 2.0
"""Flow [px/s] below which a corner has no direction to trail along."""

SMOOTHED = 0.2
"""Widest half window [s] over which the odometry is smoothed, about half of a track's span."""

NO_YAW_RATE = 0.005
"""Yaw rate [rad/s] that a body may have where the odometry tells none."""

JUMP = 0.25
"""Change from one sample of the odometry to the next, as a share of the usual speed, that counts as
sudden."""

USUAL_SPAN = 0.4
"""Usual time from the first to the last sighting of a corner [s]."""

NEAR = np.arange(-6, 7) * 0.01
"""Offsets [s] around the optimum at which its sharpness is measured."""


@dataclass(frozen=True)
class Systematic:
    """What all sightings of a drive share, however many they are.

    Attributes
    ----------
    lag, lag_sd : float
        How far corners trail their true place along their flow, and how sure that is [px].
    time_sd : float
        Standard deviation of what remains as a delay [s], whatever the flow.
    rotation_sd : float
        Standard deviation of what remains as a rotation, per axis [rad].
    spin_sd : float
        Standard deviation of the yaw rate that the odometry does not tell [rad/s], besides noise.
    """

    lag: float = 0.0
    lag_sd: float = 0.1
    time_sd: float = 0.0015
    rotation_sd: float = float(np.radians(0.06))
    spin_sd: float = 0.001


SYSTEMATIC = Systematic()
"""What simulated recordings of many scenes leave (notebook 06)."""


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
    span : tuple of float
        First and last time of these [s], on the camera clock.
    curve : OffsetCurve, optional
        How well the tracks are met over the candidate offsets, each with its best rotation; None
        where the offset was given.
    plausible : ndarray, shape (k,)
        Candidates [s] that fit as well as the best.
    converged : bool
        Whether the last step was small.
    drift : Departure
        How fast the offset grows [s/s]; `offset` holds in the middle.
    distortion : Departure
        By how much directions of travel differ between the streams beyond a rotation [rad], as the
        cosine and the sine of twice their angle.
    turning : float
        Standard deviation of the yaw rate that the odometry does not tell [rad/s], as taken.
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
    span: tuple[float, float]
    curve: OffsetCurve | None
    plausible: Floats
    converged: bool
    drift: Departure
    distortion: Departure
    turning: float


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
    systematic: Systematic = SYSTEMATIC,
    lever: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> JointRefinement | None:
    """Refine rotation and offset on all sightings of all corners.

    Each sighting has its own time, the odometry is integrated from the first sighting to it, its
    yaw included, and the distance of each corner is solved for along with the rest.  The loss is
    Tukey's.  Two nuisances are estimated too, with priors: how far corners trail along their flow,
    and how far the odometry's yaw rate is off, every 50 ms anew, so that its noise does not pass
    for motion.

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
    systematic : Systematic
        What is known of errors that all sightings share.
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
    problem = Problem(
        tracks,
        tracks.group,
        world_motion(velocities, track),
        lever,
        SLOWEST / focal,
        systematic.lag / focal,
        systematic.lag_sd / focal,
        float(np.hypot(yaw_rate_error(velocities, track), systematic.spin_sd)),
    )
    free = np.array([True, True, True, estimate_offset, True])
    widest, search = WIDEST / focal, None
    grid = candidate_offsets(max_offset)
    if estimate_offset:
        wide = search_offsets(problem, R_body_cam, grid[::4], widest)
        if wide is None:
            return None
        offset = float(wide.offsets[np.nanargmin(wide.mean)])
    fit = solve(problem, R_body_cam, offset, free, widest)
    if fit is None:
        return None
    problem, fit = checks.with_turning(problem, fit, free, widest)
    problem, fit, drift = checks.without_drift(problem, fit, free, widest)
    covariance, samples = covariance_of(problem, fit, free)
    covariance[:3, :3] += systematic.rotation_sd**2 * np.eye(3)
    if estimate_offset:
        # Under the final loss, which is far narrower, other answers stand out.
        search = search_offsets(problem, fit.R, grid[::2], fit.reach)
        near = search_offsets(problem, fit.R, np.asarray(fit.offset + NEAR), fit.reach, MOST_NEAR)
        width = _width(near, search, fit.offset)
        sd = max(float(np.sqrt(covariance[3, 3])), 0.5 * width / GATE, jump_floor(track))
        covariance[3, 3] = sd**2 + systematic.time_sd**2
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
        span=(float(tracks.start[0]), float(tracks.end.max())),
        curve=None
        if search is None
        else curve_of(search, fit.offset, max_offset, fit.reach**2 / 6),
        plausible=np.empty(0) if search is None else search.as_good(fit.offset),
        converged=fit.converged,
        drift=drift,
        distortion=checks.distortion(problem, fit, free),
        turning=problem.spin_sd,
    )


def _width(near: Search | None, wide: Search | None, offset: float) -> float:
    """Return how far offsets fit as well [s], from the near search, or both if it shows no end."""
    if near is None:
        return 0.0
    width = near.half_width(offset)
    if wide is None or np.isfinite(near.reach(offset)).all():
        return width
    return max(width, wide.half_width(offset))


def world_motion(velocities: VelocitySeries, track: VelocityTrack) -> tuple[NDArray, ...]:
    """Return time, velocity in the world, its slope and integral, yaw and segment, per sample.

    The world's axes are the body's at the first sample.  Noise of the odometry roughens the loss as
    a function of the offset, so all is smoothed a little; what a wider window takes off the peaks
    of the velocity would pass for a rotation.
    """
    yaw, v = np.zeros(track.t.size), smoothed(track, track.raw, SMOOTHED)
    if velocities.yaw_rate is not None:
        rate = smoothed(track, velocities.yaw_rate[:, None], SMOOTHED)[:, 0]
        yaw[1:] = np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(track.t))
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, z = v.T
    v = np.stack([c * x - s * y, s * x + c * y, z], axis=1)
    slope, path = track_kernel.slopes(track.t, v), track_kernel.integrate(track.t, v, track.segment)
    return track.t, v, slope, path, yaw, track.segment


def jump_floor(track: VelocityTrack) -> float:
    """Return how well the time of a sudden change of the velocity is known [s]; 0 without any.

    Between two samples of the odometry it may have come at any time.
    """
    step = np.diff(track.t)
    change = np.linalg.norm(np.diff(track.v, axis=0), axis=1)
    jumps = (change > JUMP * track.moving_speed) & (np.diff(track.segment) == 0)
    return float(step[jumps].max(initial=0.0)) / np.sqrt(12.0)


def yaw_rate_error(velocities: VelocitySeries, track: VelocityTrack) -> float:
    """Return the standard deviation of the mean yaw rate over a usual track [rad/s]."""
    if velocities.yaw_rate is None:
        return NO_YAW_RATE
    noise = float(white_noise(velocities.yaw_rate[:, None], track.segment)[0])
    return noise * float(np.sqrt(np.median(np.diff(velocities.t)) / USUAL_SPAN))

"""Rotation, offset and position from all observations of all corners at once.

Headings tell only which way the camera went.  A corner that is seen again and again tells more: by
how much further it moves from one observation to the next, up to its unknown distance.  So not only
turns of the motion show the offset, but every change of speed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from evcalib.alignment.offset import candidate_offsets
from evcalib.arrays import Flags, Floats
from evcalib.checks import instance, positive
from evcalib.joint import _model_checks as checks
from evcalib.joint._offset_search import FEWEST, GATE, Search, curve_of, search_offsets
from evcalib.joint._result import SYSTEMATIC, JointRefinement, Systematic
from evcalib.joint._solver import LAG, OFFSET, POSITION, Fit, Problem, by_gyro, covariance_of, solve
from evcalib.joint._world_motion import jump_floor, turning_radius, world_motion, yaw_rate_error
from evcalib.joint.tracks import Tracks
from evcalib.kinematics.velocity_track import VelocityTrack
from evcalib.series import VelocitySeries

MOST = 100_000
"""Observations that enter the fit.  A choice of speed: more lessen the error of the corners, not
that of the motion."""

MOST_NEAR = 40_000
"""Observations that enter the search near the optimum.  A choice of speed."""

WIDEST = 2.0
"""Scale of the loss [px] at the start.  A choice, eight times the noise of the studies' corners:
wider ones let in false observations, narrower ones need a better start
(test_false_observations_do_no_harm)."""

SLOWEST = 2.0
"""Flow [px/s] below which a corner has no direction to trail along.  A choice: noise of 0.3 px over
a track of 0.4 s is a flow of 1 px/s."""

REACH = 1.0
"""Standard deviation of the camera's place on the body before anything is seen [m].  A choice:
larger than most bodies; where nothing tells more, it is what is stated."""

NEAR = np.arange(-6, 7) * 0.01
"""Offsets [s] around the optimum at which its sharpness is measured.  A choice: where an end
lies outside, the wide search counts too."""

POSITION_BIAS = 2.0
"""How many times as much as a rotation the position feels what all directions share.  Measured: of
28 simulated drives (figure-eights, slaloms, strafing) 23 lay inside the 95 % bars of their position
with 1.0; 2.0 explains their errors."""


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
    estimate_position: bool = False,
    gyro_sd: float | None = None,
) -> JointRefinement | None:
    """Refine rotation, offset and position on all observations of all corners.

    Each observation has its own time, the odometry is integrated from the first one to it, its yaw
    included, and the distance of each corner is solved for along with the rest.  The loss is
    Tukey's.  Two nuisances are estimated too, with priors: how far corners trail along their flow,
    and how far the odometry's yaw rate is off, every 50 ms anew, so that its noise does not pass
    for motion.

    Parameters
    ----------
    tracks : Tracks
        From `evcalib.joint.tracks.tracks_of`.
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
        What is known of errors that all observations share.
    lever : tuple of float
        Position of the camera in the body frame [m].
    estimate_position : bool
        Take x and y of it as a start only.  A body that does not turn does not show them: their
        standard deviation is then a metre and more.
    gyro_sd : float, optional
        Given where a gyro turned all `r2` back, to bearings of a camera that stands as at `t1`:
        how far its rates may still be off, all the time and about any axis [rad/s].  The yaw of
        the odometry then bends the path, and moves a camera off the origin, but turns no bearing;
        the rate that is estimated every 50 ms is what the gyro is off by about the body's z.

    Returns
    -------
    JointRefinement or None
        None if there are too few tracks.

    Raises
    ------
    InputError
        If an input is of another type, or the focal length is not positive.

    Notes
    -----
    The change of the flow's direction with the unknowns is left out of the derivatives: the lag is
    a small part of a displacement.

    References
    ----------
    The paper has no such stage.  Variable projection: Golub & Pereyra 1973; the covariance is that
    of Newey & West 1987.
    """
    instance(tracks, "tracks", Tracks)
    instance(velocities, "velocities", VelocitySeries)
    instance(track, "track", VelocityTrack)
    positive(focal, "focal", "pixels per radian")
    tracks = tracks.thinned(MOST)
    if len(tracks) < FEWEST:
        return None
    if gyro_sd is not None:
        positive(gyro_sd, "gyro_sd", "radians per second")
    problem = _problem(tracks, velocities, track, focal, systematic, lever)
    if gyro_sd is not None:
        sd = float(np.hypot(gyro_sd, systematic.yaw_rate_sd))
        problem = replace(problem, yaw_rate_sd=sd, gyro_sd=gyro_sd)
    free = np.repeat([True, estimate_offset, True, estimate_position], [3, 1, 1, 2])
    widest = WIDEST / focal
    grid = candidate_offsets(max_offset)
    start = _start(problem, R_body_cam, grid[::4], widest, free) if estimate_offset else offset
    fit = None if start is None else solve(problem, R_body_cam, start, free, widest)
    if fit is None:
        return None
    problem, fit = checks.with_turning(problem, fit, free, widest)
    problem, fit, drift = checks.without_drift(problem, fit, free, widest)
    covariance, samples = covariance_of(problem, fit, free)
    covariance += by_gyro(problem, fit, free)
    covariance[:3, :3] += systematic.rotation_sd**2 * np.eye(3)
    if estimate_position:
        shared = POSITION_BIAS * systematic.rotation_sd * turning_radius(problem.motion)
        covariance[POSITION, POSITION] += min(shared, problem.lever_sd) ** 2 * np.eye(2)
    search, told = None, np.r_[: OFFSET + 1, POSITION]
    if estimate_offset:
        search, width = _sharpness(problem, fit, grid[::2], free)
        sd = np.sqrt(covariance[OFFSET, OFFSET])
        sd = max(float(sd), 0.5 * width / GATE, jump_floor(track))
        covariance[OFFSET, OFFSET] = sd**2 + systematic.time_sd**2
    return JointRefinement(
        R_body_cam=fit.R,
        offset=fit.offset,
        lag=fit.lag * focal,
        lag_sd=float(np.sqrt(covariance[LAG, LAG])) * focal,
        position=fit.position,
        covariance=covariance[np.ix_(told, told)],
        samples=samples,
        noise=fit.noise * focal,
        inlier_share=float(np.mean(fit.weights > 0)),
        tracks=len(tracks),
        observations=int(tracks.first[-1]),
        span=(float(tracks.start[0]), float(tracks.end.max())),
        curve=None
        if search is None
        else curve_of(search, fit.offset, max_offset, fit.loss_scale**2 / 6),
        plausible=np.empty(0) if search is None else search.as_good(fit.offset),
        converged=fit.converged,
        drift=drift,
        distortion=checks.distortion(problem, fit, free),
        turning=problem.yaw_rate_sd,
    )


def _problem(
    tracks: Tracks,
    velocities: VelocitySeries,
    track: VelocityTrack,
    focal: float,
    systematic: Systematic,
    lever: tuple[float, float, float],
) -> Problem:
    """Return the problem in radians."""
    return Problem(
        tracks,
        tracks.group,
        world_motion(velocities, track),
        lever,
        REACH,
        slowest=SLOWEST / focal,
        lag=systematic.lag / focal,
        lag_sd=systematic.lag_sd / focal,
        yaw_rate_sd=float(np.hypot(yaw_rate_error(velocities, track), systematic.yaw_rate_sd)),
    )


def _start(
    problem: Problem, R: Floats, offsets: Floats, widest: float, free: Flags
) -> float | None:
    """Return the offset that fits best under the widest loss; None with too few tracks."""
    wide = search_offsets(problem, R, offsets, widest, free)
    return None if wide is None else float(wide.offsets[np.nanargmin(wide.mean)])


def _sharpness(
    problem: Problem, fit: Fit, offsets: Floats, free: Flags
) -> tuple[Search | None, float]:
    """Return the search under the final loss, and the width of the offsets that fit as well [s].

    The final loss is far narrower than that of the start: other answers stand out.
    """
    problem = replace(problem, lever=tuple(fit.position))
    wide = search_offsets(problem, fit.R, offsets, fit.loss_scale, free)
    near = np.asarray(fit.offset + NEAR)
    close = search_offsets(problem, fit.R, near, fit.loss_scale, free, MOST_NEAR)
    return wide, _width(close, wide, fit.offset)


def _width(near: Search | None, wide: Search | None, offset: float) -> float:
    """Return how far offsets fit as well [s], from the near search, or both if it shows no end."""
    if near is None:
        return 0.0
    width = near.half_width(offset)
    if wide is None or np.isfinite(near.reach(offset)).all():
        return width
    return max(width, wide.half_width(offset))

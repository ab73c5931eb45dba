"""Rotation, offset and position from all observations of all corners at once.

Headings tell only which way the camera went.  A corner that is seen again and again tells more: by
how much further it moves from one observation to the next, up to its unknown distance.  So not only
turns of the motion show the offset, but every change of speed.
"""

from __future__ import annotations

import numpy as np

from evcalib.alignment.offset import candidate_offsets
from evcalib.arrays import Floats
from evcalib.checks import instance, positive
from evcalib.joint import _model_checks as checks
from evcalib.joint._offset_search import FEWEST, GATE, Search, curve_of, search_offsets
from evcalib.joint._result import SYSTEMATIC, JointRefinement, Systematic
from evcalib.joint._solver import (
    LAG,
    OFFSET,
    POSITION,
    TILT,
    UNKNOWNS,
    Fit,
    Problem,
    begin,
    converged,
    covariance_of,
    solve,
)
from evcalib.joint._turning import Turning
from evcalib.joint._world_motion import USUAL_SPAN, jump_floor, world_motion, yaw_rate_error
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
    stabilised: bool = False,
) -> JointRefinement | None:
    """Refine rotation, offset and position on all observations of all corners.

    Each observation has its own time, the odometry is integrated from the first one to it, its yaw
    included, and the distance of each corner is solved for along with the rest.  The loss is
    Tukey's.  Nuisances are estimated too, with priors: how far corners trail along their flow, how
    the body tilts by its acceleration, and how it turns about three axes beyond what the odometry
    tells, every 50 ms, as much as the tracks show: so neither noise of the yaw rate nor vibration
    passes for motion, and what cannot be told from it widens the covariance.

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
        Take x and y of it as a start only.  A body that does not turn does not show them: they stay
        as they are, at a standard deviation of a metre.
    stabilised : bool
        Whether `r2` are bearings of a camera that does not turn: a gyroscope took its turning since
        the first observation out.

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
    problem = _problem(tracks, velocities, track, focal, systematic, lever, stabilised)
    free = np.repeat(
        [True, estimate_offset, True, estimate_position, not stabilised], [3, 1, 1, 2, 2]
    )
    widest, grid = WIDEST / focal, candidate_offsets(max_offset)
    start = _start(problem, R_body_cam, grid[::4], widest) if estimate_offset else offset
    if start is None:
        return None
    fit = solve(problem, begin(problem, R_body_cam, start, widest), free, widest)
    if fit is None:
        return None
    problem, fit, drift = checks.without_drift(problem, fit, free, widest)
    covariance, samples = covariance_of(problem, fit, free)
    done = converged(fit, covariance, free)
    covariance[:3, :3] += systematic.rotation_sd**2 * np.eye(3)
    search = None
    if estimate_offset:
        search, width = _sharpness(problem, fit, grid[::2])
        sd = np.sqrt(covariance[OFFSET, OFFSET])
        sd = max(float(sd), 0.5 * width / GATE, jump_floor(track))
        covariance[OFFSET, OFFSET] = sd**2 + systematic.time_sd**2
    told, sd = np.r_[:4, POSITION], np.sqrt(np.diag(covariance))
    return JointRefinement(
        R_body_cam=fit.R,
        offset=fit.offset,
        lag=fit.lag * focal,
        lag_sd=float(sd[LAG]) * focal,
        position=np.array([*fit.values[POSITION], lever[2]]),
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
        converged=done,
        drift=drift,
        distortion=checks.distortion(problem, fit, free),
        turning=checks.turning(problem, fit),
        tilt=fit.values[TILT].copy(),
        tilt_sd=sd[TILT],
    )


def _problem(
    tracks: Tracks,
    velocities: VelocitySeries,
    track: VelocityTrack,
    focal: float,
    systematic: Systematic,
    lever: tuple[float, float, float],
    stabilised: bool,
) -> Problem:
    """Return the problem in radians."""
    prior, prior_sd = np.zeros(UNKNOWNS), np.full(UNKNOWNS, np.inf)
    prior[LAG], prior_sd[LAG] = systematic.lag / focal, systematic.lag_sd / focal
    prior[POSITION], prior_sd[POSITION] = lever[:2], REACH
    prior_sd[TILT] = systematic.tilt_sd
    yaw_rate_sd = float(np.hypot(yaw_rate_error(velocities, track), systematic.yaw_rate_sd))
    return Problem(
        tracks,
        world_motion(velocities, track),
        lever,
        slowest=SLOWEST / focal,
        prior=prior,
        prior_sd=prior_sd,
        turning=Turning.over(tracks, yaw_rate_sd, USUAL_SPAN),
        stabilised=stabilised,
    )


def _start(problem: Problem, R: Floats, offsets: Floats, widest: float) -> float | None:
    """Return the offset that fits best under the widest loss; None with too few tracks."""
    wide = search_offsets(problem, R, offsets, widest)
    return None if wide is None else float(wide.offsets[np.nanargmin(wide.mean)])


def _sharpness(problem: Problem, fit: Fit, offsets: Floats) -> tuple[Search | None, float]:
    """Return the search under the final loss, and the width of the offsets that fit as well [s].

    The final loss is far narrower than that of the start: other answers stand out.
    """
    wide = search_offsets(problem, fit.R, offsets, fit.loss_scale, like=fit)
    near = search_offsets(
        problem,
        fit.R,
        np.asarray(fit.offset + NEAR),
        fit.loss_scale,
        most=MOST_NEAR,
        like=fit,
        mirrored=True,
    )
    return wide, _width(near, wide, fit.offset)


def _width(near: Search | None, wide: Search | None, offset: float) -> float:
    """Return how far offsets fit as well [s], from the near search, or both if it shows no end."""
    if near is None:
        return 0.0
    width = near.half_width(offset)
    if wide is None or np.isfinite(near.reach(offset)).all():
        return width
    return max(width, wide.half_width(offset))

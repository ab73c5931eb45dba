"""The odometry in the world: velocity, path and yaw, and how far they may be off."""

from __future__ import annotations

import numpy as np
from scipy.integrate import cumulative_trapezoid

from evcalib.geometry import turned_by_yaw
from evcalib.kernels.joint.observation_model import WorldMotion
from evcalib.kernels.kinematics import velocity_track as track_kernel
from evcalib.kinematics.velocity_track import VelocityTrack, smoothed
from evcalib.series import VelocitySeries
from evcalib.uncertainty import white_noise

SMOOTHED = 0.2
"""Widest half window [s] over which the odometry is smoothed, about half of a track's span.  Over
0.8 s, rotations were 0.2 to 0.6 deg off
(test_the_noise_of_the_odometry_does_not_bend_the_answer)."""

NO_YAW_RATE = 0.005
"""Yaw rate [rad/s] that a body may have where the odometry tells none.  A choice, a start: where
the tracks show more, they are believed (`with_turning`)."""

JUMP = 0.25
"""Change from one sample of the odometry to the next, as a share of the usual speed, that counts as
sudden.  A choice: a turn by 15 degrees, or a quarter of the speed, within a sample."""

USUAL_SPAN = 0.4
"""Usual time from the first to the last observation of a corner [s].  It only scales the prior of
the yaw-rate bias, by its root; the tracks correct the prior (`with_turning`)."""


def world_motion(velocities: VelocitySeries, track: VelocityTrack) -> WorldMotion:
    """Return the odometry in the world.

    The world's axes are the body's at the first sample.  Noise of the odometry roughens the loss as
    a function of the offset, so all is smoothed a little; what a wider window takes off the peaks
    of the velocity would pass for a rotation.
    """
    yaw, v = np.zeros(track.t.size), smoothed(track, track.raw, SMOOTHED)
    if velocities.yaw_rate is not None:
        rate = smoothed(track, velocities.yaw_rate[:, None], SMOOTHED)[:, 0]
        yaw = cumulative_trapezoid(rate, track.t, initial=0.0)
    v = turned_by_yaw(v, yaw)
    slope, path = track_kernel.slopes(track.t, v), track_kernel.integrate(track.t, v, track.segment)
    return WorldMotion(track.t, v, slope, path, yaw, track.segment)


def turning_radius(motion: WorldMotion) -> float:
    """Return speed over yaw rate [m], root mean squares; huge where it never turns.

    By so much does a position move, for each radian that directions of travel are off.
    """
    step = np.diff(motion.t)
    inside = np.diff(motion.segment) == 0
    yaw_rate = np.sqrt(np.mean((np.diff(motion.yaw) / step)[inside] ** 2))
    speed = np.sqrt(np.mean(np.sum(motion.velocity**2, axis=1)))
    return float(speed / max(yaw_rate, 1e-9))


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

"""Where a corner is seen again, after the body has moved and turned: values and derivatives.

All is in the camera frame of the first observation, across and along the corner's bearing then.
"""

import math
from typing import NamedTuple

import numpy as np

from evcalib.kernels.jit import jit
from evcalib.kernels.linalg import cross, dot

NEAREST = 0.2
"""Points that come nearer than this part of their first distance are not fitted.  A choice: there
1 / (1 - rho z) is at most 5, and a corner 2.5 m ahead is left for the last half metre to it."""

VALUE, BY_POSITION, BY_YAW_RATE, FLOW, COLUMNS = 0, 5, 7, 8, 9
"""Columns of what an observation holds: the value, derivatives by rotation (1 to 3), offset (4),
position of the camera (5, 6) and yaw-rate bias (7), and the change with time, along which the
corner flows."""


class WorldMotion(NamedTuple):
    """The odometry at its n samples, in a world whose axes are the body's at the first one."""

    t: np.ndarray  # (n,) [s]
    velocity: np.ndarray  # (n, 3) [m/s]
    slope: np.ndarray  # (n - 1, 3) of the velocity, from each sample to the next [m/s^2]
    path: np.ndarray  # (n, 3) integral of the velocity from the start of each segment [m]
    yaw: np.ndarray  # (n,) [rad]
    segment: np.ndarray  # (n,) int64, number of the segment between gaps


class State(NamedTuple):
    """The body in the world at an instant."""

    position: tuple[float, float, float]  # [m]
    velocity: tuple[float, float, float]  # [m/s]
    yaw: float  # [rad]
    yaw_rate: float  # [rad/s]


class Camera(NamedTuple):
    """The camera on the body, and the corner as it first saw it."""

    R: np.ndarray  # (3, 3) R_body_cam
    lever: tuple[float, float, float]  # position in the body frame [m]
    bearing: np.ndarray  # (3,) of the corner's first observation
    axes: tuple[tuple[float, float, float], ...]  # two, across the bearing
    stabilised: bool  # whether later bearings are those of a camera that has not turned since


@jit
def _about_z(angle, a):
    """Return a turned about Z by `angle`."""
    c, s = math.cos(angle), math.sin(angle)
    return c * a[0] - s * a[1], s * a[0] + c * a[1], a[2]


@jit
def _across_z(rate, a):
    """Return rate * Z x a."""
    return -rate * a[1], rate * a[0], 0.0


@jit
def _sum(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@jit
def _minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@jit
def _to_camera(R, a):
    """Return R^T a."""
    return (
        R[0, 0] * a[0] + R[1, 0] * a[1] + R[2, 0] * a[2],
        R[0, 1] * a[0] + R[1, 1] * a[1] + R[2, 1] * a[2],
        R[0, 2] * a[0] + R[1, 2] * a[1] + R[2, 2] * a[2],
    )


@jit
def step_of(at, j, t):
    """Return the step of t that `at` falls into, sought from step j on."""
    while j > 0 and at < t[j]:
        j -= 1
    while j < t.size - 2 and at >= t[j + 1]:
        j += 1
    return j


@jit
def state(at, j, motion):
    """Return the body at time `at` within step j of the motion."""
    t, v, slope, path, yaw = motion.t, motion.velocity, motion.slope, motion.path, motion.yaw
    u = at - t[j]
    position = (
        path[j, 0] + u * (v[j, 0] + 0.5 * u * slope[j, 0]),
        path[j, 1] + u * (v[j, 1] + 0.5 * u * slope[j, 1]),
        path[j, 2] + u * (v[j, 2] + 0.5 * u * slope[j, 2]),
    )
    velocity = v[j, 0] + u * slope[j, 0], v[j, 1] + u * slope[j, 1], v[j, 2] + u * slope[j, 2]
    rate = (yaw[j + 1] - yaw[j]) / (t[j + 1] - t[j])
    return State(position, velocity, yaw[j] + u * rate, rate)


@jit
def observe(before, after, time, bias, ray, camera, a, z, y, dy):
    """Fill in where a corner is seen, and the displacement in the same terms.

    before, after : `State` of the body at the first observation and `time` [s] later.
    bias : error of the yaw rate [rad/s]: the odometry's, or of what turned bearings back.
    ray : bearing at t2 in the body frame of t2.
    camera : `Camera`.
    a, z : (9, 2) and (9,), displacement across and along the first bearing b, in columns as above.
    y, dy : (2,) and (8, 2), the observation and its derivatives (columns 1 to 7).

    Returns whether the corner is in front.
    """
    R, b, e, lever = camera.R, camera.bearing, camera.axes, camera.lever
    yaw1, rate1, v2, rate2 = before.yaw, before.yaw_rate, after.velocity, after.yaw_rate
    psi = after.yaw - yaw1 + time * bias
    ray_psi = time * bias if camera.stabilised else psi
    spin = 0.0 if camera.stabilised else rate2 - rate1
    arm = _about_z(psi, lever)
    path = _about_z(0.5 * time * bias - yaw1, _minus(after.position, before.position))
    change = _sum(_about_z(-yaw1, _minus(v2, before.velocity)), _across_z(-rate1, path))
    change = _sum(change, _across_z(rate2 - rate1, arm))
    D = _sum(path, _minus(arm, lever))
    seen_by_body = _about_z(ray_psi, ray)
    seen = _to_camera(R, seen_by_body)
    depth = dot(b, seen)
    if depth < NEAREST:
        return False
    y[0], y[1] = dot(e[0], seen) / depth, dot(e[1], seen) / depth
    c, s = math.cos(psi) - 1.0, math.sin(psi)
    ray_c, ray_s = math.cos(ray_psi) - 1.0, math.sin(ray_psi)
    none = (0.0, 0.0, 0.0)
    moved = (
        D,
        (0.0, D[2], -D[1]),
        (-D[2], 0.0, D[0]),
        (D[1], -D[0], 0.0),
        change,
        (c, s, 0.0),
        (-s, c, 0.0),
        _sum(_across_z(0.5 * time, path), _across_z(time, arm)),
        _sum(_about_z(-yaw1, v2), _across_z(rate2, arm)),
    )
    turned = (
        none,
        cross((ray_c, ray_s, 0.0), seen_by_body),
        cross((-ray_s, ray_c, 0.0), seen_by_body),
        none,
        _across_z(spin, seen_by_body),
        none,
        none,
        _across_z(time, seen_by_body),
        none,
    )
    for k in range(COLUMNS):
        d, h = _to_camera(R, moved[k]), _to_camera(R, turned[k])
        a[k, 0], a[k, 1], z[k] = dot(e[0], d), dot(e[1], d), dot(b, d)
        if k < FLOW:
            along = dot(b, h)
            dy[k, 0] = (dot(e[0], h) - y[0] * along) / depth
            dy[k, 1] = (dot(e[1], h) - y[1] * along) / depth
    return True

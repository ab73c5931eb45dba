"""Where a corner is seen again, after the body has moved, turned and tilted: values, derivatives.

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

VALUE, ROTATION, FLOW, OFFSET, POSITION, LATER, FIRST, COLUMNS = 0, 1, 4, 5, 6, 8, 11, 13
"""Columns of what an observation holds: the value; derivatives by rotation (3); the change with
time, along which the corner flows; derivatives by offset, position (2), turning at the observation
(3) and tilt at the anchor (2)."""


class WorldMotion(NamedTuple):
    """The odometry at its n samples, in a world whose axes are the body's at the first one."""

    t: np.ndarray  # (n,) [s]
    velocity: np.ndarray  # (n, 3) [m/s]
    slope: np.ndarray  # (n - 1, 3) of the velocity, from each sample to the next [m/s^2]
    path: np.ndarray  # (n, 3) integral of the velocity from the start of each segment [m]
    yaw: np.ndarray  # (n,) [rad]
    segment: np.ndarray  # (n,) int64, number of the segment between gaps
    pull: np.ndarray  # (n, 2) acceleration to the left and ahead, delayed, that tilts a body


class State(NamedTuple):
    """The body in the world at an instant."""

    position: tuple[float, float, float]  # [m]
    velocity: tuple[float, float, float]  # [m/s]
    yaw: float  # [rad]
    yaw_rate: float  # [rad/s]
    pull: tuple[float, float]  # [m/s^2]
    jerk: tuple[float, float]  # its change [m/s^3]


class Camera(NamedTuple):
    """The camera on the body, and the corner as it first saw it."""

    R: np.ndarray  # (3, 3) R_body_cam
    lever: tuple[float, float, float]  # position in the body frame [m]
    stabilised: bool  # whether bearings are those of a camera that does not turn
    bearing: np.ndarray  # (3,) of the corner's first observation
    axes: np.ndarray  # (2, 3) across the bearing


@jit
def _about_z(c, s, a):
    """Return a turned about Z by the angle of this cosine and sine."""
    return c * a[0] - s * a[1], s * a[0] + c * a[1], a[2]


@jit
def _across_z(rate, a):
    """Return rate * Z x a."""
    return -rate * a[1], rate * a[0], 0.0


@jit
def _tilted(sign, tilt, a):
    """Return a turned by a small tilt about X and Y, or back: right to its square."""
    x, y = sign * tilt[0], sign * tilt[1]
    b0, b1, b2 = y * a[2], -x * a[2], x * a[1] - y * a[0]
    return (
        a[0] + b0 + 0.5 * y * b2,
        a[1] + b1 - 0.5 * x * b2,
        a[2] + b2 + 0.5 * (x * b1 - y * b0),
    )


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
    pull = motion.pull
    u, step = at - t[j], t[j + 1] - t[j]
    position = (
        path[j, 0] + u * (v[j, 0] + 0.5 * u * slope[j, 0]),
        path[j, 1] + u * (v[j, 1] + 0.5 * u * slope[j, 1]),
        path[j, 2] + u * (v[j, 2] + 0.5 * u * slope[j, 2]),
    )
    velocity = v[j, 0] + u * slope[j, 0], v[j, 1] + u * slope[j, 1], v[j, 2] + u * slope[j, 2]
    rate = (yaw[j + 1] - yaw[j]) / step
    jerk = (pull[j + 1, 0] - pull[j, 0]) / step, (pull[j + 1, 1] - pull[j, 1]) / step
    pulled = pull[j, 0] + u * jerk[0], pull[j, 1] + u * jerk[1]
    return State(position, velocity, yaw[j] + u * rate, rate, pulled, jerk)


@jit
def observe(before, after, first, later, ray, camera, columns, a, z, y, dy):
    """Fill in where a corner is seen, and the displacement in the same terms.

    before, after : `State` of the body at the first observation and at this one.
    first, later : what the body is turned by beyond the odometry, then and now: roll, pitch, yaw.
    ray : bearing at this one in the body frame.
    camera : `Camera`.
    columns : how many of the columns above are wanted, OFFSET or all of them.
    a, z : (columns, 2) and (columns,), displacement across and along the first bearing b.
    y, dy : (2,) and (columns, 2), the observation and its derivatives.

    Returns whether the corner is in front.
    """
    R, b, e, lever = camera.R, camera.bearing, camera.axes, camera.lever
    yaw1, rate1, v2, rate2 = before.yaw, before.yaw_rate, after.velocity, after.yaw_rate
    more = later[2] - first[2]
    psi = after.yaw - yaw1 + more
    cm, sm = math.cos(psi), math.sin(psi)
    c, s = (math.cos(more), math.sin(more)) if camera.stabilised else (cm, sm)
    cp, sp = math.cos(0.5 * more - yaw1), math.sin(0.5 * more - yaw1)
    arm = _about_z(cm, sm, _tilted(1.0, later, lever))
    path = _about_z(cp, sp, _minus(after.position, before.position))
    D = _tilted(-1.0, first, _sum(path, _minus(arm, _tilted(1.0, first, lever))))
    seen_by_body = _tilted(-1.0, first, _about_z(c, s, _tilted(1.0, later, ray)))
    seen = _to_camera(R, seen_by_body)
    depth = dot(b, seen)
    if depth < NEAREST:
        return False
    y[0], y[1] = dot(e[0], seen) / depth, dot(e[1], seen) / depth
    tilt = _minus(_about_z(c, s, (later[0], later[1], 0.0)), (first[0], first[1], 0.0))
    moved = (
        D,
        (0.0, D[2], -D[1]),
        (-D[2], 0.0, D[0]),
        (D[1], -D[0], 0.0),
        _sum(_about_z(cp, sp, v2), _across_z(rate2, arm)),
    )
    turned = (
        (0.0, 0.0, 0.0),
        cross((c - 1.0, s, -tilt[1]), seen_by_body),
        cross((-s, c - 1.0, tilt[0]), seen_by_body),
        cross((tilt[1], -tilt[0], 0.0), seen_by_body),
        # A camera that turns sees all flow the other way.
        _across_z(-rate2, seen_by_body),
    )
    for k in range(OFFSET):
        _project(R, b, e, moved[k], turned[k], y, depth, k, a, z, dy)
    if columns > OFFSET:
        change = _sum(_about_z(cp, sp, _minus(v2, before.velocity)), _across_z(-rate1, path))
        change = _sum(change, _across_z(rate2 - rate1, arm))
        faster = 0.0 if camera.stabilised else rate2 - rate1
        whole = _sum(D, lever)
        none = (0.0, 0.0, 0.0)
        further = (
            change,
            (cm - 1.0, sm, 0.0),
            (-sm, cm - 1.0, 0.0),
            cross((cm, sm, 0.0), arm),
            cross((-sm, cm, 0.0), arm),
            _sum(_across_z(0.5, path), _across_z(1.0, arm)),
            (0.0, whole[2], -whole[1]),
            (-whole[2], 0.0, whole[0]),
        )
        spun = (
            _across_z(faster, seen_by_body),
            none,
            none,
            cross((c, s, 0.0), seen_by_body),
            cross((-s, c, 0.0), seen_by_body),
            _across_z(1.0, seen_by_body),
            (0.0, seen_by_body[2], -seen_by_body[1]),
            (-seen_by_body[2], 0.0, seen_by_body[0]),
        )
        for k in range(COLUMNS - OFFSET):
            _project(R, b, e, further[k], spun[k], y, depth, OFFSET + k, a, z, dy)
    return True


@jit
def _project(R, b, e, moved, turned, y, depth, k, a, z, dy):
    """Fill in column k: a displacement and a change of the ray, both in the body frame."""
    d, h = _to_camera(R, moved), _to_camera(R, turned)
    a[k, 0], a[k, 1], z[k] = dot(e[0], d), dot(e[1], d), dot(b, d)
    along = dot(b, h)
    dy[k, 0] = (dot(e[0], h) - y[0] * along) / depth
    dy[k, 1] = (dot(e[1], h) - y[1] * along) / depth

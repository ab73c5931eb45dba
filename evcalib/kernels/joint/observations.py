"""Corners seen again and again, against the motion of the body: residuals, gradients, information.

A track is a corner at time t1 (its anchor, bearing b) and the same corner at later times t2.  With
the camera's displacement d from t1 to t2, in the camera frame of t1, and the corner's inverse
distance rho, it is seen along b - rho d: on the plane that touches the sphere at b, at

    y = -rho a / (1 - rho z),   a = e . d (two axes e across b),   z = b . d.

A corner trails its true place by the lag along its flow.  The odometry's yaw rate has a bias, for
all tracks of a group the same.  The anchor's own error shifts all observations of a track alike:
this mean is taken off, and the inverse distance solved for, track by track (variable projection,
Golub and Pereyra 1973).  What is left depends on rotation, offset, lag, position of the camera and
yaw-rate bias.
"""

import math
from typing import NamedTuple

import numpy as np

from evcalib.kernels.jit import jit
from evcalib.kernels.joint.observation_model import (
    BY_POSITION,
    BY_YAW_RATE,
    COLUMNS,
    FLOW,
    NEAREST,
    VALUE,
    Camera,
    observe,
    state,
    step_of,
)
from evcalib.kernels.linalg import dot, tangent_basis

UNKNOWNS = 8
"""Rotation vector in the body frame [rad] (3), offset [s], lag [rad], position of the camera along
the body's X and Y [m] (2), yaw-rate bias [rad/s]."""

LAG, POSITION, YAW_RATE = 4, 5, 7

COLUMN = (1, 2, 3, 4, VALUE, BY_POSITION, BY_POSITION + 1, BY_YAW_RATE)
"""Column of `observe` that each unknown goes with; the lag, which needs none, has its own rule."""

STEPS, FORGIVING, AGAIN = 8, 2, 3
"""Steps of a track's own fit, of which the first ones forgive outliers; and steps from an earlier
fit, with its weights.  Choices between time and exactness: twelve passes come within 1e-5 of the
distance of an exact solver, or 1 % with outliers (tests/test_joint.py, against the slow twin)."""


class Observations(NamedTuple):
    """Tracks of corners: rows first[k] to first[k + 1] are observations of one."""

    first: np.ndarray  # (tracks + 1,) int64
    group: np.ndarray  # (tracks,) int64, number of the yaw-rate bias of each
    r1: np.ndarray  # (n, 3) bearings of the anchors, the same for all of a track
    r2: np.ndarray  # (n, 3) bearings later
    t1: np.ndarray  # (n,) times of the anchors [s]
    t2: np.ndarray  # (n,) later times [s]


class Unknowns(NamedTuple):
    """What is wanted besides the rotation."""

    offset: float  # [s]
    lag: float  # [rad]
    lever: tuple[float, float, float]  # position of the camera in the body frame [m]
    yaw_rate_bias: np.ndarray  # (groups,) [rad/s]


class Options(NamedTuple):
    """What stays the same in a pass."""

    loss_scale: float  # residual [rad] from which on an observation counts nothing
    slowest: float  # slowest flow with a direction [rad/s]
    stabilised: bool  # whether later bearings are those of a camera that has not turned since


class Linearisation(NamedTuple):
    """What a pass fills in; a track's fit starts from its distance and weights if that is > 0.

    Weights and gradients of what cannot be linearised are zero; its loss is that of outliers.
    """

    residuals: np.ndarray  # (n, 2) [rad]
    weights: np.ndarray  # (n,)
    distances: np.ndarray  # (tracks,) inverse [1/m]
    gradients: np.ndarray  # (tracks, 8) of the losses by the unknowns
    losses: np.ndarray  # (tracks,) [rad^2]


class _Track(NamedTuple):
    """Room for one track of up to m observations, the anchor the first of them."""

    known: np.ndarray  # (m,) 1.0 where there is an observation
    a: np.ndarray  # (m, 9, 2) displacement across the anchor's bearing, see `observe`
    z: np.ndarray  # (m, 9) displacement along it
    y: np.ndarray  # (m, 2) observation
    dy: np.ndarray  # (m, 8, 2) its derivatives
    w: np.ndarray  # (m,) weights
    e: np.ndarray  # (m, 2) residuals
    g: np.ndarray  # (m, 2) their slopes by the inverse distance, less the mean
    flow: np.ndarray  # (m, 2) unit direction of the flow
    J: np.ndarray  # (m, 8, 2) derivatives by the unknowns


@jit
def _start(m, a, z, y, w):
    """Return the inverse distance by linear least squares: y = rho (y z - a)."""
    top, bottom = 0.0, 0.0
    for i in range(1, m):
        for c in range(2):
            g = y[i, c] * z[i, VALUE] - a[i, VALUE, c]
            top += w[i] * g * y[i, c]
            bottom += w[i] * g * g
    return top / bottom if bottom > 1e-18 else 0.0


@jit
def _flow(rho, s, a, z, slowest, out):
    """Fill in the unit direction of a corner's flow; zero where it is below `slowest` [rad/s]."""
    length = 0.0
    for c in range(2):
        out[c] = -rho * a[FLOW, c] / s - rho * rho * a[VALUE, c] * z[FLOW] / (s * s)
        length += out[c] * out[c]
    length = math.sqrt(length)
    for c in range(2):
        out[c] = out[c] / length if length > slowest else 0.0


@jit
def _fit(m, rho, steps, lag, options, track):
    """Fit a track's inverse distance and mean; return rho, weight and information (0: no fit)."""
    known, a, z, y, w, e, g = track.known, track.a, track.z, track.y, track.w, track.e, track.g
    flow, slowest, loss_scale = track.flow, options.slowest, options.loss_scale
    weight, information = 0.0, 0.0
    for step in range(STEPS - steps, STEPS):
        weight = 0.0
        mean_e, mean_g = np.zeros(2), np.zeros(2)
        for i in range(m):
            s = max(1.0 - rho * z[i, VALUE], NEAREST)
            _flow(rho, s, a[i], z[i], slowest, flow[i])
            weight += w[i]
            for c in range(2):
                e[i, c] = y[i, c] + rho * a[i, VALUE, c] / s + lag * flow[i, c]
                g[i, c] = -a[i, VALUE, c] / (s * s)
                mean_e[c] += w[i] * e[i, c]
                mean_g[c] += w[i] * g[i, c]
        if weight < 1e-9:
            return rho, 0.0, 0.0
        slope, information = 0.0, 0.0
        for i in range(m):
            for c in range(2):
                e[i, c] -= mean_e[c] / weight
                g[i, c] -= mean_g[c] / weight
                slope += w[i] * g[i, c] * e[i, c]
                information += w[i] * g[i, c] * g[i, c]
        if not information > 1e-18:
            return rho, 0.0, 0.0
        if step == STEPS - 1:
            break
        rho += slope / information
        if rho <= 0.0:
            return rho, 0.0, 0.0
        for i in range(m):
            u = (e[i, 0] ** 2 + e[i, 1] ** 2) / (loss_scale * loss_scale)
            if step < FORGIVING:
                w[i] = known[i] / (1.0 + 9.0 * u)
            else:
                w[i] = known[i] * (1.0 - u) ** 2 if u < 1.0 else 0.0
    return rho, weight, information


@jit
def _derivatives(m, rho, weight, information, track):
    """Fill in the residuals' derivatives, less their share in mean and distance."""
    a, z, dy, w, g, flow, J = track.a, track.z, track.dy, track.w, track.g, track.flow, track.J
    for k in range(UNKNOWNS):
        column = COLUMN[k]
        mean = np.zeros(2)
        for i in range(m):
            s = max(1.0 - rho * z[i, VALUE], NEAREST)
            for c in range(2):
                if k == LAG:
                    J[i, k, c] = flow[i, c]
                else:
                    J[i, k, c] = (
                        dy[i, column, c]
                        + rho * a[i, column, c] / s
                        + rho * rho * a[i, VALUE, c] * z[i, column] / (s * s)
                    )
                mean[c] += w[i] * J[i, k, c] / weight
        share = 0.0
        for i in range(m):
            for c in range(2):
                J[i, k, c] -= mean[c]
                share += w[i] * J[i, k, c] * g[i, c] / information
        for i in range(m):
            for c in range(2):
                J[i, k, c] -= share * g[i, c]


@jit
def linearise(tracks, R, unknowns, motion, options, out):
    """Fill in `out`, a `Linearisation` of all tracks at R = R_body_cam and the other unknowns.

    Returns the information of the unknowns in each group, (groups, 8, 8).
    """
    first, group = tracks.first, tracks.group
    r1, r2, t1, t2 = tracks.r1, tracks.r2, tracks.t1, tracks.t2
    offset, bias = unknowns.offset, unknowns.yaw_rate_bias
    t, segment, loss_scale = motion.t, motion.segment, options.loss_scale
    residuals, weights, distances = out.residuals, out.weights, out.distances
    gradients, losses = out.gradients, out.losses
    most = 1
    for k in range(first.size - 1):
        most = max(most, first[k + 1] - first[k] + 1)
    a, z, y = np.zeros((most, COLUMNS, 2)), np.zeros((most, COLUMNS)), np.zeros((most, 2))
    dy, J = np.zeros((most, FLOW, 2)), np.zeros((most, UNKNOWNS, 2))
    known, w = np.zeros(most), np.zeros(most)
    e, g, flow = np.zeros((most, 2)), np.zeros((most, 2)), np.zeros((most, 2))
    track = _Track(known, a, z, y, dy, w, e, g, flow, J)
    total = np.zeros((bias.size, UNKNOWNS, UNKNOWNS))
    start, end = 0, 0
    for k in range(first.size - 1):
        low, m = first[k], first[k + 1] - first[k] + 1
        again = distances[k] > 0.0
        for i in range(1, m):
            w[i] = weights[low + i - 1] if again else 1.0
            weights[low + i - 1] = 0.0
        gradients[k] = 0.0
        losses[k] = (m - 1) * loss_scale * loss_scale / 6.0
        anchored = t1[low] + offset
        start = step_of(anchored, start, t)
        if anchored < t[0] or anchored > t[-1] or segment[start] != segment[start + 1]:
            continue
        before = state(anchored, start, motion)
        b = r1[low]
        camera = Camera(R, unknowns.lever, b, tangent_basis(b), options.stabilised)
        own = (dot(R[0], b), dot(R[1], b), dot(R[2], b))
        observe(before, before, 0.0, 0.0, own, camera, a[0], z[0], y[0], dy[0])
        known[0] = w[0] = 1.0
        seen = 0
        for i in range(1, m):
            a[i], z[i], y[i], dy[i] = 0.0, 0.0, 0.0, 0.0
            known[i] = 0.0
            r, at = r2[low + i - 1], t2[low + i - 1] + offset
            end = step_of(at, end, t)
            if at < t[0] or at > t[-1] or segment[start] != segment[end + 1]:
                w[i] = 0.0
                continue
            ray = (dot(R[0], r), dot(R[1], r), dot(R[2], r))
            after = state(at, end, motion)
            span = t2[low + i - 1] - t1[low]
            if observe(before, after, span, bias[group[k]], ray, camera, a[i], z[i], y[i], dy[i]):
                known[i] = 1.0
                seen += 1
            w[i] *= known[i]
        if seen < 2:
            continue
        rho = distances[k] if again else _start(m, a, z, y, w)
        distances[k] = 0.0
        if rho <= 0.0:
            continue
        steps = AGAIN if again else STEPS
        rho, weight, information = _fit(m, rho, steps, unknowns.lag, options, track)
        if weight == 0.0:
            continue
        distances[k] = rho
        _derivatives(m, rho, weight, information, track)
        losses[k] = 0.0
        for i in range(m):
            u = min((e[i, 0] ** 2 + e[i, 1] ** 2) / (loss_scale * loss_scale), 1.0)
            losses[k] += known[i] * loss_scale * loss_scale / 6.0 * (1.0 - (1.0 - u) ** 3)
            if i > 0:
                weights[low + i - 1] = w[i]
                residuals[low + i - 1] = e[i]
            for c in range(UNKNOWNS):
                gradients[k, c] += w[i] * (J[i, c, 0] * e[i, 0] + J[i, c, 1] * e[i, 1])
                for d in range(UNKNOWNS):
                    total[group[k], c, d] += w[i] * (
                        J[i, c, 0] * J[i, d, 0] + J[i, c, 1] * J[i, d, 1]
                    )
    return total

"""Corners seen again and again, against the motion of the body: residuals, gradients, information.

A track is a corner at time t1 (its anchor, bearing b) and the same corner at later times t2.  With
the camera's displacement d from t1 to t2, in the camera frame of t1, and the corner's inverse
distance rho, it is seen along b - rho d: on the plane that touches the sphere at b, at

    y = -rho a / (1 - rho z),   a = e . d (two axes e across b),   z = b . d.

A corner trails its true place by the lag along its flow.  What the body turns by beyond the
odometry is a linear spline over time, the same for all tracks: roll, pitch and yaw at knots.  Roll
and pitch follow the acceleration besides.  The anchor's own error shifts all observations of a
track alike: this mean is taken off, and the inverse distance solved for, track by track (variable
projection, Golub and Pereyra 1973).  What is left depends on the globals and on the knots.
"""

import math
from typing import NamedTuple

import numpy as np

from evcalib.kernels.jit import jit
from evcalib.kernels.joint.observation_model import (
    COLUMNS,
    FIRST,
    FLOW,
    LATER,
    NEAREST,
    OFFSET,
    POSITION,
    ROTATION,
    VALUE,
    Camera,
    observe,
    state,
    step_of,
)
from evcalib.kernels.linalg import dot, tangent_basis

UNKNOWNS = 9
"""Rotation vector in the body frame [rad] (3), offset [s], lag [rad], position of the camera in the
body [m] (2), roll and pitch by acceleration to the left and ahead [rad per m/s^2]."""

TIME, LAG, PLACE, TILT = 3, 4, 5, 7

ENTRIES = UNKNOWNS + 12
"""What one observation depends on: the globals, two knots at its anchor and two at its own time."""

STEPS, FORGIVING, AGAIN = 8, 2, 3
"""Steps of a track's own fit, of which the first ones forgive outliers; and steps from an earlier
fit, with its weights.  Choices between time and exactness: twelve passes come within 1e-5 of the
distance of an exact solver, or 1 % with outliers (tests/test_joint.py, against the slow twin)."""


class Observations(NamedTuple):
    """Tracks of corners: rows first[k] to first[k + 1] are observations of one."""

    first: np.ndarray  # (tracks + 1,) int64
    r1: np.ndarray  # (n, 3) bearings of the anchors, the same for all of a track
    r2: np.ndarray  # (n, 3) bearings later
    t1: np.ndarray  # (n,) times of the anchors [s]
    t2: np.ndarray  # (n,) later times [s]


class Unknowns(NamedTuple):
    """What is wanted besides the rotation."""

    offset: float  # [s]
    lag: float  # [rad]
    lever: tuple[float, float, float]  # position of the camera in the body frame [m]
    tilt: tuple[float, float]  # roll and pitch by acceleration [rad per m/s^2]
    knots: np.ndarray  # (knots, 3) roll, pitch and yaw beyond the odometry [rad]


class Options(NamedTuple):
    """What stays the same in a pass."""

    loss_scale: float  # residual [rad] from which on an observation counts nothing
    slowest: float  # slowest flow with a direction [rad/s]
    stabilised: bool  # whether bearings are those of a camera that does not turn
    start: float  # time of the first knot [s], camera clock
    spacing: float  # of the knots [s]
    everything: bool  # derivatives by all unknowns, or by the rotation alone


class Linearisation(NamedTuple):
    """What a pass fills in; a track's fit starts from its distance and weights if that is > 0.

    Weights and gradients of what cannot be linearised are zero; its loss is that of outliers.  A
    track belongs to the knot at or before its anchor; `reach` counts the numbers at the knots from
    there on that the tracks touch.
    """

    residuals: np.ndarray  # (n, 2) [rad]
    weights: np.ndarray  # (n,)
    distances: np.ndarray  # (tracks,) inverse [1/m]
    losses: np.ndarray  # (tracks,) [rad^2]
    gradients: np.ndarray  # (knots, 9) of the losses of a knot's tracks by the globals
    slopes: np.ndarray  # (knots, reach) by the numbers at the knots
    information: np.ndarray  # (knots, 9, 9) of the globals
    across: np.ndarray  # (knots, 9, reach) of globals and knots
    band: np.ndarray  # (3 * knots, reach) of the knots: row k, column c hold element (k, k + c)


class _Track(NamedTuple):
    """Room for one track of up to m observations, the anchor the first of them."""

    known: np.ndarray  # (m,) 1.0 where there is an observation
    a: np.ndarray  # (m, 13, 2) displacement across the anchor's bearing, see `observe`
    z: np.ndarray  # (m, 13) displacement along it
    y: np.ndarray  # (m, 2) observation
    dy: np.ndarray  # (m, 13, 2) its derivatives
    w: np.ndarray  # (m,) weights
    e: np.ndarray  # (m, 2) residuals
    g: np.ndarray  # (m, 2) their slopes by the inverse distance, less the mean
    flow: np.ndarray  # (m, 2) unit direction of the flow
    pull: np.ndarray  # (m, 2, 2) acceleration that tilts, and its change with time
    knot: np.ndarray  # (m,) int64, knot at or before an observation, counted from the anchor's
    part: np.ndarray  # (m,) how far it is on the way to the next
    J: np.ndarray  # (21, 2) derivatives of one observation, and
    column: np.ndarray  # (21,) int64, of what
    total: np.ndarray  # (9 + reach, 9 + reach) information of the track
    shared: np.ndarray  # (9 + reach, 4) part of mean and distance in it, and the gradient


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
def _flow(rho, s, a, z, dy, slowest, out):
    """Fill in the unit direction of a corner's flow; zero where it is below `slowest` [rad/s]."""
    length = 0.0
    for c in range(2):
        out[c] = -rho * a[FLOW, c] / s - rho * rho * a[VALUE, c] * z[FLOW] / (s * s) + dy[FLOW, c]
        length += out[c] * out[c]
    length = math.sqrt(length)
    for c in range(2):
        out[c] = out[c] / length if length > slowest else 0.0


@jit
def _fit(m, rho, steps, lag, options, track):
    """Fit a track's inverse distance and mean; return rho, weight and information (0: no fit)."""
    known, a, z, y, w, e, g = track.known, track.a, track.z, track.y, track.w, track.e, track.g
    dy, flow, slowest, loss_scale = track.dy, track.flow, options.slowest, options.loss_scale
    weight, information = 0.0, 0.0
    for step in range(STEPS - steps, STEPS):
        weight = 0.0
        mean_e, mean_g = np.zeros(2), np.zeros(2)
        for i in range(m):
            s = max(1.0 - rho * z[i, VALUE], NEAREST)
            _flow(rho, s, a[i], z[i], dy[i], slowest, flow[i])
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
def _slope(i, k, c, rho, track):
    """Return the derivative of an observation's residual by a column of `observe`."""
    a, z = track.a[i], track.z[i]
    s = max(1.0 - rho * z[VALUE], NEAREST)
    return track.dy[i, k, c] + rho * (a[k, c] / s + rho * a[VALUE, c] * z[k] / (s * s))


@jit
def _derivatives(i, rho, part, track):
    """Fill in the derivatives of observation i by all it depends on, the anchor's place given."""
    J, column, pull, flow = track.J, track.column, track.pull, track.flow
    later = track.part[i]
    for c in range(2):
        for k in range(3):
            J[k, c] = _slope(i, ROTATION + k, c, rho, track)
        J[LAG, c] = flow[i, c]
        J[TIME, c] = _slope(i, OFFSET, c, rho, track)
        for k in range(2):
            J[PLACE + k, c] = _slope(i, POSITION + k, c, rho, track)
        for k in range(3):
            now = _slope(i, LATER + k, c, rho, track)
            then = _slope(i, FIRST + k, c, rho, track) if k < 2 else -now
            row = UNKNOWNS + k
            J[row, c], J[row + 3, c] = (1.0 - part) * then, part * then
            J[row + 6, c], J[row + 9, c] = (1.0 - later) * now, later * now
            if k < 2:
                J[TILT + k, c] = now * pull[i, 0, k] + then * pull[0, 0, k]
    for k in range(6):
        column[UNKNOWNS + 6 + k] = UNKNOWNS + 3 * track.knot[i] + k


@jit
def _tilting(i, rho, tilt, track):
    """Add to the derivative by the offset what the tilt changes with time."""
    for c in range(2):
        for k in range(2):
            now = _slope(i, LATER + k, c, rho, track)
            then = _slope(i, FIRST + k, c, rho, track)
            track.J[TIME, c] += tilt[k] * (now * track.pull[i, 1, k] + then * track.pull[0, 1, k])


@jit
def _gather(m, rho, information, part, tilt, everything, track):
    """Sum up gradients and information of a track; return how many of the columns it fills."""
    J, column, w, e, g = track.J, track.column, track.w, track.e, track.g
    total, shared = track.total, track.shared
    entries, size = 3, 3
    if everything:
        entries, size = ENTRIES, UNKNOWNS + 3 * (track.knot[:m].max() + 2)
    total[:size, :size] = 0.0
    shared[:size] = 0.0
    slope = 0.0
    for i in range(m):
        if w[i] == 0.0:
            continue
        if everything:
            _derivatives(i, rho, part, track)
            if tilt[0] != 0.0 or tilt[1] != 0.0:
                _tilting(i, rho, tilt, track)
        else:
            for k in range(3):
                for c in range(2):
                    J[k, c] = _slope(i, ROTATION + k, c, rho, track)
        slope += w[i] * (g[i, 0] * e[i, 0] + g[i, 1] * e[i, 1])
        for p in range(entries):
            row, j0, j1 = column[p], w[i] * J[p, 0], w[i] * J[p, 1]
            shared[row, 0] += j0
            shared[row, 1] += j1
            shared[row, 2] += j0 * g[i, 0] + j1 * g[i, 1]
            shared[row, 3] += j0 * e[i, 0] + j1 * e[i, 1]
            for q in range(entries):
                if column[q] >= row:
                    total[row, column[q]] += j0 * J[q, 0] + j1 * J[q, 1]
    for row in range(size):
        shared[row, 3] -= shared[row, 2] * slope / information
    return size


@jit
def _add(size, knot, weight, information, track, out):
    """Add a track's sums, less what mean and distance take, to those of its knot."""
    total, shared = track.total, track.shared
    for row in range(size):
        s0, s1 = shared[row, 0] / weight, shared[row, 1] / weight
        s2, gradient = shared[row, 2] / information, shared[row, 3]
        if row < UNKNOWNS:
            out.gradients[knot, row] += gradient
        else:
            out.slopes[knot, row - UNKNOWNS] += gradient
        for k in range(row, size):
            value = total[row, k] - s0 * shared[k, 0] - s1 * shared[k, 1] - s2 * shared[k, 2]
            if k < UNKNOWNS:
                out.information[knot, row, k] += value
                if k > row:
                    out.information[knot, k, row] += value
            elif row < UNKNOWNS:
                out.across[knot, row, k - UNKNOWNS] += value
            else:
                out.band[3 * knot + row - UNKNOWNS, k - row] += value


@jit
def _turning(at, knots, start, spacing, pull, tilt):
    """Return roll, pitch and yaw beyond the odometry at a camera time, the knot and the way on."""
    k = min(max(int((at - start) / spacing), 0), knots.shape[0] - 2)
    u = min(max((at - start) / spacing - k, 0.0), 1.0)
    turned = (
        (1.0 - u) * knots[k, 0] + u * knots[k + 1, 0] + tilt[0] * pull[0],
        (1.0 - u) * knots[k, 1] + u * knots[k + 1, 1] + tilt[1] * pull[1],
        (1.0 - u) * knots[k, 2] + u * knots[k + 1, 2],
    )
    return turned, k, u


@jit
def _room(most, reach):
    """Return room for a track."""
    column = np.arange(ENTRIES)
    return _Track(
        np.zeros(most),
        np.zeros((most, COLUMNS, 2)),
        np.zeros((most, COLUMNS)),
        np.zeros((most, 2)),
        np.zeros((most, COLUMNS, 2)),
        np.zeros(most),
        np.zeros((most, 2)),
        np.zeros((most, 2)),
        np.zeros((most, 2)),
        np.zeros((most, 2, 2)),
        np.zeros(most, np.int64),
        np.zeros(most),
        np.zeros((ENTRIES, 2)),
        column,
        np.zeros((UNKNOWNS + reach, UNKNOWNS + reach)),
        np.zeros((UNKNOWNS + reach, 4)),
    )


@jit
def linearise(tracks, R, unknowns, motion, options, out):
    """Fill in `out`, a `Linearisation` of all tracks at R = R_body_cam and the other unknowns."""
    first, r1, r2, t1, t2 = tracks.first, tracks.r1, tracks.r2, tracks.t1, tracks.t2
    offset, lever, tilt, knots = unknowns.offset, unknowns.lever, unknowns.tilt, unknowns.knots
    t, segment, loss_scale = motion.t, motion.segment, options.loss_scale
    origin, spacing = options.start, options.spacing
    columns = COLUMNS if options.everything else OFFSET
    residuals, weights, distances, losses = out.residuals, out.weights, out.distances, out.losses
    most = 1
    for k in range(first.size - 1):
        most = max(most, first[k + 1] - first[k] + 1)
    track = _room(most, out.slopes.shape[1])
    known, a, z, y, dy = track.known, track.a, track.z, track.y, track.dy
    w, e, pull = track.w, track.e, track.pull
    start, end = 0, 0
    for k in range(first.size - 1):
        low, m = first[k], first[k + 1] - first[k] + 1
        again = distances[k] > 0.0
        for i in range(1, m):
            w[i] = weights[low + i - 1] if again else 1.0
            weights[low + i - 1] = 0.0
        losses[k] = (m - 1) * loss_scale * loss_scale / 6.0
        anchored = t1[low] + offset
        start = step_of(anchored, start, t)
        if anchored < t[0] or anchored > t[-1] or segment[start] != segment[start + 1]:
            continue
        before = state(anchored, start, motion)
        then, knot, part = _turning(t1[low], knots, origin, spacing, before.pull, tilt)
        b = r1[low]
        camera = Camera(R, lever, options.stabilised, b, tangent_basis(b))
        own = (dot(R[0], b), dot(R[1], b), dot(R[2], b))
        # Seen again at once, a corner depends on nothing but flows as it does.
        observe(before, before, then, then, own, camera, OFFSET, a[0], z[0], y[0], dy[0])
        a[0, OFFSET:], z[0, OFFSET:], dy[0, OFFSET:] = 0.0, 0.0, 0.0
        known[0] = w[0] = 1.0
        track.knot[0], track.part[0] = 0, part
        for c in range(2):
            pull[0, 0, c], pull[0, 1, c] = before.pull[c], before.jerk[c]
        for c in range(6):
            track.column[UNKNOWNS + c] = UNKNOWNS + c
        seen = 0
        for i in range(1, m):
            known[i] = 0.0
            r, at = r2[low + i - 1], t2[low + i - 1] + offset
            end = step_of(at, end, t)
            usable = t[0] <= at <= t[-1] and segment[start] == segment[end + 1]
            if usable:
                ray = (dot(R[0], r), dot(R[1], r), dot(R[2], r))
                after = state(at, end, motion)
                now, place, way = _turning(
                    t2[low + i - 1], knots, origin, spacing, after.pull, tilt
                )
                track.knot[i], track.part[i] = place - knot, way
                for c in range(2):
                    pull[i, 0, c], pull[i, 1, c] = after.pull[c], after.jerk[c]
                usable = observe(
                    before, after, then, now, ray, camera, columns, a[i], z[i], y[i], dy[i]
                )
            if usable:
                known[i] = 1.0
                seen += 1
            else:
                a[i], z[i], y[i], dy[i] = 0.0, 0.0, 0.0, 0.0
                track.knot[i] = 0
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
        losses[k] = 0.0
        for i in range(m):
            u = min((e[i, 0] ** 2 + e[i, 1] ** 2) / (loss_scale * loss_scale), 1.0)
            losses[k] += known[i] * loss_scale * loss_scale / 6.0 * (1.0 - (1.0 - u) ** 3)
            if i > 0:
                weights[low + i - 1] = w[i]
                residuals[low + i - 1] = e[i]
        size = _gather(m, rho, information, part, tilt, options.everything, track)
        _add(size, knot, weight, information, track, out)

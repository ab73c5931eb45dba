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

THEIRS, ENTRIES = UNKNOWNS + 3, UNKNOWNS + 6
"""What one observation depends on: the globals, the turning at its anchor, that at its own time."""

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
    information: np.ndarray  # (knots, 9, 9) of the globals, above the diagonal
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
    J: np.ndarray  # (15, 2) derivatives of one observation by all it depends on
    own: np.ndarray  # (12, 16) information of globals and anchor, and of them what `shared` holds
    mixed: np.ndarray  # (reach, 12) information of the knots at later times with these
    total: np.ndarray  # (9 + reach, 9 + reach) information of the track
    shared: np.ndarray  # (4, 9 + reach) part of mean (2) and distance in it, and the gradient


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
        e0, e1, g0, g1 = 0.0, 0.0, 0.0, 0.0
        for i in range(m):
            s = max(1.0 - rho * z[i, VALUE], NEAREST)
            _flow(rho, s, a[i], z[i], dy[i], slowest, flow[i])
            weight += w[i]
            for c in range(2):
                e[i, c] = y[i, c] + rho * a[i, VALUE, c] / s + lag * flow[i, c]
                g[i, c] = -a[i, VALUE, c] / (s * s)
            e0, e1 = e0 + w[i] * e[i, 0], e1 + w[i] * e[i, 1]
            g0, g1 = g0 + w[i] * g[i, 0], g1 + w[i] * g[i, 1]
        if weight < 1e-9:
            return rho, 0.0, 0.0
        e0, e1, g0, g1 = e0 / weight, e1 / weight, g0 / weight, g1 / weight
        slope, information = 0.0, 0.0
        for i in range(m):
            e[i, 0], e[i, 1] = e[i, 0] - e0, e[i, 1] - e1
            g[i, 0], g[i, 1] = g[i, 0] - g0, g[i, 1] - g1
            slope += w[i] * (g[i, 0] * e[i, 0] + g[i, 1] * e[i, 1])
            information += w[i] * (g[i, 0] * g[i, 0] + g[i, 1] * g[i, 1])
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
def _derivatives(i, rho, columns, tilt, track):
    """Fill in the derivatives of observation i: by the globals, the anchor's turning and its own.

    Without the columns after the rotation, only those by the rotation.
    """
    a, z, dy, pull, J = track.a[i], track.z[i], track.dy[i], track.pull, track.J
    s = max(1.0 - rho * z[VALUE], NEAREST)
    for c in range(2):
        near, bent = rho / s, rho * rho * a[VALUE, c] / (s * s)
        for k in range(3):
            p = ROTATION + k
            J[k, c] = dy[p, c] + near * a[p, c] + bent * z[p]
        if columns <= OFFSET:
            continue
        J[LAG, c] = track.flow[i, c]
        J[TIME, c] = dy[OFFSET, c] + near * a[OFFSET, c] + bent * z[OFFSET]
        for k in range(2):
            J[PLACE + k, c] = near * a[POSITION + k, c] + bent * z[POSITION + k]
        for k in range(3):
            p = LATER + k
            J[THEIRS + k, c] = dy[p, c] + near * a[p, c] + bent * z[p]
        for k in range(2):
            p = FIRST + k
            J[UNKNOWNS + k, c] = dy[p, c] + near * a[p, c] + bent * z[p]
            now, then = J[THEIRS + k, c], J[UNKNOWNS + k, c]
            J[TILT + k, c] = now * pull[i, 0, k] + then * pull[0, 0, k]
            # A tilt that changes is another one at another offset.
            J[TIME, c] += tilt[k] * (now * pull[i, 1, k] + then * pull[0, 1, k])
        J[UNKNOWNS + 2, c] = -J[THEIRS + 2, c]


@jit
def _gather(m, rho, information, part, tilt, columns, track):
    """Sum up gradients and information of a track; return how many of the columns it fills."""
    J, w, e, g, knot = track.J, track.w, track.e, track.g, track.knot
    total, shared, own, mixed = track.total, track.shared, track.own, track.mixed
    entries, size = 3, 3
    if columns > OFFSET:
        entries, size = THEIRS, UNKNOWNS + 3 * (knot[:m].max() + 2)
    total[:size, :size], shared[:, :size] = 0.0, 0.0
    own[:entries], mixed[: size - UNKNOWNS] = 0.0, 0.0
    slope = 0.0
    for i in range(m):
        if w[i] == 0.0:
            continue
        _derivatives(i, rho, columns, tilt, track)
        slope += w[i] * (g[i, 0] * e[i, 0] + g[i, 1] * e[i, 1])
        for p in range(entries):
            j0, j1 = w[i] * J[p, 0], w[i] * J[p, 1]
            for q in range(p, entries):
                own[p, q] += j0 * J[q, 0] + j1 * J[q, 1]
            own[p, THEIRS] += j0
            own[p, THEIRS + 1] += j1
            own[p, THEIRS + 2] += j0 * g[i, 0] + j1 * g[i, 1]
            own[p, THEIRS + 3] += j0 * e[i, 0] + j1 * e[i, 1]
        if entries == 3:
            continue
        u, row = track.part[i], 3 * knot[i]
        for k in range(3):
            j0, j1 = w[i] * J[THEIRS + k, 0], w[i] * J[THEIRS + k, 1]
            for q in range(THEIRS):
                value = j0 * J[q, 0] + j1 * J[q, 1]
                mixed[row + k, q] += (1.0 - u) * value
                mixed[row + k + 3, q] += u * value
            sums = j0, j1, j0 * g[i, 0] + j1 * g[i, 1], j0 * e[i, 0] + j1 * e[i, 1]
            for q in range(4):
                shared[q, UNKNOWNS + row + k] += (1.0 - u) * sums[q]
                shared[q, UNKNOWNS + row + k + 3] += u * sums[q]
            for q in range(3):
                value = j0 * J[THEIRS + q, 0] + j1 * J[THEIRS + q, 1]
                _pair(total, UNKNOWNS + row + k, UNKNOWNS + row + q, u, u, value)
    for p in range(min(entries, UNKNOWNS)):
        shared[:, p] = own[p, THEIRS:]
        total[p, p:entries] = own[p, p:entries]
    if entries > 3:
        _spread(size, part, track)
    for row in range(size):
        shared[3, row] -= shared[2, row] * slope / information
    return size


@jit
def _pair(total, row, column, u, v, value):
    """Add a product of two splines, each between a number and that three on, above the diagonal."""
    if row <= column:
        total[row, column] += (1.0 - u) * (1.0 - v) * value
        total[row + 3, column + 3] += u * v * value
    total[row, column + 3] += (1.0 - u) * v * value


@jit
def _spread(size, part, track):
    """Bring to the knots what hangs on the turning at the anchor."""
    total, shared, own, mixed = track.total, track.shared, track.own, track.mixed
    for p in range(UNKNOWNS):
        total[p, UNKNOWNS:size] = mixed[: size - UNKNOWNS, p]
    for k in range(3):
        row, base = UNKNOWNS + k, UNKNOWNS + k
        for p in range(UNKNOWNS):
            total[p, row] += (1.0 - part) * own[p, base]
            total[p, row + 3] += part * own[p, base]
        for q in range(4):
            shared[q, row] += (1.0 - part) * own[base, THEIRS + q]
            shared[q, row + 3] += part * own[base, THEIRS + q]
        for q in range(3):
            value = own[min(base, UNKNOWNS + q), max(base, UNKNOWNS + q)]
            _pair(total, row, UNKNOWNS + q, part, part, value)
        for other in range(UNKNOWNS, size):
            value = mixed[other - UNKNOWNS, base]
            for low, share in ((row, 1.0 - part), (row + 3, part)):
                twice = 2.0 if low == other else 1.0
                total[min(low, other), max(low, other)] += twice * share * value


@jit
def _add(size, knot, weight, information, track, out):
    """Add a track's sums, less what mean and distance take, to those of its knot."""
    total, shared, edge = track.total, track.shared, min(size, UNKNOWNS)
    whole, across = out.information[knot], out.across[knot]
    for row in range(size):
        s0, s1 = shared[0, row] / weight, shared[1, row] / weight
        s2 = shared[2, row] / information
        if row >= edge and s0 == 0.0 and s1 == 0.0 and s2 == 0.0:
            # No observation at this knot.
            continue
        for k in range(row, size):
            total[row, k] -= s0 * shared[0, k] + s1 * shared[1, k] + s2 * shared[2, k]
        if row < edge:
            out.gradients[knot, row] += shared[3, row]
            for k in range(row, edge):
                whole[row, k] += total[row, k]
            for k in range(edge, size):
                across[row, k - edge] += total[row, k]
        else:
            out.slopes[knot, row - edge] += shared[3, row]
            band = out.band[3 * knot + row - edge]
            for k in range(row, size):
                band[k - row] += total[row, k]


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
        np.zeros((THEIRS, THEIRS + 4)),
        np.zeros((reach, THEIRS)),
        np.zeros((UNKNOWNS + reach, UNKNOWNS + reach)),
        np.zeros((4, UNKNOWNS + reach)),
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
        size = _gather(m, rho, information, part, tilt, columns, track)
        _add(size, knot, weight, information, track, out)

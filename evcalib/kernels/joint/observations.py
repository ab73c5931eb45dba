"""Corners seen again and again, against the motion of the body: residuals, scores, information.

A track is a corner at time t1 (its anchor, bearing b) and the same corner at later times t2.  With
the camera's displacement d from t1 to t2, in the camera frame of t1, and the corner's inverse
distance rho, it is seen along b - rho d: on the plane that touches the sphere at b, at

    y = -rho a / (1 - rho z),   a = e . d (two axes e across b),   z = b . d.

A corner trails its true place by the lag along its flow.  The odometry's yaw rate is wrong by a
spin, for all tracks of a group the same.  The anchor's own error shifts all
sightings of a track alike: this mean is taken off, and the inverse distance solved for, track by
track (variable projection, Golub and Pereyra 1973).  What is left depends on rotation, offset,
lag and spin.
"""

import math

import numpy as np

from evcalib.kernels.jit import jit
from evcalib.kernels.joint.observation_model import (
    BY_SPIN,
    FLOW,
    NEAREST,
    VALUE,
    sighting,
    state,
    step_of,
)
from evcalib.kernels.linalg import dot, tangent_basis

UNKNOWNS = 6
"""Rotation vector in the body frame [rad] (3), offset [s], lag [rad], spin [rad/s]."""

LAG, SPIN = 4, 5

STEPS, FORGIVING, AGAIN = 8, 2, 3
"""Steps of a track's own fit, of which the first ones forgive outliers; and steps from an earlier
fit, with its weights."""


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
def _fit(m, rho, steps, sighted, lag, reach, slowest, work):
    """Fit a track's inverse distance and mean; return rho, weight and information (0: no fit).

    sighted : (a, z, y, known), known (m,) 1.0 where there is a sighting.
    work : (w, e, g, flow), weights (m,), residuals, slopes by rho less their mean, flow, (m, 2).
    """
    a, z, y, known = sighted
    w, e, g, flow = work
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
            u = (e[i, 0] ** 2 + e[i, 1] ** 2) / (reach * reach)
            if step < FORGIVING:
                w[i] = known[i] / (1.0 + 9.0 * u)
            else:
                w[i] = known[i] * (1.0 - u) ** 2 if u < 1.0 else 0.0
    return rho, weight, information


@jit
def _derivatives(m, rho, sighted, dy, work, totals, J):
    """Fill in the residuals' derivatives J (m, 6, 2), less their share in mean and distance."""
    a, z, _, _ = sighted
    w, _, g, flow = work
    weight, information = totals
    for k in range(UNKNOWNS):
        column = BY_SPIN if k == SPIN else k + 1
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
def follow(tracks, R, unknowns, motion, options, out):
    """Follow all tracks; return the information of the unknowns in each group, (groups, 6, 6).

    tracks : (first, group, r1, r2, t1, t2); rows first[k] to first[k + 1] are sightings of one
        corner at r1[i], t1[i], the same for all of a track, seen at r2[i], t2[i].
    unknowns : (offset [s], lag [rad], spin of each group (groups,) [rad/s]).
    motion : (t, v, slope, path, yaw, segment) in the world.
    options : (reach of the loss [rad], slowest flow with a direction [rad/s], camera in the body
        frame (3) [m]).
    out : (residuals (n, 2) [rad], weights (n,), inverse distances (tracks,), scores (tracks, 6),
        losses (tracks,) [rad^2]).  Where a distance is positive, the track's fit starts from it and
        from the weights.  Weights and scores of what cannot be followed are zero; its loss is that
        of outliers.
    """
    first, group, r1, r2, t1, t2 = tracks
    t, segment = motion[0], motion[5]
    reach, slowest, lever = options
    residuals, weights, distances, scores, losses = out
    most = 1
    for k in range(first.size - 1):
        most = max(most, first[k + 1] - first[k] + 1)
    a, z, y = np.zeros((most, 7, 2)), np.zeros((most, 7)), np.zeros((most, 2))
    dy, J = np.zeros((most, 6, 2)), np.zeros((most, UNKNOWNS, 2))
    known, w = np.zeros(most), np.zeros(most)
    e, g, flow = np.zeros((most, 2)), np.zeros((most, 2)), np.zeros((most, 2))
    total = np.zeros((unknowns[2].size, UNKNOWNS, UNKNOWNS))
    start, end = 0, 0
    for k in range(first.size - 1):
        low, m = first[k], first[k + 1] - first[k] + 1
        again = distances[k] > 0.0
        for i in range(1, m):
            w[i] = weights[low + i - 1] if again else 1.0
            weights[low + i - 1] = 0.0
        scores[k] = 0.0
        losses[k] = (m - 1) * reach * reach / 6.0
        anchored = t1[low] + unknowns[0]
        start = step_of(anchored, start, t)
        if anchored < t[0] or anchored > t[-1] or segment[start] != segment[start + 1]:
            continue
        before = state(anchored, start, motion)
        b = r1[low]
        camera = (R, b, tangent_basis(b))
        own = (dot(R[0], b), dot(R[1], b), dot(R[2], b))
        sighting(before, before, (0.0, 0.0), own, camera, lever, a[0], z[0], y[0], dy[0])
        known[0] = w[0] = 1.0
        seen = 0
        for i in range(1, m):
            a[i], z[i], y[i], dy[i] = 0.0, 0.0, 0.0, 0.0
            known[i] = 0.0
            r, at = r2[low + i - 1], t2[low + i - 1] + unknowns[0]
            end = step_of(at, end, t)
            if at < t[0] or at > t[-1] or segment[start] != segment[end + 1]:
                w[i] = 0.0
                continue
            ray = (dot(R[0], r), dot(R[1], r), dot(R[2], r))
            after = state(at, end, motion)
            span = t2[low + i - 1] - t1[low], unknowns[2][group[k]]
            if sighting(before, after, span, ray, camera, lever, a[i], z[i], y[i], dy[i]):
                known[i] = 1.0
                seen += 1
            w[i] *= known[i]
        if seen < 2:
            continue
        rho = distances[k] if again else _start(m, a, z, y, w)
        distances[k] = 0.0
        if rho <= 0.0:
            continue
        sighted, work = (a, z, y, known), (w, e, g, flow)
        steps = AGAIN if again else STEPS
        rho, weight, information = _fit(m, rho, steps, sighted, unknowns[1], reach, slowest, work)
        if weight == 0.0:
            continue
        distances[k] = rho
        _derivatives(m, rho, sighted, dy, work, (weight, information), J)
        losses[k] = 0.0
        for i in range(m):
            u = min((e[i, 0] ** 2 + e[i, 1] ** 2) / (reach * reach), 1.0)
            losses[k] += known[i] * reach * reach / 6.0 * (1.0 - (1.0 - u) ** 3)
            if i > 0:
                weights[low + i - 1] = w[i]
                residuals[low + i - 1] = e[i]
            for c in range(UNKNOWNS):
                scores[k, c] += w[i] * (J[i, c, 0] * e[i, 0] + J[i, c, 1] * e[i, 1])
                for d in range(UNKNOWNS):
                    total[group[k], c, d] += w[i] * (
                        J[i, c, 0] * J[i, d, 0] + J[i, c, 1] * J[i, d, 1]
                    )
    return total

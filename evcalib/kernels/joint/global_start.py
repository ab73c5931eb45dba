"""Epipolar residuals of a camera on a body that drives and turns in the plane.

A corner is seen along r1, then along r2; in between the body moved by d (in its frame before) and
turned by psi about its Z axis.  The camera at p in the body moves by D = d + (Rz(psi) - 1) p, and
with R = R_body_cam both rays and the path lie in a plane:

    D . (R r1 x Rz(psi) R r2) = 0.

Let z = R^T e_z be the body's axis in the camera, e1 and e2 complete it to a frame, and the body's X
axis be c e1 + s e2.  Turns about z commute, so with p' = p turned by the angle of (c, s) this is
linear in (c, s, p'): for each axis z, the turn about it and the position follow in closed form.
"""

import math
from typing import NamedTuple

import numpy as np

from evcalib.kernels.jit import jit
from evcalib.kernels.linalg import cross, dot, tangent_basis

PASSES = 3
"""Times that the linear equations are weighed anew.  A choice: the best candidates are refined."""

LOOSE = 0.3
"""Share of a displacement that counts as its noise as long as there is no residual of it."""


STAYS = 1e-6
"""Paths shorter than this [m] have no direction."""


class Pairs(NamedTuple):
    """Corners seen twice."""

    r1: np.ndarray  # (n, 3) bearings
    r2: np.ndarray  # (n, 3) bearings later


class Moves(NamedTuple):
    """What the body did between the two sightings of each of n pairs, at k offsets."""

    path: np.ndarray  # (k, n, 2) in the body frame at the first [m]
    turn: np.ndarray  # (k, n) [rad]
    known: np.ndarray  # (k, n) bool, whether the odometry covers both


class Options(NamedTuple):
    """What stays the same in a scan."""

    scale: float  # residual [rad] at which Cauchy's loss bends
    lever: tuple[float, float]  # expected position of the camera in the body frame [m]
    lever_sd: float  # how far off it may be [m]
    noise: float  # of a residual, against which the expected position is weighed [rad]


@jit
def turned(z, angle, r, out):
    """Fill in r turned about the unit vector z (Rodrigues)."""
    c, s = math.cos(angle), math.sin(angle)
    along = (1.0 - c) * dot(z, r)
    a, b, d = cross(z, r)
    out[0] = c * r[0] + s * a + along * z[0]
    out[1] = c * r[1] + s * b + along * z[1]
    out[2] = c * r[2] + s * d + along * z[2]


@jit
def _distance(t, r1, r2):
    """Return squares: distance of r2 from the plane of t and r1, whole distance if it goes along.

    A point before the camera flows away from t; one that flows along is nowhere.
    """
    n = cross(r1, r2)
    across = cross(t, r1)
    length = dot(across, across)
    e = dot(n, t)
    far = dot(n, n)
    if length < 1e-18:
        return far
    off = e * e / length
    depth = dot(r2, r1) * dot(t, r1) - dot(r2, t)
    return off if depth >= 0.0 else max(far, off)


@jit
def _smallest(a, b, c):
    """Return the unit eigenvector to the smaller eigenvalue of [[a, b], [b, c]]."""
    angle = 0.5 * math.atan2(2.0 * b, a - c)
    return -math.sin(angle), math.cos(angle)


@jit
def scan(pairs, moves, axes, options, losses, found):
    """Fit turn and position for each offset and axis z.

    axes : (m, 3) unit vectors.
    losses : (k, m) filled with the mean loss of the pairs known, from 0 to 1; inf without.
    found : (k, m, 4) filled with c, s and the position p in the body frame.
    """
    r1, r2, scale = pairs.r1, pairs.r2, options.scale
    n = r1.shape[0]
    after, rows, w = np.empty((n, 3)), np.empty((n, 4)), np.empty(n)
    weight = (options.noise / options.lever_sd) ** 2
    px, py = options.lever
    for k in range(moves.turn.shape[0]):
        path, turn, known = moves.path[k], moves.turn[k], moves.known[k]
        for m in range(axes.shape[0]):
            z = axes[m]
            e = tangent_basis(z)
            for i in range(n):
                w[i] = 0.0
                if not known[i]:
                    continue
                turned(z, turn[i], r2[i], after[i])
                normal = cross(r1[i], after[i])
                n1, n2 = dot(normal, e[0]), dot(normal, e[1])
                c, s = math.cos(turn[i]) - 1.0, math.sin(turn[i])
                dx, dy = path[i, 0], path[i, 1]
                rows[i, 2], rows[i, 3] = n1 * c + n2 * s, n2 * c - n1 * s
                rows[i, 0] = n1 * dx + n2 * dy + px * rows[i, 2] + py * rows[i, 3]
                rows[i, 1] = n2 * dx - n1 * dy - py * rows[i, 2] + px * rows[i, 3]
                far = LOOSE * LOOSE * dot(normal, normal) + scale * scale
                way = dx * dx + dy * dy + 0.1 * turn[i] * turn[i] + 1e-9
                w[i] = scale * scale / (far * way)
            x, y, qx, qy = 1.0, 0.0, 0.0, 0.0
            for again in range(PASSES):
                b0 = b1 = b2 = x0 = x1 = x2 = x3 = 0.0
                c0, c1, c2 = weight, 0.0, weight
                for i in range(n):
                    if w[i] > 0.0:
                        f, g, h, j = rows[i]
                        b0 += w[i] * f * f
                        b1 += w[i] * f * g
                        b2 += w[i] * g * g
                        x0 += w[i] * f * h
                        x1 += w[i] * f * j
                        x2 += w[i] * g * h
                        x3 += w[i] * g * j
                        c0 += w[i] * h * h
                        c1 += w[i] * h * j
                        c2 += w[i] * j * j
                det = c0 * c2 - c1 * c1
                # Rows of the gain: q = -gain^T (x, y).
                g0, g1 = (x0 * c2 - x1 * c1) / det, (x1 * c0 - x0 * c1) / det
                g2, g3 = (x2 * c2 - x3 * c1) / det, (x3 * c0 - x2 * c1) / det
                x, y = _smallest(
                    b0 - g0 * x0 - g1 * x1, b1 - g0 * x2 - g1 * x3, b2 - g2 * x2 - g3 * x3
                )
                qx, qy = -(g0 * x + g2 * y), -(g1 * x + g3 * y)
                ahead, behind = 0.0, 0.0
                count = 0
                for i in range(n):
                    if not known[i]:
                        continue
                    count += 1
                    c, s = math.cos(turn[i]) - 1.0, math.sin(turn[i])
                    ax, ay = px * x - py * y + qx, px * y + py * x + qy
                    u = path[i, 0] * x - path[i, 1] * y + c * ax - s * ay
                    v = path[i, 0] * y + path[i, 1] * x + s * ax + c * ay
                    t = (
                        u * e[0, 0] + v * e[1, 0],
                        u * e[0, 1] + v * e[1, 1],
                        u * e[0, 2] + v * e[1, 2],
                    )
                    across = cross(t, r1[i])
                    length = max(dot(across, across), 1e-12)
                    f, g, h, j = rows[i]
                    off = f * x + g * y + h * qx + j * qy
                    w[i] = 1.0 / (length * (1.0 + off * off / (length * scale * scale)))
                    if again == PASSES - 1:
                        forth = _distance(t, r1[i], after[i]) / (scale * scale)
                        back = _distance((-t[0], -t[1], -t[2]), r1[i], after[i]) / (scale * scale)
                        ahead += forth / (1.0 + forth)
                        behind += back / (1.0 + back)
            sign = 1.0 if ahead <= behind else -1.0
            losses[k, m] = min(ahead, behind) / count if count > 0 else np.inf
            x, y, qx, qy = sign * x, sign * y, sign * qx, sign * qy
            found[k, m, 0], found[k, m, 1] = x, y
            # Back into the body frame.
            found[k, m, 2], found[k, m, 3] = px + x * qx + y * qy, py + x * qy - y * qx


@jit
def residuals(pairs, path, turn, R, position, out):
    """Fill in the distance [rad] of each pair from its plane, with R = R_body_cam.

    path, turn : (n, 2), (n,), see `Moves`.
    position : (2,) of the camera in the body frame [m].
    out : (n, 2) signed distance; and what is left of a pair that flows the wrong way, else 0.
    """
    first, second, after = np.empty(3), np.empty(3), np.empty(3)
    z = np.array([0.0, 0.0, 1.0])
    for i in range(turn.size):
        for k in range(3):
            first[k], second[k] = dot(R[k], pairs.r1[i]), dot(R[k], pairs.r2[i])
        turned(z, turn[i], second, after)
        c, s = math.cos(turn[i]) - 1.0, math.sin(turn[i])
        t = (
            path[i, 0] + c * position[0] - s * position[1],
            path[i, 1] + s * position[0] + c * position[1],
            0.0,
        )
        across = cross(t, first)
        length = math.sqrt(dot(across, across))
        normal = cross(first, after)
        off = dot(normal, t) / max(length, 1e-9)
        depth = dot(after, first) * dot(t, first) - dot(after, t)
        left = dot(normal, normal) - off * off
        # A camera that stays where it is sees a corner where it was.
        stays = length < STAYS
        out[i, 0] = 0.0 if stays else off
        out[i, 1] = math.sqrt(max(dot(normal, normal) if stays else left, 0.0))
        if depth >= 0.0 and not stays:
            out[i, 1] = 0.0

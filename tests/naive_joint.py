"""Slow twin of the joint refinement's kernel, and noise-free tracks of corners to feed it.

The twin fits one track with generic tools: the motion of the body by trapezoids between all
corners of the velocity, the inverse distance and the common shift of a track by SciPy's optimisers.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import trapezoid
from scipy.optimize import brentq, least_squares

from evcalib.geometry import rotation_vector_to_matrix, unit
from evcalib.joint.tracks import Tracks


def about_z(angle):
    return rotation_vector_to_matrix([0.0, 0.0, angle])


class Motion:
    """The body in the world, whose axes are the body's at the first sample.

    `tilt` gives the rotation vector by which it is turned besides at a time of the body's clock.
    """

    def __init__(self, velocities, tilt=lambda time: np.zeros(3)):
        self.tilt = tilt
        self.t = velocities.t
        rate = velocities.yaw_rate
        self.yaw = np.zeros(self.t.size)
        if rate is not None:
            steps = [trapezoid(rate[k : k + 2], self.t[k : k + 2]) for k in range(rate.size - 1)]
            self.yaw = np.concatenate([[0.0], np.cumsum(steps)])
        pairs = zip(self.yaw, velocities.v, strict=True)
        self.v = np.array([about_z(yaw) @ v for yaw, v in pairs])

    def position(self, time):
        corners = np.array([self.t[0], *self.t[(self.t > self.t[0]) & (self.t < time)], time])
        v = np.stack([np.interp(corners, self.t, axis) for axis in self.v.T], axis=1)
        return trapezoid(v, corners, axis=0)

    def pose(self, time):
        """Return position and rotation of the body."""
        yaw = about_z(np.interp(time, self.t, self.yaw))
        return self.position(time), yaw @ rotation_vector_to_matrix(self.tilt(time))

    def camera(self, time, R_body_cam, lever):
        """Return position and rotation of the camera, at a time of the body's clock."""
        p, R = self.pose(time)
        return p + R @ lever, R @ R_body_cam


def plane_at(b):
    """Return two axes across b."""
    helper = np.eye(3)[np.argmin(np.abs(b))]
    first = helper - b * (b @ helper)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(b, first)])


@dataclass
class Observed:
    """A track in the terms of its plane; the anchor is the first observation."""

    y: np.ndarray
    displacement: np.ndarray
    axes: np.ndarray
    b: np.ndarray

    def predicted(self, rho):
        """Return where a corner of this inverse distance is seen, shape (m, 2)."""
        rays = self.b - rho * self.displacement
        return (rays @ self.axes.T) / (rays @ self.b)[:, None]

    def off(self, rho):
        return self.y - self.predicted(rho)


def observed(motion, track, R_body_cam, offset, lever):
    """Return a track, the rows (r1, r2, t1, t2) of one corner, on the plane of its anchor."""
    r1, r2, t1, t2 = track
    b, axes = r1[0], plane_at(r1[0])
    p1, R1 = motion.camera(t1[0] + offset, R_body_cam, lever)
    y, displacement = [np.zeros(2)], [np.zeros(3)]
    for ray, time in zip(r2, t2, strict=True):
        p2, R2 = motion.camera(time + offset, R_body_cam, lever)
        seen = R1.T @ R2 @ ray
        y.append(axes @ seen / (b @ seen))
        displacement.append(R1.T @ (p2 - p1))
    return Observed(np.array(y), np.array(displacement), axes, b)


def flow(motion, track, R_body_cam, offset, lever, rho, step=1e-5):
    """Return the unit flow in the image, turned onto its plane, by central differences over time.

    The camera moves and turns by itself a little more, and the corner is seen from there.
    """
    r1, r2, t1, t2 = track
    b, axes, out = r1[0], plane_at(r1[0]), []
    p1, R1 = motion.camera(t1[0] + offset, R_body_cam, lever)
    point = p1 + R1 @ b / rho
    for time in t2:
        R2 = motion.camera(time + offset, R_body_cam, lever)[1]
        places = []
        for h in (-step, step):
            p, R = motion.camera(time + offset + h, R_body_cam, lever)
            seen = R1.T @ R2 @ R.T @ (point - p)
            places.append(axes @ seen / (b @ seen))
        out.append(places[1] - places[0])
    return unit(np.array(out))


def tukey_loss(off, loss_scale):
    """Return c^2 / 6 (1 - (1 - |off|^2 / c^2)^3) of each row, at most c^2 / 6, c the scale."""
    u = np.minimum(np.sum(off**2, axis=1) / loss_scale**2, 1.0)
    return loss_scale**2 / 6 * (1 - (1 - u) ** 3)


def fit_tukey(track, loss_scale, rho):
    """Return inverse distance, residuals and loss where Tukey's loss is least near `rho`.

    SciPy weighs squares by rho(z) of z = |residual|^2 / loss_scale^2, per number; so the two
    numbers of an observation enter as one, its length.
    """

    def lengths(unknowns):
        return np.linalg.norm(track.off(unknowns[0]) - unknowns[1:], axis=1)

    def tukey(z):
        u = np.minimum(z, 1.0)
        return np.array([(1 - (1 - u) ** 3) / 3, (1 - u) ** 2, -2 * (1 - u)])

    start = [rho, *np.median(track.off(rho), axis=0)]
    found = least_squares(
        lengths, start, loss=tukey, f_scale=loss_scale, x_scale=[rho, loss_scale, loss_scale],
        ftol=1e-15, xtol=1e-15, gtol=1e-15,
    )  # fmt: skip
    off = track.off(found.x[0]) - found.x[1:]
    return found.x[0], off, tukey_loss(off, loss_scale).sum()


def fit_squares(track):
    """Return inverse distance and residuals by the search for the root of the plain squares."""

    def residuals(rho):
        off = track.off(rho)
        return off - off.mean(axis=0)

    def slope(rho):
        h = 1e-6
        return np.sum(residuals(rho + h) ** 2) - np.sum(residuals(rho - h) ** 2)

    grid = np.geomspace(0.02, 3.0, 200)
    cost = [np.sum(residuals(rho) ** 2) for rho in grid]
    k = int(np.argmin(cost))
    rho = brentq(slope, grid[max(k - 1, 0)], grid[min(k + 1, grid.size - 1)], xtol=1e-14)
    return rho, residuals(rho)


def made_tracks(
    rng, velocities, R_body_cam, offset, *, lever=(0.0, 0.0, 0.0), count=400, step=0.1, length=7,
    half_angle=0.5, kept=lambda t: True, tilt=lambda time: np.zeros(3),
):  # fmt: skip
    """Make tracks of random corners, 1 to 6 m away, as a camera of `half_angle` sees them.

    `kept` tells of which times [s] of the body's clock observations are kept.
    """
    motion, lever = Motion(velocities, tilt), np.asarray(lever)
    low, high = velocities.t[0] - offset, velocities.t[-1] - offset
    parts = []
    while len(parts) < count:
        t1 = rng.uniform(low, high)
        p1, R1 = motion.camera(t1 + offset, R_body_cam, lever)
        ray = np.array([*rng.uniform(-half_angle, half_angle, 2), 1.0])
        point = p1 + R1 @ (ray * rng.uniform(1.0, 6.0))
        rows = []
        for t2 in t1 + step * np.arange(1, length + 1) + rng.uniform(-0.01, 0.01, length):
            if t2 > high or not kept(t2 + offset):
                continue
            p2, R2 = motion.camera(t2 + offset, R_body_cam, lever)
            seen = R2.T @ (point - p2)
            if seen[2] > 0.3 and np.abs(seen[:2] / seen[2]).max() < half_angle:
                rows.append((unit(ray), unit(seen), t1, t2))
        if len(rows) >= 2 and kept(t1 + offset):
            parts.append(rows)
    parts.sort(key=lambda rows: rows[0][2])
    first = np.concatenate([[0], np.cumsum([len(rows) for rows in parts])]).astype(np.int64)
    whole = [row for rows in parts for row in rows]
    r1, r2, t1, t2 = (np.array(column) for column in zip(*whole, strict=True))
    return Tracks(first, r1, r2, t1, t2)


def spoiled(rng, tracks, *, noise=0.0, false=0.0, shift=0.15):
    """Return tracks with noise [rad] per axis, anchors included, and a share of false observations.

    False observations are up to `shift` [rad] away per axis.
    """
    n, k = len(tracks.r2), len(tracks)
    anchors = moved(tracks.r1[tracks.first[:-1]], noise * rng.standard_normal((k, 2)))
    r2 = moved(tracks.r2, noise * rng.standard_normal((n, 2)))
    wrong = rng.random(n) < false
    r2[wrong] = moved(r2[wrong], rng.uniform(-shift, shift, (int(wrong.sum()), 2)))
    return replace(tracks, r1=np.repeat(anchors, tracks.length, axis=0), r2=r2)


def moved(rays, by):
    """Return rays that are turned by small angles (n, 2) across them."""
    axes = np.array([plane_at(ray) for ray in rays]).reshape(-1, 2, 3)
    return unit(rays + np.einsum("nk,nki->ni", by, axes))


def rows_of(tracks, k):
    """Return (r1, r2, t1, t2) of track k."""
    rows = slice(tracks.first[k], tracks.first[k + 1])
    return tracks.r1[rows], tracks.r2[rows], tracks.t1[rows], tracks.t2[rows]

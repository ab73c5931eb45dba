"""Event images, projected maps, and the pose that lays one on the other."""

import math
from typing import NamedTuple

import numpy as np

from evcalib.kernels.jit import jit


class Template(NamedTuple):
    """What the inverse iteration needs of a projected map, one row per pixel that is used."""

    points: np.ndarray  # float64 (n, 3), in the frame of the template's view
    values: np.ndarray  # float64 (n,), the map's image there
    slopes: np.ndarray  # float64 (n, 6), by rotation and translation, free of gain and offset
    inverse: np.ndarray  # float64 (6, 6), inverse of the sum of their squares


class Limits(NamedTuple):
    """When an alignment ends."""

    steps: int  # most iterations
    rest: float  # at rest when no pixel moves further in a step, about [px]


@jit
def _splat(image, u, v, value):
    """Share a value among the four pixels around a point that has them."""
    col, row = int(u), int(v)
    p, q = u - col, v - row
    image[row, col] += value * (1.0 - p) * (1.0 - q)
    image[row, col + 1] += value * p * (1.0 - q)
    image[row + 1, col] += value * (1.0 - p) * q
    image[row + 1, col + 1] += value * p * q


@jit
def draw(rays, view, image):
    """Add up events at their undistorted pixels, bilinear.

    Parameters
    ----------
    rays : ndarray of float32, shape (n, 2)
        Directions (x, y, 1) of the events.
    view : View
        The camera without distortion.
    image : ndarray of float32, shape (height, width)
        Takes the counts.
    """
    for i in range(len(rays)):
        u, v = view.fx * rays[i, 0] + view.cx, view.fy * rays[i, 1] + view.cy
        if 0.0 <= u < view.width - 1 and 0.0 <= v < view.height - 1:
            _splat(image, u, v, 1.0)


@jit
def project(points, R, t, view, image, inverse):
    """Add up points at their pixels, bilinear, and likewise their inverse depths.

    Parameters
    ----------
    points : ndarray of float64, shape (n, 3)
        The points, in any frame.
    R, t : ndarray of float64, shapes (3, 3) and (3,)
        Take them to the camera's: R X + t.
    view : View
        The camera.
    image, inverse : ndarray of float32, shape (height, width)
        Take the counts, and the inverse depths times the counts.

    Returns
    -------
    int
        Points that are seen.
    """
    seen = 0
    for i in range(len(points)):
        X = points[i]
        z = R[2, 0] * X[0] + R[2, 1] * X[1] + R[2, 2] * X[2] + t[2]
        if z <= 0.0:
            continue
        x = R[0, 0] * X[0] + R[0, 1] * X[1] + R[0, 2] * X[2] + t[0]
        y = R[1, 0] * X[0] + R[1, 1] * X[1] + R[1, 2] * X[2] + t[1]
        u, v = view.fx * x / z + view.cx, view.fy * y / z + view.cy
        if 0.0 <= u < view.width - 1 and 0.0 <= v < view.height - 1:
            _splat(image, u, v, 1.0)
            _splat(inverse, u, v, 1.0 / z)
            seen += 1
    return seen


@jit
def _rotation(w):
    """Return the matrix of a rotation vector (Rodrigues)."""
    angle = math.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
    a = 1.0 if angle < 1e-9 else math.sin(angle) / angle
    b = 0.5 if angle < 1e-9 else (1.0 - math.cos(angle)) / angle**2
    K = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    return np.eye(3) + a * K + b * (K @ K)


@jit
def align(template, image, view, limits, R, t):
    """Find the pose from which an event image looks like a projected map.

    The inverse compositional iteration of Baker & Matthews (IJCV 56, 2004), over the six
    unknowns of a pose (Rebecq et al., EVO, RA-L 2, 2017, section IV-A).  The image may differ
    from the map's by a factor and an offset.

    Parameters
    ----------
    template : Template
        The map.
    image : ndarray of float32, shape (height, width)
        The event image.
    view : View
        The camera.
    limits : Limits
        When it ends.
    R, t : ndarray of float64, shapes (3, 3) and (3,)
        The guess, and then the answer: R X + t takes points to the camera's frame.

    Returns
    -------
    correlation : float
        Of image and map over the pixels used; 0 if too few are seen.
    seen : int
        Pixels of the template that the image holds.
    """
    n = len(template.points)
    sampled, used = np.empty(n), np.empty(n, dtype=np.int64)
    correlation, seen = 0.0, 0
    for step in range(limits.steps + 1):
        seen = 0
        si = sm = sii = smm = sim = 0.0
        for i in range(n):
            X = template.points[i]
            z = R[2, 0] * X[0] + R[2, 1] * X[1] + R[2, 2] * X[2] + t[2]
            if z <= 0.0:
                continue
            x = R[0, 0] * X[0] + R[0, 1] * X[1] + R[0, 2] * X[2] + t[0]
            y = R[1, 0] * X[0] + R[1, 1] * X[1] + R[1, 2] * X[2] + t[1]
            u, v = view.fx * x / z + view.cx, view.fy * y / z + view.cy
            if not (0.0 <= u < view.width - 1 and 0.0 <= v < view.height - 1):
                continue
            col, row = int(u), int(v)
            p, q = u - col, v - row
            value = (1.0 - q) * ((1.0 - p) * image[row, col] + p * image[row, col + 1]) + q * (
                (1.0 - p) * image[row + 1, col] + p * image[row + 1, col + 1]
            )
            m = template.values[i]
            sampled[seen], used[seen] = value, i
            seen += 1
            si += value
            sm += m
            sii += value * value
            smm += m * m
            sim += value * m
        if seen < 20:
            return 0.0, seen
        covariance = sim - si * sm / seen
        spread, width = smm - sm * sm / seen, sii - si * si / seen
        if covariance <= 0.0 or spread <= 0.0 or width <= 0.0:
            return 0.0, seen
        correlation = covariance / math.sqrt(spread * width)
        if step == limits.steps:
            break
        gain = covariance / spread
        offset = (si - gain * sm) / seen
        right = np.zeros(6)
        for k in range(seen):
            i = used[k]
            residual = (sampled[k] - offset) / gain - template.values[i]
            for j in range(6):
                right[j] += template.slopes[i, j] * residual
        change = template.inverse @ right
        # x -> D x + d moves the template as the residual asks; the pose takes it back.
        D = _rotation(change[:3])
        turned = R @ D.T
        t -= turned @ change[3:]
        R[:] = turned
        moved = 0.0
        for k in range(0, seen, max(seen // 16, 1)):
            X = template.points[used[k]]
            x = D[0, 0] * X[0] + D[0, 1] * X[1] + D[0, 2] * X[2] + change[3]
            y = D[1, 0] * X[0] + D[1, 1] * X[1] + D[1, 2] * X[2] + change[4]
            z = D[2, 0] * X[0] + D[2, 1] * X[1] + D[2, 2] * X[2] + change[5]
            moved = max(moved, abs(view.fx * (x / z - X[0] / X[2])))
            moved = max(moved, abs(view.fy * (y / z - X[1] / X[2])))
        if moved < limits.rest:
            break
    return correlation, seen

"""Rotations and directions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from evcalib.arrays import Floats

LOOKS_FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""R_body_cam of a camera that looks straight ahead, level."""


def random_rotation(rng: np.random.Generator) -> Floats:
    """Return a rotation drawn uniformly from SO(3), shape (3, 3)."""
    return quaternion_to_matrix(rng.standard_normal(4))


def quaternion_to_matrix(wxyz: ArrayLike) -> Floats:
    """Return the rotation matrix of a quaternion (w, x, y, z) of any length above zero."""
    w, x, y, z = np.asarray(wxyz, dtype=np.float64) / np.linalg.norm(wxyz)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotation_vector_to_matrix(vector: ArrayLike) -> Floats:
    """Return the matrix of a rotation vector [rad] (Rodrigues)."""
    r = np.asarray(vector, dtype=np.float64)
    half = 0.5 * np.linalg.norm(r)
    return quaternion_to_matrix([np.cos(half), *(0.5 * np.sinc(half / np.pi) * r)])


def rotation_angle(a: ArrayLike, b: ArrayLike | None = None) -> float:
    """Return the angle [rad] of rotation `a`, or between rotations `a` and `b`.

    Uses atan2 of the skew part and the trace: the bare arccos gives NaN for exact matches and
    loses half of the digits near them.

    Examples
    --------
    >>> round(rotation_angle(rpy_to_matrix([0, 0, 0.3]), rpy_to_matrix([0, 0, 0.1])), 3)
    0.2
    """
    m = np.asarray(a, dtype=np.float64)
    if b is not None:
        m = m.T @ np.asarray(b, dtype=np.float64)
    skew = 0.5 * np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    return float(np.arctan2(np.linalg.norm(skew), 0.5 * (np.trace(m) - 1.0)))


def angle_between(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return the angle [rad] between vectors along the last axis, exact near 0 and pi.

    Examples
    --------
    >>> angle_between([[1, 0, 0], [0, 2, 0]], [1, 1e-9, 0])
    array([1.00000000e-09, 1.57079633e+00])
    """
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    cross = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.arctan2(cross, np.sum(a * b, axis=-1))


def unit(v: ArrayLike) -> Floats:
    """Return vectors along the last axis scaled to length 1."""
    v = np.asarray(v, dtype=np.float64)
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def matrix_to_quaternion(R: ArrayLike) -> Floats:
    """Return the unit quaternion (w, x, y, z), w >= 0, of a rotation matrix."""
    m = np.asarray(R, dtype=np.float64)
    # The largest of the four squares is taken as the pivot (Shepperd 1978).
    squares = np.array([np.trace(m), m[0, 0], m[1, 1], m[2, 2]])
    pivot = int(np.argmax(squares))
    if pivot == 0:
        q = [1 + squares[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]
    else:
        i = pivot - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        q = [0.0] * 4
        q[0] = m[k, j] - m[j, k]
        q[1 + i] = 1 + m[i, i] - m[j, j] - m[k, k]
        q[1 + j] = m[j, i] + m[i, j]
        q[1 + k] = m[k, i] + m[i, k]
    out = unit(q)
    return -out if out[0] < 0 else out


def matrix_to_rpy(R: ArrayLike) -> Floats:
    """Return roll, pitch, yaw [rad] with R = Rz(yaw) Ry(pitch) Rx(roll); yaw is 0 at the poles."""
    m = np.asarray(R, dtype=np.float64)
    level = np.hypot(m[0, 0], m[1, 0])
    pitch = np.arctan2(-m[2, 0], level)
    if level < 1e-9:
        return np.array([np.arctan2(-np.sign(m[2, 0]) * m[0, 1], m[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(m[2, 1], m[2, 2]), pitch, np.arctan2(m[1, 0], m[0, 0])])


def rpy_to_matrix(rpy: ArrayLike) -> Floats:
    """Return R = Rz(yaw) Ry(pitch) Rx(roll) of roll, pitch, yaw [rad].

    Examples
    --------
    A quarter turn to the left takes body X to Y.

    >>> (rpy_to_matrix([0, 0, np.pi / 2]) @ [1, 0, 0]).round(6)
    array([0., 1., 0.])
    """
    roll, pitch, yaw = np.asarray(rpy, dtype=np.float64)
    x = rotation_vector_to_matrix([roll, 0, 0])
    y = rotation_vector_to_matrix([0, pitch, 0])
    return rotation_vector_to_matrix([0, 0, yaw]) @ y @ x

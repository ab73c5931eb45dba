"""Rotations and directions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from evcalib.arrays import Floats

LOOKS_FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""R_body_cam of a camera that looks straight ahead, level."""


def random_rotation(rng: np.random.Generator) -> Floats:
    """Return a rotation drawn uniformly from SO(3), shape (3, 3)."""
    return quaternion_to_matrix(rng.standard_normal(4))


def quaternion_to_matrix(wxyz: ArrayLike) -> Floats:
    """Return the rotation matrix of a quaternion (w, x, y, z) of any length above zero."""
    w, *xyz = np.asarray(wxyz, dtype=np.float64)
    return Rotation.from_quat([*xyz, w]).as_matrix()


def matrix_to_quaternion(R: ArrayLike) -> Floats:
    """Return the unit quaternion (w, x, y, z), w >= 0, of a rotation matrix."""
    *xyz, w = Rotation.from_matrix(R).as_quat(canonical=True)
    return np.array([w, *xyz])


def rotation_vector_to_matrix(vector: ArrayLike) -> Floats:
    """Return the matrix of a rotation vector [rad]."""
    return Rotation.from_rotvec(vector).as_matrix()


def rotation_vector(R: ArrayLike) -> Floats:
    """Return the rotation vector [rad] of a rotation matrix."""
    return Rotation.from_matrix(R).as_rotvec()


def rotation_angle(a: ArrayLike, b: ArrayLike | None = None) -> float:
    """Return the angle [rad] of rotation `a`, or between rotations `a` and `b`; NaN of NaN.

    Uses atan2 of the skew part and the trace: the bare arccos gives NaN for exact matches and
    loses half of the digits near them.  SciPy's is as exact, but takes ten times as long and
    refuses NaN, which a method without an answer gives.

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


def turned_by_yaw(v: Floats, yaw: Floats) -> Floats:
    """Return vectors turned about Z.

    Parameters
    ----------
    v : ndarray, shape (..., 3)
        Vectors.
    yaw : ndarray, shape (...)
        Angles [rad], which broadcast with them.

    Returns
    -------
    ndarray, shape (..., 3)
        In the frame in which the angles are measured.
    """
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    return np.stack(np.broadcast_arrays(c * x - s * y, s * x + c * y, z), axis=-1)


def unit(v: ArrayLike) -> Floats:
    """Return vectors along the last axis scaled to length 1."""
    v = np.asarray(v, dtype=np.float64)
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def matrix_to_rpy(R: ArrayLike) -> Floats:
    """Return roll, pitch, yaw [rad] with R = Rz(yaw) Ry(pitch) Rx(roll); yaw is 0 at the poles.

    SciPy has the same angles, but warns at the poles and refuses NaN.
    """
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
    return Rotation.from_euler("xyz", rpy).as_matrix()


STEEP = 80.0
"""Above this elevation [deg] left and right of an optical axis say little.

A choice: here an error of the axis of 1 deg moves its azimuth by 1 / cos(80 deg) = 6 deg.
"""
UPRIGHT = 5.0
"""An image rolled by less than this [deg] is called upright; the eye takes it for that."""


def rpy_text(R: ArrayLike) -> str:
    """Return roll, pitch and yaw of a rotation in words [deg]."""
    roll, pitch, yaw = np.degrees(matrix_to_rpy(R))
    return f"roll {roll:+.2f}, pitch {pitch:+.2f}, yaw {yaw:+.2f} deg"


def mounting(R_body_cam: ArrayLike) -> Floats:
    """Return roll, pitch, yaw [deg] against a camera that looks straight ahead, level.

    Parameters
    ----------
    R_body_cam : ndarray, shape (3, 3)
        ``v_body = R_body_cam @ v_cam``.

    Returns
    -------
    ndarray, shape (3,)
        Positive: right side down, looking down, looking left.
    """
    return np.degrees(matrix_to_rpy(np.asarray(R_body_cam) @ LOOKS_FORWARD.T))


def camera_looks(R_body_cam: ArrayLike) -> str:
    """Say where a camera looks, so that a person sees whether that can be.

    Parameters
    ----------
    R_body_cam : ndarray, shape (3, 3)
        ``v_body = R_body_cam @ v_cam``.

    Returns
    -------
    str
        Such as ``forward, tilted down by 12 deg; image upright``.

    Examples
    --------
    >>> camera_looks(LOOKS_FORWARD)
    'forward; image upright'
    """
    R = np.asarray(R_body_cam, dtype=np.float64)
    ahead, top = R[:, 2], -R[:, 1]
    up = float(np.degrees(np.arcsin(np.clip(ahead[2], -1.0, 1.0))))
    sides = ("forward", "to the left", "backward", "to the right")
    if abs(up) > STEEP:
        side = sides[round(float(np.arctan2(top[1], top[0])) / (np.pi / 2)) % 4]
        return f"{'up' if up > 0 else 'down'}; the top of the image points {side}"
    yaw = float(np.degrees(np.arctan2(ahead[1], ahead[0])))
    quarter = round(yaw / 90.0)
    rest, roll = yaw - 90.0 * quarter, float(mounting(R)[0])
    words = [sides[quarter % 4]]
    if abs(rest) >= 0.5:
        words.append(f"turned to the {'left' if rest > 0 else 'right'} by {abs(rest):.0f} deg")
    if abs(up) >= 0.5:
        words.append(f"tilted {'up' if up > 0 else 'down'} by {abs(up):.0f} deg")
    image = f"image rolled, its {'right' if roll > 0 else 'left'} side down by {abs(roll):.0f} deg"
    if abs(roll) < UPRIGHT:
        image = "image upright"
    elif abs(roll) > 180 - UPRIGHT:
        image = "image upside down"
    return f"{', '.join(words)}; {image}"

"""Least squares between wheel measurements and the twist of a rigid body."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.kinematics._states import BodyTwist
from evcalib.kinematics._wheels import check_span

MIN_SPREAD = 1e-3
"""Wheels closer together than this [m] are one wheel: no drawing tells their places better."""
MIN_GAIN = 1e-3
"""Smallest over largest response of the wheels to a unit motion; below it, no answer.  A choice:
noise of the wheels would come out a thousand times as large."""


def solve(matrix: Floats, measured: Floats, wheels: int) -> BodyTwist:
    """Return the twists that fit the measurements (n, m) of so many wheels best.

    The matrix is (m, 3), or (n, m, 3) where it differs from row to row.
    """
    return with_slip(matrix, measured, fit(matrix, measured), wheels)


def fit(matrix: Floats, measured: Floats) -> Floats:
    """Return the twists (n, 3) that fit the measurements (n, m) best."""
    if matrix.ndim == 2:
        return measured @ np.linalg.pinv(matrix).T
    return np.einsum("nij,nj->ni", np.linalg.pinv(matrix), measured)


def said(matrix: Floats, twist: Floats) -> Floats:
    """Return what the wheels would measure (n, m) under twists (n, 3)."""
    return twist @ matrix.T if matrix.ndim == 2 else np.einsum("nij,nj->ni", matrix, twist)


def with_slip(
    matrix: Floats,
    measured: Floats,
    twist: Floats,
    wheels: int,
) -> BodyTwist:
    """Return the twists (n, 3) together with what they leave unexplained."""
    residual = measured - said(matrix, twist)
    slip = np.sqrt((residual**2).sum(axis=1) / wheels)
    return BodyTwist(v=twist[:, :2], yaw_rate=twist[:, 2], slip=slip)


def contact_velocities(positions: Floats, v: Floats, yaw_rate: Floats) -> Floats:
    """Return u = v + omega x r of each wheel, shape (n, k, 2) [m/s]."""
    turn = np.stack([-positions[:, 1], positions[:, 0]], axis=1)
    return v[:, None, :] + yaw_rate[:, None, None] * turn


def check_observable(matrix: Floats, positions: Floats) -> None:
    """Refuse wheels that leave a motion of the body unmeasured, and name that motion.

    Conditioning is judged about the wheels' centroid with yaw scaled by their spread, so that
    it depends neither on the choice of the origin nor on the size of the vehicle.
    """
    centre = positions.mean(axis=0)
    spread = float(np.sqrt(((positions - centre) ** 2).sum(axis=1).mean()))
    if spread < MIN_SPREAD:
        raise InputError(
            "the yaw rate is not observable: all wheels stand at the same place,"
            f" ({centre[0]:z.3f}, {centre[1]:z.3f}) m; check the positions of the wheels"
        )
    span = np.linalg.norm(positions[:, None] - positions, axis=2).max()
    check_span(float(span), "the largest distance between two wheels")
    _, gains, motions = np.linalg.svd(_about_centre(matrix, centre, spread))
    if gains[2] < MIN_GAIN * gains[0]:
        raise InputError(_unmeasured(motions[2], centre, spread))


def check_rows(matrix: Floats, positions: Floats, moving: NDArray) -> None:
    """Refuse rows (n, m, 3) that leave a motion unmeasured while the vehicle moves."""
    centre = positions.mean(axis=0)
    spread = float(np.sqrt(((positions - centre) ** 2).sum(axis=1).mean()))
    gains = np.linalg.svd(_about_centre(matrix, centre, spread), compute_uv=False)
    bad = moving & (gains[:, 2] < MIN_GAIN * gains[:, 0])
    if bad.any():
        raise InputError(
            f"row {int(np.argmax(bad))}: with its wheels steered like this the vehicle may move in"
            " several ways; are the steering angles in radians, and their zeros right?"
        )


def _about_centre(matrix: Floats, centre: Floats, spread: float) -> Floats:
    """Return the matrix for twists about the centre, yaw in units of 1 / spread."""
    about_centre = matrix.copy()
    about_centre[..., 2] += matrix[..., 0] * centre[1] - matrix[..., 1] * centre[0]
    about_centre[..., 2] /= spread
    return about_centre


def _unmeasured(motion: Floats, centre: Floats, spread: float) -> str:
    vx, vy, omega = motion[0], motion[1], motion[2] / spread
    if abs(omega) * spread > 1e-6 * np.hypot(vx, vy):
        x, y = centre[0] - vy / omega, centre[1] + vx / omega
        what = f"the yaw rate is not observable: turning about the point ({x:z.3f}, {y:z.3f}) m"
    else:
        what = (
            f"the velocity is not observable: sliding at {np.degrees(np.arctan2(vy, vx)):.0f} deg"
        )
    return what + " turns no wheel; check positions and drive directions of the wheels"

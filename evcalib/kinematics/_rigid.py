"""Least squares between wheel measurements and the twist of a rigid body."""

from __future__ import annotations

import numpy as np

from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.kinematics._states import BodyTwist

MIN_SPREAD = 1e-3
"""Wheels closer together than this [m] are one wheel: no drawing tells their places better."""
MIN_GAIN = 1e-3
"""Smallest over largest response of the wheels to a unit motion; below it, no answer.  A choice:
noise of the wheels would come out a thousand times as large."""


def solve(matrix: Floats, measured: Floats, wheels: int) -> BodyTwist:
    """Return the twists that fit the measurements (n, m) of so many wheels best."""
    twist = measured @ np.linalg.pinv(matrix).T
    return with_slip(matrix, measured, twist, wheels)


def with_slip(
    matrix: Floats,
    measured: Floats,
    twist: Floats,
    wheels: int,
) -> BodyTwist:
    """Return the twists (n, 3) together with what they leave unexplained."""
    residual = measured - twist @ matrix.T
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
    about_centre = matrix.copy()
    about_centre[:, 2] += matrix[:, 0] * centre[1] - matrix[:, 1] * centre[0]
    about_centre[:, 2] /= spread
    _, gains, motions = np.linalg.svd(about_centre)
    if gains[2] < MIN_GAIN * gains[0]:
        raise InputError(_unmeasured(motions[2], centre, spread))


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

"""The motion of a body in the world, sampled and interpolated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation, Slerp

from data_tools.simulation.drives import Drive
from evcalib import checks
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.series import VelocitySeries, dead_reckon, yaw_angles


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Positions and rotations of a body over time.

    Between samples the position is a monotone cubic (it never overshoots a corner) and the
    rotation turns at a constant rate; 200 samples per second follow any drive.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times [s], strictly increasing, at least two.
    position : ndarray, shape (n, 3)
        Position of the body in the world [m], Z up.
    rotation : ndarray, shape (n, 3, 3)
        Rotations R_world_body; given so, or as angles about the world's Z [rad], shape (n,), or
        not at all for none.

    Raises
    ------
    InputError
        If a shape or value is unusable, or a matrix is not a rotation.
    """

    t: Floats
    position: Floats
    rotation: Floats | None = None

    def __post_init__(self) -> None:
        t = checks.times(self.t, "trajectory t")
        if t.size < 2:
            raise InputError(f"a trajectory needs at least two samples, not {t.size}")
        position = checks.floats(self.position, "trajectory position", (t.size, 3))
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "position", position)
        object.__setattr__(self, "rotation", _rotations(self.rotation, t.size))

    @classmethod
    def of_drive(
        cls,
        drive: Drive,
        *,
        offset: float = 0.0,
        rate: float = 500.0,
        shake: Callable[[Floats, Floats], Floats] | None = None,
    ) -> Trajectory:
        """Return a drive on the camera's clock, started at the origin.

        Parameters
        ----------
        drive : Drive
            Planar drive, on the body's clock.
        offset : float
            ``t_body = t_cam + offset`` [s].  Camera times below zero are cut off.
        rate : float
            Samples per second.
        shake : callable, optional
            Takes even times [s], shape (n,), and accelerations in the body frame [m/s^2], shape
            (n, 3); returns rotation vectors [rad], shape (n, 3), by which the body leaves the
            attitude of its drive, about its origin.
        """
        count = int(np.ceil(drive.duration * checks.positive(rate, "rate"))) + 1
        t = np.linspace(0.0, drive.duration, count)
        yaw_rate = drive.yaw_rate(t)
        velocities = VelocitySeries(t, drive.velocity(t), yaw_rate)
        position, yaw = dead_reckon(velocities), yaw_angles(velocities)
        keep = t >= offset
        if shake is None:
            return cls(t[keep] - offset, position[keep], yaw[keep])
        v = drive.velocity(t)
        acceleration = np.gradient(v, t, axis=0)
        acceleration[:, :2] += yaw_rate[:, None] * v[:, [1, 0]] * [-1.0, 1.0]
        level = Rotation.from_rotvec(np.outer(yaw, [0.0, 0.0, 1.0]))
        turned = level * Rotation.from_rotvec(shake(t, acceleration))
        return cls(t[keep] - offset, position[keep], turned.as_matrix()[keep])

    def position_at(self, t: ArrayLike) -> Floats:
        """Return positions [m] at times [s] within the trajectory, shape (n, 3)."""
        return self._curve(self._inside(t))

    def velocity_at(self, t: ArrayLike) -> Floats:
        """Return velocities in the world [m/s], shape (n, 3)."""
        return self._curve(self._inside(t), 1)

    def rotation_at(self, t: ArrayLike) -> Floats:
        """Return rotations R_world_body, shape (n, 3, 3)."""
        return self._turn(self._inside(t)).as_matrix()

    def rate_at(self, t: ArrayLike) -> Floats:
        """Return angular rates in the body frame [rad/s], shape (n, 3)."""
        row = np.searchsorted(self.t, self._inside(t), side="right") - 1
        return self._rates[np.minimum(row, self.t.size - 2)]

    @cached_property
    def _curve(self) -> PchipInterpolator:
        return PchipInterpolator(self.t, self.position)

    @cached_property
    def _turn(self) -> Slerp:
        return Slerp(self.t, Rotation.from_matrix(self.rotation))

    @cached_property
    def _rates(self) -> Floats:
        samples = Rotation.from_matrix(self.rotation)
        return (samples[:-1].inv() * samples[1:]).as_rotvec() / np.diff(self.t)[:, None]

    def _inside(self, t: ArrayLike) -> Floats:
        times = checks.floats(t, "t", (None,))
        out = (times < self.t[0] - 1e-9) | (times > self.t[-1] + 1e-9)
        if out.any():
            raise InputError(
                f"time {times[out][0]:.6f} s is outside the trajectory, which runs from"
                f" {self.t[0]:.6f} to {self.t[-1]:.6f} s"
            )
        return np.clip(times, self.t[0], self.t[-1])


def _rotations(given: ArrayLike | None, n: int) -> Floats:
    """Return rotation matrices, shape (n, 3, 3), of angles about Z or of matrices."""
    values = np.zeros(n) if given is None else np.asarray(given)
    if values.ndim == 1:
        angles = checks.floats(values, "trajectory rotation", (n,))
        return Rotation.from_rotvec(np.outer(angles, [0.0, 0.0, 1.0])).as_matrix()
    return checks.rotations(values, "trajectory rotation", n)

"""What all vehicles share: named wheels, what they measure, and both directions of it."""

from __future__ import annotations

from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from evcalib import checks
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.kinematics import _rigid
from evcalib.kinematics._states import BodyTwist, WheelStates
from evcalib.kinematics._wheels import Wheel


class VehicleBase:
    """Named wheels, each of which constrains the twist of the body."""

    wheels: tuple[Wheel, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the wheels."""
        return tuple(wheel.name for wheel in self.wheels)

    @property
    def speed_names(self) -> tuple[str, ...]:
        """Wheels whose speed is told, in the order of `WheelStates.speed`."""
        return self.names

    @property
    def steer_names(self) -> tuple[str, ...]:
        """Wheels whose steering angle is told, in the order of `WheelStates.steer`."""
        return ()

    @property
    def steered(self) -> bool:
        """Whether any wheel tells a steering angle."""
        return bool(self.steer_names)

    @property
    def positions(self) -> Floats:
        """Contact points [m], shape (k, 2)."""
        return np.array([(wheel.x, wheel.y) for wheel in self.wheels], dtype=np.float64)

    @property
    def matrix(self) -> Floats:
        """The matrix H from a twist (v_x, v_y, omega) to what the wheels measure."""
        raise NotImplementedError

    def directions(self, states: WheelStates) -> Floats:
        """Return the direction in which each wheel rolls, from body X [rad], shape (n, k)."""
        return np.zeros((len(states), len(self.wheels)))

    def resized(self, factor: float) -> Self:
        """Return the vehicle with all distances between its wheels scaled."""
        raise NotImplementedError

    def equations(self, states: WheelStates) -> tuple[Floats, Floats]:
        """Return what the wheels say as linear equations of the twist, ``A @ twist = b`` [m/s].

        Parameters
        ----------
        states : WheelStates
            n rows.

        Returns
        -------
        ndarray, shape (m, 3) or (n, m, 3)
            The matrix A, the same for all rows or one for each.
        ndarray, shape (n, m)
            The right side b.
        """
        check_states(states, self)
        return self.matrix, states.speed

    def twist(self, states: WheelStates) -> BodyTwist:
        """Return the twist that explains the wheel states best.

        Parameters
        ----------
        states : WheelStates
            n rows.

        Returns
        -------
        BodyTwist
            v (n, 2) [m/s], yaw rate (n,) [rad/s] and slip (n,) [m/s].

        Raises
        ------
        InputError
            If the number of wheels differs, angles are missing or superfluous, or a row leaves a
            motion open.
        """
        return _rigid.solve(*self.equations(states), len(self.wheels))

    def wheel_states(self, v: ArrayLike, yaw_rate: ArrayLike) -> WheelStates:
        """Return the states of the wheels of a body that moves without slip.

        Parameters
        ----------
        v : array_like, shape (n, 2)
            Velocity of the origin of the body frame [m/s].
        yaw_rate : array_like, shape (n,)
            Rotation rate about body Z [rad/s].

        Returns
        -------
        WheelStates
            n rows.
        """
        v, yaw_rate = check_twist(v, yaw_rate)
        return WheelStates(np.column_stack([v, yaw_rate]) @ self.matrix.T)


def contact_matrix(positions: Floats) -> Floats:
    """Return the matrix (2 k, 3) to contact velocities: rows (1, 0, -y) and (0, 1, x) per wheel."""
    x, y = positions.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    rows = np.stack([np.stack([one, zero, -y], axis=1), np.stack([zero, one, x], axis=1)], 1)
    return rows.reshape(-1, 3)


def check_states(states: WheelStates, vehicle: VehicleBase) -> None:
    """Refuse states of another number of wheels."""
    kind = f"a {type(vehicle).__name__.lower()} vehicle"
    angles = 0 if states.steer is None else states.steer.shape[1]
    if states.speed.shape[1] != len(vehicle.speed_names):
        names = ", ".join(vehicle.speed_names)
        raise InputError(f"{states.speed.shape[1]} wheel speeds, but the wheels are {names}")
    if angles and not vehicle.steered:
        raise InputError(f"{kind} has no steering angles of {', '.join(vehicle.names)}")
    if angles != len(vehicle.steer_names):
        raise InputError(
            f"{kind} needs the steering angles of {', '.join(vehicle.steer_names)}; there are"
            f" {angles}"
        )


def check_twist(v: ArrayLike, yaw_rate: ArrayLike) -> tuple[Floats, Floats]:
    """Return velocities (n, 2) and yaw rates (n,) as arrays."""
    velocity = checks.floats(v, "v", (None, 2))
    return velocity, checks.floats(yaw_rate, "yaw_rate", (velocity.shape[0],))

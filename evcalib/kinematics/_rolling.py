"""Vehicles on wheels that roll and do not slide sideways: differential drives, cars and others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.kinematics import _rigid
from evcalib.kinematics._base import VehicleBase, check_states, check_twist, contact_matrix
from evcalib.kinematics._states import WheelStates
from evcalib.kinematics._wheels import (
    RollingWheel,
    check_span,
    check_wheels,
    length,
    number,
    resized,
)

SIDEWAYS = 1e-6
"""Share of the speed that wheels may slide sideways in `Rolling.wheel_states`: rounding."""


@dataclass(frozen=True)
class Rolling(VehicleBase):
    """Wheels that roll along their direction and do not slide across it.

    A wheel at (x, y) that points along the angle a (its steering angle, or 0) gives

        u_x cos a + u_y sin a = its speed, if that is told,
        -u_x sin a + u_y cos a = 0,

    where u is its contact velocity.  The usual vehicles are made by `differential`, `skid_steer`,
    `bicycle`, `ackermann` and `tricycle`, any other one from its wheels.  The origin of the body
    frame is the middle of the axle that does not steer, unless `axle` says where that is.  Where
    there are as many equations as unknowns (two wheels, a bicycle) the slip is 0.

    Attributes
    ----------
    wheels : tuple of RollingWheel
        Those that tell a speed, steer, or must not slide sideways.

    References
    ----------
    Siegwart & Nourbakhsh, Autonomous Mobile Robots, 3.2: fixed and steered standard wheels.

    Examples
    --------
    >>> vehicle = Rolling.differential(track=0.4)
    >>> vehicle.names, vehicle.wheel_states(v=[[0.5, 0.0]], yaw_rate=[1.0]).speed
    (('left', 'right'), array([[0.3, 0.7]]))
    >>> car = Rolling.bicycle(wheelbase=1.0)
    >>> states = WheelStates(speed=[[0.5]], steer=[[np.pi / 4]])
    >>> car.speed_names, car.steer_names, car.twist(states).yaw_rate.round(6)
    (('rear',), ('front',), array([0.5]))
    """

    wheels: tuple[RollingWheel, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "wheels", check_wheels(self.wheels, 2, RollingWheel))
        if not self.speed_names:
            raise InputError("no wheel tells its speed: how fast the vehicle drives stays open")
        axles = [wheel.x for wheel in self.wheels if not wheel.steer]
        if axles and max(axles) - min(axles) > _rigid.MIN_SPREAD:
            raise InputError(
                f"wheels that do not steer stand at x = {min(axles):g} and {max(axles):g} m: the"
                " vehicle could not turn; a vehicle that turns by sliding is a skid_steer one"
            )
        straight = WheelStates(
            np.zeros((1, len(self.speed_names))),
            np.zeros((1, len(self.steer_names))) if self.steered else None,
        )
        matrix = self.equations(straight)[0]
        _rigid.check_observable(matrix.reshape(-1, 3), self.positions)

    @classmethod
    def differential(
        cls,
        track: float,
        axle: tuple[float, float] = (0.0, 0.0),
        left: Sequence[str] = ("left",),
        right: Sequence[str] = ("right",),
    ) -> Self:
        """Return a differential drive: wheels on one axle that do not steer.

        Parameters
        ----------
        track : float
            Distance between the left and the right wheels [m].
        axle : tuple of float
            Where the middle of the axle is in the body frame [m].
        left, right : sequence of str
            Names of the wheels of either side.
        """
        half = 0.5 * length(track, "track")
        return cls.skid_steer((half, -half), 0.0, left, right)._moved(axle)

    @classmethod
    def skid_steer(
        cls,
        centres: tuple[float, float],
        x: float = 0.0,
        left: Sequence[str] = ("left",),
        right: Sequence[str] = ("right",),
    ) -> Self:
        """Return a skid-steer or tracked vehicle, by the instantaneous centres of its sides.

        It moves as a differential drive whose wheels stand at the points of the two sides that do
        not slide (Mandow et al., Experimental kinematics for wheeled skid-steer mobile robots,
        IROS 2007): farther apart than its wheels, often 1.5 to 2 times.

        Parameters
        ----------
        centres : tuple of float
            y of the left and of the right centre in the body frame [m].
        x : float
            x of both [m].
        left, right : sequence of str
            Names of the wheels, or tracks, of either side.
        """
        ys = [number(y, f"the {side} centre") for side, y in zip(_SIDES, centres, strict=True)]
        if ys[0] <= ys[1]:
            raise InputError(
                f"the left centre (y = {ys[0]:g} m) must lie to the left of the right one"
                f" ({ys[1]:g} m): body Y points to the left"
            )
        check_span(ys[0] - ys[1], "the distance between the centres")
        sides = zip((left, right), ys, strict=True)
        return cls(tuple(RollingWheel(name, x, y) for names, y in sides for name in names))

    @classmethod
    def bicycle(cls, wheelbase: float, axle: tuple[float, float] = (0.0, 0.0)) -> Self:
        """Return a car told by one speed, `rear`, and one steering angle, `front`.

        Parameters
        ----------
        wheelbase : float
            Distance from the rear to the front axle [m].
        axle : tuple of float
            Where the middle of the rear axle is in the body frame [m].
        """
        front = RollingWheel("front", length(wheelbase, "wheelbase"), 0.0, speed=False, steer=True)
        return cls((RollingWheel("rear", 0.0, 0.0), front))._moved(axle)

    @classmethod
    def ackermann(
        cls, wheelbase: float, track: float, axle: tuple[float, float] = (0.0, 0.0)
    ) -> Self:
        """Return a car told by the speeds of `rl` and `rr` and the angles of `fl` and `fr`.

        Parameters
        ----------
        wheelbase, track : float
            Distances between the axles and between the sides [m].
        axle : tuple of float
            Where the middle of the rear axle is in the body frame [m].
        """
        x, y = length(wheelbase, "wheelbase"), 0.5 * length(track, "track")
        rear = (RollingWheel("rl", 0.0, y), RollingWheel("rr", 0.0, -y))
        front = (
            RollingWheel(name, x, side * y, speed=False, steer=True)
            for name, side in (("fl", 1), ("fr", -1))
        )
        return cls((*rear, *front))._moved(axle)

    @classmethod
    def tricycle(cls, wheelbase: float, axle: tuple[float, float] = (0.0, 0.0)) -> Self:
        """Return a vehicle whose one wheel `front` drives and steers, before an axle that does not.

        Parameters
        ----------
        wheelbase : float
            Distance from the axle to the steered wheel [m].
        axle : tuple of float
            Where the middle of the axle is in the body frame [m].
        """
        front = RollingWheel("front", length(wheelbase, "wheelbase"), 0.0, steer=True)
        return cls((front, RollingWheel("rear", 0.0, 0.0, speed=False)))._moved(axle)

    @property
    def speed_names(self) -> tuple[str, ...]:
        return tuple(wheel.name for wheel in self.wheels if wheel.speed)

    @property
    def steer_names(self) -> tuple[str, ...]:
        return tuple(wheel.name for wheel in self.wheels if wheel.steer)

    @property
    def matrix(self) -> Floats:
        """The matrix (2 k, 3) from a twist to the contact velocities of all wheels."""
        return contact_matrix(self.positions)

    def directions(self, states: WheelStates) -> Floats:
        angle = np.zeros((len(states), len(self.wheels)))
        if states.steer is not None:
            angle[:, self._flags("steer")] = states.steer
        return angle

    def resized(self, factor: float) -> Self:
        return replace(self, wheels=resized(self.wheels, factor))

    def equations(self, states: WheelStates) -> tuple[Floats, Floats]:
        check_states(states, self)
        k, told = len(self.wheels), self._flags("speed")
        angle = self.directions(states)
        c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
        along_x, along_y = self.matrix.reshape(k, 2, 3).swapaxes(0, 1)
        along, across = c * along_x + s * along_y, c * along_y - s * along_x
        matrix = np.concatenate([along[:, told], across], axis=1)
        measured = np.column_stack([states.speed, np.zeros((len(states), k))])
        if not self.steered:
            return matrix[0] if len(matrix) else matrix.reshape(-1, 3), measured
        _rigid.check_rows(matrix, self.positions, np.any(states.speed != 0, axis=1))
        return matrix, measured

    def wheel_states(self, v: ArrayLike, yaw_rate: ArrayLike) -> WheelStates:
        """Return the states of the wheels; they steer by up to 90 deg, and roll either way.

        Raises
        ------
        InputError
            If a wheel that does not steer would slide sideways; see `Omni.wheel_states`.
        """
        contact = _rigid.contact_velocities(self.positions, *check_twist(v, yaw_rate))
        ux, uy = contact[..., 0], contact[..., 1]
        steer = self._flags("steer")
        size = np.hypot(ux, uy)
        slides = np.where(steer, 0.0, np.abs(uy)) > SIDEWAYS * size.max(initial=0.0)
        if slides.any():
            row, wheel = np.argwhere(slides)[0]
            raise InputError(
                f"row {row}: wheel {self.names[wheel]} would slide sideways at"
                f" {abs(uy[row, wheel]):.3g} m/s, which this vehicle cannot: where its axle is at"
                " x, v_y must be -x times the yaw rate"
            )
        angle = np.where(steer & (ux != 0), np.arctan(uy / np.where(ux == 0, 1.0, ux)), 0.0)
        angle = np.where(steer & (ux == 0), np.pi / 2 * np.sign(uy), angle)
        speed = (ux * np.cos(angle) + uy * np.sin(angle))[:, self._flags("speed")]
        return WheelStates(speed, angle[:, steer] if self.steered else None)

    def _flags(self, name: str) -> np.ndarray:
        return np.array([getattr(wheel, name) for wheel in self.wheels])

    def _moved(self, axle: tuple[float, float]) -> Self:
        x, y = (number(value, f"axle {axis}") for axis, value in zip("xy", axle, strict=True))
        return replace(self, wheels=tuple(replace(w, x=w.x + x, y=w.y + y) for w in self.wheels))


_SIDES = ("left", "right")

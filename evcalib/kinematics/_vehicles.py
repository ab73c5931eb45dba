"""The omni-directional vehicles."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from evcalib import checks
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.kinematics import _rigid
from evcalib.kinematics._states import BodyTwist, WheelStates

MAX_REACH = 20.0
"""Wheels (and cameras) farther from the body's origin [m] are taken for a mistake of units: the
largest self-propelled transporters are shorter than twice this."""


@dataclass(frozen=True)
class Wheel:
    """A wheel and where it touches the ground.

    Parameters
    ----------
    name : str
        A word.
    x, y : float
        Position in the body frame [m].
    """

    name: str
    x: float
    y: float

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.isidentifier()):
            raise InputError(f"wheel name {self.name!r} must be a word (letters, digits, _)")
        for field in fields(self)[1:]:
            value = _number(getattr(self, field.name), f"{field.name} of wheel {self.name}")
            object.__setattr__(self, field.name, value)
        _check_reach(max(abs(self.x), abs(self.y)), f"wheel {self.name}")


@dataclass(frozen=True)
class OmniWheel(Wheel):
    """A wheel whose rollers slide sideways.

    Parameters
    ----------
    drive : float
        Direction in which it rolls, from body X towards Y [rad].
    """

    drive: float


class _Vehicle:
    """What the vehicles share: named wheels, a matrix, and its two directions."""

    steered: ClassVar[bool] = False
    wheels: tuple[Wheel, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the wheels, in the order of the columns of `WheelStates`."""
        return tuple(wheel.name for wheel in self.wheels)

    @property
    def positions(self) -> Floats:
        """Contact points [m], shape (k, 2)."""
        return np.array([(wheel.x, wheel.y) for wheel in self.wheels], dtype=np.float64)

    @property
    def matrix(self) -> Floats:
        """The matrix H from a twist (v_x, v_y, omega) to what the wheels measure."""
        raise NotImplementedError

    def twist(self, states: WheelStates) -> BodyTwist:
        """Return the twist that explains the wheel states best.

        Parameters
        ----------
        states : WheelStates
            n rows of k wheels.

        Returns
        -------
        BodyTwist
            v (n, 2) [m/s], yaw rate (n,) [rad/s] and slip (n,) [m/s].

        Raises
        ------
        InputError
            If the number of wheels differs, or angles are missing or superfluous.
        """
        _check_states(states, self)
        return _rigid.solve(self.matrix, states.speed, len(self.wheels))

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
            n rows of k wheels.
        """
        v, yaw_rate = _check_twist(v, yaw_rate)
        return WheelStates(np.column_stack([v, yaw_rate]) @ self.matrix.T)


@dataclass(frozen=True)
class Swerve(_Vehicle):
    """All wheels steer and drive on their own (all-wheel steering, swerve drive).

    Attributes
    ----------
    wheels : tuple of Wheel
        Two or more, anywhere, with different names, not all at one place.
    method : {"least_squares", "average"}
        ``"least_squares"`` fits a rigid body to the contact velocities, so a wheel that runs
        backwards at steering angle a + pi is the same as one that runs forwards at a.

        ``"average"`` is the paper's model of equally steered wheels,
        v = mean(speed) (cos a, sin a) with a the mean steering angle.  It departs from the
        paper's text in three ways: the sine has a plus sign (the text, read as a row vector
        times a matrix, has a minus); angles are averaged on the circle, because the mean of
        179 and -179 deg is 180, not 0; and a wheel that runs backwards counts as one that runs
        forwards at a + pi.  Where the directions cancel (a spin on the spot) there is no mean
        angle and v is 0.  The model knows no rotation, so the yaw rate is that of the least
        squares; gate rows by it, or by slip, where the average does not hold.

    Examples
    --------
    >>> swerve = Swerve((Wheel("front", 0.3, 0.0), Wheel("rear", -0.3, 0.0)))
    >>> states = swerve.wheel_states(v=[[0.0, 0.5]], yaw_rate=[0.0])
    >>> states.speed, np.degrees(states.steer)
    (array([[0.5, 0.5]]), array([[90., 90.]]))
    """

    wheels: tuple[Wheel, ...]
    method: str = "least_squares"
    steered: ClassVar[bool] = True

    def __post_init__(self) -> None:
        checks.one_of(self.method, "method", ("least_squares", "average"))
        object.__setattr__(self, "wheels", _check_wheels(self.wheels, 2, Wheel))
        _rigid.check_observable(self.matrix, self.positions)

    @property
    def matrix(self) -> Floats:
        """The matrix H, shape (2 k, 3): rows (1, 0, -y) and (0, 1, x) for each wheel."""
        x, y = self.positions.T
        one, zero = np.ones_like(x), np.zeros_like(x)
        rows = np.stack([np.stack([one, zero, -y], axis=1), np.stack([zero, one, x], axis=1)], 1)
        return rows.reshape(-1, 3)

    def twist(self, states: WheelStates) -> BodyTwist:
        _check_states(states, self)
        speed, steer = states.speed, states.steer
        assert steer is not None
        contact = np.stack([speed * np.cos(steer), speed * np.sin(steer)], axis=2)
        measured = contact.reshape(len(states), -1)
        fit = _rigid.solve(self.matrix, measured, len(self.wheels))
        if self.method == "least_squares":
            return fit
        twist = np.column_stack([_average(speed, steer), fit.yaw_rate])
        return _rigid.with_slip(self.matrix, measured, twist, len(self.wheels))

    def wheel_states(self, v: ArrayLike, yaw_rate: ArrayLike) -> WheelStates:
        """Return the states of the wheels, all running forwards; see `_Vehicle.wheel_states`.

        A wheel that stands still has angle 0.  Both methods share this inverse.
        """
        contact = _rigid.contact_velocities(self.positions, *_check_twist(v, yaw_rate))
        ux, uy = contact[..., 0], contact[..., 1]
        return WheelStates(np.hypot(ux, uy), np.arctan2(uy, ux))


@dataclass(frozen=True)
class Mecanum(_Vehicle):
    """Four wheels at a rectangle, rollers at 45 degrees, wheels named fl, fr, rl, rr.

    With a = half_length + half_width the rim speeds are (Lynch & Park, Modern Robotics, 13.2)

        fl = v_x - v_y - a omega        fr = v_x + v_y + a omega
        rl = v_x + v_y - a omega        rr = v_x - v_y + a omega

    for the usual mounting, where the rollers seen from above form an X.  Four speeds determine
    three unknowns; the slip is ``|fl + fr - rl - rr| / 4``.

    Attributes
    ----------
    half_length, half_width : float
        Distance [m] of the contact points from the body's origin along X and along Y.

    Examples
    --------
    >>> mecanum = Mecanum(half_length=0.3, half_width=0.2)
    >>> states = mecanum.wheel_states(v=[[1.0, 0.5]], yaw_rate=[0.2])
    >>> mecanum.names, states.speed
    (('fl', 'fr', 'rl', 'rr'), array([[0.4, 1.6, 1.4, 0.6]]))
    >>> mecanum.twist(states).v.round(6)
    array([[1. , 0.5]])
    """

    half_length: float
    half_width: float

    def __post_init__(self) -> None:
        for name in ("half_length", "half_width"):
            value = checks.positive(getattr(self, name), name, "m")
            _check_reach(value, name)
            object.__setattr__(self, name, value)

    @property
    def wheels(self) -> tuple[Wheel, ...]:  # type: ignore[override]
        """The four wheels, from the two lengths."""
        x, y = self.half_length, self.half_width
        corners = {"fl": (x, y), "fr": (x, -y), "rl": (-x, y), "rr": (-x, -y)}
        return tuple(Wheel(name, *corner) for name, corner in corners.items())

    @property
    def matrix(self) -> Floats:
        """The matrix H, shape (4, 3)."""
        a = self.half_length + self.half_width
        return np.array([[1, -1, -a], [1, 1, a], [1, 1, -a], [1, -1, a]], dtype=np.float64)


@dataclass(frozen=True)
class Omni(_Vehicle):
    """Three or more omni wheels (kiwi drive and its relatives), anywhere, driving anywhere.

    A wheel at (x, y) that rolls in direction b has the rim speed
    v_x cos b + v_y sin b + omega (x sin b - y cos b) (Lynch & Park, Modern Robotics, 13.2, with
    rollers at 90 degrees).  With three wheels every reading is some motion: the slip is 0.

    Attributes
    ----------
    wheels : tuple of OmniWheel
        Three or more, with different names, that together measure every motion.

    Examples
    --------
    >>> around = {"a": 0.0, "b": 2 * np.pi / 3, "c": -2 * np.pi / 3}
    >>> wheels = [OmniWheel(n, np.cos(a), np.sin(a), a + np.pi / 2) for n, a in around.items()]
    >>> Omni(tuple(wheels)).wheel_states(v=[[0.0, 0.0]], yaw_rate=[0.5]).speed.round(6)
    array([[0.5, 0.5, 0.5]])
    """

    wheels: tuple[OmniWheel, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "wheels", _check_wheels(self.wheels, 3, OmniWheel))
        _rigid.check_observable(self.matrix, self.positions)

    @property
    def matrix(self) -> Floats:
        """The matrix H, shape (k, 3)."""
        x, y = self.positions.T
        drive = np.array([wheel.drive for wheel in self.wheels])
        c, s = np.cos(drive), np.sin(drive)
        return np.stack([c, s, x * s - y * c], axis=1)


Vehicle = Swerve | Mecanum | Omni


def _average(speed: Floats, steer: Floats) -> Floats:
    """Return mean speed times (cos, sin) of the circular mean angle, shape (n, 2)."""
    forwards = np.where(speed < 0, -1.0, 1.0)
    x, y = (forwards * np.cos(steer)).mean(axis=1), (forwards * np.sin(steer)).mean(axis=1)
    length = np.hypot(x, y)
    scale = np.abs(speed).mean(axis=1) / np.where(length > 1e-9, length, np.inf)
    return np.column_stack([scale * x, scale * y])


def _check_wheels(wheels: Iterable[Wheel], least: int, kind: type[Wheel]) -> tuple[Wheel, ...]:
    wheels = tuple(wheels)
    for wheel in wheels:
        if not isinstance(wheel, kind):
            raise InputError(f"wheels must be {kind.__name__} objects, not {wheel!r}")
    names = [wheel.name for wheel in wheels]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"wheel {twice[0]} is given twice; every wheel needs its own name")
    if len(wheels) < least:
        raise InputError(f"at least {least} wheels are needed, not {len(wheels)}")
    return wheels


def _check_reach(distance: float, what: str) -> None:
    if distance > MAX_REACH:
        raise InputError(
            f"{what} is {distance:g} m from the body's origin, over {MAX_REACH:g} m; are lengths in"
            " metres (not millimetres)?"
        )


def _number(value: object, name: str) -> float:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{name} must be a finite number, not {value!r}")
    return number


def _check_states(states: WheelStates, vehicle: _Vehicle) -> None:
    names = ", ".join(vehicle.names)
    if states.speed.shape[1] != len(vehicle.wheels):
        raise InputError(f"{states.speed.shape[1]} wheel speeds, but the wheels are {names}")
    if vehicle.steered != (states.steer is not None):
        want = "needs the steering angles" if vehicle.steered else "has no steering angles"
        raise InputError(f"a {type(vehicle).__name__.lower()} vehicle {want} of {names}")


def _check_twist(v: ArrayLike, yaw_rate: ArrayLike) -> tuple[Floats, Floats]:
    velocity = checks.floats(v, "v", (None, 2))
    return velocity, checks.floats(yaw_rate, "yaw_rate", (velocity.shape[0],))

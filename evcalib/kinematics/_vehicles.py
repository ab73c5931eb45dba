"""The omni-directional vehicles."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from evcalib import checks
from evcalib.arrays import Floats
from evcalib.kinematics import _rigid
from evcalib.kinematics._base import VehicleBase, check_states, check_twist, contact_matrix
from evcalib.kinematics._states import BodyTwist, WheelStates
from evcalib.kinematics._wheels import MIN_SPAN, OmniWheel, Wheel, check_wheels, length, resized


@dataclass(frozen=True)
class Swerve(VehicleBase):
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

    def __post_init__(self) -> None:
        checks.one_of(self.method, "method", ("least_squares", "average"))
        object.__setattr__(self, "wheels", check_wheels(self.wheels, 2, Wheel))
        _rigid.check_observable(self.matrix, self.positions)

    @property
    def matrix(self) -> Floats:
        """The matrix H, shape (2 k, 3): rows (1, 0, -y) and (0, 1, x) for each wheel."""
        return contact_matrix(self.positions)

    @property
    def steer_names(self) -> tuple[str, ...]:
        return self.names

    def directions(self, states: WheelStates) -> Floats:
        check_states(states, self)
        assert states.steer is not None
        return states.steer

    def resized(self, factor: float) -> Self:
        return replace(self, wheels=resized(self.wheels, factor))

    def equations(self, states: WheelStates) -> tuple[Floats, Floats]:
        check_states(states, self)
        speed, steer = states.speed, states.steer
        assert steer is not None
        contact = np.stack([speed * np.cos(steer), speed * np.sin(steer)], axis=2)
        return self.matrix, contact.reshape(len(states), -1)

    def twist(self, states: WheelStates) -> BodyTwist:
        matrix, measured = self.equations(states)
        fit = _rigid.solve(matrix, measured, len(self.wheels))
        if self.method == "least_squares":
            return fit
        assert states.steer is not None
        twist = np.column_stack([_average(states.speed, states.steer), fit.yaw_rate])
        return _rigid.with_slip(matrix, measured, twist, len(self.wheels))

    def wheel_states(self, v: ArrayLike, yaw_rate: ArrayLike) -> WheelStates:
        """Return the states of the wheels, all running forwards; see `Omni.wheel_states`.

        A wheel that stands still has angle 0.  Both methods share this inverse.
        """
        contact = _rigid.contact_velocities(self.positions, *check_twist(v, yaw_rate))
        ux, uy = contact[..., 0], contact[..., 1]
        return WheelStates(np.hypot(ux, uy), np.arctan2(uy, ux))


@dataclass(frozen=True)
class Mecanum(VehicleBase):
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
            object.__setattr__(self, name, length(getattr(self, name), name, MIN_SPAN / 2))

    @property
    def wheels(self) -> tuple[Wheel, ...]:  # type: ignore[override]
        """The four wheels, from the two lengths."""
        x, y = self.half_length, self.half_width
        corners = {"fl": (x, y), "fr": (x, -y), "rl": (-x, y), "rr": (-x, -y)}
        return tuple(Wheel(name, *corner) for name, corner in corners.items())

    def resized(self, factor: float) -> Self:
        return replace(
            self, half_length=factor * self.half_length, half_width=factor * self.half_width
        )

    @property
    def matrix(self) -> Floats:
        """The matrix H, shape (4, 3)."""
        a = self.half_length + self.half_width
        return np.array([[1, -1, -a], [1, 1, a], [1, 1, -a], [1, -1, a]], dtype=np.float64)


@dataclass(frozen=True)
class Omni(VehicleBase):
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
        object.__setattr__(self, "wheels", check_wheels(self.wheels, 3, OmniWheel))
        _rigid.check_observable(self.matrix, self.positions)

    def directions(self, states: WheelStates) -> Floats:
        return np.tile([wheel.drive for wheel in self.wheels], (len(states), 1))

    def resized(self, factor: float) -> Self:
        return replace(self, wheels=resized(self.wheels, factor))

    @property
    def matrix(self) -> Floats:
        """The matrix H, shape (k, 3)."""
        x, y = self.positions.T
        drive = np.array([wheel.drive for wheel in self.wheels])
        c, s = np.cos(drive), np.sin(drive)
        return np.stack([c, s, x * s - y * c], axis=1)


def _average(speed: Floats, steer: Floats) -> Floats:
    """Return mean speed times (cos, sin) of the circular mean angle, shape (n, 2)."""
    forwards = np.where(speed < 0, -1.0, 1.0)
    x, y = (forwards * np.cos(steer)).mean(axis=1), (forwards * np.sin(steer)).mean(axis=1)
    length = np.hypot(x, y)
    scale = np.abs(speed).mean(axis=1) / np.where(length > 1e-9, length, np.inf)
    return np.column_stack([scale * x, scale * y])

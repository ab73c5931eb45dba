"""Drives of legs that a vehicle can make, as large and as fast as a space and a time allow.

A leg is a constant twist of the pivot: a straight line, an arc, a turn on the spot, or standing
still.  The moving mean of the twists makes a drive of them (as in `evcalib.design.waypoints`): legs
blend into each other, and the curvature stays between those of two legs that go the same way.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import NamedTuple, Self

import numpy as np
from scipy.integrate import cumulative_trapezoid

from evcalib import checks
from evcalib.arrays import Floats
from evcalib.design.waypoints import RATE
from evcalib.errors import InputError
from evcalib.geometry import turned_by_yaw
from evcalib.kinematics import RollingWheel, Vehicle
from evcalib.series import VelocitySeries

RESERVE = 0.005
"""Free space that is left on all sides together [m], and the share of the limits that is left, for
what lies between samples."""

ROUND = np.array([1.0, 0.5])
"""A vehicle told by one axle is taken to be as long as it is wide, one told by wheels in its middle
half as wide as long: a choice."""

LEAST_SIZE = 0.02
"""Legs are at least so long [m]."""


@dataclass(frozen=True)
class Limits:
    """What a drive keeps to.

    Attributes
    ----------
    speed : float
        No corner of the vehicle is faster [m/s].
    acceleration : float
        No corner accelerates by more, curves included [m/s^2].
    yaw_rate : float
        Largest yaw rate [rad/s].
    steering : float
        Largest angle of a steered wheel [rad] of a vehicle with an axle that does not steer.
    margin : float
        How far the vehicle reaches beyond its wheels, on all sides [m]; see `ROUND`.
    """

    speed: float = 0.5
    acceleration: float = 0.5
    yaw_rate: float = float(np.radians(45.0))
    steering: float = float(np.radians(30.0))
    margin: float = 0.1

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            (checks.at_least_zero if field.name == "margin" else checks.positive)(value, field.name)
        if self.steering >= np.pi / 2:
            raise InputError(
                f"steering must be below 90 deg, not {np.degrees(self.steering):g} deg"
            )


USUAL_LIMITS = Limits()
"""Of a small robot indoors: a choice."""


class Legs(NamedTuple):
    """Legs at unit speed and unit size: how long each lasts, its twist, the time of a blend."""

    lasts: Floats
    twist: Floats
    blend: float

    @property
    def starts(self) -> Floats:
        """When each begins to blend in, and when all ends."""
        return np.append(0.0, np.cumsum(self.lasts))

    @property
    def end(self) -> float:
        return float(self.lasts.sum()) + self.blend

    @property
    def times(self) -> Floats:
        """Times that hold all at which blends begin and end, and at least eight in each."""
        even = np.linspace(0.0, self.end, int(np.ceil(8 * self.end / self.blend)) + 1)
        t = np.sort(np.concatenate([even, self.starts, self.starts + self.blend]))
        return t[np.diff(t, prepend=-1.0) > 1e-6]

    def at(self, t: Floats) -> Floats:
        """Return the twists at times, shape (n, 3)."""
        knots = self.blend / 2 + self.starts
        gone = np.vstack([np.zeros(3), np.cumsum(self.lasts[:, None] * self.twist, axis=0)])
        ends = [
            np.stack([np.interp(t + side * self.blend / 2, knots, one) for one in gone.T], axis=1)
            for side in (-1, 1)
        ]
        return np.asarray((ends[1] - ends[0]) / self.blend)


class Driven(NamedTuple):
    """A drive, where the body's origin starts in the space, and the size and slowness of legs."""

    velocities: VelocitySeries
    start: Floats
    size: float
    slowness: float


@dataclass(frozen=True, eq=False)
class Ground:
    """A vehicle in a space.

    Attributes
    ----------
    space : ndarray, shape (2,)
        Length and width [m].
    limits : Limits
        What a drive keeps to.
    pivot : ndarray, shape (3,)
        The point of the body that the legs move [m].
    points : ndarray, shape (5, 3)
        The corners of the vehicle and the pivot, from the pivot [m].
    strafes : bool
        Whether it drives in all directions.
    least_radius : float
        Of the curves of its pivot [m].
    facings : tuple of float
        How it may stand in the space at first: angles from its length [rad].
    """

    space: Floats
    limits: Limits
    pivot: Floats
    points: Floats
    strafes: bool
    least_radius: float
    facings: tuple[float, ...]

    @classmethod
    def of(cls, vehicle: Vehicle, space: tuple[float, float], limits: Limits) -> Self:
        """Return a vehicle in a space; refuse one that does not fit."""
        room = np.array([checks.positive(side, "space", "m") for side in space])
        places = vehicle.positions
        half, middle = 0.5 * np.ptp(places, axis=0), 0.5 * (places.min(axis=0) + places.max(axis=0))
        half = np.where(half > 0, half, half[::-1] * ROUND) + limits.margin
        low, high = middle - half, middle + half
        rolling = [w for w in vehicle.wheels if isinstance(w, RollingWheel)]
        axle = [wheel.x for wheel in rolling if not wheel.steer]
        pivot = np.array([axle[0], middle[1]]) if axle else middle
        steered = np.array([(w.x, w.y) for w in rolling if w.steer]).reshape(-1, 2) - pivot
        across = np.abs(steered) @ [1 / np.tan(limits.steering), 1.0]
        corners = [(x, y) for x in (low[0], high[0]) for y in (low[1], high[1])] - pivot
        points = np.column_stack([np.vstack([corners, np.zeros(2)]), np.zeros(5)])
        found = cls(
            room,
            limits,
            np.append(pivot, 0.0),
            points,
            not axle,
            float(np.max(across, initial=0.0)) if axle else 0.0,
            (),
        )
        ways = np.radians([0.0, 90.0, 45.0])
        facings = tuple(float(way) for way in ways if found._fits(np.zeros((1, 3)), way[None]))
        if not facings:
            length, width = high - low
            raise InputError(
                f"the vehicle takes up {length:.2f} x {width:.2f} m, with a margin of"
                f" {limits.margin:g} m around its wheels: it does not fit into {room[0]:g} x"
                f" {room[1]:g} m; find more space"
            )
        return replace(found, facings=facings)

    def drive(self, legs: Legs, facing: float, time: float) -> Driven | None:
        """Return the largest drive of these legs that fits into the space and the time, if any."""
        t = legs.times
        twist = legs.at(t)
        # Between two times the twist changes evenly; both ends of it count.
        change = np.tile(np.diff(twist, axis=0) / np.diff(t)[:, None], (2, 1))
        ends = np.concatenate([twist[:-1], twist[1:]])
        yaw = facing + cumulative_trapezoid(twist[:, 2], t, initial=0.0)
        flat = twist * [1.0, 1.0, 0.0]
        place = cumulative_trapezoid(turned_by_yaw(flat, yaw), t, axis=0, initial=0.0)

        def slowness(size: float) -> float:
            return self._slowness(ends, change, size)

        def possible(size: float) -> bool:
            return slowness(size) * legs.end <= time and self._fits(size * place, yaw)

        low, high = max(self._least_size(legs), LEAST_SIZE), 2.0 * float(self.space.max())
        if low > high or not possible(low):
            return None
        for _ in range(20):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if possible(middle) else (low, middle)
        slow = slowness(low)
        drive = self._velocities(legs, low, slow)
        world = low * place + turned_by_yaw(self.points[:, None], yaw)
        corner = world[..., :2].min(axis=(0, 1))
        origin = turned_by_yaw(-self.pivot, np.array(facing))[:2]
        spare = 0.5 * (self.space - np.ptp(world[..., :2], axis=(0, 1)))
        return Driven(drive, origin - corner + spare, low, slow)

    def _velocities(self, legs: Legs, size: float, slowness: float) -> VelocitySeries:
        """Return the velocities of the body's origin, at rest at the end."""
        t = np.arange(0.0, legs.end * slowness + 1 / RATE, 1 / RATE)
        twist = legs.at(t / slowness) / slowness
        v = size * twist * [1.0, 1.0, 0.0]
        v -= twist[:, 2:] * np.cross([0.0, 0.0, 1.0], self.pivot)
        return VelocitySeries(t, v + 0.0, twist[:, 2])

    def _least_size(self, legs: Legs) -> float:
        """Return from which size on no leg turns more tightly than the vehicle can."""
        speed = np.hypot(*legs.twist[:, :2].T)
        turning = np.abs(legs.twist[:, 2])
        tight = turning > 0
        if not self.least_radius or not tight.any():
            return 0.0
        with np.errstate(divide="ignore"):
            return float(self.least_radius * np.max(turning[tight] / speed[tight]))

    def _slowness(self, twist: Floats, change: Floats, size: float) -> float:
        """Return by how much a drive must be slowed down to keep to the limits."""
        rate, turned = twist[:, 2], np.cross([0.0, 0.0, 1.0], self.points)
        v = size * twist * [1.0, 1.0, 0.0]
        bend = rate[:, None] * np.cross([0.0, 0.0, 1.0], v)
        speed = v[:, None] + rate[:, None, None] * turned
        pull = (size * change * [1.0, 1.0, 0.0] + bend)[:, None]
        pull = pull + change[:, 2, None, None] * turned - rate[:, None, None] ** 2 * self.points
        limits = self.limits
        fastest = np.linalg.norm(speed, axis=-1).max() / limits.speed
        hardest = np.sqrt(np.linalg.norm(pull, axis=-1).max() / limits.acceleration)
        return float((1 + RESERVE) * max(fastest, hardest, np.abs(rate).max() / limits.yaw_rate))

    def _fits(self, place: Floats, yaw: Floats) -> bool:
        """Tell whether all corners stay in the space."""
        world = place + turned_by_yaw(self.points[:, None], yaw)
        return bool((np.ptp(world[..., :2], axis=(0, 1)) <= self.space - RESERVE).all())

"""Drives: the direction and the speed of a body as functions of time, and plans to compare.

Nothing here is random; drives that are drawn from a seed are in `random_drives`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from evcalib import checks
from evcalib.arrays import Floats, Integers
from evcalib.errors import InputError


@dataclass(frozen=True)
class Drive:
    """A planar drive, exact at any time.

    Attributes
    ----------
    kind : str
        Name of the motion.
    duration : float
        Length of the drive [s]; it runs over body times 0 to `duration`.
    angle : callable
        Direction of travel in the body frame [rad] at times [s].
    speed : callable
        Speed [m/s] at times [s].
    yaw_rate : callable
        Rotation rate of the body [rad/s] at times [s].
    """

    kind: str
    duration: float
    angle: Callable[[Floats], Floats]
    speed: Callable[[Floats], Floats]
    yaw_rate: Callable[[Floats], Floats] = field(default=lambda t: np.zeros_like(t))

    def velocity(self, t: Floats) -> Floats:
        """Return the body velocity [m/s] at times `t` [s], shape (n, 3)."""
        t = np.asarray(t, dtype=np.float64)
        angle, speed = self.angle(t), self.speed(t)
        return np.stack([speed * np.cos(angle), speed * np.sin(angle), np.zeros_like(t)], axis=-1)


def straight(duration: float = 20.0, *, heading: float = 0.0, speed: float = 1.0) -> Drive:
    """Return a straight drive in direction `heading` [rad]."""
    return Drive("straight", duration, lambda t: np.full_like(t, heading), _constant(speed))


def arc(
    duration: float = 20.0, *, radius: float = 4.0, heading: float = 0.0, speed: float = 1.0
) -> Drive:
    """Return an arc of `radius` [m] at constant speed: the direction turns at speed / radius."""
    rate = speed / radius
    return Drive("arc", duration, lambda t: heading + rate * t, _constant(speed))


def s_curve(
    duration: float = 20.0,
    *,
    amplitude: float = np.pi / 4,
    period: float = 8.0,
    heading: float = 0.0,
    phase: float = 0.0,
    speed: float = 1.0,
) -> Drive:
    """Return an S-curve: the direction swings by +-`amplitude` [rad] with `period` [s]."""
    rate = 2 * np.pi / checks.positive(period, "period", "seconds")
    return Drive(
        "s-curve",
        duration,
        lambda t: heading + amplitude * np.sin(rate * t + phase),
        _constant(speed),
    )


def polyline(
    duration: float = 20.0,
    *,
    turn: float = np.pi / 4,
    side: float = 3.0,
    heading: float = 0.0,
    turn_time: float = 0.0,
    speed: float = 1.0,
) -> Drive:
    """Return a polygon: straight sides of `side` [s], each turned by `turn` [rad] from the last.

    `turn_time` [s] spreads each turn smoothly around its instant; 0 turns at once.
    """
    knots = np.arange(side, duration, checks.positive(side, "side", "seconds"))
    levels = heading + turn * np.arange(knots.size + 1)
    return Drive("polyline", duration, _steps(knots, levels, turn_time), _constant(speed))


def zigzag(
    duration: float = 20.0,
    *,
    turn: float = np.pi / 4,
    side: float = 3.0,
    heading: float = 0.0,
    turn_time: float = 0.0,
    speed: float = 1.0,
) -> Drive:
    """Return a zigzag: sides of `side` [s] whose directions alternate by `turn` [rad]."""
    knots = np.arange(side, duration, checks.positive(side, "side", "seconds"))
    levels = heading + turn * (np.arange(knots.size + 1) % 2 - 0.5)
    return Drive("zigzag", duration, _steps(knots, levels, turn_time), _constant(speed))


def fingers(
    angles: Sequence[float] = (0.0, np.pi / 3, -np.pi / 3),
    *,
    out: float = 2.0,
    pause: float = 0.5,
    speed: float = 1.0,
    duration: float | None = None,
) -> Drive:
    """Return fingers: for each of `angles` [rad], `out` seconds out, a pause, `out` seconds back.

    The speed rises and falls as a raised cosine and is zero in the pauses (as in the paper).  They
    take as long as they take, or `duration` seconds; the last one is cut short then.
    """
    if not len(angles):
        raise InputError("fingers need at least one angle")
    leg = out + pause
    directions = np.array([a + back for a in angles for back in (0.0, np.pi)])

    def index(t: Floats) -> Integers:
        return np.clip((t // leg).astype(np.int64), 0, directions.size - 1)

    def profile(t: Floats) -> Floats:
        inside = np.clip((t - index(t) * leg) / out, 0.0, 1.0)
        rise = np.minimum(1.0, 2.0 * np.sin(np.pi * inside) ** 2)
        return np.where(inside < 1.0, speed * rise, 0.0)

    length = leg * directions.size if duration is None else duration
    return Drive("fingers", length, lambda t: directions[index(t)], profile)


def _constant(value: float) -> Callable[[Floats], Floats]:
    return lambda t: np.full_like(t, value)


def _steps(knots: NDArray, levels: NDArray, turn_time: float) -> Callable[[Floats], Floats]:
    """Return a staircase of angles whose steps take `turn_time` seconds each."""
    if turn_time < 0:
        raise InputError(f"turn_time must not be negative, not {turn_time}")

    def angle(t: Floats) -> Floats:
        if turn_time == 0:
            return levels[np.searchsorted(knots, t, side="right")]
        u = np.clip((t[..., None] - knots) / turn_time + 0.5, 0.0, 1.0)
        return levels[0] + (u * u * (3 - 2 * u)) @ np.diff(levels)

    return angle


Plan = Callable[[float, float, float, float], Drive]
"""Makes a drive of a swing [deg], a period [s], a speed [m/s] and a duration [s]."""


def _s_curve(swing: float, period: float, speed: float, duration: float) -> Drive:
    return s_curve(duration, amplitude=np.radians(swing), period=period, speed=speed)


def _fingers(swing: float, period: float, speed: float, duration: float) -> Drive:
    """Go out and back along three directions; the last finger may be cut short."""
    out = 0.4 * period
    pause = 0.1 * period
    count = int(np.ceil(duration / period))
    angles = np.radians(swing) * np.array([0.0, 1.0, -1.0])
    spread = [angles[k % 3] for k in range(count)]
    return fingers(spread, out=out, pause=pause, speed=speed, duration=duration)


def _zigzag(swing: float, period: float, speed: float, duration: float) -> Drive:
    """Go left and right by the swing, with turns that take a fifth of a side."""
    side = 0.5 * period
    turn = 2.0 * np.radians(swing)
    return zigzag(duration, turn=turn, side=side, turn_time=0.2 * side, speed=speed)


def _arc(swing: float, period: float, speed: float, duration: float) -> Drive:
    """Turn by the swing in a quarter of the period, as the S-curve does on average."""
    rate = np.radians(swing) / (0.25 * period)
    if rate == 0:
        return _straight(swing, period, speed, duration)
    return arc(duration, radius=speed / rate, speed=speed)


def _straight(swing: float, period: float, speed: float, duration: float) -> Drive:
    return straight(duration, heading=np.radians(swing), speed=speed)


FASTEST, LEAST = 3.0, 5.0
"""Plans turn by at most so much [rad/s]; one that turns in place, by at least so much [deg]."""


def _turning(rate: Callable[[Floats], Floats], kind: str, speed: float, duration: float) -> Drive:
    """Drive ahead at a speed that swings by a third, and turn."""
    swings = 2 * np.pi / 7.0

    def profile(t: Floats) -> Floats:
        return speed * (1 + np.sin(swings * t) / 3) / (4 / 3)

    return Drive(kind, duration, lambda t: np.zeros_like(t), profile, rate)


def _eight(swing: float, period: float, speed: float, duration: float) -> Drive:
    """Turn by four times the swing to one side in half a period, and back."""
    rate = 2 * np.pi / period
    peak = min(2 * np.radians(swing) * rate, FASTEST)
    return _turning(lambda t: peak * np.sin(rate * t), "figure-eight", speed, duration)


def _slalom(swing: float, period: float, speed: float, duration: float) -> Drive:
    """Let the heading swing by the swing to either side."""
    rate = 2 * np.pi / period
    peak = min(np.radians(swing) * rate, FASTEST)
    return _turning(lambda t: peak * np.cos(rate * t), "slalom", speed, duration)


def _in_place(swing: float, period: float, speed: float, duration: float) -> Drive:
    """Turn on the spot, by the swing to either side; the speed says nothing."""
    plan = _slalom(max(swing, LEAST), period, speed, duration)
    return Drive(
        "turning in place", duration, plan.angle, lambda t: np.zeros_like(t), plan.yaw_rate
    )


def _parking(swing: float, period: float, speed: float, duration: float) -> Drive:
    """Go to and fro, each way in half a period, turning by the swing to one side, then the other.

    Backwards with the other lock, so that every leg turns the body on, as a car that parks.
    """
    rate = 2 * np.pi / period
    peak = min(np.radians(swing) * rate / 2, FASTEST)

    def profile(t: Floats) -> Floats:
        return speed * np.sin(rate * t)

    def yaw_rate(t: Floats) -> Floats:
        return peak * np.abs(np.sin(rate * t)) * np.sign(np.sin(rate * t / 4))

    return Drive("parking", duration, lambda t: np.zeros_like(t), profile, yaw_rate)


PLANS: dict[str, Plan] = {
    "S-curve": _s_curve,
    "fingers": _fingers,
    "zigzag": _zigzag,
    "arc": _arc,
    "straight": _straight,
    "figure-eight": _eight,
    "slalom": _slalom,
    "turning in place": _in_place,
    "parking": _parking,
}

"""Synthetic drives of an omni-directional vehicle, and the two noisy streams that they leave.

A :class:`Drive` is exact: a body velocity for any time.  :func:`simulate` samples it on two
clocks, with the noise, gaps, offset and rotation asked for, and keeps the truth beside the streams.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from evcalib import _check
from evcalib.errors import InputError
from evcalib.geometry import random_rotation
from evcalib.series import HeadingSeries, VelocitySeries

Floats = NDArray[np.float64]


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
    rate = 2 * np.pi / _check.positive(period, "period", "seconds")
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
    knots = np.arange(side, duration, _check.positive(side, "side", "seconds"))
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
    knots = np.arange(side, duration, _check.positive(side, "side", "seconds"))
    levels = heading + turn * (np.arange(knots.size + 1) % 2 - 0.5)
    return Drive("zigzag", duration, _steps(knots, levels, turn_time), _constant(speed))


def fingers(
    angles: Sequence[float] = (0.0, np.pi / 3, -np.pi / 3),
    *,
    out: float = 2.0,
    pause: float = 0.5,
    speed: float = 1.0,
) -> Drive:
    """Return fingers: for each of `angles` [rad], `out` seconds out, a pause, `out` seconds back.

    The speed rises and falls as a raised cosine and is zero in the pauses (as in the paper).
    """
    if not len(angles):
        raise InputError("fingers need at least one angle")
    leg = out + pause
    directions = np.array([a + back for a in angles for back in (0.0, np.pi)])

    def index(t: Floats) -> NDArray[np.int64]:
        return np.clip((t // leg).astype(np.int64), 0, directions.size - 1)

    def profile(t: Floats) -> Floats:
        inside = np.clip((t - index(t) * leg) / out, 0.0, 1.0)
        rise = np.minimum(1.0, 2.0 * np.sin(np.pi * inside) ** 2)
        return np.where(inside < 1.0, speed * rise, 0.0)

    return Drive("fingers", leg * directions.size, lambda t: directions[index(t)], profile)


@dataclass(frozen=True)
class Noise:
    """What spoils a stream.

    Attributes
    ----------
    sigma : float
        Standard deviation per axis, of a unit direction (headings) or in m/s (velocities).
    rho : float
        Correlation of the noise from one sample to the next, AR(1), in [0, 1).
    outliers : float
        Share of samples replaced.
    cluster : bool
        Outliers come uniform over all directions, or (True) all near one direction.
    flips : float
        Share of samples whose sign is turned.
    dropout : float
        Share of samples lost.
    gaps : tuple of (float, float)
        Intervals [s] of body time without any sample.
    """

    sigma: float = 0.0
    rho: float = 0.0
    outliers: float = 0.0
    cluster: bool = False
    flips: float = 0.0
    dropout: float = 0.0
    gaps: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        for name in ("rho", "outliers", "flips", "dropout"):
            if not 0 <= getattr(self, name) <= 1:
                raise InputError(f"{name} is a share between 0 and 1, not {getattr(self, name)}")
        if not 0 <= self.sigma < np.inf or self.rho == 1:
            raise InputError("sigma must be finite and not negative, and rho must be below 1")


@dataclass(frozen=True)
class SyntheticStreams:
    """Two streams of one drive, with the truth behind them."""

    headings: HeadingSeries
    velocities: VelocitySeries
    R_body_cam: Floats
    offset: float
    drive: Drive


def simulate(
    drive: Drive,
    rng: np.random.Generator,
    *,
    offset: float = 0.0,
    R_body_cam: Floats | None = None,
    heading_rate: float = 30.0,
    velocity_rate: float = 50.0,
    heading_noise: Noise = Noise(),
    velocity_noise: Noise = Noise(),
) -> SyntheticStreams:
    """Sample a drive with a camera and an odometry, each on its own clock and phase.

    Parameters
    ----------
    drive : Drive
        The true motion, on the body clock.
    rng : numpy.random.Generator
        Source of all randomness.
    offset : float
        ``t_body = t_cam + offset`` [s].
    R_body_cam : ndarray, shape (3, 3), optional
        Rotation of the camera against the body; drawn uniformly if not given.
    heading_rate, velocity_rate : float
        Samples per second of each stream; the phase of each is random.
    heading_noise, velocity_noise : Noise
        What spoils each stream.

    Returns
    -------
    SyntheticStreams
        Headings exist where the vehicle moves; velocities cover the whole drive.

    Examples
    --------
    >>> made = simulate(s_curve(10), np.random.default_rng(1), offset=0.2)
    >>> len(made.headings), len(made.velocities), made.offset
    (300, 500, 0.2)
    """
    R = random_rotation(rng) if R_body_cam is None else np.asarray(R_body_cam, dtype=np.float64)

    t_body = _sample_times(drive.duration, heading_rate, heading_noise, rng)
    v = drive.velocity(t_body)
    speed = np.linalg.norm(v, axis=1)
    moving = speed > 0.05 * max(float(speed.max(initial=0.0)), 1e-12)
    t_body, v = t_body[moving], v[moving] / speed[moving, None]
    headings = _spoil_directions(v @ R, heading_noise, rng)

    t_odo = _sample_times(drive.duration, velocity_rate, velocity_noise, rng)
    velocities = _spoil_velocities(drive.velocity(t_odo), velocity_noise, rng)
    return SyntheticStreams(
        headings=HeadingSeries(t_body - offset, headings),
        velocities=VelocitySeries(t_odo, velocities, drive.yaw_rate(t_odo)),
        R_body_cam=R,
        offset=float(offset),
        drive=drive,
    )


def wobble(rng: np.random.Generator, largest: float) -> Callable[[Floats], Floats]:
    """Return a yaw rate [rad/s] of two sines with periods of 2 to 7 s, `largest` at most."""
    rate, phase = 2 * np.pi / rng.uniform(2.0, 7.0, 2), rng.uniform(0, 2 * np.pi, 2)
    return lambda t: 0.5 * largest * np.sin(np.multiply.outer(t, rate) + phase).sum(axis=-1)


def dead_reckon(velocities: VelocitySeries) -> Floats:
    """Integrate body velocities and yaw rates to positions [m], shape (n, 3) (paper Eq. 13).

    The trapezoidal rule is used, where the paper has a rectangle; the heading starts at zero.
    """
    dt = np.diff(velocities.t)
    yaw = np.zeros(len(velocities))
    if velocities.yaw_rate is not None:
        rate = velocities.yaw_rate
        yaw[1:] = np.cumsum(0.5 * (rate[1:] + rate[:-1]) * dt)
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, z = velocities.v.T
    world = np.stack([c * x - s * y, s * x + c * y, z], axis=1)
    position = np.zeros_like(world)
    position[1:] = np.cumsum(0.5 * (world[1:] + world[:-1]) * dt[:, None], axis=0)
    return position


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


def _sample_times(duration: float, rate: float, noise: Noise, rng: np.random.Generator) -> Floats:
    step = 1.0 / _check.positive(rate, "rate", "samples per second")
    t = np.arange(rng.uniform(0, step), duration, step)
    keep = rng.random(t.size) >= noise.dropout
    for start, end in noise.gaps:
        keep &= (t < start) | (t > end)
    return t[keep]


def _coloured(shape: tuple[int, int], noise: Noise, rng: np.random.Generator) -> Floats:
    """Return stationary AR(1) noise of standard deviation sigma along the first axis."""
    white = rng.standard_normal(shape)
    white[1:] *= np.sqrt(1 - noise.rho**2)
    return noise.sigma * lfilter([1.0], [1.0, -noise.rho], white, axis=0)


def _spoil_directions(v: Floats, noise: Noise, rng: np.random.Generator) -> Floats:
    v = v + _coloured(v.shape, noise, rng)
    v[rng.random(len(v)) < noise.flips] *= -1
    wrong = rng.random(len(v)) < noise.outliers
    v[wrong] = _outliers(v.shape, noise, rng)[wrong]
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def _spoil_velocities(v: Floats, noise: Noise, rng: np.random.Generator) -> Floats:
    speed = np.linalg.norm(v, axis=1, keepdims=True)
    v = v.copy()
    v[:, :2] += _coloured(v[:, :2].shape, noise, rng)
    v[rng.random(len(v)) < noise.flips] *= -1
    wrong = rng.random(len(v)) < noise.outliers
    planar = _outliers(v.shape, noise, rng) * [1.0, 1.0, 0.0]
    v[wrong] = (speed * planar / np.linalg.norm(planar, axis=1, keepdims=True))[wrong]
    return v


def _outliers(shape: tuple[int, ...], noise: Noise, rng: np.random.Generator) -> Floats:
    v = rng.standard_normal(shape)
    if noise.cluster:
        v = rng.standard_normal(3) * 10 + v
    return v / np.linalg.norm(v, axis=1, keepdims=True)

"""The two noisy streams that a drive leaves: headings of the camera, velocities of the body.

:func:`simulate` samples an exact drive on two clocks, with the noise, gaps, offset and rotation
asked for, and keeps the truth beside the streams.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from data_tools.simulation.drives import Drive
from evcalib import checks
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.geometry import random_rotation
from evcalib.series import HeadingSeries, VelocitySeries
from evcalib.series import dead_reckon as dead_reckon


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
    >>> from data_tools.simulation.drives import s_curve
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


def _sample_times(duration: float, rate: float, noise: Noise, rng: np.random.Generator) -> Floats:
    step = 1.0 / checks.positive(rate, "rate", "samples per second")
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

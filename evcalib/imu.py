"""What the camera's own IMU measures, and the turning of the camera that follows from it.

The IMU shares the clock of the camera.  ``rate`` is its angular velocity in its own axes, which
``R_cam_imu`` brings to those of the camera: ``rate_cam = R_cam_imu @ rate``.  The attitude of the
camera is ``Q(t)``, from the camera's axes at t to those at the start.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from evcalib import checks
from evcalib.arrays import Flags, Floats, Integers
from evcalib.display import Shown
from evcalib.errors import InputError
from evcalib.series import bins, segments
from evcalib.uncertainty import white_noise

MAX_RATE = 40.0
"""Rates above this [rad/s] are taken for degrees.

A fact: the widest range of the gyros in event cameras is 2000 deg/s, 35 rad/s.
"""

GAP = 0.1
"""Between samples farther apart than this [s] the attitude is not known.  A choice: vibration of a
vehicle has periods of 0.05 to 0.2 s, which slower samples miss."""


@dataclass(frozen=True, eq=False)
class ImuSeries(Shown):
    """Angular velocity, and acceleration where it is known, of the camera's IMU.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times [s] on the camera clock, strictly increasing.
    rate : ndarray, shape (n, 3)
        Angular velocity [rad/s] in the axes of the IMU.
    acceleration : ndarray, shape (n, 3), optional
        Specific force [m/s^2], at rest 9.81 upwards.

    Raises
    ------
    InputError
        If a shape, a time or a value is unusable.

    Examples
    --------
    >>> len(ImuSeries(t=[0.0, 0.001], rate=[[0.0, 0.1, 0.0], [0.0, 0.1, 0.0]]))
    2
    """

    t: Floats
    rate: Floats
    acceleration: Floats | None = None

    def __post_init__(self) -> None:
        t = checks.times(self.t, "IMU t")
        if t.size < 2:
            raise InputError(f"an IMU needs two samples at least, not {t.size}")
        rate = checks.floats(self.rate, "IMU rate", (t.size, 3))
        fastest = np.abs(rate).max(axis=1)
        if fastest.max() > MAX_RATE:
            row = int(np.argmax(fastest))
            raise InputError(
                f"IMU row {row} turns by {fastest[row]:.4g} rad/s, above {MAX_RATE:g} rad/s, which"
                " no gyro of a camera measures; are the rates in degrees per second? (--imu-unit"
                " deg/s)"
            )
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "rate", rate)
        if self.acceleration is not None:
            a = checks.floats(self.acceleration, "IMU acceleration", (t.size, 3))
            object.__setattr__(self, "acceleration", a)

    def __len__(self) -> int:
        return int(self.t.size)

    @property
    def turning(self) -> float:
        """Root mean square angular velocity [rad/s]."""
        return float(np.sqrt(np.mean(np.sum(self.rate**2, axis=1))))


@dataclass(frozen=True, eq=False)
class Attitude:
    """How the camera is turned, as a function of time; made by `attitude_of`.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times [s] of the samples.
    rate : ndarray, shape (n, 3)
        Angular velocity [rad/s] in the axes of the camera, linear between the samples.
    turn : ndarray, shape (n, 4)
        Q(t) as quaternions (x, y, z, w).
    segment : ndarray of int64, shape (n,)
        Number of the stretch without gap.
    """

    t: Floats
    rate: Floats
    turn: Floats
    segment: Integers

    def covers(self, t1: ArrayLike, t2: ArrayLike) -> Flags:
        """Tell which intervals [s] lie within one stretch."""
        start, end = (np.asarray(t, dtype=np.float64) for t in (t1, t2))
        inside = (start >= self.t[0]) & (end <= self.t[-1])
        # The samples around the interval belong to one stretch.
        after = np.minimum(np.searchsorted(self.t, end), self.t.size - 1)
        return inside & (self.segment[self._before(start)] == self.segment[after])

    def at(self, t: ArrayLike) -> Rotation:
        """Return Q at times [s]; beyond the ends as at these."""
        times = np.clip(np.asarray(t, dtype=np.float64), self.t[0], self.t[-1])
        k = self._before(times)
        since = (times - self.t[k])[..., None]
        slope = (self.rate[k + 1] - self.rate[k]) / (self.t[k + 1] - self.t[k])[..., None]
        part = since * (self.rate[k] + 0.5 * slope * since)
        return Rotation.from_quat(self.turn[k]) * Rotation.from_rotvec(part)

    def between(self, t1: ArrayLike, t2: ArrayLike) -> Rotation:
        """Return Q(t1)^T Q(t2), which takes bearings at t2 to the camera as it stood at t1."""
        return self.at(t1).inv() * self.at(t2)

    def _before(self, t: Floats) -> Integers:
        return np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, self.t.size - 2)


def attitude_of(
    imu: ImuSeries, R_cam_imu: ArrayLike | None = None, bias: ArrayLike = (0.0, 0.0, 0.0)
) -> Attitude:
    """Integrate the angular velocity.

    Parameters
    ----------
    imu : ImuSeries
        The samples.
    R_cam_imu : array_like, shape (3, 3), optional
        From the axes of the IMU to those of the camera; the same axes if not given.
    bias : array_like, shape (3,)
        What the rates are too great by [rad/s], in the axes of the IMU.

    Returns
    -------
    Attitude
        Of the camera, from the identity at the first sample.

    Raises
    ------
    InputError
        If an argument is of another type, or no rotation.

    Notes
    -----
    Between two samples the rate is linear.  The step is the mean rate with the first term of the
    Magnus series, which leaves an error of the fifth order in the time step.

    References
    ----------
    Iserles & Norsett 1999 (the Magnus series); Savage 1998 (the same as the coning correction).
    """
    checks.instance(imu, "imu", ImuSeries)
    R = np.eye(3) if R_cam_imu is None else R_cam_imu
    R = checks.rotations(np.asarray(R)[None], "R_cam_imu", 1)[0]
    rate = (imu.rate - checks.floats(bias, "bias", (3,))) @ R.T
    step = np.diff(imu.t)[:, None]
    turns = step * 0.5 * (rate[1:] + rate[:-1]) + step**2 / 12 * np.cross(rate[:-1], rate[1:])
    turn = np.zeros((len(imu), 4))
    turn[0, 3] = 1.0
    turn[1:] = _running_products(Rotation.from_rotvec(turns)).as_quat()
    return Attitude(imu.t, rate, turn, segments(imu.t, GAP))


def _running_products(turns: Rotation) -> Rotation:
    """Return the product of each with all before it, in as many rounds as its number has bits."""
    q, reach = turns.as_quat(), 1
    while reach < len(q):
        head = Rotation.from_quat(q[:-reach]) * Rotation.from_quat(q[reach:])
        q = np.concatenate([q[:reach], head.as_quat()])
        reach *= 2
    return Rotation.from_quat(q)


@dataclass(frozen=True)
class YawAgreement(Shown):
    """The gyro against a yaw rate that something else tells.

    Attributes
    ----------
    bias : ndarray, shape (3,)
        Of the gyro [rad/s], in its own axes.
    bias_sd : float
        Its standard deviation per axis [rad/s].
    axis : ndarray, shape (3,) or None
        Axis of the yaw in the axes of the IMU, times the scale of the gyro against the yaw rate;
        None where the yaw rate changes too little to tell.
    axis_sd : float
        Standard deviation per component.
    """

    bias: Floats
    bias_sd: float
    axis: Floats | None
    axis_sd: float


BIAS_SD = 0.005
"""Standard deviation [rad/s] of what pitch and roll leave in the mean rate of a drive.  A choice: 3
degrees over 10 s."""

UNTOLD_SD = 0.05
"""The same where nothing tells the yaw of the drive, which may be a turn of 30 degrees in 10 s.  A
choice: the events narrow it down."""

TELLING = 0.1
"""Standard deviation of the axis below which it is told: 6 degrees, or a tenth of the scale."""

STEP = 0.02
"""Step of the offsets that are tried [s]; a yaw rate of vehicles changes little within it."""


def yaw_agreement(
    imu: ImuSeries, t: ArrayLike, yaw_rate: ArrayLike | None, max_offset: float
) -> YawAgreement:
    """Compare the gyro with the yaw rate of the body: bias and axis by least squares.

    On the whole a vehicle on a floor neither pitches nor rolls: what is left of the mean rate
    after its yaw is the gyro's bias.

    Parameters
    ----------
    imu : ImuSeries
        On the camera clock.
    t : array_like, shape (m,)
        Times [s] on the odometry clock.
    yaw_rate : array_like, shape (m,), optional
        Of the body [rad/s]; if not told, the mean rate is taken for the bias, with a wide error.
    max_offset : float
        The clocks differ by this at most [s].

    Returns
    -------
    YawAgreement
        With the axis where the yaw rate tells it.
    """
    mean = imu.rate.mean(axis=0)
    if yaw_rate is None:
        return YawAgreement(mean, UNTOLD_SD, None, np.inf)
    times, yaw = np.asarray(t, dtype=np.float64), np.asarray(yaw_rate, dtype=np.float64)
    noise = float(white_noise(yaw[:, None], segments(times, GAP))[0])
    noise *= float(np.sqrt(min(np.median(np.diff(times)) / BLOCK, 1.0)))
    fits = [
        fit
        for offset in np.arange(-max_offset, max_offset + STEP, STEP)
        if (fit := _yaw_fit(imu, times, yaw, float(offset), noise)) is not None
    ]
    if not fits:
        return YawAgreement(mean, UNTOLD_SD, None, np.inf)
    best = min(fits, key=lambda fit: fit.loss)
    if best.axis_sd < TELLING:
        bias_sd = float(np.hypot(BIAS_SD, best.axis_sd * best.turning))
        return YawAgreement(best.bias, bias_sd, best.axis, best.axis_sd)
    # Neither the axis nor what a mean yaw rate leaves in the bias is known.
    return YawAgreement(mean, float(np.hypot(BIAS_SD, best.turning)), None, best.axis_sd)


class _YawFit(NamedTuple):
    loss: float
    bias: Floats
    axis: Floats
    axis_sd: float
    turning: float


def _yaw_fit(imu: ImuSeries, t: Floats, yaw: Floats, offset: float, noise: float) -> _YawFit | None:
    """Fit the rates to a yaw rate at one offset, by means over blocks; None without overlap."""
    at = imu.t + offset
    inside = (at >= t[0]) & (at <= t[-1])
    if inside.sum() < 0.5 * inside.size:
        return None
    block = bins(at[inside] - at[inside][0], BLOCK)
    count = np.maximum(np.bincount(block), 1)[:, None]
    values = np.column_stack([np.interp(at[inside], t, yaw), imu.rate[inside]])
    means = np.stack([np.bincount(block, column) for column in values.T], axis=1) / count
    told, rate = means[:, 0], means[:, 1:]
    spread = told - told.mean()
    variance = float(np.mean(spread**2)) - noise**2
    if variance <= 9.0 * noise**2 or len(told) < 4:
        # What changes is noise for the most part, which makes any axis too short.
        return _YawFit(np.inf, rate.mean(axis=0), np.zeros(3), np.inf, float(abs(told.mean())))
    axis = spread @ (rate - rate.mean(axis=0)) / len(told) / variance
    rest = rate - rate.mean(axis=0) - np.outer(spread, axis)
    loss = float(np.mean(rest**2))
    independent = max((at[inside][-1] - at[inside][0]) / MEMORY, 2.0)
    sd = float(np.sqrt(loss / independent / variance))
    return _YawFit(loss, rate.mean(axis=0) - axis * told.mean(), axis, sd, float(abs(told.mean())))


BLOCK = 0.1
"""Rates are compared by their means over so much time [s]: noise of rows goes, turns stay."""

MEMORY = 0.3
"""Time over which rates of a vehicle go together [s].  A choice of the order of its controllers."""

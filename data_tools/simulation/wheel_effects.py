"""What a log tells of the wheels, and by how much it is late."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter, lfilter_zi

from data_tools.simulation.drives import Drive
from evcalib.arrays import Flags, Floats
from evcalib.errors import InputError
from evcalib.kinematics import Vehicle, WheelLog, WheelStates

WHEEL_RATE = 50.0

SAMPLES = 1000.0
"""Samples per second of what goes on between the rows of a log."""

LATEST = 0.5
"""A log is late or early by at most so much [s]."""

TURN_ARM = 0.3
"""A yaw rate counts as the velocity at this distance [m] when logs are compared."""


@dataclass(frozen=True)
class LogEffects:
    """What spoils the log of the wheels.

    Attributes
    ----------
    slip : float
        Standard deviation of each wheel's speed, as a share of it, anew in each row.
    rate : float
        Rows per second.
    low_pass : float
        Time constant [s] of a filter over speeds and steering angles.
    jitter : float
        Standard deviation of the stamps [s].
    encoder_step : float
        Way per count of the wheel encoders [m]; a speed is then the way since the row before.
    backlash : float
        Play of the steering [rad]: what is measured follows when it is used up.
    drop_out : float
        Share of rows that are missing.
    """

    slip: float = 0.0
    rate: float = WHEEL_RATE
    low_pass: float = 0.0
    jitter: float = 0.0
    encoder_step: float = 0.0
    backlash: float = 0.0
    drop_out: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value >= 0) or (name == "rate" and value == 0):
                raise InputError(f"{name} of a wheel log is unusable: {value!r}")

    @property
    def shaping(self) -> bool:
        """Whether more happens to a row than slip and loss."""
        return bool(self.low_pass or self.jitter or self.encoder_step or self.backlash)


def wheel_log(
    drive: Drive, vehicle: Vehicle, effects: LogEffects, rng: np.random.Generator
) -> WheelLog:
    """Return what a vehicle logs of a drive.

    Parameters
    ----------
    drive : Drive
        What the wheels do, or are told to do if that is what is logged.
    vehicle : Vehicle
        Whose wheels they are.
    effects : LogEffects
        What spoils the log.
    rng : Generator
        Of all that is random.

    Returns
    -------
    WheelLog
        On the body's clock.
    """
    period = 1 / effects.rate
    t = np.arange(rng.uniform(0, period), drive.duration, period)
    if effects.shaping:
        speed, steer = _shaped(drive, vehicle, effects, t)
    else:
        states = vehicle.wheel_states(drive.velocity(t)[:, :2], drive.yaw_rate(t))
        speed, steer = states.speed, states.steer
    speed = speed * (1.0 + effects.slip * rng.standard_normal(speed.shape))
    if effects.jitter:
        t = np.sort(t + effects.jitter * rng.standard_normal(t.size))
        t = t + 1e-6 * np.arange(t.size)  # no two rows at one time
    if effects.drop_out:
        kept = rng.random(t.size) >= effects.drop_out
        t, speed, steer = t[kept], speed[kept], None if steer is None else steer[kept]
    return WheelLog(t, WheelStates(speed, steer))


def _shaped(
    drive: Drive, vehicle: Vehicle, effects: LogEffects, rows: Floats
) -> tuple[Floats, Floats | None]:
    """Return speeds and steering angles of the rows, from fine samples."""
    t = np.arange(0.0, drive.duration + 1 / SAMPLES, 1 / SAMPLES)
    states = vehicle.wheel_states(drive.velocity(t)[:, :2], drive.yaw_rate(t))
    speed, steer = states.speed, states.steer
    if steer is not None:
        steer = _held(steer, np.abs(speed).max(axis=1) > 1e-3)
        if effects.backlash:
            steer = np.apply_along_axis(_with_play, 0, steer, 0.5 * effects.backlash)
    if effects.low_pass:
        speed = _smoothed(speed, effects.low_pass)
        steer = None if steer is None else _smoothed(steer, effects.low_pass)
    if effects.encoder_step:
        told = _counted(t, speed, effects.encoder_step, np.append(rows[0] - 1 / effects.rate, rows))
    else:
        told = _at(rows, t, speed)
    return told, None if steer is None else _at(rows, t, steer)


def _at(rows: Floats, t: Floats, values: Floats) -> Floats:
    return np.stack([np.interp(rows, t, column) for column in values.T], axis=1)


def _held(steer: Floats, moving: Flags) -> Floats:
    """Return steering angles without jumps of a turn; a vehicle at rest keeps its angles."""
    row = np.maximum.accumulate(np.where(moving, np.arange(len(steer)), moving.argmax()))
    return np.unwrap(steer[row], axis=0)


def _with_play(values: Floats, half: float) -> Floats:
    """Return what follows a value with play: it moves when the value is `half` off, either way."""
    out = np.empty_like(values)
    at = values[0]
    for k, value in enumerate(values):
        at = min(max(at, value - half), value + half)
        out[k] = at
    return out


def _smoothed(values: Floats, time_constant: float) -> Floats:
    share = 1.0 - np.exp(-1.0 / (SAMPLES * time_constant))
    b, a = [share], [1.0, share - 1.0]
    start = np.outer(lfilter_zi(b, a), values[0])
    smooth, _ = lfilter(b, a, values, axis=0, zi=start)
    return np.asarray(smooth)


def _counted(t: Floats, speed: Floats, step: float, edges: Floats) -> Floats:
    """Return the speeds between edges of time [s], from counts of a step [m]."""
    way = np.cumsum(speed, axis=0) / SAMPLES
    counts = np.floor(_at(edges, t, way) / step)
    return step * np.diff(counts, axis=0) / np.diff(edges)[:, None]


def lateness(log: WheelLog, vehicle: Vehicle, drive: Drive) -> float:
    """Return how late a log is as a whole [s], by least squares of its twists against a drive.

    Parameters
    ----------
    log : WheelLog
        On the body's clock.
    vehicle : Vehicle
        Whose log it is.
    drive : Drive
        What the body really did.

    Returns
    -------
    float
        Positive if the log tells late; 0 where the motion never changes, which says nothing.
    """
    twist = vehicle.twist(log.states)
    told = np.column_stack([twist.v, TURN_ARM * twist.yaw_rate])
    inside = (log.t > LATEST) & (log.t < drive.duration - LATEST)
    t, told = log.t[inside], told[inside]

    def cost(late: float) -> float:
        then = t - late
        true = np.column_stack([drive.velocity(then)[:, :2], TURN_ARM * drive.yaw_rate(then)])
        return float(((told - true) ** 2).sum())

    grid = np.arange(-LATEST, LATEST, 0.005)
    costs = np.array([cost(late) for late in grid])
    if np.ptp(costs) <= 1e-6 * float((told**2).sum()):
        return 0.0
    best = float(grid[costs.argmin()])
    found = minimize_scalar(cost, bounds=(best - 0.01, best + 0.01), method="bounded")
    return float(found.x)

"""A whole wheel log to a series of body velocities."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from evcalib import checks
from evcalib.arrays import Flags, Floats
from evcalib.display import Shown
from evcalib.errors import InputError
from evcalib.kinematics._rolling import Rolling
from evcalib.kinematics._states import WheelLog
from evcalib.kinematics._vehicles import Mecanum, Omni, Swerve
from evcalib.series import MAX_YAW_RATE, VelocitySeries

Vehicle = Swerve | Mecanum | Omni | Rolling
"""All kinds of vehicles."""

WARN_SLIP, REFUSE_SLIP = 1 / 10, 1 / 3
"""Shares of the wheels' speed over which slip is told and counted, and over which it is refused.
A choice between what was measured: real mecanum wheels 0.6 % (`pytest tests/test_real_wheels.py`);
a steering zero of 3 deg in one wheel of four 2 %, steering in degrees or any zeros 40 to 90 %
(`pytest tests/test_slip.py`).  Three omni wheels never contradict each other."""
CREEP = {Omni: np.radians(1.5), Mecanum: np.radians(4.5)}
"""Error [rad], sd, that all directions of vehicles on rollers share, by kind; 0 for others.  Real
wheel logs against motion capture (`data/wheels/optiodom`): the mean direction is off by -2.3 to
+2.4 deg for three omni wheels and by -1.4 to -6.8 for four mecanum wheels, which creep along their
rollers; these are the root mean squares.  Steered wheels roll where they point: what their steering
zeros are off by, only the user knows (``odometry_sd``)."""
MOVING = 0.1
"""Share of the usual top speed of the wheels above which slip is judged."""


@dataclass(frozen=True, eq=False)
class BodyVelocities(Shown):
    """Body velocities from wheels, and what was left out.

    Attributes
    ----------
    velocities : VelocitySeries
        The m rows kept, in the frame ``"body"``, with yaw rate.
    slip : ndarray, shape (m,)
        Slip of the rows kept [m/s], see `BodyTwist`.
    rows : int
        Rows n of the wheel log.
    over_slip, over_yaw_rate : int
        Rows over each limit; a row can be over both.
    removed : int
        Rows removed, n - m.
    slip_share : float
        Median slip of the log's rows that move, as a share of their `wheel_speed`.
    wheel_speed : float
        Median, over these rows, of the wheels' root mean square speed [m/s].
    """

    velocities: VelocitySeries
    slip: Floats
    rows: int
    over_slip: int
    over_yaw_rate: int
    removed: int
    slip_share: float = 0.0
    wheel_speed: float = 0.0

    def limited(
        self, max_slip: float | None = None, max_yaw_rate: float | None = None
    ) -> BodyVelocities:
        """Return the rows within limits [m/s], [rad/s]; see `body_velocities`."""
        assert self.velocities.yaw_rate is not None
        over_slip = _over(self.slip, max_slip, "max_slip", "m/s")
        over_yaw_rate = _over(
            np.abs(self.velocities.yaw_rate), max_yaw_rate, "max_yaw_rate", "rad/s"
        )
        kept = ~(over_slip | over_yaw_rate)
        if not kept.any():
            raise InputError(
                f"no wheel row is left of {kept.size}: {int(over_slip.sum())} over the slip limit,"
                f" {int(over_yaw_rate.sum())} over the yaw-rate limit; raise the limits"
                " or check units, wheel positions and steering zero"
            )
        return replace(
            self,
            velocities=self.velocities.select(kept),
            slip=self.slip[kept],
            over_slip=self.over_slip + int(over_slip.sum()),
            over_yaw_rate=self.over_yaw_rate + int(over_yaw_rate.sum()),
            removed=self.removed + int(kept.size - kept.sum()),
        )

    def summary(self) -> str:
        """Return one line for people: rows, what was removed and why, and the slip."""
        gates = f"{self.over_slip} over the slip, {self.over_yaw_rate} over the yaw-rate limit"
        middle, largest = np.median(self.slip), self.slip.max()
        line = (
            f"{self.rows - self.removed} of {self.rows} rows kept ({gates});"
            f" slip {middle:.3g} m/s median, {largest:.3g} m/s largest"
        )
        if self.slip_share > WARN_SLIP:
            line += (
                f"; the wheels contradict each other by {100 * self.slip_share:.0f} % of their"
                " speed, which is counted as an error of all directions of"
                f" {np.degrees(self.slip_share):.0f} deg (sd): look for {CAUSES}"
            )
        return line


def body_velocities(
    wheel_log: WheelLog,
    vehicle: Vehicle,
    *,
    max_slip: float | None = None,
    max_yaw_rate: float | None = None,
) -> BodyVelocities:
    """Turn a wheel log into the velocity of the body's origin, v_o of the paper.

    Parameters
    ----------
    wheel_log : WheelLog
        n rows of wheel states, in the order of the vehicle's wheels.
    vehicle : Swerve, Mecanum, Omni or Rolling
        The vehicle that wrote the log.
    max_slip : float, optional
        Remove rows whose slip [m/s] is larger.
    max_yaw_rate : float, optional
        Remove rows that turn faster [rad/s], either way, for methods that assume, as the paper
        does, that there is no rotation; `evcalib.calibrate` needs none left out.

    Returns
    -------
    BodyVelocities
        The velocities kept, their slip, and how many rows each limit concerned.

    Raises
    ------
    InputError
        If an input is of another type, the log does not fit the vehicle, the wheels contradict each
        other by over a third of their speed, a limit is not positive, or no row is left.
    """
    checks.instance(wheel_log, "wheel_log", WheelLog)
    checks.instance(vehicle, "vehicle", Swerve, Mecanum, Omni, Rolling)
    twist = vehicle.twist(wheel_log.states)
    share, wheel_speed = _judged(wheel_log, vehicle)
    turn = np.abs(twist.yaw_rate)
    if np.max(turn, initial=0.0) > MAX_YAW_RATE:
        row = int(np.argmax(turn))
        raise InputError(
            f"row {row}: the wheels tell a yaw rate of {turn[row]:.3g} rad/s, above"
            f" {MAX_YAW_RATE:.3g} rad/s; are speeds in m/s and the vehicle's lengths in m? (a"
            " column map reads other units), or is a value damaged?"
        )
    v = np.column_stack([twist.v, np.zeros(len(twist.v))])
    whole = BodyVelocities(
        velocities=VelocitySeries(
            wheel_log.t,
            v,
            twist.yaw_rate,
            frame="body",
            direction_sd=max(share if share > WARN_SLIP else 0.0, CREEP.get(type(vehicle), 0.0)),
        ),
        slip=twist.slip,
        rows=len(v),
        over_slip=0,
        over_yaw_rate=0,
        removed=0,
        slip_share=share,
        wheel_speed=wheel_speed,
    )
    return whole.limited(max_slip, max_yaw_rate)


CAUSES = (
    "steering angles in degrees, a steering zero that is off (offset in the column map), wheels in"
    " another order, a speed of the wrong sign, mecanum rollers the other way round, or another"
    " type of vehicle"
)


def _judged(wheel_log: WheelLog, vehicle: Vehicle) -> tuple[float, float]:
    """Return the usual slip as a share of the usual wheel speed, and the latter [m/s]."""
    if isinstance(vehicle, Swerve):
        vehicle = replace(vehicle, method="least_squares")
    speed = np.sqrt((wheel_log.states.speed**2).mean(axis=1))
    moving = speed > MOVING * np.percentile(speed, 90)
    if not moving.any():
        return 0.0, 0.0
    slip = vehicle.twist(wheel_log.states).slip[moving]
    usual = float(np.median(speed[moving]))
    share = float(np.median(slip)) / usual
    if share > REFUSE_SLIP:
        raise InputError(
            f"the wheels contradict each other: their slip is {np.median(slip):.3g} m/s,"
            f" {100 * share:.0f} % of their speed of {usual:.3g} m/s (medians), and no rigid body"
            f" moves like that; look for {CAUSES}"
        )
    return share, usual


def _over(values: Floats, limit: float | None, name: str, unit: str) -> Flags:
    if limit is None:
        return np.zeros(values.shape, dtype=bool)
    return values > checks.positive(limit, name, unit)

"""A whole wheel log to a series of body velocities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evcalib import checks
from evcalib.arrays import Flags, Floats
from evcalib.display import Shown
from evcalib.errors import InputError
from evcalib.kinematics._states import WheelLog
from evcalib.kinematics._vehicles import Mecanum, Omni, Swerve, Vehicle
from evcalib.series import VelocitySeries


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
    """

    velocities: VelocitySeries
    slip: Floats
    rows: int
    over_slip: int
    over_yaw_rate: int
    removed: int

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
        return BodyVelocities(
            velocities=self.velocities.select(kept),
            slip=self.slip[kept],
            rows=self.rows,
            over_slip=self.over_slip + int(over_slip.sum()),
            over_yaw_rate=self.over_yaw_rate + int(over_yaw_rate.sum()),
            removed=self.removed + int(kept.size - kept.sum()),
        )

    def summary(self) -> str:
        """Return one line for people: rows, what was removed and why, and the slip."""
        gates = f"{self.over_slip} over the slip, {self.over_yaw_rate} over the yaw-rate limit"
        middle, largest = np.median(self.slip), self.slip.max()
        return (
            f"{self.rows - self.removed} of {self.rows} rows kept ({gates});"
            f" slip {middle:.3g} m/s median, {largest:.3g} m/s largest"
        )


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
    vehicle : Swerve, Mecanum or Omni
        The vehicle that wrote the log.
    max_slip : float, optional
        Remove rows whose slip [m/s] is larger.
    max_yaw_rate : float, optional
        Remove rows that turn faster [rad/s], either way.  A camera away from the body's origin
        then sees another velocity than the origin's: the paper assumes there is no rotation.

    Returns
    -------
    BodyVelocities
        The velocities kept, their slip, and how many rows each limit concerned.

    Raises
    ------
    InputError
        If an input is of another type, the log does not fit the vehicle, a limit is not positive,
        or no row is left.
    """
    checks.instance(wheel_log, "wheel_log", WheelLog)
    checks.instance(vehicle, "vehicle", Swerve, Mecanum, Omni)
    twist = vehicle.twist(wheel_log.states)
    v = np.column_stack([twist.v, np.zeros(len(twist.v))])
    whole = BodyVelocities(
        velocities=VelocitySeries(wheel_log.t, v, twist.yaw_rate, frame="body"),
        slip=twist.slip,
        rows=len(v),
        over_slip=0,
        over_yaw_rate=0,
        removed=0,
    )
    return whole.limited(max_slip, max_yaw_rate)


def _over(values: Floats, limit: float | None, name: str, unit: str) -> Flags:
    if limit is None:
        return np.zeros(values.shape, dtype=bool)
    return values > checks.positive(limit, name, unit)

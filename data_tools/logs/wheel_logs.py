"""Wheel logs: what the wheels of a vehicle said over time, as CSV.

Columns, in any order: ``t`` [s], then for each wheel of the vehicle file ``speed_NAME`` [m/s] and,
if the vehicle steers, ``steer_NAME`` [rad].  For every kind of wheel, mecanum and omni included,
the speed is that of the rim: rotation rate [rad/s] times wheel radius [m], negative = backwards.
Logs with other columns or units are read by a map, see `data_tools.logs.column_maps`.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from data_tools.files.csv_table import Table, check_times, write_table
from data_tools.logs.column_maps import Columns, read_mapped
from data_tools.logs.vehicle_files import read_vehicle
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.kinematics import BodyVelocities, Vehicle, WheelLog, WheelStates, body_velocities
from evcalib.series import MAX_SPEED

MAX_STEER = 2 * np.pi
"""Angles beyond a full turn [rad] are taken for degrees."""
MAX_STEP = 5.0
"""A median step between rows above this [s] is taken for a mistake of units."""
MAX_JUMP = 60.0
"""A single step above this [s] is taken for a clock that was set."""


def read_wheel_log(
    path: str | Path,
    vehicle: Vehicle,
    columns: Columns | None = None,
    time_unit: str = "s",
    wheel_radius: float | None = None,
) -> WheelLog:
    """Read the wheel log of a vehicle.

    Parameters
    ----------
    path : str or Path
        CSV file with the columns described above and no others, unless there is a map.
    vehicle : Swerve, Mecanum or Omni
        Names the wheels; the states come in the order of its wheels.
    columns : mapping or path, optional
        Map from our names to the columns of the file and their units, or the YAML file that
        holds it; see `data_tools.logs.column_maps`.  Other columns are then passed over.
    time_unit : {"s", "ms", "us", "ns"}
        Unit of ``t``, unless the map tells it.
    wheel_radius : float, optional
        Radius [m] for speeds that the map has in rad/s, deg/s or rpm, unless it tells it.

    Returns
    -------
    WheelLog
        Times (n,) [s], speeds (n, k) [m/s] and, if the vehicle steers, angles (n, k) [rad].

    Raises
    ------
    InputError
        If the file is empty or has one row, columns are missing or strange, a cell is no finite
        number, times do not increase, or values look like another unit.
    """
    table = read_mapped(path, columns, time_unit=time_unit, wheel_radius=wheel_radius)
    _check_columns(table, vehicle)
    check_times(table, max_step=MAX_STEP, max_jump=MAX_JUMP)
    speed = _columns(table, "speed", vehicle.names)
    _check_range(table, "speed", vehicle.names, MAX_SPEED, "m/s")
    if not vehicle.steered:
        return WheelLog(table.columns["t"], WheelStates(speed))
    _check_range(table, "steer", vehicle.names, MAX_STEER * (1 + 1e-6), "rad")
    steer = _columns(table, "steer", vehicle.names)
    return WheelLog(table.columns["t"], WheelStates(speed, steer))


def write_wheel_log(path: str | Path, log: WheelLog, vehicle: Vehicle) -> None:
    """Write a wheel log so that `read_wheel_log` returns the same numbers."""
    columns = {"t": log.t}
    for i, name in enumerate(vehicle.names):
        columns[f"speed_{name}"] = log.states.speed[:, i]
        if log.states.steer is not None:
            columns[f"steer_{name}"] = log.states.steer[:, i]
    write_table(path, columns)


def velocities_from_files(
    wheels: str | Path,
    vehicle: str | Path,
    *,
    max_slip: float | None = None,
    max_yaw_rate: float | None = None,
) -> BodyVelocities:
    """Read a wheel log and its vehicle file and return the body velocities.

    Parameters are the two files and the limits of `evcalib.kinematics.body_velocities`.
    """
    described = read_vehicle(vehicle)
    log = read_wheel_log(wheels, described)
    return body_velocities(log, described, max_slip=max_slip, max_yaw_rate=max_yaw_rate)


def _check_columns(table: Table, vehicle: Vehicle) -> None:
    kinds = ("speed", "steer") if vehicle.steered else ("speed",)
    want = ["t"] + [f"{kind}_{name}" for name in vehicle.names for kind in kinds]
    missing = [name for name in want if name not in table.columns]
    extra = [name for name in table.columns if name not in want]
    if missing:
        at = _wheels_of(missing)
        raise InputError(
            f"{table.path} lacks the column(s) {', '.join(missing)}"
            + (f": nothing to say how wheel(s) {', '.join(at)} moved" if at else "")
            + f"; columns must be {', '.join(want)}"
            + (f", without {', '.join(extra)}" if extra else "")
        )
    if extra:
        raise InputError(
            f"{table.path} has the column(s) {', '.join(extra)}, which this vehicle does not;"
            f" columns must be {', '.join(want)}"
        )


def _wheels_of(columns: Iterable[str]) -> list[str]:
    names = [column.split("_", 1)[1] for column in columns if column != "t"]
    return list(dict.fromkeys(names))


def _columns(table: Table, kind: str, names: tuple[str, ...]) -> Floats:
    return np.stack([table.columns[f"{kind}_{name}"] for name in names], axis=1)


def _check_range(table: Table, kind: str, names: tuple[str, ...], limit: float, unit: str) -> None:
    hints = {
        "speed": "speeds are in metres per second at the rim",
        "steer": "angles are in radians, not degrees; wrap angles of several turns to +-pi",
    }
    for name in names:
        values = table.columns[f"{kind}_{name}"]
        bad = np.abs(values) > limit
        if bad.any():
            raise InputError(
                f"{table.where(bad)}: {kind}_{name} is {values[bad][0]:.6g} {unit}, beyond"
                f" {limit:.4g} {unit}; {hints[kind]}"
            )

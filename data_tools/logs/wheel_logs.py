"""Wheel logs: what the wheels of a vehicle said over time, as CSV.

Columns, in any order: ``t`` [s], then for each wheel of the vehicle file ``speed_NAME`` [m/s] and,
if the wheel steers, ``steer_NAME`` [rad].  A column ``yaw_rate`` [rad/s], of a gyro, is not needed:
the wheels are held against it.  For every kind of wheel, mecanum and omni included,
the speed is that of the rim: rotation rate [rad/s] times wheel radius [m], negative = backwards.
The steering angle is counter-clockwise from above: positive turns the wheel to the left, and a
wheel at +pi/2 that rolls forwards drives the vehicle to its left.  Other columns are passed over;
other names and units are read by a map, see `data_tools.logs.column_maps`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np

from data_tools.files.csv_table import Table, check_times, write_table
from data_tools.files.row_times import MAX_JUMP
from data_tools.logs.column_maps import Columns, Entry, converted, only_ours, read_mapped
from data_tools.logs.vehicle_files import read_vehicle
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.kinematics import BodyVelocities, Vehicle, WheelLog, WheelStates, body_velocities
from evcalib.series import MAX_SPEED

MAX_STEER = 2 * np.pi
"""Angles beyond a full turn [rad] are taken for degrees."""
MAX_STEP = 5.0
"""A median step between rows above this [s] is taken for a mistake of units."""


def read_wheel_log(
    path: str | Path,
    vehicle: Vehicle,
    columns: Columns | None = None,
    time_unit: str | None = None,
    wheel_radius: float | None = None,
    notes: list[str] | None = None,
) -> WheelLog:
    """Read the wheel log of a vehicle.

    Parameters
    ----------
    path : str or Path
        CSV file with the columns described above (see `data_tools.files.csv_table`).
    vehicle : Swerve, Mecanum, Omni or Rolling
        Names the wheels; the states come in the order of its wheels.
    columns : mapping or path, optional
        Map from our names to the columns of the file and their units, or the YAML file that
        holds it; see `data_tools.logs.column_maps`.  Other columns are then passed over.
    time_unit : {"s", "ms", "us", "ns"}
        Unit of ``t``, unless the map tells it.
    wheel_radius : float, optional
        Radius [m] for speeds that the map has in rad/s, deg/s or rpm, unless it tells it.
    notes : list of str, optional
        Takes what was held, left out or taken for granted.

    Returns
    -------
    WheelLog
        Times (n,) [s], speeds (n, k) [m/s] and, if the vehicle steers, angles (n, l) [rad].

    Raises
    ------
    InputError
        If the file is empty or has one row, columns are missing or strange, a cell is no finite
        number, times do not increase, or values look like another unit.
    """
    ours = (*wanted_columns(vehicle), "yaw_rate")
    table, entries = read_mapped(
        path, columns, ours=ours, time_unit=time_unit, wheel_radius=wheel_radius
    )
    _check_vehicle(table, vehicle)
    if columns is None:
        table = only_ours(table, ours)
    table = check_times(table, max_step=MAX_STEP, max_jump=MAX_JUMP)
    values = {name: column for name, column in table.columns.items() if name != "t"}
    t, values, more = converted(table.columns["t"], values, entries)
    if notes is not None:
        notes += [*table.notes, *more]
    same = t.size == table.line.size

    def where(row: int) -> str:
        return f"{path} line {table.line[row]}" if same else f"{path}, t = {t[row]:.3f} s"

    return wheel_log(t, values, entries, vehicle, where)


def wheel_log(
    t: Floats,
    values: Mapping[str, Floats],
    entries: Mapping[str, Entry],
    vehicle: Vehicle,
    where: Callable[[int], str],
) -> WheelLog:
    """Return columns [m/s, rad] under our names as the log of a vehicle.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times [s].
    values, entries : mapping
        Columns (n,), and the map that they came by.
    vehicle : Swerve, Mecanum, Omni or Rolling
        Names the wheels.
    where : callable
        Names a row in messages.

    Raises
    ------
    InputError
        If values look like another unit.
    """
    _check_range(values, "speed_", MAX_SPEED, "m/s", where)
    unsaid = {name: values[name] for name in values if not entries[name].stated}
    _check_range(unsaid, "steer_", MAX_STEER * (1 + 1e-6), "rad", where)
    speed, steer = (
        [values[name] for name in names] for names in (_speeds(vehicle), _angles(vehicle))
    )
    states = WheelStates(np.stack(speed, axis=1), np.stack(steer, axis=1) if steer else None)
    return WheelLog(t, states, values.get("yaw_rate"))


def wanted_columns(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the names of the columns of a vehicle's wheel log."""
    told = {*_speeds(vehicle), *_angles(vehicle)}
    names = (f"{kind}_{name}" for name in vehicle.names for kind in ("speed", "steer"))
    return ("t", *(name for name in names if name in told))


def _speeds(vehicle: Vehicle) -> tuple[str, ...]:
    return tuple(f"speed_{name}" for name in vehicle.speed_names)


def _angles(vehicle: Vehicle) -> tuple[str, ...]:
    return tuple(f"steer_{name}" for name in vehicle.steer_names)


def write_wheel_log(path: str | Path, log: WheelLog, vehicle: Vehicle) -> None:
    """Write a wheel log so that `read_wheel_log` returns the same numbers."""
    columns = dict(zip(_speeds(vehicle), log.states.speed.T, strict=True))
    if log.states.steer is not None:
        columns |= dict(zip(_angles(vehicle), log.states.steer.T, strict=True))
    columns |= {"t": log.t}
    written = {name: columns[name] for name in wanted_columns(vehicle)}
    write_table(path, written if log.yaw_rate is None else written | {"yaw_rate": log.yaw_rate})


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


def _check_vehicle(table: Table, vehicle: Vehicle) -> None:
    want = wanted_columns(vehicle)
    missing = [name for name in want if name not in table.columns]
    extra = [name for name in (*table.columns, *table.foreign) if name not in want]
    if missing:
        at = _wheels_of(missing)
        raise InputError(
            f"{table.path} lacks the column(s) {', '.join(missing)}"
            + (f": nothing to say how wheel(s) {', '.join(at)} moved" if at else "")
            + f"; columns must be {', '.join(want)}"
            + (f", without {', '.join(extra)}" if extra else "")
            + _other_type(table, vehicle)
            + "; other names and units are read by a column map (--columns)"
        )
    strange = [name for name in extra if name.startswith(("speed_", "steer_"))]
    if strange:
        raise InputError(
            f"{table.path} has the column(s) {', '.join(strange)}, which this vehicle does not;"
            f" columns must be {', '.join(want)}{_other_type(table, vehicle)}"
        )


def _other_type(table: Table, vehicle: Vehicle) -> str:
    """Say of which type of vehicle a log of other columns is likely to be."""
    speeds, angles = (
        {
            name.removeprefix(kind)
            for name in (*table.columns, *table.foreign)
            if name.startswith(kind)
        }
        for kind in ("speed_", "steer_")
    )
    if not speeds or (speeds == {*vehicle.speed_names} and angles == {*vehicle.steer_names}):
        return ""
    fits = [
        kind for kind, (wheels, steered) in _NAMES.items() if speeds == wheels and angles == steered
    ]
    if not fits and speeds == angles:
        fits = ["swerve"]
    if not fits and bool(angles) != vehicle.steered:
        fits = [name for name in _NAMES if bool(_NAMES[name][1]) == bool(angles)]
        fits += ["swerve"] if angles else ["omni"]
    if not fits:
        return ""
    return (
        f"; or is this the log of another type of vehicle ({', '.join(fits)})? say so (--vehicle)"
    )


_CORNERS = {"fl", "fr", "rl", "rr"}
_NAMES = {
    "mecanum": (_CORNERS, set()),
    "differential": ({"left", "right"}, set()),
    "skid_steer": ({"left", "right"}, set()),
    "bicycle": ({"rear"}, {"front"}),
    "ackermann": ({"rl", "rr"}, {"fl", "fr"}),
    "tricycle": ({"front"}, {"front"}),
}
"""Names of the wheels that have a speed, and that have an angle, of the usual types."""


def _wheels_of(columns: Iterable[str]) -> list[str]:
    names = [column.split("_", 1)[1] for column in columns if "_" in column]
    return list(dict.fromkeys(names))


def _check_range(
    values: Mapping[str, Floats],
    kind: str,
    limit: float,
    unit: str,
    where: Callable[[int], str],
) -> None:
    hints = {
        "speed_": "speeds are in metres per second at the rim; other units are read by a column map"
        " (--columns), as in {name}: {{column: NAME, unit: rpm, radius: 0.05}}",
        "steer_": "angles are in radians, not degrees: a column map (--columns) with {name}:"
        " {{column: NAME, unit: deg}} reads degrees, and with unit: rad radians of several turns",
    }
    for name, column in values.items():
        bad = np.abs(column) > limit
        if name.startswith(kind) and bad.any():
            row = int(np.argmax(bad))
            raise InputError(
                f"{where(row)}: {name} is {column[row]:.6g} {unit}, beyond {limit:.4g} {unit};"
                f" {hints[kind].format(name=name)}"
            )

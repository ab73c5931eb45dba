"""The samples of an IMU as a table: ``t,wx,wy,wz`` [s, rad/s], optionally ``ax,ay,az`` [m/s^2]."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data_tools.files.csv_table import check_times, write_table
from data_tools.logs.column_maps import Columns, converted, only_ours, read_mapped
from evcalib import checks
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.imu import ImuSeries

RATES, FORCES = ("wx", "wy", "wz"), ("ax", "ay", "az")
UNITS = {"rad/s": 1.0, "deg/s": float(np.pi / 180)}

MAX_STEP = 0.2
"""A median step between samples above this [s] is taken for a mistake of units: slower ones tell
nothing of vibration, and hardly anything of turns."""

LIVELY = 2.0
"""Root mean square rate [rad/s] from which a table that names no unit is asked for it.  A choice: a
vehicle that turns by 115 deg/s all the time is rarer than one whose log is in degrees."""


GRAVITY, STEADY = 9.80665, 0.25
"""Three columns whose size is that of gravity [m/s^2], give or take so large a share in nearly all
rows, are accelerations, not rates: a gyro that turns as evenly, and just as fast, is not met."""


def read_imu_table(
    path: str | Path,
    *,
    unit: str | None = None,
    columns: Columns | None = None,
    time_unit: str | None = None,
    notes: list[str] | None = None,
) -> ImuSeries:
    """Read a table of IMU samples, by the rules of all tables of motion.

    Parameters
    ----------
    path : path
        The CSV file; without a header its columns are t, wx, wy, wz, and ax, ay, az if there are
        seven.
    unit : {"rad/s", "deg/s"}, optional
        Of the rates.
    columns : mapping or path, optional
        Which of its columns, in which units, are ours; see `data_tools.logs.column_maps`.
    time_unit : {"s", "ms", "us", "ns"}, optional
        Unit of ``t``, unless the map tells it.
    notes : list of str, optional
        Takes what was held, left out or taken for granted.

    Raises
    ------
    InputError
        If the file lacks a column or has one misspelt, a row or a unit is unusable, the rates can
        hardly be in rad/s and no unit is given, or they are accelerations.
    """
    if unit is not None:
        checks.one_of(unit, "unit", tuple(UNITS))
    ours = ("t", *RATES, *FORCES)
    names = {4: ours[:4], 7: ours}
    table, entries = read_mapped(path, columns, ours=ours, time_unit=time_unit, names=names)
    lacking = [name for name in ("t", *RATES) if name not in table.columns]
    if lacking:
        raise InputError(
            f"{path} lacks the column(s) {', '.join(lacking)} of an IMU; it has"
            f" {', '.join((*table.columns, *table.foreign))}: a column map (--imu-columns) says"
            " which is which"
        )
    table = check_times(only_ours(table, ours) if columns is None else table, max_step=MAX_STEP)
    if notes is not None:
        notes += table.notes
    values = {name: column for name, column in table.columns.items() if name != "t"}
    t, found, _ = converted(table.columns["t"], values, entries)
    stated = any(entries[name].stated for name in RATES)
    if stated and unit is not None:
        raise InputError(
            f"{path}: the column map or the header gives the unit of the rates: leave {unit} out"
        )
    rate = np.stack([found[name] for name in RATES], axis=1)
    _refuse_weight(path, rate)
    rate *= UNITS[unit or "rad/s"]
    usual = float(np.sqrt(np.mean(np.sum(rate**2, axis=1))))
    if unit is None and not stated and usual > LIVELY:
        raise InputError(
            f"{path}: the rates are {usual:.3g} rad/s on the whole, {np.degrees(usual):.0f} deg/s;"
            " are they in degrees? say their unit: --imu-unit deg/s, or --imu-unit rad/s if they"
            " are rad/s all the same"
        )
    force = None
    if all(name in found for name in FORCES):
        force = np.stack([found[name] for name in FORCES], axis=1)
    try:
        return ImuSeries(t, rate, force)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _refuse_weight(path: str | Path, rate: Floats) -> None:
    """Refuse rates that are accelerations, in m/s^2 or in g: logs have either first."""
    size = np.linalg.norm(rate, axis=1)
    for weight in (GRAVITY, 1.0):
        alike = np.abs(size / weight - 1) < STEADY
        if alike.mean() > 0.95 and np.linalg.norm(rate.mean(axis=0)) > 0.8 * weight:
            raise InputError(
                f"{path}: wx, wy, wz look like the accelerations of an IMU at rest"
                f" ({weight:.3g} all the time): say which columns are which (--imu-columns)"
            )


def write_imu(path: str | Path, imu: ImuSeries) -> None:
    """Write a table of IMU samples."""
    columns = {"t": imu.t} | dict(zip(RATES, imu.rate.T, strict=True))
    if imu.acceleration is not None:
        columns |= dict(zip(FORCES, imu.acceleration.T, strict=True))
    write_table(path, columns)

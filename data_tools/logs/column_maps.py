"""Which column of a foreign log, in which unit, is which of ours.

A map is a mapping, or a YAML file of one::

    wheel_radius: 0.05                          # [m], for speeds in rad/s, deg/s or rpm
    t: {column: stamp, unit: ms}
    speed_fl: {column: fl_rate, unit: rad/s}
    speed_fr: {column: fr_rate, unit: rad/s, scale: -1}    # counts the other way round
    steer_fl: {column: fl_angle, unit: deg}
    steer_fr: fr_angle                          # a name alone: in our unit

Our names are ``t``; ``speed_NAME`` and ``steer_NAME`` for each wheel of the vehicle; and, in files
of velocities, ``vx, vy, vz, yaw_rate``.  In a ``sensor_msgs/JointState`` the columns are joints.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from data_tools.files.csv_table import Table, read_table
from data_tools.files.text import read_yaml
from evcalib import checks
from evcalib.errors import InputError

TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_SPEED = {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "km/h": 1 / 3.6}
_TURN = {"rad": 1.0, "deg": math.pi / 180}
_RATE = {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": 2 * math.pi / 60}

_KINDS = {
    "time": TIME,
    "wheel speed": _SPEED | _RATE,
    "angle": _TURN,
    "velocity": _SPEED,
    "turning rate": _RATE,
}
_PLAIN = {"t": "time", "yaw_rate": "turning rate"} | dict.fromkeys(("vx", "vy", "vz"), "velocity")
_OURS = {"time": "s", "wheel speed": "m/s", "angle": "rad", "velocity": "m/s"}


@dataclass(frozen=True)
class Entry:
    """One column of a log and the factor that brings it to our unit."""

    column: str
    factor: float


Columns = Mapping[str, Any] | str | Path
"""A map as callers give it."""


def column_map(
    columns: Columns,
    *,
    time_unit: str = "s",
    wheel_radius: float | None = None,
    speed_unit: str = "m/s",
) -> dict[str, Entry]:
    """Return the entries of a map.

    Parameters
    ----------
    columns : mapping or path
        The map, or the YAML file that holds it.
    time_unit : {"s", "ms", "us", "ns"}
        Unit of ``t`` where its entry has none.
    wheel_radius : float, optional
        Radius [m] for turning rates of wheels; the map's own ``wheel_radius`` goes first.
    speed_unit : str
        Unit of wheel speeds whose entries have none.

    Raises
    ------
    InputError
        If the file cannot be read, or an entry names no column, an unknown unit, or a rate of
        turning without a radius.
    """
    checks.one_of(time_unit, "time_unit", tuple(TIME))
    where = f"column map {columns}" if isinstance(columns, str | Path) else "column map"
    content = dict(_load(columns) if isinstance(columns, str | Path) else columns)
    radius = content.pop("wheel_radius", wheel_radius)
    defaults = {"time": time_unit, "wheel speed": speed_unit}
    try:
        return {name: _entry(name, value, radius, defaults) for name, value in content.items()}
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def read_mapped(
    path: str | Path,
    columns: Columns | None,
    *,
    time_unit: str = "s",
    wheel_radius: float | None = None,
) -> Table:
    """Read a CSV file under our names and in our units; without a map, only its times change.

    Parameters are those of `column_map`.

    Raises
    ------
    InputError
        As `column_map` and `read_table`; and if the file lacks a column of the map.
    """
    if columns is None:
        table = read_table(path)
        factor = TIME[checks.one_of(time_unit, "time_unit", tuple(TIME))]
        scaled = {"t": table.columns["t"] * factor} if "t" in table.columns else {}
        return replace(table, columns=table.columns | scaled)
    entries = column_map(columns, time_unit=time_unit, wheel_radius=wheel_radius)
    table = read_table(path, only={entry.column for entry in entries.values()})
    lacking = [e.column for e in entries.values() if e.column not in table.columns]
    if lacking:
        raise InputError(f"{path} lacks the column(s) {', '.join(lacking)} of the column map")
    return replace(
        table, columns={name: table.columns[e.column] * e.factor for name, e in entries.items()}
    )


def _entry(name: str, value: Any, radius: Any, defaults: dict[str, str]) -> Entry:
    kind = _kind(name)
    content = {"column": value} if isinstance(value, str) else value
    if not isinstance(content, Mapping) or not isinstance(content.get("column"), str):
        raise InputError(
            f"{name} must be a column's name or like {{column: NAME, unit: UNIT}}, not {value!r}"
        )
    extra = [key for key in content if key not in ("column", "unit", "radius", "scale")]
    if extra:
        raise InputError(
            f"{name} has no {', '.join(map(str, extra))}; it has column, unit, radius, scale"
        )
    unit = content.get("unit", defaults.get(kind, _OURS.get(kind, "rad/s")))
    if not isinstance(unit, str) or unit not in _KINDS[kind]:
        raise InputError(f"{name} ({kind}) is in one of {', '.join(_KINDS[kind])}, not {unit!r}")
    factor = _KINDS[kind][unit] * _number(content.get("scale", 1.0), f"scale of {name}")
    if kind == "wheel speed" and unit in _RATE:
        radius = content.get("radius", radius)
        if radius is None:
            raise InputError(f"{name} is in {unit}: give the wheel_radius in metres")
        factor *= checks.positive(_number(radius, "wheel_radius"), "wheel_radius", "m")
    return Entry(content["column"], factor)


def _kind(name: Any) -> str:
    text = str(name)
    for prefix, kind in (("speed_", "wheel speed"), ("steer_", "angle")):
        if text.startswith(prefix):
            return kind
    known = {
        "t": "time",
        "yaw_rate": "turning rate",
        **dict.fromkeys(("vx", "vy", "vz"), "velocity"),
    }
    if text in known:
        return known[text]
    raise InputError(
        f"{text} is none of t, speed_WHEEL, steer_WHEEL, vx, vy, vz, yaw_rate: our name comes"
        " first, then the column of the file"
    )


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e9:
        raise InputError(f"{name} must be a finite number, not {value!r}")
    if value == 0:
        raise InputError(f"{name} must not be 0")
    return float(value)


def _load(path: str | Path) -> Mapping[str, Any]:
    content = read_yaml(path)
    if not isinstance(content, dict):
        raise InputError(f"column map {path} must hold lines like `speed_fl: COLUMN`")
    return content

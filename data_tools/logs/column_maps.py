"""Which column of a foreign log, in which unit, is which of ours.

A map is a mapping, or a YAML file of one::

    wheel_radius: 0.05                          # [m], or wheel_diameter, for turning wheels
    t: {column: stamp, unit: ms}
    speed_fl: {column: fl_rate, unit: rpm, gear: 12}       # motor turns per wheel turn
    speed_fr: {column: fr_rate, unit: rad/s, scale: -1}    # counts the other way round
    speed_rl: {column: 7, unit: ticks, ticks_per_turn: 1024}
    steer_fl: {column: fl_angle, unit: deg, offset: -12.5} # reads 12.5 deg straight ahead
    steer_fr: fr_angle                          # a name alone: in our unit
    t: {column: sec, nanosec: nsec}             # a time in two columns, as ROS messages have it

Units in brackets behind our names, as in a header ``t [ms],vx [cm/s]``, are read without a map.

Our names are ``t``; ``speed_NAME`` and ``steer_NAME`` for each wheel of the vehicle; in files of
velocities, ``vx, vy, vz, yaw_rate``; and in files of an IMU, ``wx, wy, wz`` and ``ax, ay, az``
(in m/s^2 or g).  A column is a name, or a number (the first is 1) where a
file has no header.  In a ``sensor_msgs/JointState`` the columns are joints.

A value is ``(scale * column + offset) * unit``: the offset is in the column's own unit.
``wheel_radius`` (or ``wheel_diameter``), ``ticks_per_turn`` and ``gear`` may stand at the top, for
all wheel speeds, or in one entry.  Wheel speeds come as

=============================================  ==================================================
``m/s cm/s mm/s km/h``                         speed of the rim
``rad/s deg/s rpm rev/s ticks/s``              rate of turning; needs the radius
``rad deg turns ticks``, ``m cm mm``           a running count: how far the wheel has turned, or run
``turns/row ticks/row m/row`` and so on        the same, since the row before
=============================================  ==================================================

The mean speed that counts give belongs to the middle between two rows, so there is one row less,
and what was read at the rows (angles) is averaged.  ``wrap: 65536`` tells where a count
starts anew; what looks like it is mended and told, see `data_tools.logs.wheel_counts`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.files.csv_table import Table, read_table
from data_tools.files.text import read_yaml
from data_tools.logs.wheel_counts import count_steps
from evcalib import checks
from evcalib.arrays import Floats
from evcalib.errors import InputError

TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_SPEED = {f"{unit}/s": factor for unit, factor in _LENGTH.items()} | {"km/h": 1 / 3.6}
_TURN = {"rad": 1.0, "deg": math.pi / 180, "turns": 2 * math.pi, "ticks": 2 * math.pi}
_RATE = {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": 2 * math.pi / 60, "rev/s": 2 * math.pi}
_WHEEL_RATE = _RATE | {"ticks/s": 2 * math.pi}
_COUNT = _TURN | _LENGTH
_COUNTED = _COUNT | {f"{unit}/row": factor for unit, factor in _COUNT.items()}

_KINDS = {
    "time": TIME,
    "wheel speed": _SPEED | _WHEEL_RATE | _COUNTED,
    "angle": _TURN,
    "velocity": _SPEED,
    "turning rate": _RATE,
    "acceleration": {"m/s^2": 1.0, "g": 9.80665},
}
_PLAIN = {"t": "time", "yaw_rate": "turning rate"} | dict.fromkeys(("vx", "vy", "vz"), "velocity")
_PLAIN |= dict.fromkeys(("wx", "wy", "wz"), "turning rate")
_PLAIN |= dict.fromkeys(("ax", "ay", "az"), "acceleration")
_NAMES = "vx, vy, vz, yaw_rate, wx, wy, wz, ax, ay, az"
_WHEEL = ("speed_", "steer_")
_OURS = {"time": "s", "wheel speed": "m/s", "angle": "rad", "velocity": "m/s"}
_OURS |= {"turning rate": "rad/s", "acceleration": "m/s^2"}

RADII = (0.005, 2.0)
"""Wheels of a smaller or larger radius [m] are taken for a mistake of units."""
CLOCK_BITS = 32
"""Counters of microseconds or milliseconds start anew after 2^32."""
LOST_ROW = 1.5
"""After a step so many times the usual one a row is missing, and with it the count since then."""

_TOP = ("wheel_radius", "wheel_diameter", "ticks_per_turn", "gear")
_KEYS = (
    "column",
    "unit",
    "scale",
    "offset",
    "radius",
    "diameter",
    "ticks_per_turn",
    "gear",
    "wrap",
    "nanosec",
)


@dataclass(frozen=True)
class Entry:
    """One column of a log and what brings it to our unit.

    Attributes
    ----------
    column : str or int
        Name, or number from 1.
    factor, offset : float
        Ours is ``factor * value + offset``; for counts, of their change per second.
    stated : bool
        Whether the map gives the unit.
    count : {"running", "row"}, optional
        For wheel speeds that are told as counts.
    wrap : float, optional
        Where a count starts anew.
    nanosec : str or int, optional
        Column of nanoseconds that come to a time.
    """

    column: str | int
    factor: float
    offset: float = 0.0
    stated: bool = False
    count: str | None = None
    wrap: float | None = None
    nanosec: str | int | None = None


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
    top = {key: content.pop(key) for key in _TOP if key in content}
    if wheel_radius is not None and not top.keys() & {"wheel_radius", "wheel_diameter"}:
        top["wheel_radius"] = wheel_radius
    defaults = {"time": time_unit, "wheel speed": speed_unit}
    try:
        return {name: _entry(name, value, top, defaults) for name, value in content.items()}
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def read_mapped(
    path: str | Path,
    columns: Columns | None,
    *,
    ours: Collection[str],
    time_unit: str | None = None,
    wheel_radius: float | None = None,
    names: Mapping[int, tuple[str, ...]] | None = None,
) -> tuple[Table, Mapping[str, Entry]]:
    """Read a CSV file under our names, times in seconds, all else as it stands; and its map.

    A time unit that the map or the header gives must not be contradicted.  A time that falls by
    2^32 counts is taken for a counter that started anew, and told.  Other parameters are those of
    `column_map` and `read_table`.

    Raises
    ------
    InputError
        As `column_map` and `read_table`; and if the file lacks a column of the map.
    """
    if columns is None:
        table = read_table(path, ours=ours, names=names, hold=True)
        entries = _entries_of_header(table, time_unit)
    else:
        entries = column_map(columns, time_unit=time_unit or "s", wheel_radius=wheel_radius)
        wanted = [entry.column for entry in entries.values()]
        wanted += [entry.nanosec for entry in entries.values() if entry.nanosec is not None]
        table = read_table(path, only=set(wanted), hold=True)
        lacking = [str(name) for name in wanted if str(name) not in table.columns]
        if lacking:
            raise InputError(
                f"{path} lacks the column(s) {', '.join(lacking)} of the column map; it has"
                f" {', '.join(table.foreign) or 'columns without names'}"
            )
        raw = table.columns
        units = {n: table.units[str(e.column)] for n, e in entries.items()
                 if str(e.column) in table.units}  # fmt: skip
        table = replace(
            table, columns={n: raw[str(e.column)] for n, e in entries.items()}, units=units
        )
    if "t" in entries:
        t, notes = _seconds(table, entries["t"], time_unit)
        if (column := entries["t"].nanosec) is not None:
            t = t + raw[str(column)] * 1e-9
        table = replace(table, columns=table.columns | {"t": t}, notes=table.notes + notes)
    return table, entries


def _entries_of_header(table: Table, time_unit: str | None) -> dict[str, Entry]:
    """Return the map that the names and units of a header make."""
    entries = {}
    for name in table.columns:
        unit = table.units.get(name)
        if unit is None or unit == "date" or (name not in _PLAIN and not name.startswith(_WHEEL)):
            entries[name] = Entry(name, TIME[time_unit or "s"] if name == "t" else 1.0)
            continue
        try:
            entries[name] = _entry(name, {"column": name, "unit": unit}, {}, {})
        except InputError as error:
            raise InputError(
                f"{table.path}: the unit in the header, {name} [{unit}], is not understood:"
                f" {error}; use a column map (--columns)"
            ) from None
    return entries


def _seconds(table: Table, entry: Entry, time_unit: str | None) -> tuple[Floats, tuple[str, ...]]:
    """Return the times of a table [s]; refuse a unit that contradicts what the file says."""
    factor = abs(entry.factor)
    if table.units.get("t") == "date":
        if factor != 1 or time_unit not in (None, "s"):
            raise InputError(f"{table.path}: t holds dates, which have no unit; leave it out")
    elif entry.stated and time_unit is not None and TIME[time_unit] != factor:
        raise InputError(
            f"{table.path}: the column map or the header gives the unit of t, which --time-unit"
            f" {time_unit} (time_unit) contradicts; leave one of them out"
        )
    t, notes = _unwrapped(table.columns["t"])
    return t * entry.factor + entry.offset, notes


def _unwrapped(t: Floats) -> tuple[Floats, tuple[str, ...]]:
    """Mend a counter of 32 bits that started anew."""
    whole = 2.0**CLOCK_BITS
    falls = np.flatnonzero(np.diff(t) < -whole / 2)
    if not falls.size or t.min() < 0 or t.max() >= whole or (np.diff(falls) < 10).any():
        return t, ()
    laps = np.zeros(t.size)
    laps[falls + 1] = whole
    return t + np.cumsum(laps), (f"t started anew after 2^32, {falls.size} times: that was mended",)


def converted(
    t: Floats, values: Mapping[str, Floats], entries: Mapping[str, Entry]
) -> tuple[Floats, dict[str, Floats], list[str]]:
    """Return times [s], columns in our units, and what was left out; see the module's docstring.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times [s], increasing.
    values : mapping of str to ndarray, shape (n,)
        Columns by our names, as they were read.
    entries : mapping
        The map.
    """
    ours = {
        name: entries[name].factor * column + entries[name].offset
        for name, column in values.items()
        if entries[name].count is None
    }
    if len(ours) == len(values):
        return t, ours, []
    step = np.diff(t)
    per_row = any(entries[name].count == "row" for name in values)
    whole = step <= LOST_ROW * np.median(step) if per_row else np.ones(step.size, dtype=bool)
    middle = (t[1:] + t[:-1]) / 2
    notes = ["wheel speeds are counts: each row stands in the middle between two rows of the log"]
    if not whole.all():
        notes.append(f"{int((~whole).sum())} rows were left out: rows before them are missing")
    for name, column in values.items():
        entry = entries[name]
        if entry.count is None:
            at_rows = np.unwrap(ours[name]) if name.startswith("steer_") else ours[name]
            ours[name] = (at_rows[1:] + at_rows[:-1]) / 2
            continue
        change = column[1:]
        if entry.count == "running":
            change, good, more = count_steps(name, column, t, entry.wrap)
            whole &= good
            notes += more
        ours[name] = entry.factor * change / step + entry.offset
    return middle[whole], {name: column[whole] for name, column in ours.items()}, notes


def only_ours(table: Table, ours: tuple[str, ...]) -> Table:
    """Tell of the foreign columns of a table; refuse what looks misspelt."""
    absent = [name for name in ours if name not in table.columns]
    for name in table.foreign:
        if near := get_close_matches(name.lower(), absent, 1, 0.7):
            raise InputError(
                f"{table.path} has the unknown column(s) {name}; is it {near[0]}? rename it, or use"
                f" a column map (--columns); columns are {', '.join(ours)}"
            )
    if not table.foreign:
        return table
    note = f"column(s) passed over: {', '.join(table.foreign)}"
    return replace(table, notes=(*table.notes, note))


def _entry(name: str, value: Any, top: Mapping[str, Any], defaults: dict[str, str]) -> Entry:
    kind = _kind(name)
    content = value if isinstance(value, Mapping) else {"column": value}
    column = _column_of(name, content.get("column"), value)
    extra = [key for key in content if key not in _KEYS]
    if extra:
        raise InputError(f"{name} has no {', '.join(map(str, extra))}; it has {', '.join(_KEYS)}")
    unit = content.get("unit", defaults.get(kind, _OURS.get(kind, "rad/s")))
    if not isinstance(unit, str) or unit not in _KINDS[kind]:
        raise InputError(f"{name} ({kind}) is in one of {', '.join(_KINDS[kind])}, not {unit!r}")
    content = dict(content)
    turns = unit.removesuffix("/row") in _TURN or unit in _WHEEL_RATE
    if kind == "wheel speed" and turns:
        short = {key.removeprefix("wheel_"): top[key] for key in _TOP if key in top}
        if content.keys() & {"radius", "diameter"}:
            short = {key: short[key] for key in short.keys() - {"radius", "diameter"}}
        content = short | content
    factor = _KINDS[kind][unit]
    if unit.startswith("ticks"):
        if "ticks_per_turn" not in content:
            raise InputError(f"{name} is in {unit}: give ticks_per_turn, of the encoder's axle")
        factor /= checks.positive(_number(content["ticks_per_turn"], "ticks_per_turn"),
                                  "ticks_per_turn")  # fmt: skip
    if "gear" in content and (turns or unit in _TURN):
        factor /= checks.positive(_number(content["gear"], "gear"), "gear")
    if kind == "wheel speed" and turns:
        factor *= _radius(name, unit, content)
    scale = _number(content.get("scale", 1.0), f"scale of {name}")
    offset = content.get("offset", 0.0)
    offset = 0.0 if offset == 0 else _number(offset, f"offset of {name}")
    counted = kind == "wheel speed" and unit in _COUNTED
    if "nanosec" in content and (kind != "time" or unit != "s"):
        raise InputError(f"{name} has nanosec, which only a time in s has")
    return Entry(
        column=column,
        factor=factor * scale,
        offset=0.0 if counted else factor * offset,
        stated="unit" in content,
        count=("row" if unit.endswith("/row") else "running") if counted else None,
        wrap=None if content.get("wrap") is None else _number(content["wrap"], f"wrap of {name}"),
        nanosec=None if "nanosec" not in content else _column_of("nanosec", content["nanosec"]),
    )


def _column_of(name: str, column: Any, value: Any = None) -> str | int:
    numbered = isinstance(column, int) and not isinstance(column, bool) and column > 0
    if not isinstance(column, str) and not numbered:
        raise InputError(
            f"{name} must be a column's name or number, or like {{column: NAME, unit: UNIT}}, not"
            f" {column if value is None else value!r}"
        )
    return column


def _radius(name: str, unit: str, content: Mapping[str, Any]) -> float:
    if "radius" in content and "diameter" in content:
        raise InputError(f"{name} has a radius and a diameter; give one of them")
    if "radius" not in content and "diameter" not in content:
        raise InputError(
            f"{name} is in {unit}: give the wheel_radius (or wheel_diameter) in metres"
        )
    what, half = ("wheel_diameter", 0.5) if "diameter" in content else ("wheel_radius", 1.0)
    radius = half * checks.positive(_number(content[what[6:]], what), what, "m")
    if not RADII[0] <= radius <= RADII[1]:
        raise InputError(
            f"{what} of {radius / half:g} m: wheels are {RADII[0]:g} to {RADII[1]:g} m in radius;"
            " is it in metres?"
        )
    return radius


def _kind(name: Any) -> str:
    text = str(name)
    for prefix, kind in (("speed_", "wheel speed"), ("steer_", "angle")):
        if text.startswith(prefix):
            return kind
    if text in _PLAIN:
        return _PLAIN[text]
    raise InputError(
        f"{text} is none of t, speed_WHEEL, steer_WHEEL, {_NAMES}: our"
        " name comes first, then the column of the file"
    )


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e15:
        raise InputError(f"{name} must be a finite number, not {value!r}")
    if value == 0:
        raise InputError(f"{name} must not be 0")
    return float(value)


def _load(path: str | Path) -> Mapping[str, Any]:
    content = read_yaml(path)
    if not isinstance(content, dict):
        raise InputError(f"column map {path} must hold lines like `speed_fl: COLUMN`")
    return content

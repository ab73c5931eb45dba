"""Lists of recordings to calibrate: YAML, read strictly, so that a slip is an error and no default.

Paths are relative to the list; ``defaults`` stand for what an entry leaves out::

    defaults:
      camera: calib.txt
      vehicle: vehicle.yaml
    recordings:
      - recording: monday/events.txt.gz
        wheels: monday/wheels.csv
        name: monday
      - recording: tuesday/events.aedat4
        velocities: tuesday/velocities.csv
        size: 346x260
        max_offset: 2.0

An entry may also have each option of ``evcalib calibrate`` under its name, with ``_`` for ``-``:
``columns`` (a file, or the column map itself), ``topic``, ``wheel_radius``, ``time_unit``,
``stream``, ``camera_position``...  (`KEYS`).  Each entry needs ``recording``, ``camera``, and
either ``velocities`` or both ``wheels`` and ``vehicle``; what an entry says of its motion replaces
all that the defaults say of it.  ``name``, under which its results are kept, is the recording's
file name up to its first point if not given.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable
from collections.abc import Mapping as AnyMapping
from pathlib import Path
from typing import Any

from data_tools.files.text import Mapping, read_yaml
from data_tools.runs.imu import AUTO, rotation_of
from evcalib.errors import InputError

Entry = dict[str, Any]
"""One recording: what of `KEYS` it has, paths made absolute."""

MOTION = ("wheels", "vehicle", "velocities")
"""Keys that say how the body moved."""

READING_OPTIONS = {name: name for name in ("time_unit", "format", "disorder", "stream")}
MOTION_OPTIONS = {
    **{name: name for name in ("columns", "topic", "wheel_radius", "clock_shift", "twist_frame")},
    "motion_time_unit": "time_unit",
}
IMU_OPTIONS = {
    "imu": "source",
    **{f"imu_{name}": name for name in ("rotation", "unit", "columns", "time_unit", "stream")},
}
"""Keys that are options of reading the events, the motion and the IMU, and their names there."""

NAME = re.compile(r"[\w][\w .+-]*")


def _path(value: Any, home: Path) -> str:
    if not isinstance(value, str) or not value.strip():
        raise InputError("must be a path")
    return os.path.abspath(home / value)


def _size(value: Any, home: Path) -> list[int]:
    found = re.fullmatch(r"(\d+)x(\d+)", value) if isinstance(value, str) else None
    if found is None or "0" in found.groups():
        raise InputError("must be WIDTHxHEIGHT in pixels, like 346x260")
    return [int(number) for number in found.groups()]


def _number(least: float, words: str, *, above: bool = False) -> Callable[[Any, Path], float]:
    """Return the reader of finite numbers from `least` on, or above it."""

    def read(value: Any, home: Path) -> float:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not (
            number and math.isfinite(value) and value >= least and (value > least or not above)
        ):
            raise InputError(f"must be {words}")
        return float(value)

    return read


def _whole(value: Any, home: Path) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise InputError("must be a whole number, not negative")
    return value


def _flag(value: Any, home: Path) -> bool:
    if not isinstance(value, bool):
        raise InputError("must be true or false")
    return value


def _word(value: Any, home: Path) -> str:
    if not isinstance(value, str) or not value.strip():
        raise InputError("must be a word")
    return value


def _one_of(*words: str) -> Callable[[Any, Path], str]:
    def read(value: Any, home: Path) -> str:
        if value not in words:
            raise InputError(f"must be one of {', '.join(words)}")
        return str(value)

    return read


def _position(value: Any, home: Path) -> list[float]:
    values = value.split(",") if isinstance(value, str) else value
    try:
        numbers = [float(number) for number in values]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) != 3 or not all(map(math.isfinite, numbers)):
        raise InputError("must be X,Y,Z in metres, like 0.3,0,0.8")
    return numbers


def _columns(value: Any, home: Path) -> Any:
    return value if isinstance(value, dict) else _path(value, home)


def _imu(value: Any, home: Path) -> str:
    return AUTO if value == AUTO else _path(value, home)


def _rotation(value: Any, home: Path) -> str:
    rotation_of(_word(value, home))
    return str(value)


def _name(value: Any, home: Path) -> str:
    if not isinstance(value, str) or NAME.fullmatch(value) is None:
        raise InputError("must be letters, digits, and _ . + - or blanks: it names a folder")
    return value


KEYS: dict[str, Callable[[Any, Path], Any]] = {
    "name": _name,
    "recording": _path,
    "camera": _path,
    "wheels": _path,
    "vehicle": _path,
    "velocities": _path,
    "size": _size,
    "camera_name": _word,
    "max_offset": _number(0, "a positive number of seconds", above=True),
    "offset": _number(-math.inf, "a number of seconds"),
    "camera_position": _position,
    "camera_height": _number(-math.inf, "a number of metres"),
    "refinement": _one_of("tracks", "none"),
    "max_slip": _number(0, "a speed in m/s, not negative"),
    "max_yaw_rate": _number(0, "a rate in rad/s, not negative"),
    "columns": _columns,
    "topic": _word,
    "motion_time_unit": _one_of("s", "ms", "us", "ns"),
    "clock_shift": _number(-math.inf, "a number of seconds"),
    "twist_frame": _one_of("body", "ground"),
    "wheel_radius": _number(0, "a positive number of metres", above=True),
    "imu": _imu,
    "imu_rotation": _rotation,
    "imu_unit": _one_of("rad/s", "deg/s"),
    "imu_columns": _columns,
    "imu_time_unit": _one_of("s", "ms", "us", "ns"),
    "imu_stream": _word,
    "time_unit": _one_of("s", "ms", "us", "ns"),
    "format": _word,
    "disorder": _one_of("refuse", "sort", "drop"),
    "stream": _word,
    "surface": _word,
    "odometry_sd": _number(0, "an angle in degrees, not negative"),
    "rate": _number(0, "a positive number of keyframes per second", above=True),
    "denoise": _flag,
    "seed": _whole,
}
"""What an entry may hold, and how each value is read."""


def read_list(path: str | Path) -> tuple[Entry, ...]:
    """Read a list of recordings.

    Raises
    ------
    InputError
        If it is not such a list; the message names line and key.
    """
    path = Path(path)
    content = read_yaml(path)
    if not isinstance(content, dict) or not isinstance(content.get("recordings"), list):
        raise InputError(f"{path} needs the key recordings with a list of entries")
    unknown = [str(key) for key in content if key not in ("defaults", "recordings")]
    if unknown:
        raise InputError(f"{path}: unknown key(s) {', '.join(unknown)} beside the recordings")
    if not content["recordings"]:
        raise InputError(f"{path}: the list of recordings is empty")
    home = path.absolute().parent
    defaults = _read(content.get("defaults") or {}, home, f"{path}: defaults")
    if "name" in defaults or "recording" in defaults:
        raise InputError(f"{path}: defaults cannot hold name or recording: they are each entry's")
    entries, lines = [], dict[str, str]()
    for given in content["recordings"]:
        where = f"{path}, line {given.line}" if isinstance(given, Mapping) else str(path)
        entry = _complete(_read(given, home, where), defaults, where)
        folded = entry["name"].casefold()
        if folded in lines:
            raise InputError(
                f"{where}: the name {entry['name']} is taken by {lines[folded]}; give a `name`"
            )
        lines[folded] = where
        entries.append(entry)
    return tuple(entries)


def _read(given: Any, home: Path, where: str) -> Entry:
    if not isinstance(given, dict):
        raise InputError(f"{where}: must be `key: value` lines, not {given!r}")
    unknown = [str(key) for key in given if key not in KEYS]
    if unknown:
        raise InputError(
            f"{where}: unknown key(s) {', '.join(unknown)}; there are {', '.join(KEYS)}"
        )
    entry = {}
    for key, value in given.items():
        try:
            entry[key] = KEYS[key](value, home)
        except InputError as error:
            raise InputError(f"{where}: {key} {error}, not {value!r}") from None
    return entry


def _complete(entry: Entry, defaults: AnyMapping[str, Any], where: str) -> Entry:
    """Return the entry with defaults and a name, its keys in the order of `KEYS`."""
    if "velocities" in entry:
        defaults = {key: value for key, value in defaults.items() if key not in MOTION}
    elif "wheels" in entry or "vehicle" in entry:
        defaults = {key: value for key, value in defaults.items() if key != "velocities"}
    entry = {**defaults, **entry}
    missing = [key for key in ("recording", "camera") if key not in entry]
    if "velocities" not in entry:
        missing += [key for key in ("wheels", "vehicle") if key not in entry]
        if missing[-2:] == ["wheels", "vehicle"]:
            missing[-2:] = ["velocities (or wheels and vehicle)"]
    elif "wheels" in entry or "vehicle" in entry:
        raise InputError(f"{where}: give either velocities, or wheels and vehicle")
    if "imu" not in entry:
        missing += [f"imu, which {key} is of" for key in IMU_OPTIONS if key in entry]
    if missing:
        raise InputError(f"{where}: there is no {', no '.join(missing)}")
    if "name" not in entry:
        stem = Path(entry["recording"]).name.split(".")[0]
        try:
            entry["name"] = _name(stem, Path())
        except InputError:
            raise InputError(
                f"{where}: the recording's name makes no folder; give a `name`"
            ) from None
    return {key: entry[key] for key in KEYS if key in entry}

"""Vehicle files: a small YAML text that says where the wheels are, in metres in the body frame.

A swerve drive, whose wheels all steer; ``method: average`` asks for the paper's average::

    type: swerve
    wheels:
      fl: {x: 0.30, y: 0.25}
      fr: {x: 0.30, y: -0.25}

A mecanum drive, by the full distances between its axles and between its sides::

    type: mecanum
    wheelbase: 0.50
    track: 0.40

Omni wheels, each with the direction in which it rolls, counter-clockwise from body X::

    type: omni
    wheels:
      a: {x: 0.20, y: 0.0, drive_deg: 90}

A differential drive, whose wheels are ``left`` and ``right``, or more of them a side; a skid-steer
or tracked vehicle, by the y of the points about which its sides turn (farther apart than its
wheels) and their x::

    type: differential                 type: skid_steer
    track: 0.40                        centres: {left: 0.32, right: -0.32, x: 0.0}
    left_wheels: [fl, rl]
    right_wheels: [fr, rr]

A car told by one speed (``rear``) and one angle (``front``), or by its rear wheels' speeds (``rl``,
``rr``) and its front wheels' angles (``fl``, ``fr``); a tricycle whose wheel ``front`` drives and
steers.  A negative wheelbase has no meaning: a vehicle that steers behind is a ``rolling`` one::

    type: bicycle         type: ackermann       type: tricycle
    wheelbase: 2.60       wheelbase: 0.60       wheelbase: 1.20
                          track: 0.40

The origin of the body frame of these is the middle of the axle that does not steer (of a skid-steer
vehicle: where x and y count from); ``axle: {x: -0.3, y: 0.0}`` tells where that middle is in
another body frame.  Any other vehicle on wheels that do not slide sideways, by what the log tells
of each::

    type: rolling
    wheels:
      rl: {x: 0.0, y: 0.7}
      rr: {x: 0.0, y: -0.7}
      front: {x: 2.6, y: 0.0, speed: false, steer: true}
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from data_tools.files.text import read_yaml
from evcalib import checks
from evcalib.errors import InputError
from evcalib.kinematics import (
    Mecanum,
    Omni,
    OmniWheel,
    Rolling,
    RollingWheel,
    Swerve,
    Vehicle,
    Wheel,
)

_KEYS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "swerve": (("wheels",), ("method",)),
    "mecanum": (("wheelbase", "track"), ()),
    "omni": (("wheels",), ()),
    "differential": (("track",), ("axle", "left_wheels", "right_wheels")),
    "skid_steer": (("centres",), ("left_wheels", "right_wheels")),
    "bicycle": (("wheelbase",), ("axle",)),
    "ackermann": (("wheelbase", "track"), ("axle",)),
    "tricycle": (("wheelbase",), ("axle",)),
    "rolling": (("wheels",), ()),
}


def read_vehicle(path: str | Path) -> Vehicle:
    """Read a vehicle file.

    Raises
    ------
    InputError
        If the file cannot be read or is not YAML, if its type is unknown, a key is missing,
        unknown or given twice, a value is no number, or the wheels leave a motion unmeasured.
    """
    try:
        content = read_yaml(path)
        if not isinstance(content, dict):
            raise InputError("must hold `key: value` lines, beginning with `type: swerve`")
        return _build(content)
    except InputError as error:
        raise InputError(f"vehicle file {path}: {_without(path, error)}") from None


def write_vehicle(path: str | Path, vehicle: Vehicle) -> None:
    """Write a vehicle file that `read_vehicle` turns into the same vehicle."""
    text = yaml.safe_dump(_describe(vehicle), sort_keys=False, default_flow_style=None)
    Path(path).write_text(text, encoding="utf-8")


def _without(path: str | Path, error: InputError) -> str:
    return str(error).removeprefix(f"{path}: ")


def _build(content: dict[str, Any]) -> Vehicle:
    kind = content.get("type")
    if not isinstance(kind, str) or kind not in _KEYS:
        have = "there is no type" if kind is None else f"unknown type {kind!r}"
        raise InputError(f"{have}; type must be one of {', '.join(_KEYS)}")
    required, optional = _KEYS[kind]
    _check_keys(
        content, ("type", *required), optional, f"a{'n' * (kind[0] in 'ao')} {kind} vehicle"
    )
    if kind == "mecanum":
        lengths = (checks.positive(_number(content[key], key), key, "m") for key in required)
        return Mecanum(*(0.5 * length for length in lengths))
    if "wheels" not in required:
        return _made(kind, content)
    wheels = content["wheels"]
    if not isinstance(wheels, dict) or not wheels:
        raise InputError("wheels must hold one line per wheel, such as `fl: {x: 0.3, y: 0.25}`")
    if kind == "omni":
        return Omni(tuple(_omni_wheel(name, value) for name, value in wheels.items()))
    if kind == "rolling":
        return Rolling(tuple(_rolling_wheel(name, value) for name, value in wheels.items()))
    method = content.get("method", "least_squares")
    if not isinstance(method, str):
        raise InputError(f"method must be least_squares or average, not {method!r}")
    return Swerve(tuple(_wheel(name, value) for name, value in wheels.items()), method)


def _made(kind: str, content: dict[str, Any]) -> Rolling:
    """Return a vehicle that is told by lengths."""
    given: dict[str, Any] = {
        key: _number(content[key], key) for key in ("wheelbase", "track") if key in content
    }
    if "axle" in content:
        given["axle"] = tuple(_numbers("axle", content["axle"], ("x", "y"), "the"))
    if "centres" in content:
        left, right, given["x"] = _numbers(
            "centres", {"x": 0.0} | _mapping(content["centres"]), ("left", "right", "x"), "the"
        )
        given["centres"] = left, right
    for side in ("left", "right"):
        if f"{side}_wheels" in content:
            given[side] = _names(content[f"{side}_wheels"], f"{side}_wheels")
    make: Callable[..., Rolling] = getattr(Rolling, kind)
    return make(**given)


def _mapping(value: Any) -> dict[Any, Any]:
    if not isinstance(value, dict):
        raise InputError(f"centres must be like {{left: 0.3, right: -0.3, x: 0.0}}, not {value!r}")
    return value


def _names(value: Any, key: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not value or not all(isinstance(n, str) for n in value):
        raise InputError(f"{key} must be a list of names, such as [fl, rl], not {value!r}")
    return tuple(value)


def _rolling_wheel(name: Any, value: Any) -> RollingWheel:
    told: dict[str, Any] = {}
    if isinstance(value, dict):
        told = {key: value[key] for key in ("speed", "steer") if key in value}
        value = {key: value[key] for key in value if key not in told}
    x, y = _numbers(name, value, ("x", "y"))
    return RollingWheel(name, x, y, **told)


def _wheel(name: Any, value: Any) -> Wheel:
    x, y = _numbers(name, value, ("x", "y"))
    return Wheel(name, x, y)


def _omni_wheel(name: Any, value: Any) -> OmniWheel:
    x, y, drive = _numbers(name, value, ("x", "y", "drive_deg"))
    return OmniWheel(name, x, y, math.radians(drive))


def _numbers(name: Any, value: Any, keys: tuple[str, ...], what: str = "wheel") -> list[float]:
    if not isinstance(name, str):
        raise InputError(f"wheel name {name!r} is not text for YAML; put it in quotes or rename it")
    if not isinstance(value, dict):
        raise InputError(f"{what} {name} must hold {', '.join(keys)}, not {value!r}")
    _check_keys(value, keys, (), f"{what} {name}")
    return [_number(value[key], f"{key} of {what} {name}") for key in keys]


def _check_keys(
    content: dict[str, Any], required: tuple[str, ...], optional: tuple[str, ...], what: str
) -> None:
    missing = [key for key in required if key not in content]
    extra = [str(key) for key in content if key not in required + optional]
    if missing:
        found = f", but has {', '.join(extra)}" if extra else ""
        raise InputError(f"{what} needs {', '.join(missing)}{found}")
    if extra:
        known = ", ".join(required + optional)
        raise InputError(f"{what} has no {', '.join(extra)}; it has {known}")


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        hint = " (write 1.0e-3 for 1e-3)" if isinstance(value, str) and "e" in value else ""
        raise InputError(f"{name} must be a number, not {value!r}{hint}")
    try:
        return float(value)
    except OverflowError:
        raise InputError(f"{name} is too large for a number") from None


def _describe(vehicle: Vehicle) -> dict[str, Any]:
    if isinstance(vehicle, Mecanum):
        wheelbase, track = 2 * vehicle.half_length, 2 * vehicle.half_width
        return {"type": "mecanum", "wheelbase": wheelbase, "track": track}
    if isinstance(vehicle, Omni):
        wheels = {
            w.name: {"x": w.x, "y": w.y, "drive_deg": math.degrees(w.drive)} for w in vehicle.wheels
        }
        return {"type": "omni", "wheels": wheels}
    if isinstance(vehicle, Rolling):
        told = {
            w.name: {"x": w.x, "y": w.y, "speed": w.speed, "steer": w.steer} for w in vehicle.wheels
        }
        return {"type": "rolling", "wheels": told}
    places = {w.name: {"x": w.x, "y": w.y} for w in vehicle.wheels}
    return {"type": "swerve", "method": vehicle.method, "wheels": places}

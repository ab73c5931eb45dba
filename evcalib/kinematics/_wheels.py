"""Wheels, where they touch the ground, and what makes their places implausible."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import TypeVar

from evcalib import checks
from evcalib.errors import InputError

MAX_REACH = 20.0
"""Wheels (and cameras) farther from the body's origin [m] are taken for a mistake of units: the
largest self-propelled transporters are shorter than twice this."""
MIN_SPAN = 0.02
"""Vehicles whose wheels stand closer together than this [m] are taken for a mistake of units: the
smallest robots that are sold are twice as large."""


@dataclass(frozen=True)
class Wheel:
    """A wheel and where it touches the ground.

    Parameters
    ----------
    name : str
        A word.
    x, y : float
        Position in the body frame [m].
    """

    name: str
    x: float
    y: float

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.isidentifier()):
            raise InputError(f"wheel name {self.name!r} must be a word (letters, digits, _)")
        for field in fields(self):
            if field.type == "float":
                value = number(getattr(self, field.name), f"{field.name} of wheel {self.name}")
                object.__setattr__(self, field.name, value)
        check_reach(max(abs(self.x), abs(self.y)), f"wheel {self.name}")


W = TypeVar("W", bound=Wheel)


@dataclass(frozen=True)
class OmniWheel(Wheel):
    """A wheel whose rollers slide sideways.

    Parameters
    ----------
    drive : float
        Direction in which it rolls, from body X towards Y [rad].
    """

    drive: float


@dataclass(frozen=True)
class RollingWheel(Wheel):
    """A wheel that rolls without sliding sideways.

    Parameters
    ----------
    speed : bool
        Whether the log tells its speed.
    steer : bool
        Whether it steers, and the log tells its angle; otherwise it points along body X.
    """

    speed: bool = True
    steer: bool = False

    def __post_init__(self) -> None:
        for name in ("speed", "steer"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(
                    f"{name} of wheel {self.name} must be true or false, not"
                    f" {getattr(self, name)!r}: the log tells it or not"
                )
        super().__post_init__()


def resized(wheels: tuple[W, ...], factor: float) -> tuple[W, ...]:
    """Return the wheels, their distances from their middle scaled."""
    x, y = (sum(getattr(w, axis) for w in wheels) / len(wheels) for axis in "xy")
    return tuple(replace(w, x=x + factor * (w.x - x), y=y + factor * (w.y - y)) for w in wheels)


def length(value: float, name: str, least: float = MIN_SPAN) -> float:
    """Return a length of a vehicle [m] that is plausible."""
    metres = checks.positive(value, name, "m")
    check_reach(metres, name)
    check_span(metres, name, least)
    return metres


def check_wheels(wheels: Iterable[W], least: int, kind: type[W]) -> tuple[W, ...]:
    """Return wheels of one kind, so many at least, with different names."""
    wheels = tuple(wheels)
    for wheel in wheels:
        if not isinstance(wheel, kind):
            raise InputError(f"wheels must be {kind.__name__} objects, not {wheel!r}")
    names = [wheel.name for wheel in wheels]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"wheel {twice[0]} is given twice; every wheel needs its own name")
    if len(wheels) < least:
        raise InputError(f"at least {least} wheels are needed, not {len(wheels)}")
    return wheels


def check_reach(distance: float, what: str) -> None:
    """Refuse what is too far away."""
    if distance > MAX_REACH:
        raise InputError(
            f"{what} is {distance:g} m from the body's origin, over {MAX_REACH:g} m; are lengths in"
            " metres (not millimetres)?"
        )


def check_span(distance: float, what: str, least: float = MIN_SPAN) -> None:
    """Refuse what is too close together."""
    if distance < least:
        raise InputError(f"{what} is {distance:g} m, under {least:g} m; are lengths in metres?")


def number(value: object, name: str) -> float:
    """Return a finite number."""
    try:
        found = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        found = math.nan
    if not math.isfinite(found):
        raise InputError(f"{name} must be a finite number, not {value!r}")
    return found

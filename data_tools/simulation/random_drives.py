"""Every drive that is drawn from a seed: for studies, recordings and the campaign.

`drive` draws from plain parameters its own heading, phase and sense, at 1 m/s:

========== =====================================================================================
motion     parameters
========== =====================================================================================
straight
arc        ``radius_m``, or a range of two to draw from
polyline   ``turn_deg`` (45), ``side_s`` (3), ``turn_time_s`` (0)
zigzag     the same
s-curve    ``swing_deg`` (45), ``period_s`` (8)
fingers    ``angles_deg`` from the first finger on, or ``count`` spread evenly over 180 degrees
========== =====================================================================================

`RECORDED` draws for simulated recordings, `any_drive` for the campaign.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

from data_tools.simulation import drives
from data_tools.simulation.drives import Drive
from data_tools.simulation.streams import Noise, SyntheticStreams, simulate
from evcalib import checks
from evcalib.arrays import Floats
from evcalib.errors import InputError

Generator = np.random.Generator
Parameters = Mapping[str, Any]
Spans = tuple[tuple[float, float], ...]

HEADING_RATE, VELOCITY_RATE = 30.0, 50.0
"""Samples per second of the two streams of every study."""

RAMP = 0.8
"""Time [s] in which a sweep gets up to speed."""

ANY = {
    "straight": 0.05,
    "arc": 0.05,
    "s-curve": 0.2,
    "fingers": 0.2,
    "polyline": 0.1,
    "spline": 0.2,
    "stop and go": 0.15,
    "cut": 0.05,
}
"""Motions of `any_drive` and their shares, a choice.  Cut: fingers that start and stop at once."""


def drive(parameters: Parameters, rng: Generator) -> Drive:
    """Draw a drive of 20 s at 1 m/s (fingers take as long as they take).

    Raises
    ------
    InputError
        If ``parameters["motion"]`` is missing or unknown, or a parameter of it is missing or no
        usable number.
    """
    kind = checks.one_of(parameters.get("motion", ""), "motion", tuple(_DRAWERS))
    return _DRAWERS[kind](parameters, rng)


def streams(
    parameters: Parameters, rng: Generator, *, largest_offset: float = 0.5
) -> SyntheticStreams:
    """Draw an offset, a drive, a rotation, and both noisy streams.

    Noise stands in ``heading_noise`` and ``velocity_noise``, as dictionaries of the attributes of
    `data_tools.simulation.streams.Noise`.

    Raises
    ------
    InputError
        As `drive`; or if a noise is missing, or is none.
    """
    offset = rng.uniform(-largest_offset, largest_offset)
    return simulate(
        drive(parameters, rng),
        rng,
        offset=offset,
        heading_rate=HEADING_RATE,
        velocity_rate=VELOCITY_RATE,
        heading_noise=_noise_of(parameters, "heading_noise"),
        velocity_noise=_noise_of(parameters, "velocity_noise"),
    )


def noise(sigma: float, **more: Any) -> dict[str, Any]:
    """Return noise as the parameters of a cell: what differs from the default."""
    given = Noise(sigma, **more)
    values = {field.name: getattr(given, field.name) for field in fields(given)}
    defaults = Noise()
    return {name: v for name, v in values.items() if v != getattr(defaults, name)}


def _noise_of(parameters: Parameters, name: str) -> Noise:
    try:
        return Noise(**parameters[name])
    except (KeyError, TypeError):
        names = ", ".join(field.name for field in fields(Noise))
        raise InputError(
            f"{name} must be a dictionary of {names}, not {parameters.get(name)!r}"
        ) from None


def any_drive(rng: Generator) -> Drive:
    """Draw a motion of `ANY`, of 12 to 16 s at 0.3 to 1 m/s."""
    kind = str(rng.choice(list(ANY), p=list(ANY.values())))
    duration, speed = float(rng.uniform(12.0, 16.0)), float(rng.uniform(0.3, 1.0))
    heading = _any_heading(rng)
    common = {"duration": duration, "heading": heading, "speed": speed}
    if kind == "straight":
        return drives.straight(**common)
    if kind == "arc":
        return drives.arc(radius=sign(rng) * float(rng.uniform(1.5, 6.0)), **common)
    if kind == "s-curve":
        return drives.s_curve(
            amplitude=float(np.radians(rng.uniform(20.0, 90.0))),
            period=float(rng.uniform(3.5, 9.0)),
            phase=float(rng.uniform(0, 2 * np.pi)),
            **common,
        )
    if kind == "polyline":
        return drives.polyline(
            turn=sign(rng) * float(np.radians(rng.uniform(20.0, 100.0))),
            side=float(rng.uniform(1.5, 3.0)),
            turn_time=float(rng.choice([0.0, 0.2, 0.6])),
            **common,
        )
    if kind in ("fingers", "cut"):
        return _any_fingers(rng, kind, duration, heading, speed)
    return _wander(rng, kind, duration, speed)


def wobble(rng: Generator, largest: float) -> Callable[[Floats], Floats]:
    """Return a yaw rate [rad/s] of two sines with periods of 2 to 7 s, `largest` at most."""
    rate, phase = 2 * np.pi / rng.uniform(2.0, 7.0, 2), rng.uniform(0, 2 * np.pi, 2)
    return lambda t: 0.5 * largest * np.sin(np.multiply.outer(t, rate) + phase).sum(axis=-1)


def spans(rng: Generator, duration: float, most: int, longest: float) -> Spans:
    """Draw up to `most` intervals of 0.3 to `longest` [s] that begin within a drive."""
    starts = np.sort(rng.uniform(1.0, duration - 1.0, int(rng.integers(0, most + 1))))
    return tuple((float(start), float(start + rng.uniform(0.3, longest))) for start in starts)


def sign(rng: Generator) -> float:
    """Draw -1 or 1."""
    return float(rng.choice([-1.0, 1.0]))


def _any_heading(rng: Generator) -> float:
    return float(rng.uniform(-np.pi, np.pi))


def _arc(parameters: Parameters, rng: Generator) -> Drive:
    given = np.atleast_1d(parameters.get("radius_m", []))
    radii = checks.floats(given, "radius_m", (None,))
    if radii.size not in (1, 2) or (radii <= 0).any():
        raise InputError("an arc needs radius_m, one or two positive numbers")
    radius = rng.choice([-1, 1]) * rng.uniform(radii[0], radii[-1])
    return drives.arc(radius=radius, heading=_any_heading(rng))


def _sides(make: Callable[..., Drive]) -> Callable[[Parameters, Generator], Drive]:
    def draw(parameters: Parameters, rng: Generator) -> Drive:
        return make(
            turn=np.radians(_number(parameters, "turn_deg", 45.0)),
            side=_number(parameters, "side_s", 3.0),
            turn_time=_number(parameters, "turn_time_s", 0.0),
            heading=_any_heading(rng),
        )

    return draw


def _s_curve(parameters: Parameters, rng: Generator) -> Drive:
    heading, phase = rng.uniform(-np.pi, np.pi, 2)
    return drives.s_curve(
        amplitude=np.radians(_number(parameters, "swing_deg", 45.0)),
        period=_number(parameters, "period_s", 8.0),
        heading=heading,
        phase=phase,
    )


def _fingers(parameters: Parameters, rng: Generator) -> Drive:
    count = _number(parameters, "count", 3)
    if count < 1 or count != int(count):
        raise InputError(f"count must be a whole number of at least 1, not {count:g}")
    spread = [180.0 * k / count for k in range(int(count))]
    angles = checks.floats(parameters.get("angles_deg", spread), "angles_deg", (None,))
    return drives.fingers((_any_heading(rng) + np.radians(angles)).tolist())


def _number(parameters: Parameters, name: str, default: float) -> float:
    return float(checks.floats([parameters.get(name, default)], name, (1,))[0])


_DRAWERS: dict[str, Callable[[Parameters, Generator], Drive]] = {
    "straight": lambda parameters, rng: drives.straight(heading=_any_heading(rng)),
    "arc": _arc,
    "polyline": _sides(drives.polyline),
    "zigzag": _sides(drives.zigzag),
    "s-curve": _s_curve,
    "fingers": _fingers,
}


def _recorded_sweep(rng: Generator, duration: float, speed: float) -> Drive:
    """Return a direction that swings by two sines; the speed rises at the start."""
    heading = rng.uniform(-np.pi / 6, np.pi / 6)
    amplitude = np.radians(rng.uniform([30.0, 5.0], [55.0, 15.0]))
    rate = 2 * np.pi / rng.uniform([4.0, 2.0], [8.0, 3.5])
    phase = rng.uniform(0, 2 * np.pi, 2)

    def angle(t: Floats) -> Floats:
        return heading + np.sin(np.multiply.outer(t, rate) + phase) @ amplitude

    def ramp(t: Floats) -> Floats:
        u = np.clip(t / RAMP, 0.0, 1.0)
        return speed * u * u * (3 - 2 * u)

    return Drive("sweep", duration, angle, ramp)


def _recorded_fingers(rng: Generator, duration: float, speed: float) -> Drive:
    """Return fingers spread by 120 degrees or so, as many as the time allows."""
    out, pause = 2.0, 0.5
    count = max(int(duration / (2 * (out + pause))), 1)
    spread = np.linspace(-1.0, 1.0, count) if count > 1 else np.zeros(1)
    angles = rng.permutation(np.radians(60.0) * spread + rng.uniform(-0.2, 0.2, count))
    return drives.fingers(angles.tolist(), out=out, pause=pause, speed=speed, duration=duration)


def _recorded_straight(rng: Generator, duration: float, speed: float) -> Drive:
    return drives.straight(duration, heading=rng.uniform(-0.5, 0.5), speed=speed)


def _recorded_arc(rng: Generator, duration: float, speed: float) -> Drive:
    """Return an arc that turns the direction of travel by 90 to 180 degrees in all."""
    turned = sign(rng) * rng.uniform(0.5 * np.pi, np.pi)
    radius = speed * duration / turned
    return drives.arc(duration, radius=radius, heading=-0.5 * turned, speed=speed)


RECORDED: dict[str, Callable[[Generator, float, float], Drive]] = {
    "sweep": _recorded_sweep,
    "fingers": _recorded_fingers,
    "straight": _recorded_straight,
    "arc": _recorded_arc,
}
"""Motions of simulated recordings, drawn for a duration [s] and a top speed [m/s]; see
:func:`data_tools.simulation.recorded_drive.record_drive`."""


def _any_fingers(rng: Generator, kind: str, duration: float, heading: float, speed: float) -> Drive:
    out, pause = float(rng.uniform(1.2, 2.0)), 0.4
    leg = out + pause
    count = max(int(duration / (2 * leg)), 2)
    angles = heading + np.radians(rng.uniform(-80.0, 80.0, count))
    smooth = drives.fingers(angles.tolist(), out=out, pause=pause, speed=speed)
    if kind == "fingers":
        return smooth
    return replace(smooth, kind=kind, speed=lambda t: np.where(np.mod(t, leg) < out, speed, 0.0))


def _wander(rng: Generator, kind: str, duration: float, speed: float) -> Drive:
    """Return a direction and a speed that swing by three sines each; or the speed goes and stops.

    The spline of a path is as smooth.
    """
    rates = 2 * np.pi / rng.uniform(2.5, 12.0, (2, 3))
    phases = rng.uniform(0, 2 * np.pi, (2, 3))
    swing = np.radians(rng.uniform(15.0, 45.0))

    def waves(which: int, t: Floats) -> Floats:
        return np.asarray(np.sin(np.multiply.outer(t, rates[which]) + phases[which]).sum(axis=-1))

    def angle(t: Floats) -> Floats:
        return phases[0, 0] + swing * waves(0, t)

    if kind == "spline":
        return Drive(kind, duration, angle, lambda t: speed * (1.0 + 0.25 * waves(1, t)))
    period, ramp = float(rng.uniform(3.0, 5.0)), float(rng.uniform(0.2, 0.6))

    def stop_and_go(t: Floats) -> Floats:
        u = np.mod(t, period)
        return speed * np.asarray(np.clip(np.minimum(u, 0.7 * period - u) / ramp, 0.0, 1.0))

    return Drive(kind, duration, angle, stop_and_go)

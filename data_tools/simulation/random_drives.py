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
"""Time [s] in which a sweep, or a vehicle that turns, gets up to speed."""

CAR_WHEELBASE = 0.5
"""Distance of the axles [m] of the car that drives slaloms; its origin is the rear axle."""

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

    return Drive("sweep", duration, angle, lambda t: speed * _ramp(t))


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


def _ramp(t: Floats) -> Floats:
    """Return the share of the speed while the vehicle gets going."""
    u = np.clip(t / RAMP, 0.0, 1.0)
    return u * u * (3 - 2 * u)


def _changing(rng: Generator, speed: float) -> Callable[[Floats], Floats]:
    """Return a speed that starts from rest and swings between 0.43 and 1 times the top speed."""
    rate, phase = 2 * np.pi / rng.uniform(3.0, 6.0), rng.uniform(0, 2 * np.pi)
    return lambda t: speed * _ramp(t) * (0.715 + 0.285 * np.sin(rate * t + phase))


def _ahead(t: Floats) -> Floats:
    return np.zeros_like(t)


def _recorded_eight(rng: Generator, duration: float, speed: float) -> Drive:
    """Return eights: lobes that turn by 200 to 250 degrees, at 40 to 60 deg/s where fastest.

    The turning of a lobe is a half wave, so that one of peak w turns by 2 w / rate.
    """
    peak = np.radians(rng.uniform(40.0, 60.0))
    rate = 2 * peak / np.radians(rng.uniform(200.0, 250.0))
    way, profile = sign(rng), _changing(rng, speed)
    return Drive(
        "figure-eight",
        duration,
        _ahead,
        profile,
        lambda t: way * peak * _ramp(t) * np.sin(rate * t),
    )


def _recorded_slalom(rng: Generator, duration: float, speed: float) -> Drive:
    """Return a car's slalom: steered by up to 15 to 30 degrees at `CAR_WHEELBASE`, either way."""
    steer = np.radians(rng.uniform(15.0, 30.0))
    rate, phase = 2 * np.pi / rng.uniform(3.5, 6.0), rng.uniform(0, 2 * np.pi)
    profile = _changing(rng, speed)

    def yaw_rate(t: Floats) -> Floats:
        return profile(t) * np.tan(steer * np.sin(rate * t + phase)) / CAR_WHEELBASE

    return Drive("slalom", duration, _ahead, profile, yaw_rate)


def _recorded_strafe(rng: Generator, duration: float, speed: float) -> Drive:
    """Return a sweep whose body turns, too, by up to 20 to 45 deg/s."""
    sweep = _recorded_sweep(rng, duration, speed)
    turning = wobble(rng, np.radians(rng.uniform(20.0, 45.0)))
    return replace(sweep, kind="strafe", yaw_rate=lambda t: _ramp(t) * turning(t))


def _recorded_spin(rng: Generator, duration: float, speed: float) -> Drive:
    """Return turning in place, either way, at 30 to 60 deg/s at most; the speed says nothing."""
    turning = wobble(rng, np.radians(rng.uniform(30.0, 60.0)))
    return Drive("spin", duration, _ahead, _ahead, lambda t: _ramp(t) * turning(t))


def _recorded_circle(rng: Generator, duration: float, speed: float) -> Drive:
    """Return a circle of 0.6 to 1.5 m at constant speed, that it has from the start."""
    rate = sign(rng) * speed / rng.uniform(0.6, 1.5)
    return Drive(
        "circle",
        duration,
        _ahead,
        lambda t: np.full_like(t, speed),
        lambda t: np.full_like(t, rate),
    )


def _stopping(rng: Generator, speed: float) -> Callable[[Floats], Floats]:
    """Return a speed with a stop every 3 to 5 s, that starts from rest."""
    period, ramp = rng.uniform(3.0, 5.0), rng.uniform(0.4, 0.8)

    def profile(t: Floats) -> Floats:
        u = np.mod(t, period)
        rise = np.clip(np.minimum(u, 0.75 * period - u) / ramp, 0.0, 1.0)
        return speed * rise * rise * (3 - 2 * rise)

    return profile


def _recorded_stops(rng: Generator, duration: float, speed: float) -> Drive:
    """Return a straight line with stops, forwards only."""
    return Drive("stops", duration, _ahead, _stopping(rng, speed))


def _recorded_stop_and_go(rng: Generator, duration: float, speed: float) -> Drive:
    """Return a sweep with stops."""
    sweep = _recorded_sweep(rng, duration, speed)
    return replace(sweep, kind="stop and go", speed=_stopping(rng, speed))


RECORDED: dict[str, Callable[[Generator, float, float], Drive]] = {
    "sweep": _recorded_sweep,
    "fingers": _recorded_fingers,
    "stop and go": _recorded_stop_and_go,
    "straight": _recorded_straight,
    "arc": _recorded_arc,
    "figure-eight": _recorded_eight,
    "slalom": _recorded_slalom,
    "strafe": _recorded_strafe,
    "spin": _recorded_spin,
    "circle": _recorded_circle,
    "stops": _recorded_stops,
}
"""Motions of simulated recordings, drawn for a duration [s] and a top speed [m/s]; see
:func:`data_tools.simulation.recorded_drive.record_drive`."""

TURNING = ("figure-eight", "slalom", "strafe", "spin", "circle", "stops")
"""Those of `RECORDED` that vehicles drive which need not keep their heading."""


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

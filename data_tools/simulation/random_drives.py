"""The drives of studies, from plain parameters: each trial draws its own heading, phase and sense.

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
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from data_tools.simulation import drives
from data_tools.simulation.streams import Noise, SyntheticStreams, simulate
from evcalib.errors import InputError

Parameters = Mapping[str, Any]

HEADING_RATE, VELOCITY_RATE = 30.0, 50.0
"""Samples per second of the two streams of every study."""


def drive(parameters: Parameters, rng: np.random.Generator) -> drives.Drive:
    """Draw a drive of 20 s at 1 m/s (fingers take as long as they take).

    Raises
    ------
    InputError
        If ``parameters["motion"]`` is unknown.
    """
    kind = parameters["motion"]
    if kind not in _DRAWERS:
        raise InputError(f"motion must be one of {', '.join(_DRAWERS)}, not {kind!r}")
    return _DRAWERS[kind](parameters, rng)


def streams(
    parameters: Parameters, rng: np.random.Generator, *, largest_offset: float = 0.5
) -> SyntheticStreams:
    """Draw an offset, a drive, a rotation, and both noisy streams.

    Noise stands in ``heading_noise`` and ``velocity_noise``, as dictionaries of the attributes of
    `data_tools.simulation.streams.Noise`.
    """
    offset = rng.uniform(-largest_offset, largest_offset)
    return simulate(
        drive(parameters, rng),
        rng,
        offset=offset,
        heading_rate=HEADING_RATE,
        velocity_rate=VELOCITY_RATE,
        heading_noise=Noise(**parameters["heading_noise"]),
        velocity_noise=Noise(**parameters["velocity_noise"]),
    )


def noise(sigma: float, **more: Any) -> dict[str, Any]:
    """Return noise as the parameters of a cell: what differs from the default."""
    given = Noise(sigma, **more)
    values = {field.name: getattr(given, field.name) for field in fields(given)}
    defaults = Noise()
    return {name: v for name, v in values.items() if v != getattr(defaults, name)}


def _any_heading(rng: np.random.Generator) -> float:
    return float(rng.uniform(-np.pi, np.pi))


def _straight(parameters: Parameters, rng: np.random.Generator) -> drives.Drive:
    return drives.straight(heading=_any_heading(rng))


def _arc(parameters: Parameters, rng: np.random.Generator) -> drives.Drive:
    low, high = np.broadcast_to(parameters["radius_m"], 2)
    radius = rng.choice([-1, 1]) * rng.uniform(low, high)
    return drives.arc(radius=radius, heading=_any_heading(rng))


def _steps(make: Callable[..., drives.Drive]) -> Callable[..., drives.Drive]:
    def draw(parameters: Parameters, rng: np.random.Generator) -> drives.Drive:
        return make(
            turn=np.radians(parameters.get("turn_deg", 45.0)),
            side=parameters.get("side_s", 3.0),
            turn_time=parameters.get("turn_time_s", 0.0),
            heading=_any_heading(rng),
        )

    return draw


def _s_curve(parameters: Parameters, rng: np.random.Generator) -> drives.Drive:
    heading, phase = rng.uniform(-np.pi, np.pi, 2)
    return drives.s_curve(
        amplitude=np.radians(parameters.get("swing_deg", 45.0)),
        period=parameters.get("period_s", 8.0),
        heading=heading,
        phase=phase,
    )


def _fingers(parameters: Parameters, rng: np.random.Generator) -> drives.Drive:
    count = parameters.get("count", 3)
    angles = parameters.get("angles_deg", [180.0 * k / count for k in range(count)])
    return drives.fingers(_any_heading(rng) + np.radians(angles))


_DRAWERS: dict[str, Callable[[Parameters, np.random.Generator], drives.Drive]] = {
    "straight": _straight,
    "arc": _arc,
    "polyline": _steps(drives.polyline),
    "zigzag": _steps(drives.zigzag),
    "s-curve": _s_curve,
    "fingers": _fingers,
}

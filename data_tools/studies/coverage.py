"""Whether the error bars hold what they promise: how often they contain the truth, and how wide.

Each case is one kind of drive of 20 s at 1 m/s under one kind of noise.  The Cramer-Rao bound on
the offset stands beside its error.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from data_tools.simulation import random_drives
from data_tools.simulation.streams import SyntheticStreams
from data_tools.studies._engine.study import Cell, Row, Study
from evcalib.alignment import align
from evcalib.geometry import rotation_angle

ODOMETRY_NOISE = 0.02
"""Standard deviation of a velocity per axis [m/s], the same in all cases."""


def _case(name: str, noise: dict[str, Any], course: Mapping[str, Any], **more: Any) -> Cell:
    parameters = {
        "heading_noise": noise,
        "velocity_noise": random_drives.noise(ODOMETRY_NOISE),
        "method": "profile",
        "given": False,
        "max_offset": 1.0,
        **course,
        **more,
    }
    return Cell(name, parameters)


white = random_drives.noise
CURVE = {"motion": "s-curve", "swing_deg": 45.0, "period_s": 8.0}
"""The usual drive."""
LIVELY = {"motion": "s-curve", "swing_deg": 90.0, "period_s": 5.0}
"""One lively enough for a few milliseconds from 40 % of the headings."""
ARC = {"motion": "arc", "radius_m": [2.0, 10.0]}
FAST_ZIGZAG = {"motion": "zigzag", "turn_deg": 60.0, "side_s": 0.8, "turn_time_s": 0.3}
FINGERS = {"motion": "fingers", "angles_deg": [0.0, 60.0, 120.0]}

ACCURACY = (
    *(_case(f"white {s:g}", white(s), CURVE) for s in (0.02, 0.05, 0.1, 0.2)),
    *(_case(f"ar1 {rho:g}", white(0.1, rho=rho), CURVE) for rho in (0.4, 0.8)),
    _case("outliers 20%", white(0.1, outliers=0.2), CURVE),
    _case("lively white 0.1", white(0.1), LIVELY),
    _case("lively outliers 60%", white(0.1, outliers=0.6), LIVELY),
    _case("lively flips 40%", white(0.1, flips=0.4), LIVELY),
)
OTHERS = (
    _case("trace, outliers 60%", white(0.1, outliers=0.6), LIVELY, method="trace"),
    _case("trace, flips 40%", white(0.1, flips=0.4), LIVELY, method="trace"),
    _case("polyline", white(0.1), {"motion": "polyline"}, max_offset=0.7),
    _case("arc", white(0.1), ARC),
    _case("arc, offset given", white(0.1), ARC, given=True),
    _case("straight", white(0.1), {"motion": "straight"}),
    _case("zigzag, period 1.6 s", white(0.1), FAST_ZIGZAG, max_offset=1.5),
    _case("fingers", white(0.02), FINGERS),
    *(
        _case(f"s-curve {deg} deg", white(0.05), {**CURVE, "swing_deg": float(deg)})
        for deg in (5, 10, 20)
    ),
)
SLOW = tuple(
    _case(
        f"slow odometry {sd:g}, {name}",
        white(0.1),
        {**course, "velocity_noise": white(sd, rho=0.98)},
    )
    for name, course in {
        "s-curve": CURVE,
        "lively": LIVELY,
        "polyline": {"motion": "polyline", "max_offset": 0.7},
        "zigzag": {"motion": "zigzag", "turn_deg": 60.0, "side_s": 2.0, "max_offset": 0.9},
    }.items()
    for sd in (0.05, 0.1, 0.2)
)
"""Odometry whose noise remembers for a second: drift, as of wheels that creep."""
CASES = ACCURACY + OTHERS + SLOW
"""The second group asks mostly what is flagged."""


def study() -> Study:
    """Return the study."""
    return Study("coverage", CASES, trial)


def trial(parameters: Mapping[str, Any], seed: np.random.SeedSequence) -> list[Row]:
    """Return one row: errors, whether the intervals hold the truth, and what is flagged."""
    return [outcome(parameters, np.random.default_rng(seed))]


def outcome(parameters: Mapping[str, Any], rng: np.random.Generator) -> Row:
    """Return the row of one drive."""
    made = random_drives.streams(parameters, rng)
    found = align(
        made.headings,
        made.velocities,
        max_offset=parameters["max_offset"],
        offset_method=parameters["method"],
        offset=made.offset if parameters["given"] else None,
    )
    low, high = found.offset_interval
    error = rotation_angle(found.R_body_cam, made.R_body_cam)
    return {
        "offset_error_s": found.offset - made.offset,
        "offset_sd_s": found.offset_sd,
        "bound_s": cramer_rao(made, parameters["heading_noise"]["sigma"]),
        "offset_inside": bool(low <= made.offset <= high),
        "offset_observable": bool(found.offset_observable),
        "rotation_deg": np.degrees(error),
        "rotation_radius_deg": np.degrees(found.rotation_radius),
        "rotation_inside": bool(error <= found.rotation_radius),
        "rotation_observable": bool(found.rotation_observable),
    }


def cramer_rao(made: SyntheticStreams, sigma: float) -> float:
    """Return the Cramer-Rao bound on the offset's standard deviation [s], for small white noise.

    Var = (sigma_e^2 / rate_e + sigma_o^2 / rate_o) / integral of (omega - mean omega)^2 dt: noise
    of either stream per unit of time, over how much the rate of turning changes.
    """
    t, half = made.headings.t + made.offset, 1e-4
    rate = (made.drive.angle(t + half) - made.drive.angle(t - half)) / (2 * half)
    information = np.sum((rate - rate.mean()) ** 2) / random_drives.HEADING_RATE
    noise = sigma**2 / random_drives.HEADING_RATE + ODOMETRY_NOISE**2 / random_drives.VELOCITY_RATE
    return float(np.sqrt(noise / max(information, 1e-12)))

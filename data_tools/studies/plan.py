"""Planned drives (`evcalib.design.plan`): whether calibrations are as good as was predicted.

One level below events (`data_tools.studies.sighting_drives`), in a world as the prediction takes
it: corners of 0.3 px of noise that live for 0.6 s or so, no lag, no lean.  The paper's fingers, as
large and as many as tell most in the same time and space, stand beside.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from data_tools.simulation.drives import Drive
from data_tools.studies._engine.result import StudyResult
from data_tools.studies._engine.study import Cell, Row, Study
from data_tools.studies.sighting_drives import Fault, sight
from data_tools.studies.sightings import FARTHEST, NEAREST, RATE, Corners
from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.design import Plan, Viewing, plan
from evcalib.geometry import rotation_angle, rotation_vector_to_matrix
from evcalib.joint import Systematic
from evcalib.kinematics import Mecanum, Rolling, Vehicle
from evcalib.series import VelocitySeries

TIME = 16.0

VEHICLES: dict[str, tuple[Vehicle, tuple[float, float]]] = {
    "mecanum": (Mecanum(0.25, 0.2), (3.0, 2.0)),
    "differential": (Rolling.differential(0.4), (3.0, 2.0)),
    "car": (Rolling.ackermann(0.6, 0.4), (6.0, 4.0)),
}
"""Vehicles, and the space that they have [m]."""

CELLS = (
    *(Cell(name, {"vehicle": name, "drive": "plan"}) for name in VEHICLES),
    Cell("fingers of the mecanum", {"vehicle": "mecanum", "drive": "fingers"}),
)

WORLD = Corners(count=25, life=0.3, noise=0.3)

CAMERA = Camera(240, 180, 200.0, 200.0, 119.5, 89.5)
AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])

WHEELS = 0.002
"""Noise of a velocity [m/s], 50 times a second; the prediction takes velocities for true."""

VIEWING = Viewing(
    noise=WORLD.noise,
    # Corners live for twice `life`, so that twice `count` are there; the prediction has 20 Hz.
    corners=2 * WORLD.count * RATE / 20.0,
    # The mean square of 1 / distance.
    distance=float(np.sqrt(2 * np.log(FARTHEST / NEAREST) / (NEAREST**-2 - FARTHEST**-2))),
    lean_sd=0.0,
)

SHARED = Systematic(lag_sd=0.0, time_sd=0.0, rotation_sd=0.0, yaw_rate_sd=0.0063)
"""Nothing but the noise of the yaw rate, 0.01 rad/s 50 times a second, over 50 ms."""


def study() -> Study:
    """Return the study."""
    return Study("plan", CELLS, trial)


@cache
def planned(vehicle: str) -> Plan:
    """Return the plan of a vehicle."""
    what, space = VEHICLES[vehicle]
    return plan(what, space, time=TIME, viewing=VIEWING, systematic=SHARED)


def trial(parameters: Mapping[str, Any], seed: np.random.SeedSequence) -> list[Row]:
    """Return one row: errors, and the standard deviations that were predicted."""
    rng = np.random.default_rng(seed)
    made = planned(parameters["vehicle"])
    if parameters["drive"] == "fingers":
        assert made.fingers is not None
        made = made.fingers
    told = made.prediction
    R = rotation_vector_to_matrix(rng.normal(0.0, 0.1, 3)) @ AHEAD
    offset, lever = float(rng.uniform(-0.4, 0.4)), np.array([*VIEWING.position, 0.0])
    lever *= made.position_counts
    seen = sight(
        _drive(made.velocities),
        rng,
        camera=CAMERA,
        R_body_cam=R,
        offset=offset,
        corners=WORLD,
        odometry_noise=WHEELS,
        fault=Fault(lever=tuple(lever.tolist())),
    )
    found = seen.calibrate(max_offset=0.6)
    position = np.full(3, np.nan) if found.joint is None else found.joint.position - lever
    return [
        {
            "answered": bool(found.offset_observable and found.rotation_observable),
            "offset_error_s": found.offset - offset,
            "offset_predicted_s": told.offset_sd,
            "rotation_error_deg": np.degrees(rotation_angle(found.R_body_cam, R)),
            "rotation_predicted_deg": np.degrees(np.linalg.norm(told.rotation_sd)),
            "position_error_m": np.linalg.norm(position[:2]) if made.position_counts else np.nan,
            "position_predicted_m": np.linalg.norm(told.position_sd),
        }
    ]


def ratios(result: StudyResult) -> dict[str, dict[str, float]]:
    """Return the root mean square errors of those answered over those predicted, per cell.

    Parameters
    ----------
    result : StudyResult
        Of this study.

    Returns
    -------
    dict
        For each cell ``answered``, a share, and ratios ``offset``, ``rotation`` and ``position``.
    """
    found = {}
    for group in result.labels("group"):
        good = result.values("answered", group=group).astype(bool)
        found[group] = {"answered": float(good.mean())}
        for name, unit in (("offset", "s"), ("rotation", "deg"), ("position", "m")):
            error, sd = (
                result.values(f"{name}_{kind}_{unit}", group=group)[good]
                for kind in ("error", "predicted")
            )
            found[group][name] = float(np.sqrt(np.mean((error / sd) ** 2)))
    return found


def _drive(velocities: VelocitySeries) -> Drive:
    """Return the drive that a table of velocities tells."""

    def at(t: Floats, column: Floats) -> Floats:
        return np.interp(t, velocities.t, column)

    x, y, _ = velocities.v.T
    assert velocities.yaw_rate is not None
    rate = velocities.yaw_rate
    return Drive(
        "planned",
        float(velocities.t[-1]),
        lambda t: np.arctan2(at(t, y), at(t, x)),
        lambda t: np.hypot(at(t, x), at(t, y)),
        lambda t: at(t, rate),
    )

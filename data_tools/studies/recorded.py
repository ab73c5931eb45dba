"""From raw events to the calibration, on simulated recordings that nothing was tuned to.

Each trial draws a motion, a mounting, an offset and a room, simulates events and wheel states, and
calibrates as ``evcalib calibrate`` does.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from data_tools.simulation.recorded_drive import ROUGH, VEHICLE, Disturbances, record_drive
from data_tools.studies._engine.study import Cell, Row, Study
from evcalib.geometry import rotation_angle
from evcalib.kinematics import body_velocities
from evcalib.pipeline import calibrate

CELLS = (
    Cell("sweep", {"motion": "sweep", "rough": False}),
    Cell("fingers", {"motion": "fingers", "rough": False}),
    Cell("sweep, rough", {"motion": "sweep", "rough": True}),
    Cell("fingers, rough", {"motion": "fingers", "rough": True}),
    Cell("straight", {"motion": "straight", "rough": False}),
    Cell("arc", {"motion": "arc", "rough": False}),
)
"""Rough: noisy pixels, slipping wheels, a body that turns
(`data_tools.simulation.recorded_drive`)."""


def study() -> Study:
    """Return the study."""
    return Study("recorded", CELLS, trial, largest_piece=1)


def trial(parameters: Mapping[str, Any], seed: np.random.SeedSequence) -> list[Row]:
    """Return one row: errors, whether the intervals hold the truth, and what is determined."""
    rng = np.random.default_rng(seed)
    drive = record_drive(
        int(rng.integers(1 << 31)),
        motion=parameters["motion"],
        mounting=str(rng.choice(["forward", "sideways", "down"], p=[0.6, 0.2, 0.2])),
        disturbances=ROUGH if parameters["rough"] else Disturbances(),
    )
    body = body_velocities(drive.wheels, VEHICLE)
    run = calibrate(drive.simulator.stream(threads=1), drive.simulator.camera, body)
    found = run.calibration
    low, high = found.offset_interval
    error = rotation_angle(found.R_body_cam, drive.R_body_cam)
    row: Row = {
        "offset_error_s": found.offset - drive.offset,
        "offset_half_width_s": 0.5 * (high - low),
        "offset_inside": bool(low <= drive.offset <= high),
        "offset_observable": bool(found.offset_observable),
        "rotation_deg": np.degrees(error),
        "rotation_radius_deg": np.degrees(found.rotation_radius),
        "rotation_inside": bool(error <= found.rotation_radius),
        "rotation_observable": bool(found.rotation_observable),
        "lag_px": np.nan if found.joint is None else found.joint.lag,
        "headings": len(run.estimate.headings),
    }
    return [row]

"""Five runs of one rig, of which one may be off: whether comparing them tells.

One level below events (`data_tools.studies.sighting_drives`).  In the groups of changes the third
run has another offset, or another rotation, than the others.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from data_tools.simulation import random_drives
from data_tools.studies._campaign_faults import camera_of
from data_tools.studies._engine.study import Cell, Row, Study
from data_tools.studies.sighting_drives import sight
from evcalib.errors import InputError
from evcalib.geometry import random_rotation, rotation_angle, rotation_vector_to_matrix, unit
from evcalib.joint import SYSTEMATIC
from evcalib.pipeline import RunAnswer, compare_runs

RUNS, OFF = 5, 2

CELLS = (
    Cell("no change", {"shift_s": 0.0, "turn_deg": 0.0}),
    Cell("3 ms in one run", {"shift_s": 0.003, "turn_deg": 0.0}),
    Cell("0.3 deg in one run", {"shift_s": 0.0, "turn_deg": 0.3}),
)
"""What changes before the third run and back after it."""

DRIVE = {"motion": "s-curve", "swing_deg": 60.0, "period_s": 6.0}
"""One that determines both unknowns."""


def study() -> Study:
    """Return the study."""
    return Study("repeat", CELLS, trial)


def trial(parameters: Mapping[str, Any], seed: np.random.SeedSequence) -> list[Row]:
    """Return one row: what the comparison of five runs says, and how far off their mean is."""
    rng = np.random.default_rng(seed)
    camera, R, offset = camera_of(rng), random_rotation(rng), float(rng.uniform(-0.4, 0.4))
    turn = np.radians(parameters["turn_deg"]) * unit(rng.standard_normal(3))
    runs = []
    for k in range(RUNS):
        off = k == OFF
        made = sight(
            random_drives.drive(DRIVE, rng),
            rng,
            camera=camera,
            R_body_cam=rotation_vector_to_matrix(turn * off) @ R,
            offset=offset + parameters["shift_s"] * off,
        )
        try:
            runs.append(RunAnswer.of(f"{k}", made.calibrate(max_offset=0.6), SYSTEMATIC))
        except InputError:
            continue
    found = compare_runs(runs)
    rotation, time = found.unknowns.get("rotation"), found.unknowns.get("offset")
    R_found = np.eye(3) if found.R_body_cam is None else found.R_body_cam
    return [
        {
            "offset_runs": 0 if time is None else len(time.runs),
            "offset_p": np.nan if time is None else time.agreement.p_value,
            "offset_contradicts": time is not None and time.contradict,
            "offset_odd": "" if time is None else time.odd or "",
            "offset_error_s": found.offset - offset,
            "offset_sd_s": found.offset_sd,
            "rotation_runs": 0 if rotation is None else len(rotation.runs),
            "rotation_p": np.nan if rotation is None else rotation.agreement.p_value,
            "rotation_contradicts": rotation is not None and rotation.contradict,
            "rotation_odd": "" if rotation is None else rotation.odd or "",
            "rotation_deg": np.degrees(rotation_angle(R_found, R)),
            "rotation_radius_deg": np.degrees(found.rotation_radius),
        }
    ]

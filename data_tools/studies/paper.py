"""The paper's synthetic study (its Fig. 6): every method on the same drives.

Six arcs and six polylines, each with a random offset, mounting and heading; headings and
velocities are noisy, and the trajectories are what dead reckoning of them gives (paper Eq. 13), so
they drift.  The paper gives neither noise nor lengths; those here are the parameters of `study`.
`drives` adds what the paper lacks: zigzags, S-curves and fingers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from data_tools.simulation.random_drives import noise, streams
from data_tools.simulation.streams import SyntheticStreams
from data_tools.studies._engine.study import Cell, Row, Study
from evcalib.errors import EvcalibError
from evcalib.geometry import rotation_angle

GROUPS: dict[str, tuple[dict[str, Any], ...]] = {
    "arc": tuple({"radius_m": radius} for radius in (2.0, 4.0, 6.0, 8.0, 10.0, 12.0)),
    "polyline": tuple({"turn_deg": turn} for turn in (15.0, 30.0, 45.0, 60.0, 75.0, 90.0)),
    "zigzag": tuple({"turn_deg": turn} for turn in (15.0, 30.0, 45.0, 60.0, 75.0, 90.0)),
    "s-curve": tuple({"swing_deg": swing} for swing in (10.0, 20.0, 30.0, 45.0, 60.0, 90.0)),
    "fingers": tuple({"count": count} for count in (2, 3, 4, 5)),
}
"""What changes from group to group of each motion."""

UNITS = {"radius_m": "m", "turn_deg": "deg", "swing_deg": "deg", "count": ""}


def study(
    *,
    name: str = "paper",
    motions: Sequence[str] = ("arc", "polyline"),
    methods: Sequence[str] | None = None,
    heading_noise: Mapping[str, Any] | None = None,
    velocity_noise: Mapping[str, Any] | None = None,
    max_offset: float = 1.0,
) -> Study:
    """Return the study.

    Parameters
    ----------
    name : str
        Name of the study and its files.
    motions : sequence of str
        Keys of `GROUPS`.
    methods : sequence of str, optional
        Keys of :data:`evcalib.baselines.METHODS`; all if not given.
    heading_noise, velocity_noise : dict, optional
        Attributes of :class:`data_tools.simulation.streams.Noise`; standard deviations of 0.1 and
        0.02 if not given.
    max_offset : float
        Offsets from -max_offset to max_offset [s] are searched; true ones lie within +-0.5 s.
    """
    from evcalib.baselines import METHODS

    common = {
        "heading_noise": noise(**(heading_noise or {"sigma": 0.1})),
        "velocity_noise": noise(**(velocity_noise or {"sigma": 0.02})),
        "methods": list(methods or METHODS),
        "max_offset": max_offset,
    }
    cells = tuple(
        Cell(label(motion, change), {"motion": motion, **change, **common})
        for motion in motions
        for change in GROUPS[motion]
    )
    return Study(name, cells, trial)


def drives(**options: Any) -> Study:
    """Return the same study on the drives that the paper lacks."""
    return study(**{"name": "drives", "motions": ("zigzag", "s-curve", "fingers"), **options})


def label(motion: str, change: Mapping[str, Any]) -> str:
    """Return the name of a group."""
    ((name, value),) = change.items()
    return f"{motion} {value:g} {UNITS[name]}".rstrip()


def trial(parameters: Mapping[str, Any], seed: np.random.SeedSequence) -> list[Row]:
    """Return a row per method: errors of its rotation and offset, on the same streams.

    A method that gives up leaves its reason in ``failure``.
    """
    made = streams(parameters, np.random.default_rng(seed))
    draws = int(seed.generate_state(1)[0])
    return [_row(name, made, parameters["max_offset"], draws) for name in parameters["methods"]]


def _row(name: str, made: SyntheticStreams, max_offset: float, seed: int) -> Row:
    from data_tools.studies.baseline_runs import reckoned_poses
    from evcalib.baselines import TRAJECTORY_METHODS, RivalInput, calibrate_with

    try:
        given = RivalInput(made.headings, made.velocities)
        if name in TRAJECTORY_METHODS:
            speed = made.drive.speed(made.headings.t + made.offset)
            given = reckoned_poses(made.headings, made.velocities, speed)
        found = calibrate_with(name, given, max_offset=max_offset, seed=seed)
    except EvcalibError as error:
        return {"method": name, "failure": str(error)}
    return {
        "method": name,
        "rotation_deg": np.degrees(rotation_angle(found.R_body_cam, made.R_body_cam)),
        "offset_error_s": found.offset - made.offset,
        "offset_observable": bool(found.offset_observable),
        "rotation_observable": bool(found.rotation_observable),
    }

"""Vehicles that turn, from raw events, started from nothing: rotation, offset and position.

Eights of a differential drive, a car's slalom, mecanum wheels that strafe and turn; and motions
that cannot tell everything: turning in place, circles, straight lines with stops.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from data_tools.simulation.random_drives import TURNING
from data_tools.studies._drive_outcomes import draw, judged
from data_tools.studies._engine.study import Cell, Row, Study

SPEED = (0.5, 0.7)
"""Range of the top speed [m/s]; speeds then lie between 0.2 and 0.7 m/s."""

THRESHOLD = 0.3
"""Of the pixels: a turning camera makes ten million events in 4 s at 0.2, with nothing new in them.
"""

CELLS = tuple(
    Cell(
        motion,
        {
            "motion": motion,
            "duration": 16.0,
            "speed": list(SPEED),
            "sensor": {"threshold_on": THRESHOLD, "threshold_off": THRESHOLD},
        },
    )
    for motion in TURNING
)


def study() -> Study:
    """Return the study."""
    return Study("turning", CELLS, trial, largest_piece=1)


def trial(parameters: Mapping[str, Any], seed: np.random.SeedSequence) -> list[Row]:
    """Return one row: errors and bars of rotation, offset and position."""
    return [judged(draw(parameters, seed))]

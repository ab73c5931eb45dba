"""Everything at once: what robots see indoors, outdoors, at dusk and in the dark.

What pixels do is after the presets of v2e (Hu, Liu & Delbruck 2021): bandwidth of 300 Hz at a white
surface, leak of 0.1 Hz and threshold mismatch of 0.03 in good light; ``noisy``, for the dark, has
30 Hz, shot noise of 5 Hz and a mismatch of 0.05.  Between them the bandwidth falls with the light
and the shot noise grows.  Leak grows in sunlight (Nozaki & Delbruck 2017, "Temperature and
parasitic photocurrent effects in dynamic vision sensors").  The rest is a choice: a body of 0.2 to
0.3 deg per m/s^2 and 0.1 to 0.3 deg of vibration, wheels that slip by 2 to 5 %, encoders of 1 mm, a
log that is filtered over 20 ms and stamped to 2 ms, lamps on 50 Hz mains that flicker by 5 %.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from data_tools.studies._drive_outcomes import draw, judged
from data_tools.studies._engine.study import Cell, Row, Study

MOTIONS = ("fingers", "sweep", "stop and go")

INDOOR: dict[str, Any] = {
    "sensor": {
        "mismatch": 0.03,
        "refractory": 5e-4,
        "noise_rate": 0.1,
        "light": 0.5,
        "cutoff": 300.0,
        "shot_noise": 1.0,
        "leak_rate": 0.1,
        "hot_pixels": 0.001,
        "flicker": 0.05,
        "row_time": 1e-6,
        "event_time": 1e-7,
    },
    "body": {
        "tilt": float(np.radians(0.2)),
        "vibration": float(np.radians(0.1)),
        "untold_yaw_rate": float(np.radians(0.5)),
        "slip": 0.02,
        "encoder_step": 1e-3,
        "wheel_low_pass": 0.02,
        "wheel_jitter": 2e-3,
        "drop_out": 0.01,
        "dead_time": 0.05,
        "bandwidth": 4.0,
    },
}
"""A robot of the size of a vacuum cleaner to that of a pallet, on an even floor, in lamp light."""

ROUGH_GROUND: dict[str, Any] = {
    **INDOOR["body"],
    "tilt": float(np.radians(0.3)),
    "vibration": float(np.radians(0.3)),
    "untold_yaw_rate": float(np.radians(1.0)),
    "slip": 0.05,
}

OUTDOOR: dict[str, Any] = {
    "sensor": {
        **INDOOR["sensor"],
        "light": 1.0,
        "shot_noise": 0.5,
        "leak_rate": 0.3,
        "flicker": 0.0,
    },
    "body": ROUGH_GROUND,
}

DUSK: dict[str, Any] = {
    "sensor": {**OUTDOOR["sensor"], "light": 0.3, "shot_noise": 2.0, "leak_rate": 0.1},
    "body": ROUGH_GROUND,
}
"""Pixels of 90 Hz at a white surface."""

DARK: dict[str, Any] = {
    "sensor": {
        **DUSK["sensor"],
        "mismatch": 0.05,
        "light": 0.1,
        "shot_noise": 5.0,
    },
    "body": ROUGH_GROUND,
}
"""v2e's ``noisy``: 30 Hz at a white surface."""

MIXTURES = {"indoor robot": INDOOR, "outdoor": OUTDOOR, "dusk": DUSK, "dark": DARK}

CELLS = tuple(
    Cell(name + more, {"mixture": name, "imu": bool(more)})
    for name in MIXTURES
    for more in ("", ", IMU")
)


def study() -> Study:
    """Return the study."""
    return Study("mixtures", CELLS, trial, largest_piece=1)


def trial(parameters: Mapping[str, Any], seed: np.random.SeedSequence) -> list[Row]:
    """Return one row: errors, bars and class of a drive; motions take turns."""
    motion = MOTIONS[seed.spawn_key[1] % len(MOTIONS)]
    mixed = MIXTURES[parameters["mixture"]]
    drive = draw({"motion": motion, "duration": 16.0, **mixed}, seed)
    return [judged(drive, imu=parameters["imu"])]

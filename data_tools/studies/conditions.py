"""What one thing that is not ideal costs: body, sensor, lens, wheels, motion, one at a time.

Each trial draws a drive, its mounting, room and clocks, simulates raw events and a wheel log with
the disturbance of its cell, and calibrates.  Trial k is the same drive in all cells of a motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from data_tools.studies._drive_outcomes import draw, judged
from data_tools.studies._engine.study import Cell, Row, Study

MOTIONS = ("fingers", "sweep", "stop and go")

LENS = (-0.3, 0.1, 0.0, 0.0)
"""Distortion of the lens whose first coefficient is told 5 % off; a usual wide one."""


def _bodies(factor: str, values: Mapping[str, Any]) -> list[Cell]:
    return [
        Cell(f"{factor} {name}, {motion}", {"motion": motion, "body": body})
        for name, body in values.items()
        for motion in MOTIONS
    ]


def _sensors(factor: str, values: Mapping[str, Any]) -> list[Cell]:
    return [
        Cell(f"{factor} {name}".strip(), {"motion": "sweep", "sensor": sensor})
        for name, sensor in values.items()
    ]


def _one(factor: str, **parameters: Any) -> list[Cell]:
    return [Cell(factor, {"motion": "sweep", **parameters})]


def _rad(degrees: float) -> float:
    return float(np.radians(degrees))


FACTORS: dict[str, list[Cell]] = {
    "none": [Cell(f"none, {motion}", {"motion": motion}) for motion in MOTIONS],
    "tilt": _bodies("tilt", {f"{x} deg per m/s^2": {"tilt": _rad(x)} for x in (0.1, 0.3, 1.0)}),
    "vibration": _bodies("vibration", {f"{x} deg": {"vibration": _rad(x)} for x in (0.2, 0.5)}),
    "pixels": _sensors("pixels", {f"{x} Hz": {"cutoff": float(x)} for x in (200, 50, 20)}),
    "noise": _sensors("noise", {f"{x} Hz": {"noise_rate": float(x)} for x in (1, 3, 5, 10)})
    + _one("noise 5 Hz, unfiltered", sensor={"noise_rate": 5.0}, denoise=False),
    "leak": _sensors("leak", {f"{x} Hz": {"leak_rate": x} for x in (0.1, 0.5)}),
    "dim": _one(
        "dim light, pixels 30 Hz, shot noise 3 Hz",
        sensor={"light": 0.1, "cutoff": 300.0, "shot_noise": 3.0},
    ),
    "hot pixels": _sensors("hot pixels", {"0.5 %": {"hot_pixels": 0.005, "hot_rate": 200.0}}),
    "mismatch": _sensors("mismatch", {"20 %": {"mismatch": 0.2}}),
    "refractory": _sensors("refractory", {"5 ms": {"refractory": 5e-3}}),
    "readout": _sensors(
        "readout",
        {
            "2 us a row, 0.2 us an event": {"row_time": 2e-6, "event_time": 2e-7},
            "stamps of 1 ms": {"stamp": 1e-3},
            "gaps of 20 ms, 1 per s": {"gap_rate": 1.0, "gap": 0.02},
        },
    ),
    "flicker": _sensors(
        "flicker",
        {f"20 % at {x} Hz": {"flicker": 0.2, "flicker_rate": float(x)} for x in (100, 120)},
    ),
    "lens": _one("k1 5 % off", distortion=list(LENS), k1_share=1.05),
    "yaw": _one("yaw to 20 deg/s, told", body={"yaw_rate": _rad(20.0)})
    + [
        cell
        for x in (1, 3)
        for cell in _one(f"yaw to {x} deg/s, untold", body={"untold_yaw_rate": _rad(x)})
    ],
    "slip": _one("slip 5 %", body={"slip": 0.05}),
    "encoder": _one("encoder steps 5 mm", body={"encoder_step": 0.005}),
    "log": _one("log at 10 Hz", body={"wheel_rate": 10.0})
    + _one("log low-pass 50 ms", body={"wheel_low_pass": 0.05})
    + _one("log jitter 5 ms", body={"wheel_jitter": 0.005})
    + _one("steering with 2 deg of play", body={"backlash": _rad(2.0)})
    + _one("log drop-outs 20 %", body={"drop_out": 0.2}),
    "controllers": _one("controllers 0.1 s, 3 Hz", body={"dead_time": 0.1, "bandwidth": 3.0})
    + _one(
        "commands logged, controllers 0.1 s, 3 Hz",
        body={"dead_time": 0.1, "bandwidth": 3.0, "logs_commands": True},
    ),
    "short": _one("4 s", duration=4.0),
    "slow": _one("0.1 m/s", speed=0.1),
    "long": _one("60 s", duration=60.0),
}
"""What is varied, and the cells of each.

Sizes are those that small robots and event cameras have (`data_tools.studies.mixtures` says where
they are from), and larger ones, to see where it ends.
"""


CELLS = tuple(cell for cells in FACTORS.values() for cell in cells)


def study() -> Study:
    """Return the study; ``study().only(["tilt", "none"])`` has fewer cells."""
    return Study("conditions", CELLS, trial, largest_piece=1)


def trial(parameters: Mapping[str, Any], seed: np.random.SeedSequence) -> list[Row]:
    """Return one row: errors, bars and class of a drive."""
    drive = draw(parameters, seed)
    lens = drive.simulator.camera
    if "k1_share" in parameters:
        k1, *rest = lens.distortion
        lens = replace(lens, distortion=(parameters["k1_share"] * k1, *rest))
    return [judged(drive, lens, denoise=parameters.get("denoise", True))]

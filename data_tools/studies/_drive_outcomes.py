"""One simulated drive from raw events to its calibration, and what that is worth to a user."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from data_tools.simulation.gyro import Gyro, angular_rates
from data_tools.simulation.recorded_drive import (
    CAMERA,
    Disturbances,
    RecordedDrive,
    record_drive,
)
from data_tools.simulation.sensor import Sensor
from data_tools.studies._engine.study import Row
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.geometry import rotation_angle
from evcalib.imu import ImuSeries
from evcalib.kinematics import body_velocities
from evcalib.pipeline import RefinedCalibration, calibrate
from evcalib.uncertainty import t_quantile

USEFUL_S, USEFUL_DEG = 0.015, 1.0
"""An answer off by no more is useful: events of a scene that passes by at 1 m/s are then put 15 mm
off, and a point 10 m away 17 cm.  A choice."""

MAX_OFFSET = 0.6
"""Offsets within which all are searched [s]; true ones are drawn within 0.5 s."""

BIASED = Gyro(bias=(float(np.radians(1.0)),) * 3)
"""What a usual chip is off by: MPU-6150 within 20 deg/s, BMI160 3 (data sheets), less what was
subtracted at rest; a choice."""


def draw(parameters: Mapping[str, Any], seed: np.random.SeedSequence) -> RecordedDrive:
    """Return the drive of a trial.

    Trial k of all cells of a study draws from the same numbers: cells differ by nothing but their
    parameters, which cells are run does not matter, and cells can be compared drive by drive.

    Parameters
    ----------
    parameters : mapping
        ``motion``, and what differs from the defaults: ``sensor``, of `Sensor`; ``body``, of
        `Disturbances`; ``duration`` [s]; ``speed`` [m/s], or a range of two to draw from;
        ``distortion``, of the camera.
    seed : SeedSequence
        Of the trial.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed.entropy, spawn_key=seed.spawn_key[1:]))
    number = int(rng.integers(1 << 31))
    mounting = str(rng.choice(["forward", "sideways", "down"], p=[0.6, 0.2, 0.2]))
    speed = np.atleast_1d(parameters.get("speed", 0.5))
    return record_drive(
        number,
        motion=parameters["motion"],
        mounting=mounting,
        duration=parameters.get("duration", 10.0),
        speed=float(rng.uniform(speed[0], speed[-1])),
        camera=replace(CAMERA, distortion=tuple(parameters.get("distortion", ()))),
        disturbances=Disturbances(
            Sensor(**parameters.get("sensor", {})), **parameters.get("body", {})
        ),
    )


def judged(
    drive: RecordedDrive, camera: Camera | None = None, *, denoise: bool = True, imu: bool = False
) -> Row:
    """Calibrate a drive from its raw events, and return a row: what came out, and what it is worth.

    ``class`` is ``refused`` (offset or rotation not determined, or no answer), ``useful`` (within
    `USEFUL_S` and `USEFUL_DEG`), ``wide`` (off by more, but within its 95 % bars), ``wrong, told``
    (beyond a bar, with a doubt) or ``silently wrong``.  ``bars`` is the error over its 95 % bar,
    the larger one of offset and rotation.

    Parameters
    ----------
    drive : RecordedDrive
        What to calibrate.
    camera : Camera, optional
        What the calibration is told of the lens; the truth if not given.
    denoise : bool
        As in `calibrate`.
    imu : bool
        Whether the camera has a gyro, of a bias of 1 deg/s about each axis.
    """
    began = time.process_time()
    body = body_velocities(drive.wheels, drive.vehicle)
    lens = camera or drive.simulator.camera
    shown = {"motion": drive.drive.kind, "late_s": drive.late}
    try:
        stream = drive.simulator.stream(threads=1)
        gyro = ImuSeries(*angular_rates(drive.simulator, BIASED)) if imu else None
        run = calibrate(stream, lens, body, max_offset=MAX_OFFSET, denoise=denoise, imu=gyro)
    except InputError as error:
        return {**shown, **_REFUSED, "verdict": str(error), "seconds": time.process_time() - began}
    return {
        **shown,
        **outcome(run.calibration, drive),
        "headings": len(run.estimate.headings),
        "seconds": time.process_time() - began,
    }


def outcome(found: Any, drive: RecordedDrive) -> Row:
    """Return the errors of a calibration, its bars, and its class; see `judged`."""
    error = found.offset - drive.offset
    rotation = rotation_angle(found.R_body_cam, drive.R_body_cam)
    low, high = found.offset_interval
    bar = 0.5 * (high - low)
    determined = bool(found.offset_observable and found.rotation_observable)
    doubts = tuple(getattr(found.verdict, "doubts", ()))
    bars = max(abs(error) / bar, rotation / found.rotation_radius) if determined else np.nan
    useful = determined and abs(error) <= USEFUL_S and np.degrees(rotation) <= USEFUL_DEG
    outside = determined and bars > 1.0
    return {
        "offset_error_ms": 1e3 * error,
        "offset_95_ms": 1e3 * bar,
        "rotation_deg": np.degrees(rotation),
        "rotation_95_deg": np.degrees(found.rotation_radius),
        "bars": bars,
        "determined": determined,
        "inside": determined and not outside,
        "useful": useful,
        "silently_wrong": outside and not useful and not doubts,
        "class": _class(determined, useful, outside, bool(doubts)),
        **_position(found, drive),
        "doubts": " | ".join(doubts),
        "verdict": found.verdict.summary,
    }


def _class(determined: bool, useful: bool, outside: bool, doubted: bool) -> str:
    if not determined:
        return "refused"
    if useful:
        return "useful"
    if not outside:
        return "wide"
    return "wrong, told" if doubted else "silently wrong"


def _position(found: RefinedCalibration, drive: RecordedDrive) -> Row:
    """Return the error of the position in the plane [m], and whether both its bars hold it."""
    off = found.position[:2] - drive.lever[:2]
    known = all(found.position_observable)
    samples = np.inf if found.joint is None else found.joint.samples
    bar = t_quantile(samples) * found.position_sd[:2]
    return {
        "position_m": float(np.hypot(*off)) if known else np.nan,
        "position_95_m": float(np.hypot(*bar)) if known else np.nan,
        "position_determined": known,
        "position_inside": known and bool((np.abs(off) <= bar).all()),
    }


_REFUSED: Row = {
    "offset_error_ms": np.nan,
    "offset_95_ms": np.nan,
    "rotation_deg": np.nan,
    "rotation_95_deg": np.nan,
    "bars": np.nan,
    "determined": False,
    "inside": False,
    "useful": False,
    "silently_wrong": False,
    "class": "refused",
    "position_m": np.nan,
    "position_95_m": np.nan,
    "position_determined": False,
    "position_inside": False,
    "doubts": "",
    "headings": 0,
}
"""The row of a drive that gave no answer."""

"""From the files of a drive to its calibration and report: what ``evcalib calibrate`` runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.logs.velocity_sources import VelocitySource, read_body_velocities
from data_tools.recordings import Recording
from data_tools.runs._inputs import input_file
from data_tools.runs.folder import RunFolder
from data_tools.runs.headings import open_with_camera, with_progress
from data_tools.runs.imu import imu_of, rotation_of
from evcalib.alignment import Calibration
from evcalib.errors import InputError
from evcalib.kinematics import REFUSE_SLIP
from evcalib.pipeline import CalibrationRun, Truth, calibrate

LEAST_SLIP, USUAL_SLIPS = 0.05, 6.0
"""Rows whose slip is above this [m/s], and above so many times the median, or a third of the usual
wheel speed if that is less, are left out."""


def calibrate_files(recording: str | Path, camera: str | Path, **options: Any) -> Calibration:
    """Calibrate one recording; the calibration of `run_files`, whose parameters it takes."""
    return run_files(recording, camera, **options).calibration


def run_files(
    recording: str | Path,
    camera: str | Path,
    *,
    wheels: str | Path | None = None,
    vehicle: str | Path | None = None,
    velocities: str | Path | None = None,
    size: str | tuple[int, int] | None = None,
    camera_name: str | None = None,
    output: str | Path | None = None,
    overwrite: bool = False,
    command: str = "",
    max_slip: float | None = None,
    max_yaw_rate: float | None = None,
    reading: Mapping[str, Any] | None = None,
    motion: Mapping[str, Any] | None = None,
    imu: Mapping[str, Any] | None = None,
    on_stage: Callable[[str], object] = lambda name: None,
    truth: Truth | None = None,
    **options: Any,
) -> CalibrationRun:
    """Read a recording and how the vehicle moved, calibrate, and leave a folder of results.

    Parameters
    ----------
    recording : path
        Events, in any format that `data_tools.recordings.open_recording` knows.
    camera : path
        Its calibration, in any form that `data_tools.logs.camera_files` knows.
    wheels, vehicle : path
        Wheel log (CSV or bag) and vehicle file; a bag of velocities needs no vehicle.
    velocities : path
        Velocities (CSV or bag) in place of wheels and vehicle.
    size : str or (int, int), optional
        Sensor size, where no file tells it: ``240x180``.
    camera_name : str, optional
        Which camera of the file, where several are of the recording's size.
    output : path, optional
        Folder for calibration.yaml, headings.csv, velocities.csv and report.html.
    overwrite : bool
        Replace an earlier calibration there.
    command : str
        Command line that repeats the run, for the report.
    max_slip : float, optional
        Wheel rows that slip more [m/s] are left out; by default those above 0.05 m/s, and above
        six times the median or a third of the wheels' speed.
    max_yaw_rate : float, optional
        Rows that turn faster [rad/s] are left out; by default none, for turning is accounted for.
    reading, motion : mapping, optional
        Further options of `open_recording` and of `read_body_velocities`.
    imu : mapping, optional
        Arguments of `data_tools.runs.imu.imu_of`, ``source`` among them, and ``rotation``, a text
        that `data_tools.runs.imu.rotation_of` reads.
    on_stage : callable
        Called with the name of each stage as it begins.
    truth : Truth, optional
        For the report, where it is known.
    **options
        See `evcalib.calibrate`.

    Raises
    ------
    InputError
        If a file is unusable, the clocks do not overlap, or the folder cannot be used.
    """
    source = _one_source(wheels, vehicle, velocities)
    if isinstance(size, tuple):
        size = f"{size[0]}x{size[1]}"
    with ExitStack() as stack:
        folder = None
        if output is not None:
            folder = stack.enter_context(RunFolder(output, overwrite=overwrite, command=command))

        def stage(name: str) -> None:
            on_stage(name)
            if folder is not None:
                folder.stage(name)

        events, lens = open_with_camera(
            recording, camera, size=size, camera_name=camera_name, **(reading or {})
        )
        started = time.perf_counter()
        whole = read_body_velocities(
            source, vehicle=vehicle, origin_us=events.origin_us, **(motion or {})
        )
        body = _within_limits(whole, max_slip, max_yaw_rate)
        spent = time.perf_counter() - started
        gyro, told = _gyro(events, imu)
        run = calibrate(
            with_progress(iter(events)),
            lens,
            body.velocities if body.wheels is None else body.wheels,
            on_stage=stage,
            **gyro,
            **options,
        )
        told += [] if run.gyro is None else run.gyro.notes
        files = {"recording": recording, "camera": camera, "motion": source, "vehicle": vehicle}
        run = replace(
            run,
            recording=_description(
                events, run, [f"{source}: {line}" for line in body.notes] + told
            ),
            losses=dict(events.losses),
            settings={
                **run.settings,
                "max_slip": max_slip,
                "max_yaw_rate": max_yaw_rate,
                **({"clock_shift": shift} if (shift := (motion or {}).get("clock_shift")) else {}),
            },
            timings={"velocities": spent, **run.timings},
            command=command,
            truth=truth,
            files={
                role: input_file(path, digest=role == "vehicle")
                for role, path in files.items()
                if path is not None
            },
        )
        if folder is not None:
            stage("report")
            folder.write_run(run)
    return run


def _gyro(events: Recording, imu: Mapping[str, Any] | None) -> tuple[dict[str, Any], list[str]]:
    """Return what `evcalib.calibrate` is told of the IMU, and what the user should know of it."""
    if imu is None:
        return {}, []
    options = dict(imu)
    R_cam_imu = rotation_of(options.pop("rotation", None))
    found = imu_of(events, **options)
    return {"imu": found.imu, "R_cam_imu": R_cam_imu}, list(found.notes)


def _one_source(
    wheels: str | Path | None, vehicle: str | Path | None, velocities: str | Path | None
) -> str | Path:
    if (wheels is None) == (velocities is None):
        raise InputError("either wheels (with their vehicle) or velocities are needed, not both")
    if velocities is not None:
        if vehicle is not None:
            raise InputError("velocities need no vehicle: leave it out, or give wheels")
        return velocities
    assert wheels is not None
    return wheels


def _within_limits(
    source: VelocitySource, max_slip: float | None, max_yaw_rate: float | None
) -> VelocitySource:
    """Apply the limits; one of the slip that was not given follows the usual slip."""
    if source.wheels is not None and max_slip is None:
        wheels = source.wheels
        usual = USUAL_SLIPS * float(np.median(wheels.slip))
        max_slip = max(LEAST_SLIP, min(usual, REFUSE_SLIP * wheels.wheel_speed))
    return source.limited(max_slip=max_slip, max_yaw_rate=max_yaw_rate)


def _description(events: Recording, run: CalibrationRun, more: list[str]) -> dict[str, str]:
    counts, rate = run.estimate.counts, run.estimate.event_rate
    described = {
        "format": events.format,
        "sensor": f"{events.width} x {events.height} px",
        "events": f"{counts.events:,}",
    }
    if (noise := run.estimate.noise) is not None and noise.kept < noise.events:
        described["note noise"] = f"left out as noise: {noise.text()}"
    if rate is not None and rate.t.size:
        described["from"] = f"{rate.t[0]:.3f} s"
        described["to"] = f"{rate.t[-1] + rate.width:.3f} s"
    if events.origin_us:
        described["origin"] = f"{events.origin_us} us, subtracted from all times, also the body's"
    notes = [*events.notes, *more]
    described.update({f"note {k + 1}": note for k, note in enumerate(notes)})
    return described

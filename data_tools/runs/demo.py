"""The drives behind ``evcalib demo`` and README's pictures."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from data_tools.files.atomic import write_file
from data_tools.logs.vehicle_files import write_vehicle
from data_tools.logs.wheel_logs import write_wheel_log
from data_tools.recordings.convert import convert
from data_tools.runs.calibrate import run_files
from data_tools.runs.headings import with_progress
from data_tools.simulation.drives import s_curve
from data_tools.simulation.recorded_drive import VEHICLE, Disturbances, RecordedDrive, record_drive
from data_tools.simulation.sensor import Sensor
from data_tools.simulation.streams import Noise, SyntheticStreams, simulate
from evcalib.alignment import Calibration
from evcalib.errors import InputError, NoAnswerError
from evcalib.events import Events
from evcalib.geometry import rotation_angle
from evcalib.pipeline import Truth

DURATION, WARM_UP = 9.5, 3.0

FILES = {
    "recording": "events.h5",
    "camera": "calib.txt",
    "wheels": "wheels.csv",
    "vehicle": "vehicle.yaml",
}
"""Parameters of `data_tools.runs.calibrate.run_files`, and the names of their files in a folder."""


def demo_streams(seed: int = 1) -> SyntheticStreams:
    """Return an S-curve of 20 s with noise of 3 degrees that remembers, and 10 % outliers."""
    return simulate(
        s_curve(20.0, amplitude=np.radians(45), period=6.0),
        np.random.default_rng(seed),
        offset=0.137,
        heading_noise=Noise(0.05, rho=0.5, outliers=0.1),
        velocity_noise=Noise(0.02),
    )


def demo_drive(seed: int = 1) -> RecordedDrive:
    """Return a sweeping drive of 9.5 s with wheels that slip and a body that turns a little."""
    rough = Disturbances(Sensor(mismatch=0.1, noise_rate=1.0), slip=0.03, yaw_rate=np.radians(2.0))
    return record_drive(seed, duration=DURATION, disturbances=rough)


def files_in(folder: Path) -> dict[str, Any]:
    """Return the files of a recorded drive by role."""
    return {role: folder / name for role, name in FILES.items()}


def write_demo(folder: str | Path, drive: RecordedDrive) -> dict[str, Any]:
    """Write a recorded drive as the files that ``evcalib calibrate`` takes; return them by role."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {folder}: {error.strerror or error}") from None
    paths = files_in(folder)
    lens = drive.simulator.camera
    text = f"{lens.fx} {lens.fy} {lens.cx} {lens.cy} 0 0 0 0 0\n"
    write_file(paths["camera"], lambda path: path.write_text(text, encoding="ascii"))
    write_file(paths["wheels"], lambda path: write_wheel_log(path, drive.wheels, VEHICLE))
    write_file(paths["vehicle"], lambda path: write_vehicle(path, VEHICLE))
    convert(_Simulated(drive), paths["recording"])
    return paths


class _Simulated:
    """A simulation as a source of events to write."""

    path = Path("simulation")
    origin_us = 0

    def __init__(self, drive: RecordedDrive) -> None:
        self._simulator = drive.simulator
        self.width, self.height = drive.simulator.camera.width, drive.simulator.camera.height

    def __iter__(self) -> Iterator[Events]:
        yield from with_progress(self._simulator.stream(), "simulating")


def warm_up() -> None:
    """Calibrate a short drive, so that all that a calibration needs is compiled and kept."""
    with TemporaryDirectory() as folder:
        files = write_demo(folder, record_drive(0, duration=WARM_UP))
        with suppress(NoAnswerError):
            run_files(**files)


def against_truth(calibration: Calibration, truth: Truth) -> str:
    """Return lines that compare a calibration with the truth."""
    turn = np.degrees(rotation_angle(calibration.R_body_cam, truth.R_body_cam))
    error = 1e3 * (calibration.offset - truth.offset)
    return (
        "\nSimulated recording; found and true:\n"
        f"  offset    {calibration.offset:+.4f} s, {truth.offset:+.4f} s: error {error:+.1f} ms"
        f" (sd {1e3 * calibration.offset_sd:.1f} ms)\n"
        f"  rotation  error {turn:.2f} deg"
        f" (95 % radius {np.degrees(calibration.rotation_radius):.2f} deg)"
    )

"""Make the recorded drives behind notebooks 0 and 6, and the tables of many drives.

    python notebooks/_make_drives.py recordings        # notebooks/data/sweep, fingers: a minute
    python notebooks/_make_drives.py stages            # notebooks/data/stages.csv, 8 minutes
    python notebooks/_make_drives.py table FOLDER      # notebooks/data/recorded.csv, at once
    python notebooks/_make_drives.py lags FOLDER       # notebooks/data/lag.csv, at once
    python notebooks/_make_drives.py turning           # notebooks/data/turning.csv, 5 minutes

A drive is four files, as a user has them: events.h5, calib.txt, wheels.csv, vehicle.yaml; and the
truth, as a calibration.  The camera is small, so that the files are.  ``FOLDER`` holds what
``evcalib study recorded --trials 10 --seed 1 -o FOLDER`` or ``evcalib study lag --trials 1 -o
FOLDER`` (some ten minutes) left.
"""

from __future__ import annotations

import csv
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import yaml

from data_tools.runs.demo import write_demo
from data_tools.simulation import recorded_drive
from data_tools.simulation.random_drives import RECORDED
from data_tools.simulation.recorded_drive import VEHICLE, Disturbances, record_drive
from data_tools.simulation.sensor import Sensor
from data_tools.studies import lag, load_study
from data_tools.studies.sighting_drives import Fault, sight
from data_tools.studies.sightings import Corners
from evcalib.alignment import align
from evcalib.camera import Camera
from evcalib.geometry import LOOKS_FORWARD, rotation_angle, rotation_vector_to_matrix
from evcalib.kinematics import body_velocities
from evcalib.pipeline import calibrate
from evcalib.uncertainty import t_quantile

HERE = Path(__file__).parent / "data"
CAMERA = Camera(120, 90, 100.0, 100.0, 59.5, 44.5)
SENSOR = Sensor(0.3, 0.3, noise_rate=0.05)
DRIVES = {"sweep": (11, 12.0), "fingers": (11, 15.5)}
"""Motion to seed and duration [s]."""

STAGED = [("sweep", seed) for seed in range(301, 309)] + [
    ("fingers", seed) for seed in range(301, 305)
]
"""Motions and seeds of the drives that are followed from stage to stage."""

TURNED = [(motion, seed) for motion in ("figure-eight", "slalom", "strafe") for seed in range(12)]
"""Motions and seeds of the drives of bodies that turn."""

COLUMNS = {
    "offset_error_s": ("offset_error_ms", 1e3),
    "offset_half_width_s": ("offset_half_width_ms", 1e3),
    "offset_observable": ("offset_observable", 1.0),
    "rotation_deg": ("rotation_deg", 1.0),
    "rotation_radius_deg": ("rotation_radius_deg", 1.0),
    "rotation_observable": ("rotation_observable", 1.0),
    "lag_px": ("lag_px", 1.0),
}
"""Columns of the study to names and factors of the table."""


def make_recordings() -> None:
    """Simulate and write both drives."""
    for motion, (seed, duration) in DRIVES.items():
        drive = record_drive(
            seed,
            motion=motion,
            duration=duration,
            camera=CAMERA,
            disturbances=Disturbances(SENSOR),
        )
        for path in write_demo(HERE / motion, drive).values():
            print(f"{path.relative_to(HERE)}: {path.stat().st_size / 1000:.0f} kB")
        truth = {"R_body_cam": drive.R_body_cam.tolist(), "offset_s": drive.offset}
        truth |= {"offset_observable": True, "rotation_observable": True}
        (HERE / motion / "truth.yaml").write_text(yaml.safe_dump(truth), encoding="ascii")


def make_stages() -> None:
    """Calibrate some drives, and store the errors of the headings alone beside those at the end."""
    with (HERE / "stages.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["motion", "seed", "stage", "offset_error_ms", "rotation_deg"])
        for motion, seed in STAGED:
            drive = record_drive(seed, motion=motion)
            body = body_velocities(drive.wheels, VEHICLE)
            run = calibrate(drive.simulator.stream(), drive.simulator.camera, body)
            before = align(run.estimate.headings, run.velocities)
            for stage, found in (("headings", before), ("tracks", run.calibration)):
                late = 1e3 * (found.offset - drive.offset) if found.offset_observable else np.nan
                turn = np.degrees(rotation_angle(found.R_body_cam, drive.R_body_cam))
                writer.writerow([motion, seed, stage, f"{late:.3g}", f"{turn:.3g}"])
            file.flush()


def make_table(folder: Path) -> None:
    """Shorten the table of a finished study: a line per drive."""
    table = load_study(folder / "recorded.h5").table
    with (HERE / "recorded.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["drive", *(name for name, _ in COLUMNS.values())])
        columns = [[k * float(x) for x in table[name]] for name, (_, k) in COLUMNS.items()]
        for group, *values in zip(table["group"], *columns, strict=True):
            writer.writerow([str(group), *(f"{value:.4g}" for value in values)])


def make_lags(folder: Path) -> None:
    """Shorten the table of the study of lags: a line per drive and way to measure."""
    result = load_study(folder / "lag.h5")
    settings = [field.name for field in fields(lag.Drive)]
    measured = [name for name in result.table if name not in ("cell", "group", "trial", "failure")]
    with (HERE / "lag.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*settings, *measured])
        columns = (result.table[name].tolist() for name in ("cell", *measured))
        for cell, *values in zip(*columns, strict=True):
            row = [*(result.cells[cell].parameters[name] for name in settings), *values]
            writer.writerow([f"{v:.4g}" if isinstance(v, float) else v for v in row])


def make_turning() -> None:
    """Calibrate bodies that turn, from corners as a camera sees them, and store errors and bars."""
    errors = ["offset_error_ms", "rotation_error_deg", "x_error_cm", "y_error_cm"]
    bars = ["offset_95_ms", "rotation_95_deg", "x_95_cm", "y_95_cm"]
    with (HERE / "turning.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["motion", "seed", *errors, *bars])
        for motion, seed in TURNED:
            row = [motion, seed, *(f"{value:.3g}" for value in turned(motion, seed))]
            writer.writerow(row)
            file.flush()


def turned(motion: str, seed: int) -> list[float]:
    """Return errors of offset, rotation, x and y, and their 95 % bars."""
    rng = np.random.default_rng([8, seed])
    R = rotation_vector_to_matrix(np.radians(rng.uniform(-30, 30, 3))) @ LOOKS_FORWARD
    lever = (*rng.uniform(-0.4, 0.4, 2), 0.3)
    offset = float(rng.uniform(-0.5, 0.5))
    drive = sight(
        RECORDED[motion](rng, 12.0, float(rng.uniform(0.5, 0.7))),
        rng,
        camera=recorded_drive.CAMERA,
        R_body_cam=R,
        offset=offset,
        corners=Corners(noise=0.3, false=0.1),
        fault=Fault(lever=lever),
    )
    found = drive.calibrate(max_offset=0.6)
    off = 100 * (found.position[:2] - lever[:2])
    half = 100 * t_quantile(found.samples) * found.position_sd[:2]
    return [
        1e3 * (found.offset - offset),
        float(np.degrees(rotation_angle(found.R_body_cam, R))),
        *off,
        500 * float(np.ptp(found.offset_interval)),
        float(np.degrees(found.rotation_radius)),
        *half,
    ]


if __name__ == "__main__":
    if sys.argv[1:2] == ["recordings"]:
        make_recordings()
    elif sys.argv[1:2] == ["stages"]:
        make_stages()
    elif sys.argv[1:2] == ["table"] and len(sys.argv) == 3:
        make_table(Path(sys.argv[2]))
    elif sys.argv[1:2] == ["lags"] and len(sys.argv) == 3:
        make_lags(Path(sys.argv[2]))
    elif sys.argv[1:2] == ["turning"]:
        make_turning()
    else:
        sys.exit(__doc__)

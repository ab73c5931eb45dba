"""Make the small recordings and the measured tables behind notebooks 1, 2 and 7.

    python notebooks/_make_data.py recordings           # notebooks/data/*.npz, half a minute
    python notebooks/_make_data.py tables DATA_FOLDER   # notebooks/data/*.csv, a few minutes
    python notebooks/_make_data.py studies FOLDER       # notebooks/data/study_*.csv, at once

The simulator makes the recordings.  The tables are measured on full-size simulations and on the
real recording in ``DATA_FOLDER/slider_depth`` (Event Camera Dataset: ``events.txt.gz`` and
``calib.txt``).  ``FOLDER`` holds what ``evcalib study NAME --trials 100 --seed 1 -o FOLDER`` left
for the names paper, drives and real.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools.course.samples import Sample, write_sample
from data_tools.logs.camera_files import read_calib_txt
from data_tools.recordings.formats.events_text import load_events_text
from data_tools.simulation.scenes import furnished_room
from data_tools.simulation.sensor import Sensor
from data_tools.simulation.simulator import FORWARD, Simulator, simulate_translation
from data_tools.simulation.trajectory import Trajectory
from data_tools.studies import load_study, short_lines
from evcalib.camera import Camera
from evcalib.events import Events
from evcalib.geometry import angle_between, unit
from evcalib.heading import estimate_headings
from evcalib.surfaces import SURFACES

HERE = Path(__file__).parent / "data"
SPEEDS = (0.2, 0.4, 0.8, 1.6)
"""Speeds of the same path [m/s]."""
PATH = 0.4
"""Its length [m]."""
PLACES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
"""Where on it pictures are taken, as parts of it."""
FULL = Camera(346, 260, 250.0, 250.0, 172.5, 129.5)
"""The camera behind the tables."""

Floats = NDArray[np.float64]


def recorded(
    direction: tuple[float, ...],
    speed: float,
    duration: float,
    camera: Camera,
    *,
    threshold: float,
    pictures: tuple[float, ...] = (),
) -> Sample:
    """Simulate a straight motion, with pictures at some parts of its duration."""
    ahead = unit(np.array(direction))
    ends = np.outer([-0.5, 0.5], speed * duration * FORWARD @ ahead) + [0.0, 0.0, 1.2]
    path = Trajectory(np.array([0.0, duration]), ends)
    scene = furnished_room(path.position_at(np.linspace(0.0, duration, 100)), 3)
    sensor = Sensor(threshold, threshold)
    simulator = Simulator(path, camera, scene, lever=(0.0, 0.0, 0.0), sensor=sensor, seed=3)
    times = duration * np.array(pictures)
    shape = (times.size, camera.height, camera.width)
    light = np.array([simulator.frame(t) for t in times]).reshape(shape)
    depths = np.array([simulator.depth(t) for t in times]).reshape(shape)
    brightest = light.max(initial=1e-9)
    frames = np.rint(255 * np.sqrt(light / brightest)).astype(np.uint8)
    return Sample(simulator.run().events, camera, ahead, speed, times, frames, depths)


def make_recordings() -> None:
    """Make one path at four speeds (notebook 1), and two drives (notebook 2)."""
    small = Camera(160, 120, 115.0, 115.0, 79.5, 59.5)
    for speed in SPEEDS:
        pictures = PLACES if speed == SPEEDS[0] else ()
        sample = recorded((1, 0, 0.3), speed, PATH / speed, small, threshold=0.5, pictures=pictures)
        _write(f"speed_{round(100 * speed):03d}", sample)
    large = Camera(240, 180, 173.0, 173.0, 119.5, 89.5)
    drives = {"sideways": ((1, 0, 0.3), 0.7), "forward": ((0.35, 0, 1), 0.5)}
    for name, (direction, threshold) in drives.items():
        sample = recorded(direction, 0.6, 0.75, large, threshold=threshold, pictures=(0.5,))
        _write(name, sample)


def _write(name: str, sample: Sample) -> None:
    path = HERE / f"{name}.npz"
    write_sample(path, sample)
    print(f"{path.name}: {len(sample.events)} events, {path.stat().st_size / 1000:.0f} kB")


def make_surface_table(slider: Path) -> None:
    """Measure the headings from each surface at several speeds.

    Keyframes and baselines follow the speed, so that only the surface can notice it.
    """
    rows = []
    for speed in (0.25, 0.5, 1.0, 2.0):
        recordings = [
            (simulate_translation(direction, speed, 0.45 / speed, FULL, seed=k).events, direction)
            for k, direction in enumerate([(1, 0, 0.3), (1, 0, 1), (0, 0, 1)])
        ]
        for surface in SURFACES:
            options = {"surface": surface, "rate": 40 * speed, "max_baseline": 0.35 / speed}
            parts = [_errors(e, FULL, d, options) for e, d in recordings]
            rows.append((f"simulated,{speed:.2f} m/s,{surface}", parts))
    events, camera = _slider(slider)
    for factor in (0.25, 0.5, 1.0, 2.0, 4.0):
        t = np.rint(events.t / factor).astype(np.int64)
        faster = Events(events.x, events.y, t, events.p, events.width, events.height)
        for surface in SURFACES:
            options = {"surface": surface, "rate": 20 * factor, "max_baseline": 0.7 / factor}
            part = _errors(faster, camera, (1, 0, 0), options, start=0.2 / factor)
            rows.append((f"slider_depth,x{factor:.2f},{surface}", [part]))
    _write_table("surfaces.csv", "recording,speed,surface", rows)


def make_solver_table(slider: Path) -> None:
    """Measure the headings of both solvers over the direction of motion."""
    rows = []
    for angle in (0, 15, 30, 45, 60, 75, 90):
        direction = (np.sin(np.deg2rad(angle)), 0.0, np.cos(np.deg2rad(angle)))
        events = simulate_translation(direction, 0.5, 0.9, FULL, seed=angle).events
        for solver in ("two_point", "five_point"):
            part = _errors(events, FULL, direction, {"solver": solver})
            rows.append((f"simulated,{angle},{solver}", [part]))
    for solver in ("two_point", "five_point"):
        part = _errors(*_slider(slider), (1, 0, 0), {"solver": solver}, start=0.2)
        rows.append((f"slider_depth,90,{solver}", [part]))
    _write_table("solvers.csv", "recording,angle_deg,solver", rows)


def _slider(folder: Path) -> tuple[Events, Camera]:
    events = load_events_text(folder / "events.txt.gz", 240, 180)
    return events, read_calib_txt(folder / "calib.txt", 240, 180)


def _errors(
    events: Events,
    camera: Camera,
    truth: tuple[float, ...],
    options: dict[str, Any],
    start: float | None = None,
) -> tuple[Floats, int]:
    """Return the errors [deg] after `start`, or in the middle half, and the windows there."""
    estimate = estimate_headings(events, camera, **options)
    low, high = (0.25 * events.duration, 0.75 * events.duration) if start is None else (start, 1e9)
    t = estimate.headings.t
    inside = (t >= low) & (t <= high)
    lost = sum(low <= gap.t <= high for gap in estimate.gaps)
    off = np.degrees(angle_between(estimate.headings.v[inside], unit(np.array(truth))))
    return off, off.size + lost


def make_study_tables(folder: Path) -> None:
    """Shorten the tables of finished studies: a line per group, method and quantity."""
    for name in ("paper", "drives"):
        result = load_study(folder / f"{name}.h5")
        lines = short_lines(result, {"offset_observable": ["ours"]})
        _write_lines(f"study_{name}.csv", lines)
    table = load_study(folder / "real.h5").table
    columns = ("group", "method", "rotation_deg", "offset_s", "rotation_sd_deg", "offset_sd_s")
    lines = [",".join(columns)]
    for row in zip(*(table[column].tolist() for column in columns), strict=True):
        head = (text.replace(",", "") for text in row[:2])
        lines.append(",".join([*head, *("" if v != v else f"{v:.3f}" for v in row[2:])]))
    _write_lines("study_real.csv", lines)


def _write_lines(name: str, lines: list[str]) -> None:
    path = HERE / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"{name}: {len(lines) - 1} rows, {path.stat().st_size / 1000:.0f} kB")


def _write_table(name: str, head: str, rows: list[tuple[str, list[tuple[Floats, int]]]]) -> None:
    lines = [f"{head},median_deg,p90_deg,found"]
    for start, parts in rows:
        off = np.concatenate([part for part, _ in parts])
        found = off.size / sum(windows for _, windows in parts)
        values = (np.median(off), np.percentile(off, 90)) if off.size else (np.nan, np.nan)
        lines.append(f"{start},{values[0]:.2f},{values[1]:.2f},{found:.2f}")
    (HERE / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    HERE.mkdir(exist_ok=True)
    if sys.argv[1:2] == ["recordings"]:
        make_recordings()
    elif sys.argv[1:2] == ["tables"] and len(sys.argv) == 3:
        make_surface_table(Path(sys.argv[2]) / "slider_depth")
        make_solver_table(Path(sys.argv[2]) / "slider_depth")
    elif sys.argv[1:2] == ["studies"] and len(sys.argv) == 3:
        make_study_tables(Path(sys.argv[2]))
    else:
        sys.exit(__doc__)

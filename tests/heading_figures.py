"""Headings of real events, as one table that anybody can make again.

``EVCALIB_DATA=FOLDER python tests/heading_figures.py`` prints, per recording, lens and transform,
windows with a heading where nothing translates, and the spread of the headings of slider_depth.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from data_tools.logs.camera_files import read_calib_txt
from data_tools.recordings import open_recording
from evcalib.camera import Camera
from evcalib.events import Events
from evcalib.geometry import angle_between, unit
from evcalib.heading import estimate_headings

TRANSFORMS = ("as it is", "reversed", "transposed", "mirrored")
"""Exact transforms of a recording and its calibration."""

FOCAL_GARFIELD = (100.0, 115.0, 150.0)
"""Focal lengths [px] that a DVS128 may have had; nobody told."""

EVBENCH, SLIDER = "rotation/evbench/calib.txt", "slider_depth/calib.txt"
SIZES = {"rotation": (240, 180), "slider_depth": (240, 180), "motion": (128, 128)}
TURN = ("no parallax: a turn explains the matches",)
THINGS = ("only a small part of the image moves", "matches move to and fro along the direction")


@dataclass(frozen=True)
class Case:
    """A recording without translation, and the lens that it is said to have."""

    name: str
    recording: str
    lens: str | float
    plain: bool
    reasons: tuple[str, ...]


def still_cases() -> list[Case]:
    """Return turns, rolls and moving things, with good and with bad camera files."""
    cases = []
    for name in ("seq_0001", "seq_0003"):
        for plain in (False, True):
            title = f"{name}{' plain lens' if plain else ''}"
            recording = f"rotation/evbench/{name}.txt.gz"
            cases.append(Case(title, recording, EVBENCH, plain, TURN))
    for plain in (False, True):
        title = f"disk{' plain lens' if plain else ''}"
        rolls = (*THINGS, "matches disagree")
        cases.append(Case(title, "rotation/disk/events.txt.gz", SLIDER, plain, rolls))
    for focal in (200.0, 350.0):
        car = f"car {focal:.0f}"
        cases.append(Case(car, "still/atis_car.txt.gz", focal, True, (*TURN, *THINGS)))
        cases.append(Case(f"emlb {focal:.0f}", "still/emlb.aedat4", focal, True, THINGS))
    return cases


def events_of(data: Path, recording: str) -> Events:
    """Return the events of a real recording."""
    size = (304, 240) if "atis" in recording else SIZES.get(recording.split("/")[0])
    pieces = list(open_recording(data / recording, size=size))
    columns = (np.concatenate([getattr(piece, name) for piece in pieces]) for name in "xytp")
    return Events.from_arrays(*columns, pieces[0].width, pieces[0].height)


def lens_of(data: Path, case: Case | float) -> Camera:
    """Return the camera of a case, or that of garfield with a focal length."""
    if not isinstance(case, Case):
        return Camera(128, 128, case, case, 63.5, 63.5)
    if isinstance(case.lens, str):
        told = read_calib_txt(data / case.lens, 240, 180)
        return replace(told, distortion=(0.0,) * 5) if case.plain else told
    width, height = (304, 240) if "atis" in case.recording else (346, 260)
    return Camera(width, height, case.lens, case.lens, 0.5 * width, 0.5 * height)


def transformed(how: str, events: Events, camera: Camera) -> tuple[Events, Camera]:
    """Return an exact transform of a recording and its calibration."""
    x, y, t, p = events.x.astype(int), events.y.astype(int), events.t, events.p
    width, height = camera.width, camera.height
    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    k1, k2, p1, p2, k3 = (*camera.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    if how == "reversed":
        x, y, t, p = x[::-1], y[::-1], (t[-1] - t)[::-1], ~p[::-1]
    elif how == "transposed":
        x, y, width, height = y, x, height, width
        camera = Camera(width, height, fy, fx, cy, cx, (k1, k2, p2, p1, k3))
    elif how == "mirrored":
        x = width - 1 - x
        camera = Camera(width, height, fx, fy, width - 1 - cx, cy, (k1, k2, p1, -p2, k3))
    return Events.from_arrays(x, y, t, p, width, height), camera


def spread(data: Path, how: str) -> tuple[np.ndarray, np.ndarray, int]:
    """Return how far headings of slider_depth are off their mean, their sd [deg], how many lack.

    The slider has its speed from 0.2 s on.
    """
    events = events_of(data, "slider_depth/events.txt.gz")
    events, camera = transformed(how, events, read_calib_txt(data / SLIDER, 240, 180))
    end = 1e-6 * events.t[-1]
    low, high = (0.0, end - 0.2) if how == "reversed" else (0.2, end)
    estimate = estimate_headings(events, camera)
    headings = estimate.headings
    steady = (headings.t >= low) & (headings.t <= high)
    v = headings.v[steady]
    off = np.degrees(angle_between(v, unit(v.mean(axis=0))))
    lost = sum(low <= gap.t <= high for gap in estimate.gaps)
    return off, np.degrees(headings.sd[steady]), lost


def main() -> None:
    """Print the table."""
    data = Path(os.environ["EVCALIB_DATA"])
    wrong = windows = 0
    for case in still_cases():
        for how in TRANSFORMS:
            told = transformed(how, events_of(data, case.recording), lens_of(data, case))
            estimate = estimate_headings(*told)
            found = len(estimate.headings)
            print(f"{case.name:20s} {how:10s} {found} of {found + len(estimate.gaps)} windows")
            wrong, windows = wrong + found, windows + found + len(estimate.gaps)
    print(f"without translation: {wrong} of {windows} windows have a heading")
    for how in TRANSFORMS:
        off, sd, lost = spread(data, how)
        z = np.sqrt(0.5 * np.mean((off / sd) ** 2))
        print(
            f"slider_depth {how:10s} {off.size} headings, {lost} lost; off their mean by"
            f" {np.median(off):.2f} deg (median), {np.percentile(off, 90):.2f} (90 %); z {z:.2f}"
        )


if __name__ == "__main__":
    main()

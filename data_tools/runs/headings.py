"""From a recording's files to its headings: what ``evcalib headings`` runs."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm.auto import tqdm

from data_tools.logs.camera_files import read_camera_file
from data_tools.recordings import Recording, open_recording
from data_tools.recordings.formats import SizeUnknown
from data_tools.runs.imu import imu_of, rotation_of
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.heading import HeadingEstimate, estimate_headings
from evcalib.heading.gyro import corrected
from evcalib.imu import Attitude, attitude_of


@dataclass(frozen=True, eq=False)
class RecordingHeadings:
    """Headings of a recording, and what sums them up: counts, and why windows have none."""

    estimate: HeadingEstimate
    summary: str


def parse_size(size: str) -> tuple[int, int]:
    """Return (width, height) [px] of a text like ``240x180``."""
    found = re.fullmatch(r"([1-9]\d{0,4})x([1-9]\d{0,4})", size.strip())
    if found is None:
        raise InputError(f"the size must be WIDTHxHEIGHT in pixels, like 240x180, not {size!r}")
    return int(found.group(1)), int(found.group(2))


def open_with_camera(
    recording: str | Path,
    camera: str | Path,
    *,
    size: str | None = None,
    camera_name: str | None = None,
    **options: Any,
) -> tuple[Recording, Camera]:
    """Open a recording and the camera that made it, whose sizes must be the same.

    Of several cameras in a file, the only one of the recording's size is taken.

    Parameters
    ----------
    recording, camera, size, camera_name
        As in `headings_from_files`.
    **options
        As in :func:`data_tools.recordings.open_recording`.
    """
    cameras = read_camera_file(camera)
    given = None if size is None else parse_size(size)
    if given is not None:
        cameras.choose(given[0], given[1], camera_name)
    try:
        opened = open_recording(recording, size=given, **options)
    except SizeUnknown:
        opened = open_recording(recording, size=cameras.size(camera_name), **options)
    lens, notes = cameras.choose(opened.width, opened.height, camera_name)
    for note in notes:
        opened.note(note)
    return opened, lens


def headings_from_files(
    recording: str | Path,
    camera: str | Path,
    *,
    size: str | None = None,
    camera_name: str | None = None,
    time_unit: str | None = None,
    format: str | None = None,
    origin_us: int | None = None,
    disorder: str = "refuse",
    stream: str | None = None,
    imu: Mapping[str, Any] | None = None,
    **options: Any,
) -> RecordingHeadings:
    """Read a recording in pieces and estimate its headings.

    Parameters
    ----------
    recording : path
        Events in any format that is known.
    camera : path
        Its calibration, in any form that `data_tools.logs.camera_files` knows.
    size : str, optional
        ``WIDTHxHEIGHT`` [px], needed where neither the camera file nor the recording tells it.
    camera_name : str, optional
        Which camera of the file, where several are of the recording's size.
    time_unit, format, origin_us, disorder, stream
        As in :func:`data_tools.recordings.open_recording`.
    imu : mapping, optional
        Arguments of `data_tools.runs.imu.imu_of`, ``source`` among them, and ``rotation``, a text
        that `data_tools.runs.imu.rotation_of` reads.  The recording is then read twice: first for
        the bias of the gyro.
    **options
        As in :func:`evcalib.heading.estimate_headings`.
    """
    opened, lens = open_with_camera(
        recording,
        camera,
        size=size,
        camera_name=camera_name,
        time_unit=time_unit,
        format=format,
        origin_us=origin_us,
        disorder=disorder,
        stream=stream,
    )
    started = time.perf_counter()
    attitude = None if imu is None else _attitude(opened, lens, dict(imu), options)
    estimate = estimate_headings(with_progress(iter(opened)), lens, attitude=attitude, **options)
    seconds = time.perf_counter() - started
    return RecordingHeadings(estimate, _summary(estimate, opened, seconds))


def _attitude(
    opened: Recording, lens: Camera, imu: dict[str, Any], options: Mapping[str, Any]
) -> Attitude:
    """Return how the gyro says that the camera turns, its bias found from the events."""
    R = rotation_of(imu.pop("rotation", None))
    found = imu_of(opened, **imu)
    for note in found.notes:
        opened.note(note)
    turn = isinstance(R, str)
    axes = np.eye(3) if R is None or isinstance(R, str) else R
    first = attitude_of(found.imu, axes)
    estimate = estimate_headings(
        with_progress(iter(opened), "reading for the gyro"),
        lens,
        attitude=first,
        **{**options, "keep_correspondences": True},
    )
    better = corrected(found.imu, first, estimate, focal=lens.focal, R_cam_imu=axes, turn=turn)
    for note in better.notes:
        opened.note(note)
    return better.attitude


def _summary(estimate: HeadingEstimate, recording: Recording, seconds: float) -> str:
    events, found = estimate.counts.events, len(estimate.headings)
    inliers = estimate.headings.inliers
    median = int(np.median(inliers)) if inliers is not None and found else 0
    lines = [
        f"{events} events in {seconds:.1f} s ({events / seconds / 1e6:.2f} million/s);"
        f" {found} headings of {found + len(estimate.gaps)} windows, {median} inliers (median)"
    ]
    reasons = Counter(gap.reason for gap in estimate.gaps)
    if reasons:
        lines.append("no heading: " + _counted(reasons.most_common()))
    lost = [(reason, count) for reason, count in recording.losses.items() if count]
    if lost:
        lines.append("not used of the recording: " + _counted(lost))
    if estimate.noise is not None and estimate.noise.kept < events:
        lines.append(f"left out as noise: {estimate.noise.text()}")
    if recording.origin_us:
        lines.append(f"times count from {recording.origin_us} us of the recording's clock")
    return "\n".join([*lines, *recording.notes])


def _counted(reasons: list[tuple[str, int]]) -> str:
    return ", ".join(f"{count} x {reason}" for reason, count in reasons)


def with_progress(stream: Iterator[Events], what: str = "reading") -> Iterator[Events]:
    """Pass pieces on, counting events on a terminal or in Jupyter only."""
    with tqdm(desc=what, unit=" events", unit_scale=True, disable=None, leave=False) as bar:
        for piece in stream:
            yield piece
            bar.update(len(piece))

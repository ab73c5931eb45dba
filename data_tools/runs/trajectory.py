"""From a recording's files to the camera's trajectory: what ``evcalib trajectory`` runs."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.runs.headings import open_with_camera, with_progress
from evcalib.odometry import Trajectory, estimate_trajectory


@dataclass(frozen=True, eq=False)
class RecordingTrajectory:
    """Trajectory of a recording, and what sums it up."""

    trajectory: Trajectory
    summary: str


def trajectory_from_files(
    recording: str | Path,
    camera: str | Path,
    *,
    size: str | None = None,
    camera_name: str | None = None,
    seed: int = 0,
    **reading: Any,
) -> RecordingTrajectory:
    """Read a recording in pieces and follow its camera.

    Parameters
    ----------
    recording, camera, size, camera_name
        As in :func:`data_tools.runs.headings.headings_from_files`.
    seed : int
        As in :func:`evcalib.odometry.estimate_trajectory`.
    **reading
        As in :func:`data_tools.recordings.open_recording`.
    """
    opened, lens = open_with_camera(
        recording, camera, size=size, camera_name=camera_name, **reading
    )
    started = time.perf_counter()
    found = estimate_trajectory(with_progress(iter(opened), "tracking"), lens, seed=seed)
    seconds = time.perf_counter() - started
    poses = found.poses
    span = float(poses.t[-1] - poses.t[0])
    lines = [
        f"{found.events} events in {seconds:.1f} s; {len(poses)} poses over {span:.2f} s"
        f" ({poses.t[0]:.3f} to {poses.t[-1]:.3f} s), {found.maps} maps, the last one of"
        f" {len(found.depth)} points; correlation {np.nanmedian(found.correlation):.2f} (median)",
        "the unit of length is that of the first map: the scale is not known",
    ]
    if found.lost:
        lines.append(f"the trajectory ends before the recording: {found.lost}")
    lines.extend(f"doubted: {doubt}" for doubt in found.doubts)
    lost = [f"{count} x {what}" for what, count in opened.losses.items() if count]
    if lost:
        lines.append("not used of the recording: " + ", ".join(lost))
    if opened.origin_us:
        lines.append(f"times count from {opened.origin_us} us of the recording's clock")
    return RecordingTrajectory(found, "\n".join([*lines, *opened.notes]))

"""Stand-ins for the calibration of one recording; workers import them by name."""

import os
from pathlib import Path
from types import SimpleNamespace

from evcalib.errors import InputError
from evcalib.geometry import rpy_to_matrix


def calibrate(*, recording, camera, output, velocities=None, max_offset=1.0, **more):
    """Return what the recording's name says; note each call in the folder of results."""
    output.mkdir(parents=True, exist_ok=True)
    with open(output / "calls", "a", encoding="utf-8") as file:
        file.write("x")
    name = Path(recording).name
    if "broken" in name and not (output.parent.parent / "mended").exists():
        raise InputError(f"{name} is damaged")
    if "killer" in name:
        os.kill(os.getpid(), 9)
    return SimpleNamespace(
        R_body_cam=rpy_to_matrix([0.1, 0.2, 0.3]),
        offset=0.25 * max_offset,
        offset_sd=0.002,
        offset_observable="vague" not in name,
        rotation_sd=0.01,
        rotation_observable="vague" not in name,
        inlier_share=0.9,
        verdict=SimpleNamespace(summary="The motion determines both."),
    )


def large(*, recording, output, **more):
    """Return a calibration that drags a megabyte along."""
    return SimpleNamespace(
        R_body_cam=rpy_to_matrix([0.0, 0.0, 0.0]),
        offset=float(len(recording)),
        offset_sd=0.0,
        offset_observable=True,
        rotation_sd=0.0,
        rotation_observable=True,
        inlier_share=1.0,
        verdict=SimpleNamespace(summary=""),
        ballast=bytearray(1_000_000),
    )

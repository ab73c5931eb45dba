"""The IMU of a run: that of the recording, of another one, or a table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.logs.imu_files import read_imu_table
from data_tools.recordings import RecordedImu, Recording, read_imu
from evcalib.arrays import Floats
from evcalib.errors import InputError

AUTO, ESTIMATE = "auto", "estimate"
TABLES = (".csv", ".txt", ".tsv")


def imu_of(
    recording: Recording,
    source: str | Path,
    *,
    stream: str | None = None,
    unit: str | None = None,
    columns: Any = None,
    time_unit: str | None = None,
) -> RecordedImu:
    """Read the IMU that goes with a recording.

    Parameters
    ----------
    recording : Recording
        The events.
    source : path
        A table (.csv, .txt or .tsv), a recording that holds an IMU, or ``auto``: the recording
        itself.
    stream : str, optional
        Topic or group, where there are several.
    unit, columns, time_unit
        Of a table; see `data_tools.logs.imu_files.read_imu_table`.

    Raises
    ------
    InputError
        If there is no IMU, or it does not overlap the events.
    """
    path = recording.path if str(source) == AUTO else Path(source)
    if path.suffix.lower() in TABLES and str(source) != AUTO:
        if stream is not None:
            raise InputError(f"{path} is a table: it has no stream {stream} of an IMU")
        notes: list[str] = []
        imu = read_imu_table(path, unit=unit, columns=columns, time_unit=time_unit, notes=notes)
        imu = replace(imu, t=imu.t - 1e-6 * recording.origin_us)
        return RecordedImu(imu, tuple(notes))
    for name, value in (("unit", unit), ("columns", columns), ("time unit", time_unit)):
        if value is not None:
            raise InputError(f"{path} is a recording, which has its own {name}: leave it out")
    own = recording.format if path == recording.path else None
    return read_imu(path, format=own, stream=stream, origin_us=recording.origin_us)


def rotation_of(text: str | None) -> Floats | str | None:
    """Return how an IMU is turned against the camera, from a text.

    Parameters
    ----------
    text : str, optional
        ``estimate``; nine numbers, the rows of ``R_cam_imu``; or which axes of the IMU point along
        X, Y and Z of the camera, like ``-x,y,-z``.

    Raises
    ------
    InputError
        If it is none of these, or no rotation.
    """
    if text is None or text == ESTIMATE:
        return text
    parts = [part.strip().lower() for part in text.split(",")]
    axes = {sign + name: k for k, name in enumerate("xyz") for sign in ("", "+", "-")}
    try:
        if len(parts) == 3 and all(part in axes for part in parts):
            R = np.zeros((3, 3))
            for row, part in enumerate(parts):
                R[row, axes[part]] = -1.0 if part.startswith("-") else 1.0
        else:
            R = np.array([float(part) for part in parts]).reshape(3, 3)
    except ValueError:
        raise InputError(
            f"how the IMU is turned must be estimate, axes like -x,y,-z, or nine numbers, not"
            f" {text!r}"
        ) from None
    if not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0:
        raise InputError(f"{text} is no rotation: axes must be different, and right-handed")
    return R

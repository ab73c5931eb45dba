"""Checks of the front doors: arrays in, checked float arrays or a clear error out."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from evcalib.arrays import Floats
from evcalib.errors import InputError

ROTATION_TOLERANCE = 1e-6
"""Largest departure of R R^T from the identity, and of det R from 1, that is taken for rounding.

A choice: numbers written with seven digits pass, and single precision does; a matrix that was
typed with fewer is refused, since the angle that it is off adds to every direction.
"""


def floats(values: ArrayLike, name: str, shape: tuple[int | None, ...]) -> Floats:
    """Return finite C-ordered float64 values of the given shape (None = any length)."""
    try:
        array = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be numbers: {error}") from None
    fits = array.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        want = "(" + ", ".join("n" if s is None else str(s) for s in shape) + ")"
        raise InputError(f"{name} must have shape {want}, not {array.shape}")
    bad = ~np.isfinite(array)
    if bad.any():
        row = int(np.argwhere(bad)[0][0]) if array.ndim else 0
        raise InputError(
            f"{name} holds {int(bad.sum())} value(s) that are NaN or infinite, first in row {row};"
            " remove these rows"
        )
    return array


def rotations(values: ArrayLike, name: str, n: int) -> Floats:
    """Return rotation matrices, shape (n, 3, 3)."""
    matrices = floats(values, name, (n, 3, 3))
    off = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    off = np.maximum(off, np.abs(np.linalg.det(matrices) - 1.0))
    if off.max() > ROTATION_TOLERANCE:
        row = int(np.argmax(off > ROTATION_TOLERANCE))
        raise InputError(f"{name} {row} is not a rotation matrix")
    return matrices


def times(t: ArrayLike, name: str = "t") -> Floats:
    """Return finite, strictly increasing times [s]."""
    array = floats(t, name, (None,))
    steps = np.diff(array)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0)) + 1
        what = "repeats" if steps[row - 1] == 0 else "goes back from"
        raise InputError(
            f"{name} must increase strictly, but row {row} ({array[row]:.6f} s) {what}"
            f" row {row - 1} ({array[row - 1]:.6f} s); sort the rows and drop duplicates"
        )
    return array


MADE_BY = {
    "BodyVelocities": "evcalib.kinematics.body_velocities(wheel_log, vehicle)",
    "Calibration": "evcalib.align(headings, velocities)",
    "CalibrationRun": "evcalib.calibrate(events, camera, velocities)",
    "Camera": (
        "evcalib.Camera(width, height, fx, fy, cx, cy)"
        " or data_tools.logs.camera_files.read_camera(path)"
    ),
    "Events": (
        "evcalib.Events.from_arrays(x, y, t, p, width, height)"
        " or data_tools.recordings.open_recording(path)"
    ),
    "HeadingSeries": (
        "evcalib.HeadingSeries(t, v), or take .headings of"
        " evcalib.estimate_headings(events, camera)"
    ),
    "Attitude": "evcalib.imu.attitude_of(imu)",
    "ImuSeries": "evcalib.ImuSeries(t, rate) or data_tools.recordings.read_imu(path)",
    "OffsetCurve": "evcalib.alignment.offset.find_offset(headings, track)",
    "Swerve": (
        "evcalib.kinematics.Swerve(wheels) or data_tools.logs.vehicle_files.read_vehicle(path)"
    ),
    "Tracks": "evcalib.joint.tracks.tracks_of(correspondences)",
    "VelocitySeries": (
        "evcalib.VelocitySeries(t, v) or data_tools.logs.series_files.read_velocities(path), or"
        " take .velocities of evcalib.kinematics.body_velocities(wheel_log, vehicle)"
    ),
    "VelocityTrack": "evcalib.kinematics.velocity_track.velocity_track(velocities)",
    "WheelLog": (
        "evcalib.kinematics.WheelLog(t, states) or"
        " data_tools.logs.wheel_logs.read_wheel_log(path, vehicle)"
    ),
}
"""How the classes that the front doors take are made, by name."""


def instance(value: object, name: str, *kinds: type, how: str = "") -> None:
    """Raise InputError unless the value is of one of these classes, and say how one is made."""
    if not isinstance(value, kinds):
        how = how or MADE_BY.get(kinds[0].__name__, "")
        raise InputError(
            f"{name} must be {' or '.join(kind.__name__ for kind in kinds)}, not"
            f" {type(value).__name__}" + (f"; make it with {how}" if how else "")
        )


def one_of(value: str, name: str, choices: tuple[str, ...]) -> str:
    """Return value if it is one of the choices."""
    if value not in choices:
        raise InputError(f"{name} must be one of {', '.join(choices)}, not {value!r}")
    return value


def _number(value: float) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        return float("nan")


def positive(value: float, name: str, unit: str = "") -> float:
    """Return a finite number above zero."""
    number = _number(value)
    if not (np.isfinite(number) and number > 0):
        raise InputError(f"{name} must be a positive number{unit and ' of ' + unit}, not {value!r}")
    return number


def at_least_zero(value: float, name: str) -> float:
    """Return a finite number that is not negative."""
    number = _number(value)
    if not 0 <= number < np.inf:
        raise InputError(f"{name} must be a finite number of at least 0, not {value!r}")
    return number


MAX_SIDE = 65_535
"""Largest width or height [px] whose pixels uint16 can count."""


def whole_us(value: int, name: str) -> int:
    """Return a point in time [us] that is a whole number, of any size."""
    if not isinstance(value, int | np.integer):
        raise InputError(f"{name} must be whole microseconds (int), not {value!r}")
    return int(value)


def side(value: int, name: str) -> int:
    """Return a width or height [px]."""
    number = int(value) if isinstance(value, int | np.integer) else 0
    if not 1 <= number <= MAX_SIDE:
        raise InputError(f"{name} must be a whole number of 1 to {MAX_SIDE} pixels, not {value!r}")
    return number

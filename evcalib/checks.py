"""Checks of the front doors: arrays in, checked float arrays or a clear error out."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from evcalib.arrays import Floats
from evcalib.errors import InputError


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


def one_of(value: str, name: str, choices: tuple[str, ...]) -> str:
    """Return value if it is one of the choices."""
    if value not in choices:
        raise InputError(f"{name} must be one of {', '.join(choices)}, not {value!r}")
    return value


MAKERS = {
    "Camera": "Camera(width, height, fx, fy, cx, cy) makes one,"
    " data_tools.logs.camera_files.read_camera reads a file",
    "Events": "Events(x, y, t, p, width, height) makes them,"
    " data_tools.recordings.open_recording reads a file",
    "Swerve": "evcalib.kinematics.Swerve(wheels) makes one,"
    " data_tools.logs.vehicle_files.read_vehicle reads a file",
    "Tracks": "evcalib.joint.tracks.tracks_of makes them of correspondences",
    "VelocitySeries": "VelocitySeries(t, v) makes one,"
    " data_tools.logs.series_files.read_velocities reads a file",
    "VelocityTrack": "evcalib.kinematics.velocity_track.velocity_track makes one of velocities",
    "WheelLog": "evcalib.kinematics.WheelLog(t, states) makes one,"
    " data_tools.logs.wheel_logs.read_wheel_log reads a file",
}
"""How the types are made that functions ask for."""


def of_type(value: object, name: str, *wanted: type) -> None:
    """Refuse a value of another type, and say what makes one of the first type wanted."""
    if not isinstance(value, wanted):
        kinds = " or ".join(kind.__name__ for kind in wanted)
        raise InputError(
            f"{name} must be {kinds}, not {type(value).__name__}: {MAKERS[wanted[0].__name__]}"
        )


def positive(value: float, name: str, unit: str = "") -> float:
    """Return a finite number above zero."""
    number = float(value)
    if not (np.isfinite(number) and number > 0):
        raise InputError(f"{name} must be a positive number{unit and ' of ' + unit}, not {value!r}")
    return number


def at_least_zero(value: float, name: str) -> float:
    """Return a finite number that is not negative."""
    number = float(value)
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

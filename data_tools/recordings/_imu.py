"""The IMU of a recording: what its format holds of it, by the rules of all tables of motion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_tools.files.row_times import advancing
from data_tools.recordings.formats import Options, Samples, find
from evcalib.errors import InputError
from evcalib.imu import ImuSeries

USUAL_GRAVITY = (0.5, 1.5)
"""Mean specific force that an IMU on the earth measures, in units of gravity; else its scale is
not the one that was taken."""


@dataclass(frozen=True, eq=False)
class RecordedImu:
    """The IMU of a recording.

    Attributes
    ----------
    imu : ImuSeries
        Its samples, on the clock of the events.
    notes : tuple of str
        Where they come from, what was taken for granted, and what was left out.
    """

    imu: ImuSeries
    notes: tuple[str, ...]


def read_imu(
    path: str | Path,
    *,
    format: str | None = None,
    stream: str | None = None,
    origin_us: int = 0,
) -> RecordedImu:
    """Read the IMU of a recording.

    AEDAT 2.0 (DAVIS), 3.1 and 4, ROS bags (``sensor_msgs/Imu``), and HDF5 (as M3ED and MVSEC have
    it) may hold one.

    Parameters
    ----------
    path : path
        The recording.
    format : str, optional
        Its format, as in `open_recording`.
    stream : str, optional
        Topic or group, where there are several.
    origin_us : int
        Subtracted from all times [us]: that of the recording.

    Returns
    -------
    RecordedImu
        Samples in order of time; repeated and late ones, and those with NaN, are left out and told.

    Raises
    ------
    InputError
        If the file cannot be read, holds no IMU or several, its clock was set, or its rates are
        impossible.
    """
    path = Path(path)
    samples = samples_of(path, format=format, stream=stream)
    if samples is None:
        raise InputError(
            f"{path} holds no samples of an IMU; give them as a table (--imu FILE.csv) of t, wx, wy"
            " and wz"
        )
    return _checked(path, samples, origin_us)


def samples_of(
    path: Path, *, format: str | None = None, stream: str | None = None
) -> Samples | None:
    """Return the samples as the file has them; None where it, or its format, has none."""
    module = find(path, format)
    read = getattr(module, "imu", None)
    return None if read is None else read(path, Options(format=format, stream=stream))


def _checked(path: Path, samples: Samples, origin_us: int) -> RecordedImu:
    notes = list(samples.notes)
    t, rate, force = samples.t_ns, samples.rate, samples.acceleration
    finite = np.isfinite(rate).all(axis=1)
    if force is not None:
        finite &= np.isfinite(force).all(axis=1)
    if not finite.all():
        notes.append(f"{int((~finite).sum())} IMU samples without a number were left out")
        t, rate = t[finite], rate[finite]
        force = None if force is None else force[finite]
    if t.size < 2:
        raise InputError(f"{path} holds {t.size} usable samples of an IMU; two at least are needed")
    keep, more = advancing(t, lambda k: f"{path}, IMU sample {k}", per_second=1e9)
    notes += [f"IMU: {note}" for note in more]
    seconds = (t[keep] - 1000 * origin_us) / 1e9
    force = None if force is None else force[keep]
    if force is not None:
        size = float(np.median(np.linalg.norm(force, axis=1))) / 9.80665
        if not USUAL_GRAVITY[0] < size < USUAL_GRAVITY[1]:
            notes.append(
                f"the IMU measures {size:.2f} g on the whole: the scale of its accelerations is not"
                " the one that was taken, perhaps that of its rates neither"
            )
    try:
        return RecordedImu(ImuSeries(seconds, rate[keep], force), tuple(notes))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None

"""Small recordings for notebooks: simulated once, committed, read in a moment."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_tools.files.archives import SUFFIX, load_array, opened_zip
from data_tools.logs.camera_files import read_calib_txt
from data_tools.recordings.formats.events_text import load_events_text
from evcalib import checks
from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.events import Events

HIDDEN = 0.05
"""Points whose distance differs by this share from that of what is seen there are hidden."""


@dataclass(frozen=True, eq=False)
class Sample:
    """A recording of a camera that moves straight on at a constant speed without turning.

    Attributes
    ----------
    events : Events
        What the camera saw, from t = 0 on.
    camera : Camera
        The camera.
    direction : ndarray, shape (3,)
        Unit direction of its motion, in its own frame.
    speed : float
        Its speed [m/s].
    frame_times : ndarray, shape (m,)
        Times of the pictures [s].
    frames : ndarray of uint8, shape (m, height, width)
        Square roots of the intensities, 255 for the brightest.
    depths : ndarray, shape (m, height, width)
        Distances along the bearings [m].
    """

    events: Events
    camera: Camera
    direction: Floats
    speed: float
    frame_times: Floats
    frames: NDArray[np.uint8]
    depths: Floats

    def moved(self, xy: ArrayLike, before: int, after: int) -> Floats:
        """Return where points of one picture are in another.

        Parameters
        ----------
        xy : array_like, shape (n, 2)
            Pixels in picture `before`, within the image.
        before, after : int
            Numbers of the pictures.

        Returns
        -------
        ndarray, shape (n, 2)
            Pixels in picture `after`; NaN where the point left the image or is hidden there.
        """
        points = checks.floats(xy, "xy", (None, 2))
        travel = self.speed * (self.frame_times[after] - self.frame_times[before])
        seen = self.camera.bearings(points) * _at(self.depths[before], points)[:, None]
        there = seen - travel * self.direction
        out = self.camera.project(there)
        limit = (self.camera.width - 1, self.camera.height - 1)
        with np.errstate(invalid="ignore"):
            inside = ((out >= 0) & (out <= limit)).all(axis=1)
        out[~inside] = np.nan
        distance = np.linalg.norm(there[inside], axis=1)
        hidden = distance > (1 + HIDDEN) * _at(self.depths[after], out[inside])
        out[np.flatnonzero(inside)[hidden]] = np.nan
        return out


def _at(depth: Floats, xy: Floats) -> Floats:
    """Return the depth of the nearest thing within a pixel: corners lie on what is in front."""
    columns, rows = np.rint(xy).astype(np.int64).T
    height, width = depth.shape
    around = [
        depth[np.clip(rows + dy, 0, height - 1), np.clip(columns + dx, 0, width - 1)]
        for dy in (-1, 0, 1)
        for dx in (-1, 0, 1)
    ]
    return np.min(around, axis=0)


def _millimetres(depths: Floats) -> NDArray[np.uint16]:
    """Return whole millimetres; steps between them wrap around and come back."""
    return np.rint(1000 * depths).astype(np.uint16)


def write_sample(path: str | Path, sample: Sample) -> None:
    """Write a sample as a compressed ``.npz`` file: times as steps, depths in millimetres."""
    events, camera = sample.events, sample.camera
    if camera.distortion:
        raise InputError("the camera of a sample has no distortion")
    if max(events.shape) > 256 or np.diff(events.t, prepend=0).max(initial=0) > 65535:
        raise InputError("a sample has at most 256 px a side and no silence of 65 ms")
    np.savez_compressed(
        path,
        x=events.x.astype(np.uint8),
        y=events.y.astype(np.uint8),
        step_us=np.diff(events.t, prepend=0).astype(np.uint16),
        polarity=np.packbits(events.p),
        camera=[camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy],
        direction=sample.direction,
        speed=sample.speed,
        frame_times=sample.frame_times,
        frames=sample.frames,
        depth_steps_mm=np.diff(_millimetres(sample.depths), axis=2, prepend=np.uint16(0)),
    )


def load_sample(path: str | Path) -> Sample:
    """Read a sample that `write_sample` wrote.

    Raises
    ------
    InputError
        If there is no such file, or it is not a sample.
    """
    if not Path(path).is_file():
        raise InputError(f"there is no file {path}")
    try:
        with opened_zip(Path(path)) as archive:
            names = [name.removesuffix(SUFFIX) for name in archive.namelist()]
            return _sample({name: load_array(archive, name) for name in names})
    except (LookupError, TypeError, ValueError) as error:
        raise InputError(f"{path} is not a sample: {error}") from None


def slider_depth(folder: str | Path | None = None) -> Sample | None:
    """Return the real recording slider_depth from 0.2 s on, or None where it is not present.

    The camera moves along its own X axis, to about 1 degree.  There are no pictures.

    Parameters
    ----------
    folder : str or Path, optional
        Holds ``slider_depth/events.txt.gz`` and ``slider_depth/calib.txt`` of the Event Camera
        Dataset (Mueggler et al. 2017); by default the environment variable ``EVCALIB_DATA``.
    """
    root = folder if folder is not None else os.environ.get("EVCALIB_DATA")
    if root is None or not (Path(root) / "slider_depth" / "events.txt.gz").is_file():
        return None
    home = Path(root) / "slider_depth"
    whole = load_events_text(home / "events.txt.gz", 240, 180)
    steady = whole[whole.t >= 200_000]
    events = Events(steady.x, steady.y, steady.t - 200_000, steady.p, 240, 180)
    none = np.empty((0, 180, 240))
    return Sample(
        events=events,
        camera=read_calib_txt(home / "calib.txt", 240, 180),
        direction=np.array([1.0, 0.0, 0.0]),
        speed=0.318,
        frame_times=np.empty(0),
        frames=none.astype(np.uint8),
        depths=none,
    )


def _sample(columns: dict[str, Any]) -> Sample:
    width, height, *lens = columns["camera"]
    camera = Camera(int(width), int(height), *lens)
    x = columns["x"]
    depths_mm = np.cumsum(columns["depth_steps_mm"], axis=2, dtype=np.uint16)
    t = np.cumsum(columns["step_us"], dtype=np.int64)
    p = np.unpackbits(columns["polarity"], count=x.size).astype(np.bool_)
    return Sample(
        events=Events.from_arrays(x, columns["y"], t, p, camera.width, camera.height),
        camera=camera,
        direction=columns["direction"],
        speed=float(columns["speed"]),
        frame_times=columns["frame_times"],
        frames=columns["frames"],
        depths=0.001 * depths_mm.astype(np.float64),
    )

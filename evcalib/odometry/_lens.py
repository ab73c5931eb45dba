"""Events as rays, and the camera without distortion in which maps are drawn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evcalib.arrays import Flags, Floats
from evcalib.camera import Camera
from evcalib.events import Events
from evcalib.kernels.odometry.space_sweep import View

WIDEST = 346
"""Most columns of maps and event images, whatever the sensor has: memory and time stay bounded.

A choice: the width of a usual sensor of this kind (DAVIS346).
"""

FLATTEST = 0.2
"""Unit rays that lean so far from the optical axis have no place in a pinhole image."""

Rays = NDArray[np.float32]


class Lens:
    """The rays of a camera's pixels, and a pinhole view of the same focal length.

    Parameters
    ----------
    camera : Camera
        Of the sensor that the events come from.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        scale = min(1.0, WIDEST / camera.width)
        self.view = View(
            width=max(round(scale * camera.width), 2),
            height=max(round(scale * camera.height), 2),
            fx=scale * camera.fx,
            fy=scale * camera.fy,
            cx=scale * (camera.cx + 0.5) - 0.5,
            cy=scale * (camera.cy + 0.5) - 0.5,
        )
        rows, columns = np.mgrid[: camera.height, : camera.width]
        bearings = camera.bearings(np.stack([columns.ravel(), rows.ravel()], axis=1))
        ahead = np.where(bearings[:, 2] > FLATTEST, bearings[:, 2], np.nan)
        plane = (bearings[:, :2] / ahead[:, None]).astype(np.float32)
        self._rays = plane.reshape(camera.height, camera.width, 2)
        self._seen: Flags = np.asarray(np.isfinite(self._rays).all(axis=2))

    def rays(self, events: Events) -> tuple[Rays, Floats]:
        """Return directions (x, y, 1), shape (n, 2), and times [s] of events that have one."""
        rays: Rays = self._rays[events.y, events.x]
        t: Floats = 1e-6 * events.t.astype(np.float64)
        seen: Flags = self._seen[events.y, events.x]
        return (rays, t) if seen.all() else (rays[seen], t[seen])

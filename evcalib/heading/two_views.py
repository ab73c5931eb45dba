"""Keypoints at chosen times, and the matches of two of them: the heading's raw material, by hand.

`evcalib.heading` does the same for whole recordings, with keyframes and baselines of its own
choice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evcalib.arrays import Floats, Integers
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.features import KeypointFinder, Keypoints, match
from evcalib.features.corners import arc_star
from evcalib.surfaces.quality import surface_images

CELL_PX = 8
"""Matches whose midpoints share a cell of this side [px] see the same corner."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Matched points before and after.

    Attributes
    ----------
    xy1, xy2 : ndarray, shape (n, 2)
        Pixels.
    r1, r2 : ndarray, shape (n, 3)
        Unit bearings.
    """

    xy1: Floats
    xy2: Floats
    r1: Floats
    r2: Floats

    def __len__(self) -> int:
        return len(self.xy1)

    @property
    def groups(self) -> Integers:
        """Equal numbers for matches that see the same corner, shape (n,); see `two_point`."""
        cells = np.floor((self.xy1 + self.xy2) / (2 * CELL_PX))
        return np.unique(cells, axis=0, return_inverse=True)[1].ravel().astype(np.int64)

    @classmethod
    def pooled(cls, parts: Sequence[Pairs]) -> Pairs:
        """Return the rows of all parts, of which there must be one at least."""
        if not parts:
            raise InputError("there are no matches to pool")
        names = ("xy1", "xy2", "r1", "r2")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def keypoints_at(
    events: Events, t_us: Sequence[int], *, surface: str = "tos_ts", gather_us: int = 60_000
) -> list[Keypoints]:
    """Return the keypoints at several times.

    Parameters
    ----------
    events : Events
        The stream.
    t_us : sequence of int
        Times in order [us].
    surface : {"tos_ts", "tos", "ts", "silc", "dist"}
        Where keypoints are described.
    gather_us : int
        Corner events of this time before each of `t_us` become keypoints [us].
    """
    corners = events[arc_star(events)]
    finder = KeypointFinder(events.width, events.height)
    images = surface_images(surface, events, t_us)
    return [
        finder.find(image, corners.between(t - gather_us, t + 1))
        for image, t in zip(images, t_us, strict=True)
    ]


def matched(camera: Camera, first: Keypoints, second: Keypoints, *, reach: float = np.inf) -> Pairs:
    """Match keypoints of two times and return their pixels and bearings.

    Parameters
    ----------
    camera : Camera
        The camera.
    first, second : Keypoints
        From `keypoints_at`.
    reach : float
        Largest displacement [px].
    """
    i, j = match(first, second, reach=reach).T
    xy1, xy2 = first.xy[i], second.xy[j]
    r1, r2 = camera.bearings(xy1), camera.bearings(xy2)
    seen = np.isfinite(r1).all(axis=1) & np.isfinite(r2).all(axis=1)
    return Pairs(xy1[seen], xy2[seen], r1[seen], r2[seen])

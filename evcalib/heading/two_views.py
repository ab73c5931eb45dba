"""Keypoints at chosen times, and the matches of two of them: the heading's raw material, by hand.

`evcalib.heading` does the same for whole recordings, with keyframes and baselines of its own
choice.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evcalib.camera import Camera
from evcalib.events import Events
from evcalib.features import KeypointFinder, Keypoints, match
from evcalib.features.corners import arc_star
from evcalib.heading._matches import Matches
from evcalib.surfaces.quality import surface_images


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


def matched(
    camera: Camera, first: Keypoints, second: Keypoints, *, reach: float = np.inf
) -> Matches:
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
    return Matches(xy1[seen], xy2[seen], r1[seen], r2[seen])

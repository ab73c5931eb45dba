"""How many matches on a surface are right, against a known motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.features._keypoints import KeypointFinder, Keypoints, match
from evcalib.surfaces.quality import (
    edges,
    grey,
    harris_corners,
    share_found,
    share_on_edges,
)


class Known(Protocol):
    """Pictures of a scene, and where its points go from one to another."""

    @property
    def frames(self) -> NDArray[np.uint8]: ...  # noqa: D102

    def moved(self, xy: ArrayLike, before: int, after: int) -> Floats: ...  # noqa: D102


@dataclass(frozen=True)
class SurfaceScore:
    """How clean a surface is, and how well it is found again.

    Attributes
    ----------
    on_edges : float
        Share of its brightness on edges of the picture.
    repeatability : float
        Share of its corners that are found again in the next image, where the motion takes them.
    right : float
        Matches of Arc* keypoints described on it that are right, per pair of images.
    wrong : float
        Matches that are not.
    """

    on_edges: float
    repeatability: float
    right: float
    wrong: float


def score_surface(
    known: Known,
    images: Sequence[NDArray],
    corners: Events,
    t_us: Sequence[int],
    gather_us: int,
    *,
    count: int = 80,
) -> SurfaceScore:
    """Judge the images of a surface by the motion between them.

    Parameters
    ----------
    known : Known
        One picture per image, and the motion.
    images : sequence of ndarray, shape (height, width)
        From `surface_images`.
    corners : Events
        Arc* corners of the stream.
    t_us : sequence of int
        Times of the images [us].
    gather_us : int
        Corners of this time before each image become keypoints [us].
    count : int
        Most corners of an image whose repeatability is measured.

    Returns
    -------
    SurfaceScore
        Means over the images and over all pairs of neighbours.
    """
    if len(images) != len(known.frames) or len(t_us) != len(images) or len(images) < 2:
        raise InputError("as many images, times and pictures are needed, and at least two")
    finder = KeypointFinder(corners.width, corners.height)
    greys = [grey(image) for image in images]
    clean = [share_on_edges(g, edges(f)) for g, f in zip(greys, known.frames, strict=True)]
    found = [harris_corners(g, count) for g in greys]
    keypoints = [
        finder.find(image, corners.between(t - gather_us, t + 1))
        for image, t in zip(images, t_us, strict=True)
    ]
    pairs = list(pairwise(range(len(images))))
    again = [share_found(known.moved(found[i], i, j), found[j]) for i, j in pairs]
    matched = np.array([_count_right(known, i, j, keypoints) for i, j in pairs])
    right, wrong = matched.mean(axis=0)
    return SurfaceScore(float(np.mean(clean)), float(np.mean(again)), float(right), float(wrong))


def _count_right(
    known: Known, before: int, after: int, keypoints: list[Keypoints], reach: float = 3.0
) -> tuple[int, int]:
    """Return how many matches lie where the motion takes them, and how many do not.

    Points that the motion hides do not count.
    """
    first, second = keypoints[before], keypoints[after]
    i, j = match(first, second).T
    off = np.linalg.norm(known.moved(first.xy[i], before, after) - second.xy[j], axis=1)
    off = off[np.isfinite(off)]
    return int((off < reach).sum()), int((off >= reach).sum())

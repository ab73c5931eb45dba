"""How good a surface is, measured against a motion that is known.

Three questions.  Does the surface look the same at another speed (`likeness`)?  Does it show edges
and nothing else (`share_on_edges`)?  Are its corners found again where the motion takes them
(`harris_corners`, `share_found`)?  `score_surface` answers the last two for a whole recording.

Surfaces are compared as 8-bit images (`grey`).  All that follows is exact in integers, so that the
figures are the same on every machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from evcalib import _check
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.features import KeypointFinder, Keypoints, match
from evcalib.surfaces import SURFACES

Floats = NDArray[np.float64]

HARRIS_K = 1 / 16
"""Weight of the squared trace in Harris's measure."""


def grey(surface: NDArray) -> NDArray[np.uint8]:
    """Return a surface as an image whose largest value is 255 (all 0 if it is empty)."""
    image = np.asarray(surface, dtype=np.float64)
    if image.ndim != 2:
        raise InputError(f"a surface must have shape (height, width), not {image.shape}")
    most = image.max(initial=0.0)
    return np.rint(image * (255.0 / most if most > 0 else 0.0)).astype(np.uint8)


def likeness(first: NDArray, second: NDArray) -> float:
    """Return the correlation of two images (h, w): 1 if they agree but for brightness and contrast.

    0 if one of them is uniform.
    """
    a, b = (image - image.mean() for image in (np.asarray(first, float), np.asarray(second, float)))
    norm = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / norm if norm > 0 else 0.0


def edges(picture: NDArray[np.uint8], *, step: int = 45) -> NDArray[np.bool_]:
    """Return where neighbouring pixels of a picture differ by `step` or more of 255."""
    image = picture.astype(np.int64)
    out = np.zeros(image.shape, dtype=np.bool_)
    for axis in (0, 1):
        far = np.abs(np.diff(image, axis=axis)) >= step
        out |= np.insert(far, 0, False, axis=axis) | np.insert(far, far.shape[axis], False, axis)
    return out


def share_on_edges(image: NDArray[np.uint8], edge: NDArray[np.bool_], *, reach: int = 1) -> float:
    """Return which share of an image's brightness lies within `reach` [px] of edges."""
    near = ndimage.binary_dilation(edge, np.ones((3, 3)), iterations=reach)
    total = int(image.sum(dtype=np.int64))
    return int(image[near].sum(dtype=np.int64)) / total if total else 0.0


def harris_corners(
    image: NDArray[np.uint8], count: int, *, window: int = 5, spacing: int = 3, border: int = 6
) -> NDArray[np.int64]:
    """Return the strongest corners of an image (Harris & Stephens 1988).

    Parameters
    ----------
    image : ndarray of uint8, shape (height, width)
        The image.
    count : int
        Most corners.
    window : int
        Side of the box over which gradients are summed [px].
    spacing : int
        A corner is the strongest within this distance along both axes [px].
    border : int
        No corners nearer to the border than this [px].

    Returns
    -------
    ndarray of int64, shape (n, 2)
        Columns x, y [px], the strongest first; of equals, the upper and then the left one.
    """
    if image.dtype != np.uint8 or image.ndim != 2:
        raise InputError("harris_corners takes an image of uint8, shape (height, width); see grey")
    whole = image.astype(np.float64)
    gx, gy = ndimage.sobel(whole, axis=1), ndimage.sobel(whole, axis=0)
    xx, yy, xy = (_box(product, window) for product in (gx * gx, gy * gy, gx * gy))
    strength = xx * yy - xy * xy - HARRIS_K * (xx + yy) ** 2
    peak = strength == ndimage.maximum_filter(strength, 2 * spacing + 1, mode="constant")
    peak &= strength > 0
    inside = np.zeros_like(peak)
    inside[border : image.shape[0] - border, border : image.shape[1] - border] = True
    rows, columns = np.nonzero(peak & inside)
    order = np.lexsort((columns, rows, -strength[rows, columns]))[:count]
    return np.column_stack((columns, rows))[order]


def _box(values: Floats, side: int) -> Floats:
    """Sum over a box; sums of whole numbers below 2^53 are exact in any order."""
    ones = np.ones(side)
    across = ndimage.correlate1d(values, ones, axis=1, mode="nearest")
    return ndimage.correlate1d(across, ones, axis=0, mode="nearest")


def share_found(expected: ArrayLike, found: ArrayLike, *, reach: float = 2.0) -> float:
    """Return which share of expected points has a found one within `reach`: repeatability.

    Parameters
    ----------
    expected : array_like, shape (n, 2)
        Where points should be [px]; rows of NaN (points that cannot be seen) do not count.
    found : array_like, shape (m, 2)
        Where points are [px].
    reach : float
        Largest distance [px].

    Returns
    -------
    float
        0 to 1; NaN if nothing was expected.
    """
    there = np.asarray(expected, dtype=np.float64).reshape(-1, 2)
    there = there[np.isfinite(there).all(axis=1)]
    have = _check.floats(np.reshape(found, (-1, 2)), "found", (None, 2))
    if not len(there):
        return float("nan")
    if not len(have):
        return 0.0
    squares = ((there[:, None] - have[None]) ** 2).sum(axis=2)
    return float((squares.min(axis=1) <= reach**2).mean())


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


def surface_images(
    name: str, events: Events, t_us: Sequence[int], **options: float | str
) -> list[NDArray]:
    """Return the images of a surface at several times.

    Parameters
    ----------
    name : {"tos_ts", "tos", "ts", "silc", "dist"}
        Which surface.
    events : Events
        The stream.
    t_us : sequence of int
        Times in order [us].
    **options
        Of the surface; polarities are merged by default.
    """
    kind = SURFACES[_check.one_of(name, "name", tuple(SURFACES))]
    surface = kind(events.width, events.height, **{"polarity": "merged", **options})  # type: ignore[arg-type]
    images, taken = [], 0
    for t in t_us:
        head = events.between(0, t + 1)
        surface.update(head[taken:])
        images.append(surface.render(t))
        taken = len(head)
    return images


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

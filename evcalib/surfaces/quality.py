"""How good a surface is, measured against a motion that is known.

Three questions.  Does the surface look the same at another speed (`likeness`)?  Does it show edges
and nothing else (`share_on_edges`)?  Are its corners found again where the motion takes them
(`harris_corners`, `share_found`)?  `score_surface` answers the last two for a whole recording.

Surfaces are compared as 8-bit images (`grey`).  All that follows is exact in integers, so that the
figures are the same on every machine.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from evcalib import checks
from evcalib.arrays import Flags, Floats, Integers
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.surfaces._names import SURFACES

HARRIS_K = 1 / 16
"""Weight of the squared trace in Harris's measure.  A choice, next to the usual 0.04 to 0.06."""


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


def edges(picture: NDArray[np.uint8], *, step: int = 45) -> Flags:
    """Return where neighbouring pixels of a picture differ by `step` or more of 255."""
    image = picture.astype(np.int64)
    out = np.zeros(image.shape, dtype=np.bool_)
    for axis in (0, 1):
        far = np.abs(np.diff(image, axis=axis)) >= step
        out |= np.insert(far, 0, False, axis=axis) | np.insert(far, far.shape[axis], False, axis)
    return out


def share_on_edges(image: NDArray[np.uint8], edge: Flags, *, reach: int = 1) -> float:
    """Return which share of an image's brightness lies within `reach` [px] of edges."""
    near = ndimage.binary_dilation(edge, np.ones((3, 3)), iterations=reach)
    total = int(image.sum(dtype=np.int64))
    return int(image[near].sum(dtype=np.int64)) / total if total else 0.0


def harris_corners(
    image: NDArray[np.uint8], count: int, *, window: int = 5, spacing: int = 3, border: int = 6
) -> Integers:
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
    have = checks.floats(np.reshape(found, (-1, 2)), "found", (None, 2))
    if not len(there):
        return float("nan")
    if not len(have):
        return 0.0
    squares = ((there[:, None] - have[None]) ** 2).sum(axis=2)
    return float((squares.min(axis=1) <= reach**2).mean())


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
    kind = SURFACES[checks.one_of(name, "name", tuple(SURFACES))]
    checks.instance(events, "events", Events)
    surface = kind(events.width, events.height, **{"polarity": "merged", **options})  # type: ignore[arg-type]
    images, taken = [], 0
    for t in t_us:
        head = events.between(0, t + 1)
        surface.update(head[taken:])
        images.append(surface.render(t))
        taken = len(head)
    return images

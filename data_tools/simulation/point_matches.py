"""Matches of points that never were: bearings before and after a known motion, with noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from evcalib import checks
from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.geometry import rotation_vector_to_matrix, unit
from evcalib.heading import Matches


def random_matches(
    camera: Camera,
    shift: ArrayLike,
    rng: np.random.Generator,
    *,
    count: int = 200,
    noise: float = 0.8,
    outliers: float = 0.0,
    turn: ArrayLike = (0.0, 0.0, 0.0),
    depths: tuple[float, float] = (1.5, 6.0),
) -> Matches:
    """Draw points that a camera sees before and after it moves, and their noisy bearings.

    Parameters
    ----------
    camera : Camera
        The camera.
    shift : array_like, shape (3,)
        Its motion in its own frame [m].
    rng : Generator
        Source of everything random.
    count : int
        Number of matches.
    noise : float
        Standard deviation per axis and picture [px].
    outliers : float
        Share of matches whose second point is anywhere in the image.
    turn : array_like, shape (3,)
        Rotation vector of the camera over the motion [rad].
    depths : tuple of float
        Least and largest distance along the optical axis [m].
    """
    motion = checks.floats(shift, "shift", (3,))
    if not 0 <= outliers <= 1:
        raise InputError(f"outliers must be a share of 0 to 1, not {outliers!r}")
    size = np.array([camera.width, camera.height]) - 1.0
    R = rotation_vector_to_matrix(turn)
    pairs: list[Floats] = []
    for _ in range(100):
        pixels = rng.uniform(0, size, (count, 2))
        rays = camera.bearings(pixels)
        points = rays * (rng.uniform(*depths, count) / rays[:, 2])[:, None]
        later = camera.project((points - motion) @ R)
        both = np.hstack([pixels, later])
        pairs.extend(both[((later >= 0) & (later <= size)).all(axis=1)])
        if len(pairs) >= count:
            break
    else:
        raise InputError("the camera sees too few points both before and after this motion")
    xy = np.array(pairs[:count])
    wrong = rng.random(count) < outliers
    xy[wrong, 2:] = rng.uniform(0, size, (int(wrong.sum()), 2))
    xy += rng.normal(0.0, noise, xy.shape)
    xy1, xy2 = xy[:, :2], xy[:, 2:]
    return Matches(xy1, xy2, unit(camera.bearings(xy1)), unit(camera.bearings(xy2)))

"""Corners as a moving camera observes them: points in space, projected into keyframes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from data_tools.simulation.random_drives import Spans
from data_tools.simulation.trajectory import Trajectory
from evcalib.arrays import Flags, Floats, Integers
from evcalib.camera import Camera

RATE = 8.0
"""Keyframes per second."""

NEAREST, FARTHEST = 0.7, 8.0
"""Distances of corners along the optical axis [m]."""

SLOWEST = 3.0
"""Corners that flow slower than this [px/s] leave too few events to be seen.

A choice: they move by 1.8 px over the longest pair (0.6 s), as far as an edge is wide."""


@dataclass(frozen=True)
class Corners:
    """What the camera sees, and how well.

    Attributes
    ----------
    count : int
        Corners in view at a time.
    life : float
        Mean time [s] for which one is seen at most.
    noise : float
        Standard deviation of an observation per axis [px].
    memory : float
        Time constant [s] over which half of the noise's variance lasts; 0 for white noise.
    lag : float
        Corners trail their flow by so much [px].
    false : float
        Share of the matches that go to another corner, anywhere within the search window.
    movers : tuple of (float, float)
        Intervals [s] of camera time in which all that is seen moves by itself.
    gaps : tuple of (float, float)
        Intervals [s] of camera time without keyframes.
    """

    count: int = 45
    life: float = 1.5
    noise: float = 0.2
    memory: float = 0.0
    lag: float = 0.0
    false: float = 0.0
    movers: Spans = ()
    gaps: Spans = ()


USUAL = Corners()
"""Some corners of little noise, all of them true."""


@dataclass(frozen=True, eq=False)
class Sightings:
    """Observed corners; row i is corner `corner[i]` in keyframe `keyframe[i]` at `xy[i]`.

    Rows are in order of keyframes, then corners; `t` (keyframes,) are times on the camera clock.
    """

    t: Floats
    keyframe: Integers
    corner: Integers
    xy: Floats


def sighted(
    path: Trajectory,
    rng: np.random.Generator,
    camera: Camera,
    R_body_cam: Floats,
    corners: Corners,
    lever: tuple[float, float, float],
    shake: Callable[[Floats], Floats],
    t: Floats,
    body: Floats,
) -> Sightings:
    """Draw corners that come into being all along the drive, and see them in all keyframes.

    `shake` tells the rotation vectors (n, 3) [rad] by which the body is turned beyond the path, in
    its own frame.
    """

    def pose(when: Floats) -> tuple[Floats, Floats]:
        """Return centres and axes of the camera."""
        R = path.rotation_at(when) @ Rotation.from_rotvec(shake(when)).as_matrix()
        return path.position_at(when) + R @ np.asarray(lever), R @ R_body_cam

    centres, axes = pose(body)
    # In view of some keyframe: a pixel, a distance.
    births = int(corners.count * max(t.size / (RATE * corners.life), 1.0))
    at = rng.integers(0, t.size, births)
    rays = camera.bearings(rng.uniform(0, [camera.width - 1, camera.height - 1], (births, 2)))
    depth = np.exp(rng.uniform(np.log(NEAREST), np.log(FARTHEST), births))
    rays *= (depth / rays[:, 2])[:, None]
    points = centres[at] + np.einsum("nij,nj->ni", axes[at], rays)
    moving = ~outside(t[at], corners.movers)
    speed = np.where(moving[:, None], rng.normal(0.0, 0.5, (births, 3)), 0.0)
    span = rng.exponential(corners.life, (births, 2))

    first = np.searchsorted(t, t[at] - span[:, 0])
    last = np.searchsorted(t, t[at] + span[:, 1], side="right")
    corner = np.repeat(np.arange(births), last - first)
    keyframe = np.arange(corner.size) - np.repeat(np.cumsum(last - first) - last, last - first)
    alone = moving[corner] <= ~outside(t[keyframe], corners.movers)
    corner, keyframe = corner[alone], keyframe[alone]

    def seen(late: float) -> Floats:
        """Return pixels at the keyframes, or a little later."""
        when = np.clip(body + late, path.t[0], path.t[-1])
        where, R = pose(when)
        now = points[corner] + speed[corner] * (when[keyframe] - body[at[corner]])[:, None]
        ray = np.einsum("nji,nj->ni", R[keyframe], now - where[keyframe])
        return np.where(ray[:, 2:] > 0.2, camera.project(ray), np.nan)

    h = 1e-3
    xy, flow = seen(0.0), (seen(h) - seen(-h)) / (2 * h)
    size = np.hypot(*flow.T)
    noise = corners.noise * unit_noise(rng, corner, keyframe, corners.memory)
    xy = xy - corners.lag * flow / np.maximum(size, 1e-9)[:, None] + noise
    inside = (xy >= 0).all(axis=1) & (xy <= [camera.width - 1, camera.height - 1]).all(axis=1)
    kept = np.flatnonzero(inside & (size >= SLOWEST))
    kept = kept[np.lexsort((corner[kept], keyframe[kept]))]
    # As many as a keyframe holds, the oldest first.
    rank = np.arange(kept.size) - np.searchsorted(keyframe[kept], keyframe[kept])
    kept = kept[rank < 2 * corners.count]
    return Sightings(t, keyframe[kept], corner[kept], xy[kept])


def unit_noise(
    rng: np.random.Generator, corner: Integers, keyframe: Integers, memory: float
) -> Floats:
    """Return unit noise (n, 2): white, or half of its variance an AR(1) along each corner."""
    white = rng.standard_normal((corner.size, 2))
    if not memory:
        return white
    # A sum of cosines of random rates has the correlation that a Cauchy spectrum gives:
    # exp(-|lag| / memory).
    waves = 8
    rate = rng.standard_cauchy((int(corner.max()) + 1, waves, 2)) / memory
    phase = rng.uniform(0, 2 * np.pi, rate.shape)
    slow = np.cos(rate[corner] * (keyframe / RATE)[:, None, None] + phase[corner]).sum(axis=1)
    return np.sqrt(0.5) * (white + np.sqrt(2.0 / waves) * slow)


def outside(t: Floats, spans: Spans) -> Flags:
    """Tell which times lie in none of the intervals."""
    out = np.ones(t.shape, dtype=np.bool_)
    for start, end in spans:
        out &= (t < start) | (t > end)
    return out

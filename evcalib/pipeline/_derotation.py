"""Headings of a camera that turns, the turning that the odometry tells taken out of its matches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from evcalib.arrays import Floats, Integers
from evcalib.heading import Correspondences, Gap, HeadingEstimate
from evcalib.heading.epipolar import two_point
from evcalib.series import HeadingSeries, VelocitySeries, bins

WINDOW = 0.1
"""Headings are fitted to the matches whose middles lie in so much time [s]: two keyframes of
`evcalib.estimate_headings`, which pools as many to either side."""

MOST = 600
"""Matches of a window that are fitted.  A choice of speed: their scatter is not what limits it."""

THRESHOLD, FEWEST, SHARE, MAX_SD = 1.5, 20, 0.3, np.radians(3.0)
"""As in `HeadingOptions` and for every heading: residual of an inlier [px], fewest inliers, least
share of them, largest standard deviation [rad]."""

CELL = 0.02
"""Corners within a cell of this size [rad] share their error."""

TOO_FEW, DISAGREE, UNCERTAIN = "too few corners", "matches disagree", "direction uncertain"


def derotated(
    estimate: HeadingEstimate,
    axis: Floats,
    yaw: Callable[[Floats], Floats],
    *,
    focal: float,
    seed: int = 0,
) -> HeadingEstimate:
    """Return the headings anew, of bearings turned into the camera's frame at mid-window.

    Parameters
    ----------
    estimate : HeadingEstimate
        With its correspondences, those of windows without heading too.
    axis : ndarray, shape (3,)
        The body's Z axis in the camera frame.
    yaw : callable
        Angle [rad] that the body has turned by at times [s] on the camera clock.
    focal : float
        Pixels per radian.
    seed : int
        Of the samples of the solver.

    Returns
    -------
    HeadingEstimate
        Headings of the camera's own motion, and windows without.
    """
    c = estimate.correspondences
    assert c is not None
    middle = 0.5 * (c.t1 + c.t2)
    window = bins(middle - middle.min(initial=np.inf), WINDOW)
    order = np.argsort(window, kind="stable")
    ends = np.searchsorted(window[order], np.arange(window.max(initial=-1) + 2))
    rows: list[tuple[float, ...]] = []
    directions, covariances, gaps = [], [], []
    for low, high in pairwise(ends):
        part = order[low:high][:: max((high - low) // MOST, 1)]
        if part.size == 0:
            continue
        centre = float(middle[part].mean())
        found = _heading(c, part, centre, axis, yaw, focal, seed)
        if isinstance(found, str):
            gaps.append(Gap(centre, found))
        elif not rows or found[0] > rows[-1][0]:
            *numbers, v, covariance = found
            rows.append(tuple(numbers))
            directions.append(v)
            covariances.append(covariance)
    t, t_start, t_end, sd, inliers, share = np.array(rows, dtype=np.float64).reshape(-1, 6).T
    v = np.array(directions).reshape(-1, 3)
    return replace(
        estimate,
        headings=HeadingSeries(t, v, t_start=t_start, t_end=t_end, sd=sd, inliers=inliers),
        covariance=np.array(covariances).reshape(-1, 3, 3),
        gaps=tuple(gaps),
        inlier_share=share,
    )


def _heading(
    c: Correspondences,
    part: Integers,
    centre: float,
    axis: Floats,
    yaw: Callable[[Floats], Floats],
    focal: float,
    seed: int,
) -> tuple | str:
    """Return times, sd, inliers, their share, direction and covariance; or why there are none."""
    if part.size < FEWEST:
        return TOO_FEW
    ahead = yaw(np.array([centre]))[0]
    r1 = _turned(c.r1[part], axis, yaw(c.t1[part]) - ahead)
    r2 = _turned(c.r2[part], axis, yaw(c.t2[part]) - ahead)
    cells = np.floor((r1 + r2) / (2 * CELL)).astype(np.int64)
    groups = np.unique(cells, axis=0, return_inverse=True)[1].ravel()
    found = two_point(r1, r2, threshold=THRESHOLD / focal, seed=seed, groups=groups)
    if found is None or found.inliers.mean() < SHARE:
        return DISAGREE
    if found.inliers.sum() < FEWEST:
        return TOO_FEW
    if not found.sd <= MAX_SD:
        return UNCERTAIN
    some = part[found.inliers]
    weight = np.sum((r2 - r1)[found.inliers] ** 2, axis=1)
    start, end = (float(np.average(t[some], weights=weight)) for t in (c.t1, c.t2))
    inliers = float(found.inliers.sum())
    numbers = 0.5 * (start + end), start, end, found.sd, inliers, inliers / part.size
    return *numbers, found.direction, found.covariance


def _turned(r: Floats, axis: Floats, angle: Floats) -> Floats:
    """Return bearings (n, 3) turned about a unit axis by angles (n,) (Rodrigues)."""
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    turned = c * r + s * np.cross(axis, r) + (1.0 - c) * (r @ axis)[:, None] * axis
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)


def at_camera(velocities: VelocitySeries, position: Floats) -> VelocitySeries:
    """Return the velocity of the camera's place on the body, v + w z x p; it turns no more."""
    if velocities.yaw_rate is None:
        return velocities
    v = velocities.v.copy()
    v[:, 0] -= velocities.yaw_rate * position[1]
    v[:, 1] += velocities.yaw_rate * position[0]
    return replace(velocities, v=v, yaw_rate=None)

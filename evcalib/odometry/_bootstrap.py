"""The first map: a straight, steady path from headings, brought into focus.

EVO starts from a plane parallel to the image, on which a sideways motion and a turn look alike, and
hopes that the map comes right.  Here the direction of motion is known before any map: the heading
of `evcalib.heading`, for a camera that does not turn.  Velocity and angular rate, both steady over
the bootstrap, are then those under which rays meet best.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.geometry import angle_between, unit
from evcalib.heading import Correspondences, HeadingEstimate, estimate_headings
from evcalib.kernels.linalg import tangent_basis
from evcalib.kernels.odometry.space_sweep import Planes, View
from evcalib.odometry._lens import Lens, Rays
from evcalib.odometry.mapping import PLANES, fill_volume, packets_of
from evcalib.poses import PoseSeries

WAY = 0.3
"""The typical corner moves by this share of the image's width during the bootstrap."""

STEADY = np.radians(15.0)
"""Headings of a bootstrap agree to this [rad]."""

FOCUS_EVENTS, FOCUS_PLANES = 40_000, 40
"""Events and planes of the volumes by which a path is judged."""

NEAREST, MARGIN = 98.0, 1.5
"""The last plane lies at this percentile of the inverse depths of the corners, times the margin."""


@dataclass(frozen=True, eq=False)
class Start:
    """A first path and the depths to look for along it.

    Attributes
    ----------
    poses : PoseSeries
        Of a camera whose path has length 1, in a world that is its own first frame.
    last : float
        Largest inverse depth to expect, in one over that length.
    """

    poses: PoseSeries
    last: float


def find_start(events: Events, camera: Camera, lens: Lens, seed: int) -> Start | str:
    """Return the first steady part of a stretch of events, or why there is none."""
    try:
        estimate = estimate_headings(events, camera, keep_correspondences=True, seed=seed)
    except InputError as error:
        return str(error)
    if not len(estimate.headings):
        reasons = Counter(gap.reason for gap in estimate.gaps).most_common(1)
        return f"no direction of motion was found in it ({reasons[0][0] if reasons else 'too short'})"
    chosen = _steady_part(estimate, float(events.t[-1]) * 1e-6, WAY * camera.width / camera.focal)
    if isinstance(chosen, str):
        return chosen
    start, end, direction = chosen
    last = _nearest(estimate.correspondences, start, end, direction)
    part = events.between(round(1e6 * start), round(1e6 * end))
    every = max(len(part) // FOCUS_EVENTS, 1)
    rays, t = lens.rays(part)
    path = _focus(rays[::every], t[::every], (start, end), direction, last, lens.view)
    return Start(path, last)


def _steady_part(
    estimate: HeadingEstimate, end: float, way: float
) -> tuple[float, float, Floats] | str:
    """Return start, end [s] and direction of the first part that is straight and long enough."""
    kept, headings = estimate.correspondences, estimate.headings
    assert kept is not None
    moved = np.linalg.norm(np.cross(kept.r1, kept.r2), axis=1) / np.maximum(kept.t2 - kept.t1, 1e-6)
    reason = "the scene moves too little in it"
    for row, t in enumerate(headings.t):
        mine = (kept.heading == row) & kept.inlier
        if not mine.any():
            continue
        length = way / max(float(np.median(moved[mine])), 1e-9)
        start = max(t - 0.5 * length, 1e-6 * 0)
        if start + length > end:
            continue
        near = (headings.t >= start) & (headings.t <= start + length)
        direction = unit(headings.v[near].sum(axis=0))
        if angle_between(headings.v[near], direction).max() < STEADY:
            return start, start + length, direction
        reason = "the direction of motion changes too fast in it"
    return reason


def _nearest(kept: Correspondences | None, start: float, end: float, direction: Floats) -> float:
    """Return the largest inverse depth to expect, of corners triangulated along the path."""
    assert kept is not None
    span = (kept.t2 - kept.t1) / (end - start)
    near = kept.inlier & (np.abs(0.5 * (kept.t1 + kept.t2) - 0.5 * (start + end)) < end - start)
    across = np.linalg.norm(np.cross(kept.r2, direction), axis=1)
    moved = np.linalg.norm(np.cross(kept.r1, kept.r2), axis=1)
    near &= across > 0.1
    return MARGIN * float(np.percentile((moved / (across * span))[near], NEAREST))


def steady_path(start: float, end: float, velocity: Floats, turn: Floats) -> PoseSeries:
    """Return a path of steady velocity, and turn [rad], both over its whole time."""
    t = np.linspace(start, end, 41)
    share = (t - start) / (end - start)
    R = Rotation.from_rotvec(np.outer(share, turn)).as_matrix()
    return PoseSeries(t, np.outer(share, velocity), R)


def focus(rays: Rays, t: Floats, path: PoseSeries, last: float, view: View) -> float:
    """Return how sharply the rays of a path meet: the mean square of the largest ray density."""
    planes = Planes(0.0, last / (FOCUS_PLANES - 1), FOCUS_PLANES)
    middle = len(path) // 2
    reference = path.matrices[middle], path.position[middle]
    volume = fill_volume(rays, packets_of(t, path), reference, view, planes)
    return float(np.mean(volume.max(axis=0).astype(np.float64) ** 2))


def _focus(
    rays: Rays,
    t: Floats,
    span: tuple[float, float],
    direction: Floats,
    last: float,
    view: View,
) -> PoseSeries:
    basis = tangent_basis(direction)

    def path(x: Floats) -> PoseSeries:
        return steady_path(*span, unit(direction + x[:2] @ basis), x[2:])

    def blur(x: Floats) -> float:
        return -focus(rays, t, path(x), last, view)

    scale = np.array([0.05, 0.05, 0.01, 0.01, 0.01])
    simplex = np.vstack([np.zeros(5), np.diag(scale)])
    options = {"initial_simplex": simplex, "xatol": 2e-4, "fatol": 1e-9, "maxfev": 200}
    found = minimize(blur, np.zeros(5), method="Nelder-Mead", options=options)
    return path(found.x)

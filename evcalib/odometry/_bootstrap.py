"""The first map: a steady motion that explains matched corners, brought into focus.

EVO starts from a plane parallel to the image, on which a sideways motion and a turn look alike, and
hopes that the map comes right.  Here corners are matched first, as for headings: one direction of
motion and one turn, both steady, that explain the matches of up to two seconds.  They are then
refined until rays meet best.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares, minimize
from scipy.spatial.transform import Rotation

from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.geometry import unit
from evcalib.heading import Correspondences, estimate_headings
from evcalib.kernels.linalg import tangent_basis
from evcalib.kernels.odometry.space_sweep import Planes, View
from evcalib.odometry._lens import Lens, Rays
from evcalib.odometry.mapping import fill_volume, packets_of
from evcalib.poses import PoseSeries

WAYS = (0.3, 0.2, 0.1)
"""The typical corner moves by one of these shares of the image's width during the bootstrap.  The
longest for which the motion is steady is taken: a turn is told from a sideways motion by how
perspective bends their flows, and errors of both fall with the square of the way."""

STEP = 0.2
"""From one candidate part of a stretch to the next [s]."""

LEAST_MATCHES, MOST_MATCHES = 40, 600
"""Fewest matches that show a motion, and most that are asked."""

RESIDUAL, AGREEING, AS_GOOD = 1.5, 0.5, 0.9
"""Residual of a match that agrees [px], the share of all that has to, and the share of those that
agree with a turn that have to agree without one, for the camera to be taken not to turn."""

PARALLAX = 0.03
"""Least way of the typical corner without the turn, as a share of the image's width."""

FOCUS_EVENTS, FOCUS_PLANES = 25_000, 30
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


@dataclass(frozen=True, eq=False)
class _Motion:
    """A steady motion from `start` to `end` [s]: direction, turn [rad], and what it explains."""

    start: float
    end: float
    direction: Floats
    turn: Floats
    turns: bool
    agreeing: float
    parallax: float
    last: float


def find_start(events: Events, camera: Camera, lens: Lens, seed: int) -> Start | str:
    """Return a steady part of a stretch of events, or why there is none."""
    try:
        estimate = estimate_headings(events, camera, keep_correspondences=True, seed=seed)
    except InputError as error:
        return str(error)
    kept = estimate.correspondences
    if kept is None or len(kept) < LEAST_MATCHES:
        reasons = Counter(gap.reason for gap in estimate.gaps).most_common(1)
        return f"too few corners were matched in it ({reasons[0][0] if reasons else 'too short'})"
    motion = _steady_part(kept, 1e-6 * float(events.t[0]), 1e-6 * float(events.t[-1]), camera)
    if isinstance(motion, str):
        return motion
    part = events.between(round(1e6 * motion.start), round(1e6 * motion.end))
    every = max(len(part) // FOCUS_EVENTS, 1)
    rays, t = lens.rays(part)
    return Start(_focus(rays[::every], t[::every], motion, lens.view), motion.last)


def _steady_part(
    kept: Correspondences, begin: float, end: float, camera: Camera
) -> _Motion | str:
    """Return the best motion of the longest parts that are steady, or why there is none."""
    width, pixel = camera.width / camera.focal, 1.0 / camera.focal
    moved = np.linalg.norm(np.cross(kept.r1, kept.r2), axis=1) / np.maximum(kept.t2 - kept.t1, 1e-6)
    reason = "the scene moves too little in it"
    for way in WAYS:
        found: list[_Motion] = []
        for start in np.arange(begin, end, STEP):
            soon = (kept.t1 >= start) & (kept.t1 < start + STEP)
            if soon.sum() < LEAST_MATCHES:
                continue
            stop = start + way * width / max(float(np.median(moved[soon])), 1e-9)
            inside = (kept.t1 >= start) & (kept.t2 <= stop)
            if stop <= end and inside.sum() >= LEAST_MATCHES:
                part = kept.select(inside)
                free = _fit(part, start, stop, pixel, turns=True)
                straight = _fit(part, start, stop, pixel, turns=False)
                as_good = straight.agreeing >= AS_GOOD * free.agreeing
                found.append(straight if as_good else free)
        steady = [one for one in found if one.agreeing >= AGREEING]
        moving = [one for one in steady if one.parallax >= PARALLAX * width]
        if moving:
            return max(moving, key=lambda one: (not one.turns, one.agreeing))
        if steady:
            reason = "the camera turns in it, but hardly changes its place"
        elif found:
            reason = "its motion is not steady for long enough, or things move by themselves"
    return reason


def _fit(
    kept: Correspondences, start: float, end: float, pixel: float, *, turns: bool
) -> _Motion:
    """Fit direction and turn to matches, by their distances from epipolar planes."""
    every = max(len(kept) // MOST_MATCHES, 1)
    r1, r2 = kept.r1[::every], kept.r2[::every]
    s1, s2 = ((t[::every] - start) / (end - start) for t in (kept.t1, kept.t2))

    def turned(turn: Floats) -> tuple[Floats, Floats]:
        first, second = (Rotation.from_rotvec(np.outer(s, turn)) for s in (s1, s2))
        return first.apply(r1), second.apply(r2)

    def residuals(v: Floats, turn: Floats) -> Floats:
        a, b = turned(turn)
        far = np.maximum(np.linalg.norm(np.cross(v, a), axis=1), 0.1)
        return np.asarray(np.cross(a, b) @ v / (far * pixel))

    best, v, turn, found = np.inf, np.zeros(3), np.zeros(3), np.zeros(5)
    for axis in np.eye(3):
        basis = tangent_basis(axis)

        def misfit(x: Floats, axis: Floats = axis, basis: Floats = basis) -> Floats:
            return residuals(unit(axis + x[:2] @ basis), x[2:] if turns else turn)

        none = np.zeros(5 if turns else 2)
        fit = least_squares(misfit, none, loss="soft_l1", x_scale="jac", max_nfev=20)
        if fit.cost < best:
            best, found = fit.cost, fit.x
            v = unit(axis + found[:2] @ basis)
    if turns:
        turn = found[2:]
    a, b = turned(turn)
    good = np.abs(residuals(v, turn)) < RESIDUAL
    flow, span = b - a, np.maximum(s2 - s1, 1e-6)
    if np.median((flow @ v - np.sum(a * flow, axis=1) * (a @ v))[good]) > 0:
        v = -v  # Points in front flow against the motion.
    across = np.linalg.norm(np.cross(b, v), axis=1)
    shift = np.linalg.norm(np.cross(a, b), axis=1) / span
    near = good & (across > 0.1)
    last = MARGIN * float(np.percentile((shift / across)[near], NEAREST)) if near.any() else 1.0
    parallax = float(np.median(shift[good])) if good.any() else 0.0
    return _Motion(start, end, v, turn, turns, float(good.mean()), parallax, last)


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


def _focus(rays: Rays, t: Floats, motion: _Motion, view: View) -> PoseSeries:
    """Return the steady path near a motion under which the rays meet best."""
    basis = tangent_basis(motion.direction)

    def path(x: Floats) -> PoseSeries:
        velocity = unit(motion.direction + x[:2] @ basis)
        turn = motion.turn + x[2:] if motion.turns else motion.turn
        return steady_path(motion.start, motion.end, velocity, turn)

    def blur(x: Floats) -> float:
        return -focus(rays, t, path(x), motion.last, view)

    steps = np.diag([0.05, 0.05, 0.01, 0.01, 0.01] if motion.turns else [0.05, 0.05])
    simplex = np.vstack([np.zeros(len(steps)), steps])
    options = {"initial_simplex": simplex, "xatol": 2e-4, "fatol": 1e-9, "maxfev": 150}
    return path(minimize(blur, simplex[0], method="Nelder-Mead", options=options).x)

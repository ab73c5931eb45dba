"""The first map: a steady motion that explains matched corners.

EVO starts from a plane parallel to the image, on which a sideways motion and a turn look alike, and
hopes that the map comes right.  Here corners are matched first, as for headings, and the first map
is swept along the one steady direction that explains the matches of up to two seconds.  A part in
which a turn explains them better is no start: its direction would be off by tens of degrees.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.geometry import unit
from evcalib.heading import Correspondences, estimate_headings
from evcalib.kernels.linalg import tangent_basis
from evcalib.poses import PoseSeries

WAYS = (0.3, 0.2, 0.1)
"""The typical corner moves by one of these shares of the image's width during the bootstrap.  The
longest for which the motion is steady is taken: a turn is told from a sideways motion by how
perspective bends their flows, and errors of both fall with the square of the way."""

POSES = 41
"""Poses of the first path, evenly spaced."""

STEP = 0.2
"""From one candidate part of a stretch to the next [s]."""

LEAST_MATCHES, MOST_MATCHES = 40, 600
"""Fewest matches that show a motion, and most that are asked."""

RESIDUAL, AGREEING, AS_GOOD = 1.5, 0.8, 0.95
"""Residual of a match that agrees [px]; the share of all matches that has to; and the share, of
those that agree with a direction and a turn, that has to agree with a direction alone."""

MISFIT, AS_SHARP = 0.005, 1.2
"""Largest median residual without a turn, as a share of the way of the typical corner, and as a
multiple of that with a turn.  A turn taken for a sideways motion leaves 1 to 3 % of the way in a
simulated room where the direction was 27 to 70 degrees off, whatever the fits say of the turn:
unless it is steady, the fit with a turn is no better.  Straight motions leave 0.3 % there, and on a
real slider with ways of 0.3.  A likelihood of hundreds of matches is decided by far less than the
second."""

PARALLAX = 0.03
"""Least way of the typical corner without the turn, as a share of the image's width."""

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
    """A steady motion from `start` to `end` [s], and how well it explains matches.

    `agreeing` is a share of them, `misfit` the median residual of all [px].
    """

    start: float
    end: float
    direction: Floats
    agreeing: float
    misfit: float
    parallax: float
    last: float


def find_start(events: Events, camera: Camera, seed: int) -> Start | str:
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
    t = np.linspace(motion.start, motion.end, POSES)
    share = (t - motion.start) / (motion.end - motion.start)
    return Start(PoseSeries(t, np.outer(share, motion.direction)), motion.last)


def _steady_part(kept: Correspondences, begin: float, end: float, camera: Camera) -> _Motion | str:
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
            if stop > end or inside.sum() < LEAST_MATCHES:
                continue
            part = kept.select(inside)
            straight = _fit(part, start, stop, pixel, turns=False)
            turning = _fit(part, start, stop, pixel, turns=True)
            if turning.agreeing < AGREEING:
                reason = "its motion is not steady for long enough, or things move by themselves"
            elif (
                straight.agreeing < AS_GOOD * turning.agreeing
                or straight.misfit > AS_SHARP * turning.misfit
            ):
                reason = "the camera turns in it"
            elif straight.misfit > MISFIT * way * camera.width:
                reason = "matches are not sharp enough to tell its motion from a turn"
            elif turning.parallax < PARALLAX * width:
                reason = "the camera hardly changes its place in it, or turns"
            else:
                found.append(straight)
        if found:
            return max(found, key=lambda one: one.agreeing)
    return reason


def _fit(kept: Correspondences, start: float, end: float, pixel: float, *, turns: bool) -> _Motion:
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

        def errors(x: Floats, axis: Floats = axis, basis: Floats = basis) -> Floats:
            return residuals(unit(axis + x[:2] @ basis), x[2:] if turns else turn)

        none = np.zeros(5 if turns else 2)
        fit = least_squares(errors, none, loss="soft_l1", x_scale="jac", max_nfev=20)
        if fit.cost < best:
            best, found = fit.cost, fit.x
            v = unit(axis + found[:2] @ basis)
    if turns:
        turn = found[2:]
    a, b = turned(turn)
    off = np.abs(residuals(v, turn))
    good = off < RESIDUAL
    flow, span = b - a, np.maximum(s2 - s1, 1e-6)
    if np.median((flow @ v - np.sum(a * flow, axis=1) * (a @ v))[good]) > 0:
        v = -v  # Points in front flow against the motion.
    across = np.linalg.norm(np.cross(b, v), axis=1)
    shift = np.linalg.norm(np.cross(a, b), axis=1) / span
    near = good & (across > 0.1)
    last = MARGIN * float(np.percentile((shift / across)[near], NEAREST)) if near.any() else 1.0
    parallax = float(np.median(shift[good])) if good.any() else 0.0
    agreeing, misfit = float(good.mean()), float(np.median(off))
    return _Motion(start, end, v, agreeing, misfit, parallax, last)

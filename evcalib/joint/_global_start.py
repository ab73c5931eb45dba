"""A start for the joint refinement from no prior at all: no heading, no rotation, no offset.

Given the body's axis Z in the camera and the offset, the rotation about that axis and the camera's
position in the body follow from the odometry in closed form (`evcalib.kernels.joint.global_start`).
So directions all over the sphere and offsets all over the search are few enough to try them all;
the best are refined.  It holds for a body that turns, where headings do not, and for one that
does not: then the position stays where it was expected.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from evcalib.arrays import Flags, Floats, Integers
from evcalib.checks import instance, positive
from evcalib.display import Shown
from evcalib.geometry import rotation_angle, rotation_vector_to_matrix
from evcalib.joint._world_motion import world_motion
from evcalib.joint.tracks import Tracks
from evcalib.kernels.joint import global_start as kernel
from evcalib.kernels.joint.observation_model import WorldMotion
from evcalib.kinematics.velocity_track import VelocityTrack
from evcalib.series import VelocitySeries, bins

AXES = 400
"""Directions that are tried, some 10 degrees apart.  A choice: corners of half that distance are
refined from all the same."""

OFFSET_STEP = 0.1
"""Between offsets that are tried [s].  A choice: within half of it no vehicle turns otherwise."""

SPAN = 0.25
"""Longest time between the two sightings of a pair [s], where there are enough.  A choice: a body
that turns by 60 deg/s turns by 15 degrees, and what axes 5 degrees off make of it, one degree,
still leaves an order among them."""

FEW, MANY = 300, 1_500
"""Pairs that rank the candidates, and that refine the best.  A choice of speed."""

FEWEST = 30
"""Pairs without which there is no start."""

BEST = 24
"""Candidates that are refined: as many as share the time with the scan."""

SCALES = (6.0, 3.0, 1.5)
"""Scales of the loss [px], in turn: of the scan, and down to the noise of false matches' kin."""

STEPS = 7
"""Gauss-Newton steps at each scale.  A choice: the joint refinement goes on from there."""

POSITION_SD = 0.5
"""How far the camera may be from where it is expected, standard deviation per axis [m]: a choice
that keeps the position bounded where nothing shows it."""

AWAY = np.radians(15.0), 0.15
"""Angle [rad] and offset [s] beyond which another candidate is another answer."""


@dataclass(frozen=True, eq=False)
class Start(Shown):
    """Where to begin.

    Attributes
    ----------
    R_body_cam : ndarray, shape (3, 3)
        Rotation.
    offset : float
        ``t_body = t_cam + offset`` [s].
    position : ndarray, shape (3,)
        Of the camera in the body frame [m]; z as expected.
    loss : float
        Mean loss of a pair, from 0 (all agree) to 1 (none does).
    pairs : int
        Pairs of sightings behind it.
    runner_up : Start, optional
        The best other answer, far away; None where all candidates lead here.
    margin : float
        Standard errors by which the runner-up is worse; inf without.
    """

    R_body_cam: Floats
    offset: float
    position: Floats
    loss: float
    pairs: int
    runner_up: Start | None = None
    margin: float = np.inf


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Pairs of sightings, and the odometry that they are held against."""

    t1: Floats
    t2: Floats
    arrays: kernel.Pairs
    motion: WorldMotion

    @classmethod
    def of(cls, tracks: Tracks, rows: Integers, motion: WorldMotion) -> _Pairs:
        arrays = kernel.Pairs(*(np.ascontiguousarray(r[rows]) for r in (tracks.r1, tracks.r2)))
        return cls(tracks.t1[rows], tracks.t2[rows], arrays, motion)

    def moves(self, offset: float) -> tuple[Floats, Floats, Flags]:
        """Return path (n, 2) in the body frame of t1, turn (n,) and which are known."""
        motion = self.motion
        a, b = self.t1 + offset, self.t2 + offset
        x, y, yaw = (
            np.stack([np.interp(at, motion.t, values) for at in (a, b)])
            for values in (motion.path[:, 0], motion.path[:, 1], motion.yaw)
        )
        dx, dy = np.diff(x, axis=0)[0], np.diff(y, axis=0)[0]
        c, s = np.cos(yaw[0]), np.sin(yaw[0])
        last = motion.t.size - 1
        low = np.clip(np.searchsorted(motion.t, a, side="right") - 1, 0, last)
        high = np.clip(np.searchsorted(motion.t, b), 0, last)
        known = (a >= motion.t[0]) & (b <= motion.t[-1])
        known &= motion.segment[low] == motion.segment[high]
        return np.stack([c * dx + s * dy, c * dy - s * dx], axis=1), yaw[1] - yaw[0], known


@dataclass(frozen=True, eq=False)
class _Candidate:
    """Unknowns: rotation, offset, position (2,), and the losses (n,) of the pairs that refine."""

    R: Floats
    offset: float
    position: Floats
    losses: Floats

    @property
    def loss(self) -> float:
        """Mean loss of the pairs known; 1 without."""
        known = np.isfinite(self.losses)
        return float(self.losses[known].mean()) if known.any() else 1.0


def global_start(
    tracks: Tracks,
    velocities: VelocitySeries,
    track: VelocityTrack,
    *,
    focal: float,
    max_offset: float = 1.0,
    lever: tuple[float, float, float] = (0.0, 0.0, 0.0),
    seed: int = 0,
) -> Start | None:
    """Find rotation, offset and position of the camera from nothing.

    Parameters
    ----------
    tracks : Tracks
        Corners seen again and again, false ones among them.
    velocities : VelocitySeries
        Its yaw rate is used, where there is one.
    track : VelocityTrack
        The same velocities, prepared.
    focal : float
        Pixels per radian, to speak of pixels.
    max_offset : float
        Offsets from -max_offset to max_offset [s] are tried.
    lever : tuple of float
        Where the camera is expected in the body frame [m].
    seed : int
        Of the choice of the pairs.

    Returns
    -------
    Start or None
        The best candidate, also where others are as good: then its margin is small.  None where
        the odometry covers too few pairs at any offset.

    Notes
    -----
    On a body that does not turn, offsets that differ by less than the motion changes are told apart
    by the joint refinement alone, and the position stays as expected.
    """
    instance(tracks, "tracks", Tracks)
    positive(focal, "focal", "pixels per radian")
    positive(max_offset, "max_offset", "seconds")
    rng = np.random.default_rng(seed)
    motion = world_motion(velocities, track)
    rows = _spread(tracks, MANY, rng)
    if rows.size < FEWEST:
        return None
    many = _Pairs.of(tracks, rows, motion)
    few = _Pairs.of(tracks, rng.permutation(rows)[:FEW], motion)
    position = np.asarray(lever[:2], dtype=np.float64)
    candidates = [
        _refined(many, candidate, position, focal, max_offset)
        for candidate in _scanned(few, position, focal, max_offset)
    ]
    return _chosen(many, candidates, float(lever[2]))


def _spread(tracks: Tracks, most: int, rng: np.random.Generator) -> Integers:
    """Return rows of pairs, drawn evenly over time, in order of time."""
    span = tracks.t2 - tracks.t1
    if not span.size:
        return np.empty(0, dtype=np.int64)
    usable = rng.permutation(np.flatnonzero(span <= max(SPAN, float(np.quantile(span, 0.2)))))
    stretch = bins(tracks.t1[usable] - tracks.t1.min(), SPAN)
    order = np.argsort(stretch, kind="stable")
    usable, stretch = usable[order], stretch[order]
    rank = np.arange(usable.size) - np.searchsorted(stretch, stretch)
    # The k-th of each stretch comes before the (k + 1)-th of any.
    chosen = usable[np.argsort(rank, kind="stable")][:most]
    return np.asarray(chosen[np.argsort(tracks.t1[chosen], kind="stable")], dtype=np.int64)


def _sphere(count: int) -> Floats:
    """Return directions spread evenly over the sphere (Fibonacci's lattice), shape (count, 3)."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)


def _scanned(pairs: _Pairs, position: Floats, focal: float, max_offset: float) -> list[_Candidate]:
    """Return the best candidates of the scan, no two of them neighbours."""
    half = int(np.ceil(max_offset / OFFSET_STEP))
    offsets = np.linspace(-max_offset, max_offset, 2 * half + 1)
    path, turn, known = (np.stack(part) for part in zip(*map(pairs.moves, offsets), strict=True))
    enough = known.sum(axis=1) >= max(FEWEST, 0.5 * known.sum(axis=1).max())
    offsets, axes = offsets[enough], _sphere(AXES)
    losses, found = np.empty((offsets.size, AXES)), np.empty((offsets.size, AXES, 4))
    kernel.scan(
        pairs.arrays,
        kernel.Moves(*(np.ascontiguousarray(part[enough]) for part in (path, turn, known))),
        axes,
        kernel.Options(
            SCALES[0] / focal, (float(position[0]), float(position[1])), POSITION_SD, 1.0 / focal
        ),
        losses,
        found,
    )
    chosen: list[_Candidate] = []
    for place in np.argsort(losses, axis=None):
        k, m = divmod(int(place), AXES)
        if len(chosen) == BEST or not np.isfinite(losses[k, m]):
            break
        R = _rotation(axes[m], *found[k, m, :2])
        near = any(
            abs(offsets[k] - c.offset) < 1.5 * OFFSET_STEP and rotation_angle(R, c.R) < 0.3
            for c in chosen
        )
        if not near:
            chosen.append(_Candidate(R, float(offsets[k]), found[k, m, 2:].copy(), np.empty(0)))
    return chosen


def _rotation(z: Floats, c: float, s: float) -> Floats:
    """Return R_body_cam of the body's axis in the camera and the turn about it."""
    first, second = kernel.tangent_basis(z)
    return np.stack([c * first + s * second, c * second - s * first, z])


def _refined(
    pairs: _Pairs, at: _Candidate, position: Floats, focal: float, max_offset: float
) -> _Candidate:
    """Return a candidate after some steps on more pairs, the loss narrowing down."""
    for scale in SCALES[1:]:
        for _ in range(STEPS):
            at = _step(pairs, at, position, scale / focal, focal, max_offset)
    scale = SCALES[-1] / focal
    return replace(at, losses=_losses(*_residuals(pairs, at), scale))


def _residuals(pairs: _Pairs, at: _Candidate) -> tuple[Floats, Flags]:
    path, turn, known = pairs.moves(at.offset)
    out = np.empty((turn.size, 2))
    kernel.residuals(pairs.arrays, path, turn, at.R, at.position, out)
    return out, known


def _losses(out: Floats, known: Flags, scale: float) -> Floats:
    """Return the loss of each pair, from 0 to 1; NaN where the odometry does not tell."""
    square = (out**2).sum(axis=1) / scale**2
    return np.where(known, square / (1.0 + square), np.nan)


TINY = 1e-5
"""Difference by which derivatives are taken [rad, m]; of the offset a hundred times as much [s]."""


def _step(
    pairs: _Pairs, at: _Candidate, position: Floats, scale: float, focal: float, max_offset: float
) -> _Candidate:
    """Take a Gauss-Newton step in rotation, offset and position."""
    out, known = _residuals(pairs, at)
    moved = [replace(at, R=rotation_vector_to_matrix(TINY * one) @ at.R) for one in np.eye(3)]
    moved.append(replace(at, offset=at.offset + 100 * TINY))
    moved += [replace(at, position=at.position + TINY * one) for one in np.eye(2)]
    J = np.stack([(_residuals(pairs, one)[0][:, 0] - out[:, 0]) / TINY for one in moved], axis=1)
    J[:, 3] /= 100.0
    right = known & (out[:, 1] == 0.0)
    w = right / (1.0 + (out[:, 0] / scale) ** 2) ** 2
    prior = np.zeros(6)
    prior[4:] = 1.0 / POSITION_SD**2
    unit = (1.0 / focal) ** 2
    information = (J * w[:, None]).T @ J / unit + np.diag(prior)
    gradient = J.T @ (w * out[:, 0]) / unit
    gradient[4:] += prior[4:] * (at.position - position)
    # Marquardt's damping holds what the pairs do not show.
    information += np.diag(1e-3 * np.diag(information) + 1e-3 * len(w))
    change = -np.linalg.solve(information, gradient)
    change *= min(1.0, 0.2 / max(float(np.abs(change).max()), 1e-300))
    return replace(
        at,
        R=rotation_vector_to_matrix(change[:3]) @ at.R,
        offset=float(np.clip(at.offset + change[3], -max_offset, max_offset)),
        position=at.position + change[4:],
    )


def _chosen(pairs: _Pairs, candidates: list[_Candidate], z: float) -> Start | None:
    """Return the best candidate, and the best one far from it."""
    if not candidates:
        return None
    first, *others = sorted(candidates, key=lambda one: one.loss)
    start = _start(first, z)
    angle, shift = AWAY
    for other in others:
        if rotation_angle(other.R, first.R) > angle or abs(other.offset - first.offset) > shift:
            margin = _margin(pairs, first, other)
            return replace(start, runner_up=_start(other, z), margin=margin)
    return start


def _start(candidate: _Candidate, z: float) -> Start:
    return Start(
        R_body_cam=candidate.R,
        offset=candidate.offset,
        position=np.append(candidate.position, z),
        loss=candidate.loss,
        pairs=int(np.isfinite(candidate.losses).sum()),
    )


def _margin(pairs: _Pairs, best: _Candidate, other: _Candidate) -> float:
    """Return by how many standard errors another candidate is worse (Vuong 1989)."""
    more = other.losses - best.losses
    known = np.isfinite(more)
    if not known.any():
        return np.inf
    # Pairs of one stretch share corners and motion.
    stretch = bins(pairs.t1[known] - pairs.t1[0], 2 * SPAN)
    sums = np.bincount(stretch, more[known])
    spread = float(np.sqrt(np.sum((sums - sums.mean()) ** 2)))
    return float(sums.sum()) / max(spread, 1e-12)

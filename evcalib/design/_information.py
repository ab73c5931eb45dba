"""What corners that a camera sees say about its mounting, while the body drives and turns.

A corner in the direction u, as seen from its first observation in the frame that the body then has,
and at the distance Z, is seen along ``u - D / Z`` once the odometry's yaw is taken out, where D is
the camera's displacement (first order in D / Z).  This changes with

- a rotation r of the mounting by ``(r - A r) x u + A r x D / Z``, A being the body's turn since;
- the offset, as yaw and displacement come earlier or later;
- the position p of the camera by ``-(A p - p) / Z``;
- what else is unknown: how far corners trail their flow, how the body leans by its acceleration, a
  yaw that the odometry does not tell, and u and Z of every corner.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.linalg import solveh_banded

from evcalib.arrays import Floats, Integers
from evcalib.errors import InputError
from evcalib.geometry import turned_by_yaw
from evcalib.joint import NO_YAW_RATE, Systematic
from evcalib.series import VelocitySeries, dead_reckon

STEP = 0.05
"""Time from one observation of a corner to the next [s]: that of headings at 20 Hz."""

OBSERVATIONS = 12
"""A corner is seen so often after its first observation: for 0.6 s."""

SLOWEST = 3.0
"""Corners that flow slower than this [px/s] leave too few events to be seen: in 0.6 s they move by
less than an edge is wide."""

TILT_SD = float(np.radians(0.3))
"""Standard deviation of the lean of a body by its acceleration [rad per m/s^2]: 0.1 to 0.5 deg are
usual for small robots."""

SPREAD = (1.28, 0.6)
"""Half of the corners are so much nearer, half so much farther: in units of the mean square of
1 / distance."""

GRID = (4, 3)
"""Corners stand on a grid of so many columns and rows over the field of view."""

CORNER = 3
"""Unknowns of a corner: 1 / distance, and two of its direction."""

CHUNK = 200
"""Corners of so many starts are looked at together: a choice of memory."""

UP = np.array([0.0, 0.0, 1.0])

ROTATION, OFFSET, LAG, POSITION, TILT, TOGETHER = slice(0, 3), 3, 4, slice(5, 7), slice(7, 9), 9
"""Places of the globals."""


@dataclass(frozen=True)
class Viewing:
    """What the camera makes of a drive.

    Attributes
    ----------
    focal : float
        Pixels per radian.
    noise : float
        Standard deviation of an observation per axis [px].
    corners : float
        Corners in view whose errors are independent.
    distance : float
        Their distance [m].
    direction : float
        Where the camera looks, from body X towards Y [rad].
    field : float
        Width of its field of view [rad]; the height is three quarters of that.
    position : tuple of float
        About where it is in the body frame, x and y [m].
    lean_sd : float
        Standard deviation of the body's lean by its acceleration [rad per m/s^2].
    """

    focal: float = 200.0
    noise: float = 0.3
    corners: float = 20.0
    distance: float = 2.5
    direction: float = 0.0
    field: float = 1.1
    position: tuple[float, float] = (0.2, 0.1)
    lean_sd: float = TILT_SD

    @property
    def step_sd(self) -> float:
        """Standard deviation of a displacement across the view per axis [m], from all corners."""
        return self.noise / self.focal * self.distance / float(np.sqrt(self.corners))

    @property
    def bearings(self) -> Floats:
        """Directions of corners in the body frame, shape (12, 3)."""
        x, y = ((np.arange(n) + 0.5) / n - 0.5 for n in GRID)
        azimuth, elevation = np.meshgrid(self.direction + self.field * x, 0.75 * self.field * y)
        c = np.cos(elevation)
        rays = c * np.cos(azimuth), c * np.sin(azimuth), np.sin(elevation)
        return np.stack(rays, axis=-1).reshape(-1, 3)


USUAL = Viewing()
"""A small camera that looks ahead, indoors."""


class _Motion(NamedTuple):
    """The drive at the times of observations: yaw [rad], rates, velocity, acceleration, path."""

    t: Floats
    yaw: Floats
    rate: Floats
    v: Floats
    acceleration: Floats
    path: Floats


def information(
    velocities: VelocitySeries, viewing: Viewing, systematic: Systematic, speed: bool
) -> Floats:
    """Return the information (9, 9) on the globals, the priors of lag and tilt included.

    Parameters
    ----------
    velocities : VelocitySeries
        The drive.
    viewing : Viewing
        What the camera sees.
    systematic : Systematic
        What all observations share.
    speed : bool
        Compare displacements in length; otherwise each corner has a distance of its own in every
        observation.

    Raises
    ------
    InputError
        If the drive is shorter than corners live, or does not move.
    """
    motion = _motion(velocities, np.array([*viewing.position, 0.0]))
    last = motion.t.size - OBSERVATIONS
    total = np.zeros((TOGETHER, TOGETHER))
    mixed = np.zeros((motion.t.size, TOGETHER))
    band = np.zeros((OBSERVATIONS + 1, motion.t.size))
    for start in range(0, last, CHUNK):
        first = np.arange(start, min(start + CHUNK, last))
        J = _derivatives(motion, first, viewing, speed)
        whole = _without_corners(J) * viewing.corners / OBSERVATIONS / len(viewing.bearings)
        whole /= (viewing.noise / viewing.focal) ** 2
        total += whole[:, :TOGETHER, :TOGETHER].sum(axis=0)
        for i in range(OBSERVATIONS + 1):
            at = TOGETHER + i
            mixed[first + i] += whole[:, at, :TOGETHER]
            for j in range(i + 1):
                band[i - j, first + j] += whole[:, at, TOGETHER + j]
    told = velocities.yaw_rate is not None
    sd = np.hypot(systematic.yaw_rate_sd, 0.0 if told else NO_YAW_RATE)
    _random_walk(band, max(float(sd), 1e-6) * STEP)
    total -= mixed.T @ solveh_banded(band, mixed, lower=True)
    total[LAG, LAG] += max(systematic.lag_sd / viewing.focal, 1e-9) ** -2
    total[TILT, TILT] += np.eye(2) * max(viewing.lean_sd, 1e-9) ** -2
    return total


def _random_walk(band: Floats, sd: float) -> None:
    """Add the prior of a yaw that changes by `sd` [rad] from one time to the next."""
    band[0, 1:] += sd**-2
    band[0, :-1] += sd**-2
    band[1, :-1] -= sd**-2
    band[0] += 1e-6 * sd**-2


def _without_corners(J: Floats) -> Floats:
    """Return the information on globals and yaws (n, c, c) of corners whose place is unknown."""
    J = J.reshape(*J.shape[:2], -1, J.shape[-1])
    whole = J.swapaxes(-1, -2) @ J
    place = whole[..., -CORNER:, -CORNER:] + 1e-12 * np.eye(CORNER)
    mixed = whole[..., -CORNER:, :-CORNER]
    known = whole[..., :-CORNER, :-CORNER] - mixed.swapaxes(-1, -2) @ np.linalg.solve(place, mixed)
    return np.asarray(known.sum(axis=1))


def _motion(velocities: VelocitySeries, position: Floats) -> _Motion:
    """Return the motion of the camera in the frame of the body."""
    t = np.arange(velocities.t[0], velocities.t[-1] + 1e-9, STEP)
    if t.size < 2 * OBSERVATIONS:
        raise InputError(
            f"the drive lasts {velocities.t[-1] - velocities.t[0]:.2f} s; at least"
            f" {2 * OBSERVATIONS * STEP:g} s are needed"
        )
    v = np.stack([np.interp(t, velocities.t, column) for column in velocities.v.T], axis=1)
    rate = np.zeros_like(t)
    if velocities.yaw_rate is not None:
        rate = np.interp(t, velocities.t, velocities.yaw_rate)
    if not (np.any(v) or np.any(rate)):
        raise InputError("the drive does not move")
    yaw = cumulative_trapezoid(rate, dx=STEP, initial=0.0)
    v = v + rate[:, None] * np.cross(UP, position)
    acceleration = np.gradient(v, t, axis=0) + rate[:, None] * np.cross(UP, v)
    path = dead_reckon(VelocitySeries(t, v, rate))
    return _Motion(t, yaw, rate, v, acceleration, path)


def _derivatives(motion: _Motion, first: Integers, viewing: Viewing, speed: bool) -> Floats:
    """Return how observations change with all unknowns, (n, bearings, times, 2, columns).

    Columns are the globals, the yaws untold at the times of the observations, and 1 / distance and
    direction of the corner.  Rows are zero where a corner is not seen.
    """
    rows = np.add.outer(first, np.arange(OBSERVATIONS + 1))
    yaw = motion.yaw[rows] - motion.yaw[first][:, None]
    back = -motion.yaw[first][:, None]
    D = turned_by_yaw(motion.path[rows] - motion.path[first][:, None], back)
    v, rate = turned_by_yaw(motion.v[rows], yaw), motion.rate[rows]
    moved = v - v[:, :1] - rate[:, :1, None] * np.cross(UP, D)
    # From here on (n, bearings, times, 3).
    D, v, moved, pull = (some[:, None] for some in (D, v, moved, motion.acceleration[rows]))
    turns = [turned_by_yaw(axis, yaw)[:, None] for axis in np.eye(3)]
    u = viewing.bearings[:, None]
    near = np.resize([SPREAD, SPREAD[::-1]], len(u))[:, None, None] / viewing.distance
    spin = np.cross(UP, u)
    flow = -rate[:, None, :, None] * spin - near * v
    flow -= (flow * u).sum(axis=-1, keepdims=True) * u
    size = np.linalg.norm(flow, axis=-1, keepdims=True)
    columns = [
        *(
            np.cross(axis - turned, u) + near * np.cross(turned, D)
            for axis, turned in zip(np.eye(3), turns, strict=True)
        ),
        -(rate - rate[:, :1])[:, None, :, None] * spin - near * moved,
        -flow / np.maximum(size, 1e-9),
        *(-near * (turned - axis) for axis, turned in zip(np.eye(3)[:2], turns[:2], strict=True)),
        -np.cross(turns[0], u) * pull[..., 1:2],
        np.cross(turns[1], u) * pull[..., :1],
    ]
    shape = np.broadcast_shapes(*(column.shape for column in columns))
    across = _across(viewing.bearings)
    J = np.zeros((*shape, TOGETHER + OBSERVATIONS + 1 + CORNER))
    for k, column in enumerate(columns):
        J[..., k] = column
    for i in range(OBSERVATIONS + 1):
        J[:, :, i, :, TOGETHER + i] = -spin[:, 0]
    J[..., -CORNER] = -D
    J[..., 1 - CORNER :] = across.swapaxes(1, 2)[None, :, None]
    seen = (viewing.focal * size > SLOWEST) * np.clip(1 - np.abs(yaw) / viewing.field, 0, 1)[
        :, None, :, None
    ]
    if not speed:
        # What is left across the way of the corner, whatever the distance; the first observation,
        # which has no way, tells the direction itself.
        way = D - (D * u).sum(axis=-1, keepdims=True) * u
        length = np.linalg.norm(way, axis=-1, keepdims=True)
        way = way / np.maximum(length, 1e-9)
        J -= way[..., None] * (way[..., None] * J).sum(axis=-2, keepdims=True)
    return np.asarray((across[None, :, None] @ J) * np.sqrt(seen)[..., None])


def _across(bearings: Floats) -> Floats:
    """Return two unit vectors across each direction, shape (k, 2, 3)."""
    side = np.cross(UP, bearings)
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    return np.stack([side, np.cross(bearings, side)], axis=1)

"""What the motion can tell, and what it cannot.

The offset shows only through a body direction that turns at a changing rate: on a constant-rate
arc ``v_o(t + td) = Rz(omega td) v_o(t)``, so every offset fits with its own rotation.  The rotation
shows only as far as the directions span more than one axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evcalib.arrays import Flags, Floats, Integers
from evcalib.kinematics.velocity_track import VelocityTrack, rebuilt
from evcalib.series import bins
from evcalib.uncertainty import coloured_noise

BLOCK = 0.5
"""Length [s] of the blocks over which the heading-rate test averages: a choice; longer ones average
more noise away, shorter ones see faster turns."""

RATE_GATE = 3.0
"""Standard deviations by which the heading rate must vary for the offset to be observable: all
constant arcs and straight lines stay below, all S-curves of 5 degrees and more lie above
(`tests/test_acceptance.py`, `tests/test_observability.py`)."""

FOLLOW_GATE = 2.0
"""Standard errors by which the headings must prefer the track to one that turns steadily; noise
does so in 2 % of cases."""

HEADING_BIAS = np.radians(0.75)
"""Systematic error [rad] that real headings share; limits what nearly parallel ones can tell.  On
the real `slider_depth` they are off by 0.3 to 1.1 degrees (`tests/test_heading.py`)."""

MAX_ROTATION_SD = np.radians(15.0)
"""An axis about which the rotation is less sure than this [rad] counts as not determined: a choice,
about what the eye tells of a mounting."""

DIRECTION_FLOOR = 1e-4
"""Velocity directions [rad] are never taken to be more exact than this, four digits of a log."""


@dataclass(frozen=True, eq=False)
class DirectionSpread:
    """How the body directions are spread.

    Attributes
    ----------
    axis : ndarray, shape (3,)
        Main axis of the directions in the body frame, X (else Y, else Z) positive.
    spread : float
        Root mean square angle [rad] of the directions from that axis, within the widest plane, less
        what noise of the velocities explains.
    axes : int
        Number of distinct axes, 10 degrees apart, that hold at least 5 % of the directions each.
    """

    axis: Floats
    spread: float
    axes: int


def heading_rate_test(track: VelocityTrack, start: float, end: float) -> float:
    """Return by how many standard deviations the body's heading rate varies.

    Velocities are averaged over blocks.  From one block to the next the direction turns; the turns
    are compared with the best constant rate of turning, and their sum of squares with what noise
    leaves, its memory included, so that noise does not pass for motion.

    Parameters
    ----------
    track : VelocityTrack
        Velocities.
    start, end : float
        Part [s] of the track to look at.

    Returns
    -------
    float
        z value; below 3 the offset is not observable.
    """
    t, direction, segment, variance = _block_means(track, start, end)
    joined = (segment[1:] == segment[:-1]) & (np.diff(t) < 1.5 * BLOCK)
    if joined.sum() < 3:
        return 0.0
    _, residual, step = _fit_rate(t, direction, joined)
    variance += DIRECTION_FLOOR**2
    expected = variance * np.sum(2.0 / step**2)
    # Neighbouring turns share a block: their sum of squares scatters as with 2/3 of their number.
    dof = 2.0 / 3.0 * step.size
    return _normal(residual / expected * dof, dof)


def speed_test(track: VelocityTrack, start: float, end: float) -> float:
    """Return by how many standard deviations the body's speed varies.

    Speeds are averaged over blocks and compared with their mean, as turns are in
    `heading_rate_test`.  A motion whose speed is as constant as its rate of turning looks the same
    at any offset, whatever else the noise of the odometry suggests.

    Parameters
    ----------
    track : VelocityTrack
        Velocities.
    start, end : float
        Part [s] of the track to look at.
    """
    used = (track.t >= start) & (track.t <= end)
    t, speed = track.t[used], np.linalg.norm(track.raw[used], axis=1)
    if t.size < 2:
        return 0.0
    block = np.unique(bins(t - t[0], BLOCK), return_inverse=True)[1]
    count = np.bincount(block)
    full = count >= 0.8 * np.median(count)
    if full.sum() < 3:
        return 0.0
    mean = (np.bincount(block, speed) / count)[full]
    sigma, rho = coloured_noise(track.raw, track.segment, float(np.median(np.diff(track.t))))
    variance = float(np.max(sigma)) ** 2 * (1 + rho) / (1 - rho) / count[full]
    variance += (DIRECTION_FLOOR * track.moving_speed) ** 2
    square = float(np.sum((mean - mean.mean()) ** 2 / variance))
    return _normal(square, float(full.sum() - 1))


def _normal(square: float, dof: float) -> float:
    """Return a chi-square as a standard normal deviate (Wilson & Hilferty 1931)."""
    root = (square / dof) ** (1 / 3)
    return float((root - (1 - 2 / (9 * dof))) / np.sqrt(2 / (9 * dof)))


def steady_turning(track: VelocityTrack, start: float, end: float) -> VelocityTrack:
    """Return the track as if the direction had turned at one constant rate in each segment.

    Speeds and times stay.  Headings that follow the real track no better than this one carry no
    information on the offset.
    """
    used = (track.t >= start) & (track.t <= end)
    v = track.v.copy()
    rate = _common_rate(track, start, end)
    speed = np.linalg.norm(v, axis=1)
    length = float(np.linalg.norm(rate))
    axis = rate / length if length > 0 else np.array([0.0, 0.0, 1.0])
    for number in np.unique(track.segment[used]):
        rows = used & (track.segment == number)
        angle = length * (track.t[rows] - track.t[rows].mean())
        mean = _turn(v[rows], axis, -angle).sum(axis=0)
        norm = np.linalg.norm(mean)
        if norm > 0:
            straight = np.broadcast_to(mean / norm, (int(rows.sum()), 3))
            v[rows] = speed[rows, None] * _turn(straight, axis, angle)
    return rebuilt(track, v)


def _common_rate(track: VelocityTrack, start: float, end: float) -> Floats:
    """Return the constant rate of turning [rad/s] that fits the blocks best."""
    t, direction, segment, _ = _block_means(track, start, end)
    joined = (segment[1:] == segment[:-1]) & (np.diff(t) < 1.5 * BLOCK)
    return _fit_rate(t, direction, joined)[0] if joined.any() else np.zeros(3)


def _fit_rate(t: Floats, direction: Floats, joined: Flags) -> tuple[Floats, float, Floats]:
    """Return the rate w of turn = w x direction, the residual sum of squares, and the steps."""
    step = np.diff(t)[joined]
    turn = (direction[1:] - direction[:-1])[joined] / step[:, None]
    middle = 0.5 * (direction[1:] + direction[:-1])[joined]
    rows = np.zeros((len(middle), 3, 3))
    rows[:, 0, 1], rows[:, 0, 2] = middle[:, 2], -middle[:, 1]
    rows[:, 1, 0], rows[:, 1, 2] = -middle[:, 2], middle[:, 0]
    rows[:, 2, 0], rows[:, 2, 1] = middle[:, 1], -middle[:, 0]
    rate, *_ = np.linalg.lstsq(rows.reshape(-1, 3), turn.ravel(), rcond=1e-9)
    return np.asarray(rate, dtype=np.float64), float(np.sum((turn - rows @ rate) ** 2)), step


def _turn(v: Floats, axis: Floats, angle: Floats) -> Floats:
    """Return vectors (n, 3) turned about a unit axis by angles (n,) (Rodrigues)."""
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    along = (v @ axis)[:, None] * axis
    return along + c * (v - along) + s * np.cross(axis, v)


def _block_means(
    track: VelocityTrack, start: float, end: float
) -> tuple[Floats, Floats, Integers, float]:
    """Return times, directions and segments of blocks, and the noise variance of a direction."""
    speed = np.linalg.norm(track.v, axis=1)
    used = (track.t >= start) & (track.t <= end) & (speed >= track.min_speed) & (speed > 0)
    if not used.any():
        return np.empty(0), np.empty((0, 3)), np.empty(0, dtype=np.int64), 0.0
    t, v, segment = track.t[used], track.raw[used], track.segment[used]
    block = bins(t - t[0], BLOCK)
    first = np.flatnonzero(np.r_[True, (np.diff(block) > 0) | (np.diff(segment) > 0)])
    count = np.diff(np.r_[first, t.size])
    total = np.add.reduceat(v, first, axis=0)
    length = np.maximum(np.linalg.norm(total, axis=1), 1e-300)
    direction = total / length[:, None]
    sigma, rho = coloured_noise(track.raw, track.segment, float(np.median(np.diff(track.t))))
    # Noise along the direction does not turn it.
    across = float(np.mean((1.0 - direction**2) @ sigma**2))
    mean_t = np.add.reduceat(t, first) / count
    # A block cut short by a gap or an end is noisier than the others.
    full = count >= 0.8 * np.median(count)
    memory = _slow_variance(rho, float(np.median(count[full])))
    variance = across * memory * float(np.mean((count / length**2)[full]))
    return mean_t[full], direction[full], segment[first][full], variance


def _slow_variance(rho: float, count: float) -> float:
    """Return by how much AR(1) memory raises the variance that blocks of samples show, at most.

    ``(1 + rho) / (1 - rho)`` is that of a mean over more than the memory.  Where the memory is
    longer than a block, means of neighbouring blocks share their noise: their difference cannot
    have more than that of a random walk of the same steps, of variance ``1 - rho ** 2``, which is
    2 count / 3 of these.
    """
    return min((1 + rho) / (1 - rho), count**2 * (1 - rho**2) / 3)


def direction_spread(d: Floats, track: VelocityTrack) -> DirectionSpread:
    """Describe how body directions (n, 3) are spread; opposite directions count as one."""
    values, vectors = np.linalg.eigh(d.T @ d / len(d))
    axis = vectors[:, 2]
    axis = axis * np.sign(axis[np.argmax(np.abs(axis) > 1e-6)])
    noise = float(np.max(track.noise) / track.moving_speed) ** 2
    return DirectionSpread(axis, float(np.sqrt(max(values[1] - noise, 0.0))), _count_axes(d))


def _count_axes(d: Floats, apart: float = np.radians(10.0), share: float = 0.05) -> int:
    if len(d) > 2000:
        return _count_axes(d[:: len(d) // 1000])
    near = (np.abs(d @ d.T) > np.cos(apart / 2)).astype(np.float32)
    left, count = np.ones(len(d), dtype=bool), 0
    while left.any():
        size = near @ left.astype(np.float32)
        if size.max() < share * len(d):
            break
        count += 1
        left &= ~(np.abs(d @ d[int(size.argmax())]) > np.cos(apart))
    return count


def axis_name(axis: Floats) -> str:
    """Name a direction in the body frame: forward, left, up, or by its numbers."""
    for name, index in (("forward", 0), ("left", 1), ("up", 2)):
        if abs(axis[index]) > np.cos(np.radians(20.0)):
            return f"the body's {name} axis"
    return f"the body axis ({axis[0]:.2f}, {axis[1]:.2f}, {axis[2]:.2f})"

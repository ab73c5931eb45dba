"""How a body turns, as its odometry tells, and what that shows."""

from __future__ import annotations

import numpy as np
from scipy import stats

from evcalib.arrays import Floats
from evcalib.kinematics.velocity_track import VelocityTrack
from evcalib.series import VelocitySeries, bins
from evcalib.uncertainty import coloured_noise

BLOCK = 0.5
"""Yaw rates are averaged over so much time [s], as velocities are in `heading_rate_test`."""

TURNS = 0.02
"""Yaw rate beyond noise [rad/s], rms, from which a body turns.  A choice: a camera 0.3 m from its
origin then moves by 0.7 degrees otherwise at 0.5 m/s, as much as headings are off themselves; less
tells nothing of the position."""

LEADS = 0.1
"""Yaw rate beyond noise [rad/s], rms, from which headings do not hold and the calibration starts
without them.  A choice: over a baseline of 0.3 s the body turns by 2 degrees, and corners 3 m ahead
move by as much for a translation at 0.3 m/s."""

LAST_DIGIT = 1e-3
"""Velocities [m/s] and yaw rates [rad/s] are never taken to be more exact than this, a log's last
digit."""

VARIOUS = 3.0
"""By how much twists must differ from multiples of one, against noise (rms over rms).  At 3, noise
makes a tenth of the difference, and bends what rests on it by as much."""


def turning_beyond_noise(velocities: VelocitySeries, track: VelocityTrack) -> float:
    """Return the root mean square yaw rate [rad/s] less what is noise; 0 where it is not told."""
    if velocities.yaw_rate is None or len(velocities) < 2:
        return 0.0
    twist, sd = _blocks(velocities, track, track.t[0], track.t[-1])
    return float(np.sqrt(max(float(np.mean(twist[:, 2] ** 2)) - sd[2] ** 2, 0.0)))


def yaw_rate_changes(
    velocities: VelocitySeries, track: VelocityTrack, start: float, end: float
) -> float:
    """Return by how many standard deviations the yaw rate varies within a part [s] of the track."""
    if velocities.yaw_rate is None:
        return 0.0
    twist, sd = _blocks(velocities, track, start, end)
    if len(twist) < 3:
        return 0.0
    rate = twist[:, 2]
    square = float(np.sum((rate - rate.mean()) ** 2)) / max(sd[2], 0.1 * LAST_DIGIT) ** 2
    return float(stats.norm.isf(max(stats.chi2.sf(square, rate.size - 1), 1e-300)))


def turns_variously(
    velocities: VelocitySeries, track: VelocityTrack, start: float, end: float
) -> bool:
    """Tell whether the body turns about more than one point, or also without turning.

    Twists that are multiples of one, as on a circle or in turning in place, move the camera in one
    direction of the body all the time: its yaw and its position stay unknown.
    """
    if velocities.yaw_rate is None:
        return False
    twist, sd = _blocks(velocities, track, start, end)
    if len(twist) < 3:
        return False
    size = np.linalg.svd(twist / np.maximum(sd, LAST_DIGIT), compute_uv=False)
    return float(np.sqrt(np.sum(size[1:] ** 2) / (2 * len(twist)))) > VARIOUS


def _blocks(
    velocities: VelocitySeries, track: VelocityTrack, start: float, end: float
) -> tuple[Floats, Floats]:
    """Return mean twists (x, y, yaw) of blocks, and the standard deviations that noise leaves."""
    assert velocities.yaw_rate is not None
    twist = np.column_stack([velocities.v[:, :2], velocities.yaw_rate])
    used = np.flatnonzero((track.t >= start) & (track.t <= end))
    if used.size < 2:
        return np.empty((0, 3)), np.ones(3)
    block = np.unique(bins(track.t[used] - track.t[used[0]], BLOCK), return_inverse=True)[1]
    count = np.bincount(block)
    full = count >= 0.8 * np.median(count)
    sums = np.stack([np.bincount(block, column[used]) for column in twist.T], axis=1)
    mean = (sums / count[:, None])[full]
    sigma, rho = coloured_noise(twist, track.segment, float(np.median(np.diff(track.t))))
    share = (1 + rho) / (1 - rho) * float(np.mean(1.0 / count[full]))
    return mean, sigma * np.sqrt(share)

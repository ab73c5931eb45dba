"""How a body turns, as its odometry tells, and what that shows."""

from __future__ import annotations

import numpy as np
from scipy import stats

from evcalib.arrays import Floats, Integers
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


def turning_beyond_noise(velocities: VelocitySeries, track: VelocityTrack) -> float:
    """Return the root mean square yaw rate [rad/s] less what is noise; 0 where it is not told."""
    if velocities.yaw_rate is None or len(velocities) < 2:
        return 0.0
    rate, variance = _blocks(velocities, track, np.arange(len(velocities)))
    return float(np.sqrt(max(float(np.mean(rate**2)) - variance, 0.0)))


def yaw_rate_changes(
    velocities: VelocitySeries, track: VelocityTrack, start: float, end: float
) -> float:
    """Return by how many standard deviations the yaw rate varies within a part [s] of the track."""
    used = np.flatnonzero((track.t >= start) & (track.t <= end))
    if velocities.yaw_rate is None or used.size < 2:
        return 0.0
    rate, variance = _blocks(velocities, track, used)
    if rate.size < 3:
        return 0.0
    # Four digits of a log, at a turn within ten seconds.
    variance += 1e-8
    square, dof = float(np.sum((rate - rate.mean()) ** 2)) / variance, rate.size - 1
    return float(stats.norm.isf(max(stats.chi2.sf(square, dof), 1e-300)))


def _blocks(
    velocities: VelocitySeries, track: VelocityTrack, used: Integers
) -> tuple[Floats, float]:
    """Return mean yaw rates of blocks, and the variance that noise leaves of one."""
    assert velocities.yaw_rate is not None
    t, rate = track.t[used], velocities.yaw_rate[used]
    block = np.unique(bins(t - t[0], BLOCK), return_inverse=True)[1]
    count = np.bincount(block)
    full = count >= 0.8 * np.median(count)
    mean = (np.bincount(block, rate) / count)[full]
    step = float(np.median(np.diff(track.t)))
    sigma, rho = coloured_noise(velocities.yaw_rate[:, None], track.segment, step)
    variance = float(sigma[0]) ** 2 * (1 + rho) / (1 - rho) * float(np.mean(1.0 / count[full]))
    return mean, variance

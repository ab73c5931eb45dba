"""The odometry as a function of time: which way the body moved, at or over any time.

Velocities are smoothed where they are smooth, linear between samples, and undefined across gaps
and where the vehicle (almost) stands.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from evcalib import checks
from evcalib.arrays import Floats, Integers
from evcalib.errors import InputError
from evcalib.kernels.kinematics import velocity_track as kernel
from evcalib.series import BORDER, VelocitySeries, segments
from evcalib.uncertainty import white_noise

SMOOTHING = np.array([0.04, 0.06, 0.09, 0.13, 0.2, 0.3, 0.4, 0.6, 0.8])
"""Half widths [s] of the smoothing windows, of which each sample takes the widest without bias.  A
choice: each half as wide again as the last, from two samples at 50 Hz on."""

SMOOTHING_GATE = 2.5
"""Standard deviations within which the estimates of two windows agree.  A choice within the usual 2
to 3 of the rule: lower ones leave noise, higher ones round turns (tests/test_track.py bounds
both)."""

STILL = 0.1
"""Share of the usual top speed below which the vehicle counts as standing.  A choice: noise of the
wheels is far below, slow driving above (test_standing_most_of_the_time_spoils_nothing)."""


@dataclass(frozen=True, eq=False)
class VelocityTrack:
    """Velocities prepared for lookups at any time.

    Attributes
    ----------
    t : ndarray, shape (m,)
        Sample times [s].
    v : ndarray, shape (m, 3)
        Velocity [m/s], smoothed.
    slope : ndarray, shape (m - 1, 3)
        Slope from each sample to the next [m/s^2].
    path : ndarray, shape (m, 3)
        Integral of the velocity [m] from the start of each segment.
    segment : ndarray of int, shape (m,)
        Number of the segment between gaps that each sample belongs to.
    min_speed : float
        Mean speed [m/s] below which there is no direction.
    hold : float
        Time [s] for which the sample at either end of a segment holds beyond it.
    noise : ndarray, shape (3,)
        Standard deviation [m/s] of the white noise of the velocities as given, per axis.
    raw : ndarray, shape (m, 3)
        Velocity as given.
    """

    t: Floats
    v: Floats
    slope: Floats
    path: Floats
    segment: Integers
    min_speed: float
    hold: float
    noise: Floats
    raw: Floats

    @property
    def arrays(self) -> kernel.Samples:
        """What the kernels take."""
        return kernel.Samples(self.t, self.v, self.slope, self.path, self.segment)

    @property
    def moving_speed(self) -> float:
        """Median speed [m/s] of the samples that move."""
        speed = np.linalg.norm(self.v, axis=1)
        moving = speed[(speed >= self.min_speed) & (speed > 0)]
        return float(np.median(moving)) if moving.size else 1e-12

    @property
    def limits(self) -> kernel.Limits:
        """Lowest speed with a direction, and how long the samples at the ends hold."""
        return kernel.Limits(self.min_speed, self.hold)

    def directions(self, start: Floats, end: Floats, offset: float = 0.0) -> Floats:
        """Return unit directions of the mean velocity over [start, end] + offset, shape (n, 3).

        Rows are zero where the interval is not covered or the vehicle stands.
        """
        out = np.empty((3, start.size))
        kernel.directions(start, end, float(offset), self.arrays, self.limits, out)
        return np.ascontiguousarray(out.T)


def velocity_track(
    velocities: VelocitySeries,
    *,
    max_gap: float | None = None,
    min_speed: float | None = None,
    hold: float = 0.0,
    smooth: bool = True,
) -> VelocityTrack:
    """Prepare velocities for lookups at any time.

    Parameters
    ----------
    velocities : VelocitySeries
        At least two samples.
    max_gap : float, optional
        Longest step [s] to interpolate across; five times the median step if not given.
    min_speed : float, optional
        Mean speed [m/s] below which there is no direction; a tenth of the 90 % quantile of the
        speed while moving if not given.
    hold : float
        Time [s] for which the sample at either end of a gap also stands beyond it.  For rows that
        were paired within a tolerance, as the authors' are; 0 never extrapolates.
    smooth : bool
        Smooth by local parabolas over up to 1.6 s.  The window at each sample is the widest that
        shows no bias against narrower ones, so instant turns stay sharp.

    Raises
    ------
    InputError
        If there are too few samples, or the vehicle neither moves nor turns.
    """
    checks.instance(velocities, "velocities", VelocitySeries)
    t, v = velocities.t, velocities.v
    if t.size < 2:
        raise InputError(f"velocities: at least 2 rows are needed, not {t.size}")
    top = _top_speed(velocities.speed)
    stands = velocities.speed.max() == 0 or (min_speed is None and top == 0)
    if stands and velocities.turning == 0:
        raise InputError("velocities: the vehicle does not move (all, or nearly all, are zero)")
    gap = 5 * float(np.median(np.diff(t))) if max_gap is None else max_gap
    checks.positive(gap, "max_gap", "seconds")
    still = STILL * top if min_speed is None else checks.at_least_zero(min_speed, "min_speed")
    segment = segments(t, gap)
    noise = white_noise(v, segment)
    smoothed = _parabolas(t, v, segment, noise) if smooth else v
    return VelocityTrack(
        t,
        smoothed,
        kernel.slopes(t, smoothed),
        kernel.integrate(t, smoothed, segment),
        segment,
        still,
        checks.at_least_zero(hold, "hold"),
        noise,
        v,
    )


def smoothed(track: VelocityTrack, values: Floats, widest: float = np.inf) -> Floats:
    """Return up to three columns of values at the track's times, smoothed as its velocity was.

    They come back as they are if the track was not smoothed.  `widest` bounds the half widths of
    the windows [s].
    """
    if track.v is track.raw:
        return values
    columns = np.zeros((len(values), 3))
    columns[:, : values.shape[1]] = values
    noise = white_noise(columns, track.segment)
    return _parabolas(track.t, columns, track.segment, noise, widest)[:, : values.shape[1]]


def _parabolas(
    t: Floats, v: Floats, segment: Integers, noise: Floats, widest: float = np.inf
) -> Floats:
    """Return three columns smoothed, over windows of half widths up to `widest` [s]."""
    windows = SMOOTHING[SMOOTHING <= widest] + BORDER
    return np.asarray(kernel.smooth(t, v, segment, windows, noise, SMOOTHING_GATE))


def _top_speed(speed: Floats) -> float:
    """Return the 90 % quantile [m/s] of the speeds that are not those of standing still."""
    usual = float(np.quantile(speed, 0.95, method="lower"))
    return float(np.quantile(speed[speed >= STILL * usual], 0.9))


def rebuilt(track: VelocityTrack, v: Floats) -> VelocityTrack:
    """Return the track with other velocities (m, 3) at the same times."""
    slope, path = kernel.slopes(track.t, v), kernel.integrate(track.t, v, track.segment)
    return replace(track, v=v, slope=slope, path=path)

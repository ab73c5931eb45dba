"""Drives along way points, to be judged before anyone drives them (`evcalib.design`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from evcalib import checks
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.series import VelocitySeries

RATE = 50.0
"""Samples of a drive per second."""

BLEND = 0.5
"""The velocity changes from one leg to the next within this time [s].  A choice: 1 m/s^2 at 0.5
m/s."""

PAUSE = 1.0
"""A point that is given twice in a row is a pause of this length [s]."""

MOST_POINTS = 200
FARTHEST = 1000.0
LONGEST = 600.0
"""Most points, their farthest [m] and the longest drive [s]: beyond them numbers are slips of the
pen, in other units, and pictures take minutes."""


def read_way_points(text: str) -> Floats:
    """Read way points from lines of two numbers, forward and to the left [m].

    Parameters
    ----------
    text : str
        One point per line, its numbers apart by spaces or a comma; empty lines are left out.

    Returns
    -------
    ndarray, shape (n, 2)

    Raises
    ------
    InputError
        If a line is not two numbers, with its number.
    """
    points = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.replace(",", " ").split()
        if not words:
            continue
        try:
            forward, left = (float(word) for word in words)
        except ValueError:
            raise InputError(
                f"line {number} is {line.strip()!r}; write two numbers, forward and left in metres"
            ) from None
        points.append((forward, left))
    return np.array(points, dtype=np.float64).reshape(-1, 2)


def drive_through(points: ArrayLike, *, speed: float = 0.5) -> VelocitySeries:
    """Return the drive of a body that keeps its heading, from point to point.

    The legs are straight and driven at one speed.  The moving mean of the velocity over 0.5 s
    (`BLEND`) rounds the corners into parabolas and lets the drive start and end at rest: linear
    segments with parabolic blends.

    Parameters
    ----------
    points : array_like, shape (n, 2)
        Way points, forward and to the left [m]; the same point twice in a row is a pause of a
        second.
    speed : float
        On the legs [m/s].

    Returns
    -------
    VelocitySeries
        At 50 Hz from t = 0 on; it ends at the last point.

    Raises
    ------
    InputError
        If there are less than two points, or too many, or they are too far away.
    """
    places = checks.floats(points, "way points", (None, 2))
    checks.positive(speed, "speed", "m/s")
    if not 2 <= len(places) <= MOST_POINTS:
        raise InputError(f"from 2 to {MOST_POINTS} way points are needed, not {len(places)}")
    if np.abs(places).max() > FARTHEST:
        raise InputError(f"way points are at most {FARTHEST:g} m away; give them in metres")
    legs = np.diff(places, axis=0)
    length = np.hypot(*legs.T)
    lasts = np.where(length > 0, length / speed, PAUSE)
    if lasts.sum() > LONGEST:
        raise InputError(f"the drive takes {lasts.sum():.0f} s; the most is {LONGEST:g} s")
    knots = BLEND / 2 + np.append(0.0, np.cumsum(lasts))
    t = np.arange(0.0, knots[-1] + BLEND / 2 + 1 / RATE, 1 / RATE)
    ends = [np.interp(t + side * BLEND / 2, knots, along) for side in (-1, 1) for along in places.T]
    flat = (np.stack(ends[2:], axis=1) - np.stack(ends[:2], axis=1)) / BLEND
    return VelocitySeries(t, np.column_stack((flat, np.zeros(t.size))))

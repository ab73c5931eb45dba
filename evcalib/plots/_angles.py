"""Azimuth and elevation of directions, and axes that show enough of them."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from evcalib.arrays import Floats, Integers


def azimuth(v: Floats) -> Floats:
    """Return the angle from forward to the left [deg]."""
    return np.asarray(np.degrees(np.arctan2(v[:, 1], v[:, 0])))


def elevation(v: Floats) -> Floats:
    """Return the angle above the plane of travel [deg]."""
    return np.asarray(np.degrees(np.arctan2(v[:, 2], np.hypot(v[:, 0], v[:, 1]))))


def beside(line: Floats, angle: Floats) -> Floats:
    """Return angles [deg] on the same turn as a line, so that nothing jumps where they wrap."""
    return line + (angle - line + 180.0) % 360.0 - 180.0


def unbroken(t: Floats, angle: Floats) -> tuple[Floats, Integers]:
    """Return angles [deg] that do not jump where they wrap, and where gaps in time cut them."""
    steps = np.diff(t)
    longest = 5.0 * np.median(steps) if steps.size else 0.0
    cuts = np.flatnonzero(steps > longest) + 1
    parts = [np.unwrap(part, period=360.0) for part in np.split(angle, cuts)]
    return np.concatenate(parts), cuts


def cut(values: Floats, cuts: Integers) -> Floats:
    """Return values with NaN in the cuts, where a line is to break."""
    return np.insert(values, cuts, np.nan)


def show_at_least(ax: Axes, span: float) -> None:
    """Widen the axis of angles to a span [deg], so that noise does not fill it."""
    low, high = ax.get_ylim()
    if high - low < span:
        middle = 0.5 * (low + high)
        ax.set_ylim(middle - span / 2, middle + span / 2)

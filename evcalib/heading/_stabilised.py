"""Matches as a camera would have made them that does not turn: a gyro takes the turning out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from evcalib.heading._matches import KeyframeMatches
from evcalib.imu import Attitude


def covered(matches: KeyframeMatches, attitude: Attitude) -> KeyframeMatches:
    """Return the matches between whose times the attitude is known."""
    known = attitude.covers(matches.t1, matches.t2)
    return matches if known.all() else matches[known]


def stabilised(matches: KeyframeMatches, attitude: Attitude, focal: float) -> KeyframeMatches:
    """Return matches whose second bearing is that of a camera turned as at the first time.

    The second pixel is moved about as far as a point near the middle of the image would be: it
    only says how far a corner moved, and which cell it is in.

    Parameters
    ----------
    matches : KeyframeMatches
        As seen.
    attitude : Attitude
        Of the camera, known between their times.
    focal : float
        Pixels per radian.
    """
    r2 = attitude.between(matches.t1, matches.t2).apply(matches.r2)
    xy2 = np.maximum(matches.xy1 + focal * (r2 - matches.r1)[:, :2], 0.0)
    return replace(matches, r2=r2, xy2=xy2)


def at_middle(matches: KeyframeMatches, attitude: Attitude) -> KeyframeMatches:
    """Return stabilised matches in the axes of the camera as it stands half-way between the two.

    A window's pairs lie evenly about it, so there they have one direction.
    """
    to_middle = attitude.between(0.5 * (matches.t1 + matches.t2), matches.t1)
    return replace(matches, r1=to_middle.apply(matches.r1), r2=to_middle.apply(matches.r2))

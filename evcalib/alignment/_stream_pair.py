"""Headings and odometry at an offset: which headings are covered, and how much they weigh."""

from __future__ import annotations

import numpy as np

from evcalib.alignment.rotation import MIN_SIGMA
from evcalib.arrays import Floats
from evcalib.kinematics.velocity_track import VelocityTrack
from evcalib.series import HeadingSeries

MIN_OVERLAP = 0.5
"""Candidates with less than this share of the best overlap are not compared."""


def weights(headings: HeadingSeries) -> Floats:
    """Return the weight of each heading, 1 on average: as given, else from its sd, else 1.

    The scatter that all headings share is taken to be as large as the median standard deviation.
    """
    if headings.weight is not None:
        w = headings.weight / max(headings.weight.max(initial=0.0), 1e-300)
    elif headings.sd is not None and headings.sd.any():
        sd = np.clip(headings.sd, MIN_SIGMA, np.pi)
        w = 1.0 / (sd**2 + np.median(sd) ** 2)
    else:
        return np.ones(len(headings))
    return w * (len(headings) / max(w.sum(), 1e-300))


def no_overlap(headings: HeadingSeries, track: VelocityTrack, where: str) -> str:
    """Say how far apart two streams are that do not overlap, and `where` they were compared."""
    if headings.t.size == 0:
        return "headings: no usable row is left"
    return (
        f"headings ({headings.t[0]:.3f} to {headings.t[-1]:.3f} s) and velocities"
        f" ({track.t[0]:.3f} to {track.t[-1]:.3f} s, where moving and without gaps) do not overlap"
        f" {where}"
    )


def covered_at_all(headings: HeadingSeries, track: VelocityTrack, offsets: Floats) -> HeadingSeries:
    """Return the headings that the odometry covers at all offsets, if they are enough.

    Scores are means over headings: where outliers come and go at the ends with the offset, the mean
    moves without any change in agreement, which costs up to half of the precision (measured).
    """
    begin, end = intervals(headings)
    covered = np.ones(len(headings), dtype=bool)
    for offset in offsets:
        covered &= np.any(track.directions(begin, end, float(offset)) != 0, axis=1)
    enough = weights(headings)[covered].sum() >= MIN_OVERLAP * weights(headings).sum()
    return headings.select(covered) if enough else headings


def intervals(headings: HeadingSeries) -> tuple[Floats, Floats]:
    """Return start and end [s] of each heading; equal where it stands for an instant."""
    if headings.t_start is None or headings.t_end is None:
        return headings.t, headings.t
    return headings.t_start, headings.t_end

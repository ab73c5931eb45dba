"""The procedure that the paper's authors released, on two streams."""

from __future__ import annotations

import numpy as np

from evcalib.authors import SEARCH, PairedRows, with_alignment
from evcalib.baselines.rival import RivalCalibration, RivalInput, finish
from evcalib.errors import InputError
from evcalib.geometry import unit
from evcalib.offset import OffsetCurve

PAIRING = 0.011
"""Largest difference [s] of the times of a pair.  The authors paired within 10 ms, which is half a
step of 50 Hz odometry and would leave the last pair of each step to rounding."""

STILL = 1e-6
"""Speed [m/s] below which a velocity has no direction."""


def authors(streams: RivalInput) -> RivalCalibration:
    """Run :func:`evcalib.authors.with_alignment` on headings paired with the nearest velocities.

    The script searches +-1 s, whatever is asked for, and ignores weights.

    Raises
    ------
    InputError
        If fewer than four headings have a velocity within the tolerance.
    """
    rows = paired_rows(streams)
    found = with_alignment(rows)
    peak = int(np.argmax(found.correlation))
    curve = OffsetCurve(
        method="authors",
        offsets=found.offsets,
        score=found.correlation,
        overlap=np.ones(SEARCH.size),
        offset=found.offset,
        second_peak_ratio=np.nan,
        at_edge=peak in (0, SEARCH.size - 1),
    )
    return finish(streams, found.R_body_cam, found.offset, method="authors", curve=curve)


def paired_rows(streams: RivalInput) -> PairedRows:
    """Return each usable heading with the direction of the velocity nearest in time."""
    headings, velocities = streams.usable_headings(), streams.velocities
    moving = velocities.select(velocities.speed > STILL)
    if len(moving) == 0:
        raise InputError("velocities: the vehicle does not move")
    after = np.clip(np.searchsorted(moving.t, headings.t), 0, len(moving) - 1)
    before = np.maximum(after - 1, 0)
    nearer = headings.t - moving.t[before] < moving.t[after] - headings.t
    nearest = np.where(nearer, before, after)
    near = np.abs(moving.t[nearest] - headings.t) <= PAIRING
    if near.sum() < 4:
        raise InputError(
            f"authors: {int(near.sum())} of {len(headings)} headings have a velocity within"
            f" {1e3 * PAIRING:g} ms; at least 4 are needed. Are the clocks that far apart?"
        )
    row = nearest[near]
    return PairedRows(headings.v[near], headings.t[near], unit(moving.v[row]), moving.t[row])

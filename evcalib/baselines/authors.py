"""The authors' released procedure, frozen, so that its numbers can be compared with ours.

This is not an estimator to use.  It reproduces what the script published with the paper
(nubot-nudt/EvCalib) computes, including what departs from the paper's text or hurts:

- Each stream is sorted by its own time; the first row and every row whose time repeats the row
  before it are dropped.
- The odometry is interpolated by one cubic spline across all gaps, and extrapolated at both ends.
- The correlation is not the paper's trace but the first canonical correlation.  Its
  weights come from per-axis standardised data, with 1e-5 added to the diagonals of all three
  covariances, and are then applied to the data that are not standardised.
- The robust weights of the rotation multiply up from one iteration to the next, which takes them
  back to where they started from.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from evcalib import checks
from evcalib.alignment import enough
from evcalib.alignment.offset import OffsetCurve
from evcalib.arrays import Floats
from evcalib.baselines._interface import RivalCalibration, RivalInput, finish
from evcalib.errors import InputError
from evcalib.geometry import unit
from evcalib.kernels.baselines import authors as kernel

SEARCH = np.arange(-1000, 1000) / 1000.0
"""Candidate offsets [s] of the released script."""


@dataclass(frozen=True)
class PairedRows:
    """Rows of the authors' files: headings and velocities, paired within 10 ms.

    Attributes
    ----------
    v_e, v_o : ndarray, shape (n, 3)
        Headings and velocity directions, as stored (headings are not quite unit).
    t_e, t_o : ndarray, shape (n,)
        Their times [s], neither sorted nor unique.
    """

    v_e: Floats
    t_e: Floats
    v_o: Floats
    t_o: Floats

    @classmethod
    def from_rows(cls, rows: NDArray) -> PairedRows:
        """Split rows of v_e (3), t_e, v_o (3), t_o."""
        rows = checks.floats(rows, "paired rows", (None, 8))
        if len(rows) < 4:
            raise InputError(f"paired rows: at least 4 are needed, not {len(rows)}")
        return cls(rows[:, :3].copy(), rows[:, 3].copy(), rows[:, 4:7].copy(), rows[:, 7].copy())


@dataclass(frozen=True)
class AuthorsResult:
    """What the released procedure finds.

    Attributes
    ----------
    R_body_cam : ndarray, shape (3, 3)
        Rotation.
    offset : float
        Offset [s] of the largest correlation; 0 without alignment.
    offsets, correlation : ndarray, shape (m,)
        The curve; empty without alignment.
    rows : int
        Rows used.
    """

    R_body_cam: Floats
    offset: float
    offsets: Floats
    correlation: Floats
    rows: int


def without_alignment(rows: PairedRows) -> AuthorsResult:
    """Return the rotation of the rows as they are paired (the paper's VC-woTA)."""
    R = kernel.kabsch(rows.v_e, rows.v_o)
    return AuthorsResult(R, 0.0, np.empty(0), np.empty(0), len(rows.t_e))


def with_alignment(rows: PairedRows, iterations: int = 10_000) -> AuthorsResult:
    """Return offset and rotation of the released procedure (the paper's VC).

    Parameters
    ----------
    rows : PairedRows
        Headings and velocities.
    iterations : int
        Steps of the re-weighting; fewer than about 3000 have not settled.
    """
    t_e, v_e = _sorted_unique(rows.t_e, rows.v_e)
    t_o, v_o = _sorted_unique(rows.t_o, rows.v_o)
    if len(t_e) < 4 or len(t_o) < 4:
        raise InputError("fewer than 4 distinct times are left after the removal of duplicates")
    spline = CubicSpline(t_o, v_o)
    curve = kernel.correlation_curve(t_e, v_e, t_o, np.ascontiguousarray(spline.c), SEARCH)
    offset = float(SEARCH[int(np.argmax(curve))])
    R = kernel.multiplied_weights(v_e, spline(t_e + offset), 0.1, iterations)
    return AuthorsResult(R, offset, SEARCH, curve, len(t_e))


def _sorted_unique(t: Floats, v: Floats) -> tuple[Floats, Floats]:
    order = np.argsort(t, kind="stable")
    t, v = t[order], v[order]
    later = np.flatnonzero(np.diff(t) > 0) + 1
    return t[later], v[later]


PAIRING = 0.011
"""Largest difference [s] of the times of a pair.  The authors paired within 10 ms, which is half a
step of 50 Hz odometry and would leave the last pair of each step to rounding."""

STILL = 1e-6
"""Speed [m/s] below which a velocity has no direction."""


def authors(streams: RivalInput) -> RivalCalibration:
    """Run :func:`with_alignment` on headings paired with the nearest velocities.

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
    headings, velocities = enough(streams.headings), streams.velocities
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

"""The time offset between camera and odometry (the paper's Alg. 1).

Each method gives a score for every candidate offset, and none of them needs the rotation.  The
odometry is never interpolated across gaps or extrapolated: a heading counts at an offset only
where the odometry covers it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evcalib import checks
from evcalib.alignment._stream_pair import MIN_OVERLAP, StreamPair
from evcalib.arrays import Floats, Integers
from evcalib.display import Shown
from evcalib.errors import InputError
from evcalib.kernels.alignment import offset as kernel
from evcalib.kinematics.velocity_track import VelocityTrack
from evcalib.series import HeadingSeries
from evcalib.uncertainty import peak_of_parabola

METHODS = ("profile", "trace", "canonical", "scalar", "none")

STEP = 0.01
"""Grid of the search [s]; finer grids only follow the noise of the odometry (`evcalib study
ablations` has one of 1 ms)."""

WIDE_LOSS_SCALES = np.array([2.0, 1.0, 0.5])
"""Scales of Tukey's loss in the search, 1 - cos(angle): 180, 90 and 60 degrees.  A choice that
needs no start; from there on the noise sets the scale."""

RANK_TOLERANCE = 1e-9
"""Eigenvalues below this share of the largest one are zero: far above rounding (1e-16), far below
the square of any direction that is measured (`DIRECTION_FLOOR`)."""


@dataclass(frozen=True, eq=False)
class OffsetCurve(Shown):
    """Score over candidate offsets, and its peak.

    Attributes
    ----------
    method : str
        Name of the method.
    offsets : ndarray, shape (m,)
        Candidates [s], ascending.
    score : ndarray, shape (m,)
        Score of each, at most 1; NaN where too few headings overlap.
    overlap : ndarray, shape (m,)
        Share of the headings' weight that the odometry covers.
    offset : float
        Peak [s], between the grid points.
    second_peak_ratio : float
        Height of the second local maximum over that of the first; 0 if there is only one.
    at_edge : bool
        Whether the peak lies on the border of the candidates.
    """

    method: str
    offsets: Floats
    score: Floats
    overlap: Floats
    offset: float
    second_peak_ratio: float
    at_edge: bool

    @property
    def peak(self) -> int:
        """Index of the largest score."""
        return int(np.nanargmax(self.score))


def candidate_offsets(max_offset: float, step: float = STEP) -> Floats:
    """Return offsets [s] from -max_offset to max_offset, zero included."""
    checks.positive(max_offset, "max_offset", "seconds")
    if max_offset > 1e5 * step:
        raise InputError(
            f"max_offset of {max_offset:g} s asks for more than 200,000 candidates; bring the"
            " clocks together first (--clock-shift)"
        )
    if max_offset < 2 * step:
        raise InputError(f"max_offset must be at least two steps of {step:g} s, not {max_offset:g}")
    count = int(np.floor(max_offset / checks.positive(step, "step", "seconds") + 1e-9))
    return np.arange(-count, count + 1, dtype=np.float64) * step


def find_offset(
    headings: HeadingSeries,
    track: VelocityTrack,
    *,
    max_offset: float = 1.0,
    method: str = "profile",
    step: float = STEP,
) -> OffsetCurve:
    """Search the offset that makes the two streams agree best under some rotation.

    Parameters
    ----------
    headings : HeadingSeries
        Directions of the camera's motion.
    track : VelocityTrack
        Velocities of the body (see :func:`evcalib.kinematics.velocity_track.velocity_track`).
    max_offset : float
        Offsets from -max_offset to max_offset [s] are tried.
    method : {"profile", "trace", "canonical", "scalar"}
        ``profile``: the best rotation's robust score (ours).  ``trace``: the paper's trace
        correlation, mended: pseudo-inverse and 1/rank in place of an inverse that planar
        motion does not have and 1/3; no lag in the auto-covariances.  ``canonical``: the first
        canonical correlation.  ``scalar``: correlation of the two rates of turning.
    step : float
        Grid [s]; the peak of a parabola through its surroundings is returned.

    Raises
    ------
    InputError
        If the two streams overlap at no candidate, or a parameter is unusable.

    Examples
    --------
    >>> from evcalib.series import VelocitySeries
    >>> from evcalib.kinematics.velocity_track import velocity_track
    >>> t = np.arange(0, 10, 0.02)
    >>> v = np.stack([np.cos(np.sin(t)), np.sin(np.sin(t)), 0 * t], axis=1)
    >>> curve = find_offset(HeadingSeries(t, v), velocity_track(VelocitySeries(t + 0.2, v)))
    >>> round(curve.offset, 2), curve.at_edge
    (0.2, False)
    """
    checks.instance(headings, "headings", HeadingSeries)
    checks.instance(track, "track", VelocityTrack)
    checks.one_of(method, "offset_method", METHODS[:-1])
    offsets = candidate_offsets(max_offset, step)
    pair = StreamPair.of(headings, track)
    total = pair.weight.sum()
    pair = pair.covered_at_all(offsets[[0, offsets.size // 2, -1]])
    score, totals = _CURVES[method](pair, offsets)
    if not (totals > 0).any():
        where = f"for any offset within +-{max_offset:g} s; check the clocks or raise max_offset"
        raise InputError(pair.no_overlap(where))
    score = np.where(totals >= MIN_OVERLAP * totals.max(), score, np.nan)
    peak = int(np.nanargmax(score))
    return OffsetCurve(
        method=method,
        offsets=offsets,
        score=score,
        overlap=totals / total,
        offset=_subgrid_peak(offsets, score, peak),
        second_peak_ratio=second_peak_ratio(score, peak),
        at_edge=_at_edge(score, peak),
    )


def _profile_curve(pair: StreamPair, offsets: Floats) -> tuple[Floats, Floats]:
    return pair.profile(offsets, WIDE_LOSS_SCALES)[:2]


def _canonical_squares(pair: StreamPair, offsets: Floats) -> tuple[Floats, Integers, Floats]:
    """Return the squared canonical correlations (m, 3), their number (rank) and the weights."""
    track = pair.track
    S_ee, S_oo, S_oe, totals = kernel.moments(pair.columns, offsets, track.arrays, track.limits)
    half_ee, rank_ee = _inverse_root(S_ee)
    half_oo, rank_oo = _inverse_root(S_oo)
    correlation = np.linalg.svd(half_oo @ S_oe @ half_ee, compute_uv=False)
    return correlation**2, np.minimum(rank_ee, rank_oo), totals


def _inverse_root(S: Floats) -> tuple[Floats, Integers]:
    """Return pseudo-inverse square roots of covariances (m, 3, 3), and their ranks."""
    values, vectors = np.linalg.eigh(S)
    kept = values > RANK_TOLERANCE * np.maximum(values[:, -1:], 1e-300)
    root = np.where(kept, 1.0 / np.sqrt(np.where(kept, values, 1.0)), 0.0)
    return (vectors * root[:, None, :]) @ vectors.transpose(0, 2, 1), kept.sum(axis=1)


def _trace_curve(pair: StreamPair, offsets: Floats) -> tuple[Floats, Floats]:
    squares, rank, totals = _canonical_squares(pair, offsets)
    return np.sqrt(squares.sum(axis=1) / np.maximum(rank, 1)), totals


def _canonical_curve(pair: StreamPair, offsets: Floats) -> tuple[Floats, Floats]:
    squares, _, totals = _canonical_squares(pair, offsets)
    return np.sqrt(squares[:, 0]), totals


def _scalar_curve(pair: StreamPair, offsets: Floats, half: float = 0.25) -> tuple[Floats, Floats]:
    """Correlate how fast the two directions turn, which no rotation changes (cf. Mair 2011)."""
    t, rate = _turn_rate(pair.headings.t, pair.headings.v, half)
    track = pair.track
    score, totals = kernel.turning_correlation(t, rate, half, offsets, track.arrays, track.limits)
    return score, totals


def _turn_rate(t: Floats, v: Floats, half: float) -> tuple[Floats, Floats]:
    """Return the change of the mean direction from [t - 2 half, t) to (t, t + 2 half]."""
    total = np.vstack([np.zeros(3), np.cumsum(v, axis=0)])
    here = np.searchsorted(t, t)
    left, right = np.searchsorted(t, t - 2 * half), np.searchsorted(t, t + 2 * half, side="right")
    enough = (here - left >= 2) & (right - here > 2)
    enough &= (t - 2 * half >= t[0]) & (t + 2 * half <= t[-1])
    before = (total[here] - total[left])[enough] / (here - left)[enough, None]
    # The heading at t itself is in neither mean: in one, it would shift times by half a step.
    after = (total[right] - total[here + 1])[enough] / (right - here - 1)[enough, None]
    return t[enough], np.linalg.norm(after - before, axis=1)


_Curve = Callable[[StreamPair, Floats], tuple[Floats, Floats]]

_CURVES: dict[str, _Curve] = {
    "profile": _profile_curve,
    "trace": _trace_curve,
    "canonical": _canonical_curve,
    "scalar": _scalar_curve,
}


def _subgrid_peak(offsets: Floats, score: Floats, peak: int, reach: int = 5) -> float:
    """Return the vertex of the least-squares parabola through the points around the peak."""
    window = np.arange(max(peak - reach, 0), min(peak + reach + 1, offsets.size))
    window = window[np.isfinite(score[window])]
    if window.size < 4:
        return float(offsets[peak])
    limit = reach * (offsets[1] - offsets[0])
    move, _ = peak_of_parabola(offsets[window] - offsets[peak], score[window], limit)
    return float(offsets[peak] + move)


def _at_edge(score: Floats, peak: int) -> bool:
    """Whether no finite candidate follows the peak on one of its sides."""
    known = np.flatnonzero(np.isfinite(score))
    return bool(peak in (known[0], known[-1])) and known.size > 1


def second_peak_ratio(score: Floats, peak: int) -> float:
    """Return the height of the second local maximum over that at `peak`; 0 if there is only one."""
    filled = np.where(np.isfinite(score), score, -np.inf)
    left = np.r_[-np.inf, filled[:-1]]
    right = np.r_[filled[1:], -np.inf]
    others = np.flatnonzero((filled > left) & (filled >= right) & np.isfinite(filled))
    # A ripple on the flank of the peak is not a second one: the curve must dip in between.
    top, floor = filled[peak], float(np.nanmin(score))
    best = 0.0
    for other in others[others != peak]:
        low, high = sorted((int(other), peak))
        valley = float(filled[low : high + 1].min())
        if filled[other] - valley > 0.05 * (top - floor):
            best = max(best, float(filled[other]))
    return best / float(top) if top > 0 else 0.0

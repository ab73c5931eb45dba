"""The offset once its neighbourhood is known: refined, and weighed against the other candidates."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from evcalib.alignment._stream_pair import MIN_OVERLAP, covered_at_all, intervals, weights
from evcalib.alignment.offset import WIDE_REACHES
from evcalib.alignment.rotation import MIN_SIGMA, Mixture, fit_mixture, misfits, tukey_reach
from evcalib.arrays import Flags, Floats
from evcalib.kernels.alignment import offset as kernel
from evcalib.kinematics.velocity_track import VelocityTrack
from evcalib.series import HeadingSeries


@dataclass(frozen=True, eq=False)
class RefinedOffset:
    """Offset after the local search.

    Attributes
    ----------
    offset : float
        Offset [s].
    R_body_cam : ndarray, shape (3, 3)
        Best rotation there, under the same loss.
    mixture : Mixture
        Inlier scale and shares there.
    curvature : float
        Second derivative of the mean score [1/s^2]; negative at a peak.
    converged : bool
        Whether the peak stayed within the window.
    """

    offset: float
    R_body_cam: Floats
    mixture: Mixture
    curvature: float
    converged: bool


def refine_offset(
    headings: HeadingSeries, track: VelocityTrack, start: float, *, window: float | None = None
) -> RefinedOffset:
    """Move an offset to the nearest peak of the profile under a loss as narrow as the noise.

    A parabola is fitted by least squares to the profile over +-window around the offset, again
    around its vertex, until that stays.  The width averages over the roughness that noise in the
    odometry leaves in the profile.

    Parameters
    ----------
    headings, track
        As in :func:`find_offset`.
    start : float
        Offset [s] within the basin of the peak.
    window : float, optional
        Half width [s]; 0.1, or 1.5 headings' spacing if that is more, if not given.
    """
    headings = headings.usable()
    if window is None:
        spacing = float(np.median(np.diff(headings.t))) if len(headings) > 1 else 0.0
        window = max(0.1, min(1.5 * spacing, 0.2))
    steps = np.linspace(-window, window, 21)
    offset, turn = start, _turning(track, headings, start)
    R, mixture = _at(headings, track, offset, WIDE_REACHES)
    curvature, converged = 0.0, False
    for _ in range(12):
        # Misfits at the window's borders must stay within reach of the loss.
        sigma = float(np.hypot(mixture.sigma, turn * window / np.sqrt(3)))
        reaches = np.append(WIDE_REACHES[-1:], np.full(3, min(tukey_reach(sigma), 0.5)))
        part = covered_at_all(headings, track, offset + steps)
        begin, end = intervals(part)
        w, e = weights(part), np.ascontiguousarray(part.v.T)
        score, totals, _ = kernel.profile(
            begin, end, e, w, offset + steps, track.arrays, track.limits, reaches
        )
        use = totals >= MIN_OVERLAP * totals.max()
        if use.sum() < 5 or totals.max() == 0:
            break
        a, b, _ = np.polyfit(steps[use], score[use], 2)
        curvature = 2 * a
        if a >= 0:
            break
        move = float(np.clip(-b / (2 * a), -window, window))
        offset += move
        R, mixture = _at(headings, track, offset, reaches)
        if abs(move) < 1e-3 * window:
            converged = True
            break
    return RefinedOffset(offset, R, mixture, curvature, converged)


def inliers_at(headings: HeadingSeries, track: VelocityTrack, offset: float) -> RefinedOffset:
    """Return the robust rotation and the noise at an offset that is taken as it is."""
    R, mixture = _at(headings.usable(), track, offset, WIDE_REACHES)
    return RefinedOffset(offset, R, mixture, -1.0, True)


def plausible_offsets(
    headings: HeadingSeries,
    track: VelocityTrack,
    offsets: Floats,
    refined: RefinedOffset,
    *,
    inflation: float = 1.0,
    gate: float = 2.0,
) -> Flags:
    """Tell which candidates the data cannot tell from the peak.

    The scores of the same headings at two offsets are compared pair by pair (Vuong 1989): a
    candidate is plausible if the mean difference is below `gate` standard errors.  (At a smooth
    peak that is the case up to 2 * gate standard deviations of the offset.)

    Parameters
    ----------
    headings, track, offsets
        As in :func:`find_offset`.
    refined : RefinedOffset
        The peak.
    inflation : float
        Variance inflation of a mean, from the correlation of the noise over time.
    gate : float
        Standard errors.

    Returns
    -------
    ndarray of bool, shape (m,)
        The plausible ones.
    """
    headings = headings.usable()
    begin, end = intervals(headings)
    w, e = weights(headings), np.ascontiguousarray(headings.v.T)
    reach = min(tukey_reach(refined.mixture.sigma), 0.5)
    reaches = np.concatenate([WIDE_REACHES, [reach, reach]])
    _, totals, rotations = kernel.profile(
        begin, end, e, w, offsets, track.arrays, track.limits, reaches
    )
    peak = _scores(headings, track, refined, reach)
    mean, variance, pairs = kernel.contrast(
        begin, end, e, w, offsets, track.arrays, track.limits, rotations, reach, peak
    )
    error = np.sqrt(inflation * variance / np.maximum(pairs, 1))
    compared = (pairs >= 3) & (totals >= MIN_OVERLAP * totals.max())
    return compared & (mean <= gate * error)


def preference(
    headings: HeadingSeries,
    track: VelocityTrack,
    other: VelocityTrack,
    refined: RefinedOffset,
    *,
    inflation: float = 1.0,
) -> float:
    """Return by how many standard errors the headings prefer one track to another (Vuong 1989).

    Parameters
    ----------
    headings, track, refined, inflation
        As in :func:`plausible_offsets`.
    other : VelocityTrack
        The rival, which gets a rotation of its own.
    """
    headings = headings.usable()
    reach = min(tukey_reach(refined.mixture.sigma), 0.5)
    reaches = np.concatenate([WIDE_REACHES, [reach, reach, reach]])
    rival, _ = _at(headings, other, refined.offset, reaches)
    first = _scores(headings, track, refined, reach)
    second = _scores(headings, other, replace(refined, R_body_cam=rival), reach)
    both = (first >= 0) & (second >= 0)
    gap = (first - second)[both]
    w = weights(headings)[both]
    if gap.size < 3 or not w.any():
        return 0.0
    mean = float(np.average(gap, weights=w))
    spread = float(np.sqrt(np.average((gap - mean) ** 2, weights=w) * inflation / gap.size))
    return mean / spread if spread > 0 else 0.0


def _scores(
    headings: HeadingSeries, track: VelocityTrack, refined: RefinedOffset, reach: float
) -> Floats:
    """Return the Tukey score of each heading at the refined offset, -1 where it is not covered."""
    d = track.directions(*intervals(headings), refined.offset)
    u = misfits(headings.v, d, refined.R_body_cam)
    return np.where(np.any(d != 0, axis=1), np.maximum(0.0, 1.0 - u / reach) ** 3, -1.0)


def _at(
    headings: HeadingSeries, track: VelocityTrack, offset: float, reaches: Floats
) -> tuple[Floats, Mixture]:
    begin, end = intervals(headings)
    w, e = weights(headings), np.ascontiguousarray(headings.v.T)
    _, _, rotations = kernel.profile(
        begin, end, e, w, np.array([offset]), track.arrays, track.limits, reaches
    )
    d = track.directions(begin, end, offset)
    known = np.any(d != 0, axis=1)
    if not known.any():
        return rotations[0], Mixture(MIN_SIGMA, 0.0, 0.0, 1.0)
    return rotations[0], fit_mixture(misfits(headings.v[known], d[known], rotations[0]), w[known])


def _turning(track: VelocityTrack, headings: HeadingSeries, offset: float) -> float:
    """Return the root mean square turning rate of the body directions [rad/s]."""
    begin, end = intervals(headings)
    half = 0.05
    before = track.directions(begin, end, offset - half)
    after = track.directions(begin, end, offset + half)
    known = np.any(before != 0, axis=1) & np.any(after != 0, axis=1)
    if not known.any():
        return 0.0
    chord = np.linalg.norm(after[known] - before[known], axis=1)
    return float(np.sqrt(np.mean(chord**2))) / (2 * half)

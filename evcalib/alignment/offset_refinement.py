"""The offset once its neighbourhood is known: refined, and weighed against the other candidates."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from evcalib.alignment._stream_pair import MIN_OVERLAP, MIN_SIGMA, StreamPair
from evcalib.alignment.offset import WIDE_LOSS_SCALES
from evcalib.alignment.rotation import Mixture, cosine_residuals, fit_mixture, tukey_scale
from evcalib.arrays import Flags, Floats
from evcalib.kernels.alignment import offset as kernel
from evcalib.kinematics.velocity_track import VelocityTrack
from evcalib.series import HeadingSeries
from evcalib.uncertainty import WHITE, NoiseModel, peak_of_parabola


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
    pair = StreamPair.of(headings, track)
    if window is None:
        spacing = float(np.median(np.diff(pair.headings.t))) if len(pair) > 1 else 0.0
        window = max(0.1, min(1.5 * spacing, 0.2))
    steps = np.linspace(-window, window, 21)
    offset, turn = start, _turning(pair, start)
    R, mixture = _at(pair, offset, WIDE_LOSS_SCALES)
    curvature, converged = 0.0, False
    least = MIN_OVERLAP * pair.weight[pair.directions(start)[1]].sum()
    for _ in range(12):
        # Residuals at the window's borders must stay within the scale of the loss.
        sigma = float(np.hypot(mixture.sigma, turn * window / np.sqrt(3)))
        scales = np.append(WIDE_LOSS_SCALES[-1:], np.full(3, _narrow(sigma)))
        part = pair.covered_at_all(offset + steps)
        score, totals, _ = part.profile(offset + steps, scales)
        use = totals >= MIN_OVERLAP * totals.max()
        if use.sum() < 5 or totals.max() == 0:
            break
        move, curvature = peak_of_parabola(steps[use], score[use], window)
        if curvature >= 0:
            break
        if pair.weight[pair.directions(offset + move)[1]].sum() < least:
            break  # it walks away from the data
        offset += move
        R, mixture = _at(pair, offset, scales)
        if abs(move) < 1e-3 * window:
            converged = True
            break
    return RefinedOffset(offset, R, mixture, curvature, converged)


def inliers_at(headings: HeadingSeries, track: VelocityTrack, offset: float) -> RefinedOffset:
    """Return the robust rotation and the noise at an offset that is taken as it is."""
    R, mixture = _at(StreamPair.of(headings, track), offset, WIDE_LOSS_SCALES)
    return RefinedOffset(offset, R, mixture, -1.0, True)


def plausible_offsets(
    headings: HeadingSeries,
    track: VelocityTrack,
    offsets: Floats,
    refined: RefinedOffset,
    *,
    noise: NoiseModel = WHITE,
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
    noise : NoiseModel
        Correlation of the residuals over time.  It counts where the two body directions differ:
        about instant turns noise that lasts for a second has a few headings to add up over.
    gate : float
        Standard errors.

    Returns
    -------
    ndarray of bool, shape (m,)
        The plausible ones.
    """
    pair = StreamPair.of(headings, track)
    scale = _narrow(refined.mixture.sigma)
    _, totals, rotations = pair.profile(offsets, np.append(WIDE_LOSS_SCALES, [scale, scale]))
    scores, seen = _scores(pair, refined, scale)
    mean, variance, pairs, inflation = kernel.contrast(
        pair.columns, offsets, track.arrays, track.limits, rotations, scale,
        kernel.Peak(scores, seen), (noise.share, noise.memory),
    )  # fmt: skip
    error = np.sqrt(inflation * variance / np.maximum(pairs, 1))
    compared = (pairs >= 3) & (totals >= MIN_OVERLAP * totals.max())
    return compared & (mean <= gate * error)


def preference(
    headings: HeadingSeries,
    track: VelocityTrack,
    other: VelocityTrack,
    refined: RefinedOffset,
    *,
    noise: NoiseModel = WHITE,
) -> float:
    """Return by how many standard errors the headings prefer one track to another (Vuong 1989).

    Parameters
    ----------
    headings, track, refined, noise
        As in :func:`plausible_offsets`.
    other : VelocityTrack
        The rival, which gets a rotation of its own.
    """
    pair = StreamPair.of(headings, track)
    rivals = pair.along(other)
    scale = _narrow(refined.mixture.sigma)
    rival, _ = _at(rivals, refined.offset, np.append(WIDE_LOSS_SCALES, [scale, scale, scale]))
    first, seen = _scores(pair, refined, scale)
    second, seen_too = _scores(rivals, replace(refined, R_body_cam=rival), scale)
    both = (first >= 0) & (second >= 0)
    gap = (first - second)[both]
    w = pair.weight[both]
    if gap.size < 3 or not w.any():
        return 0.0
    mean = float(np.average(gap, weights=w))
    inflation = noise.inflation_of(pair.headings.t[both], w[:, None] * (seen - seen_too)[both])
    spread = float(np.sqrt(np.average((gap - mean) ** 2, weights=w) * inflation / gap.size))
    return mean / spread if spread > 0 else 0.0


def _narrow(sigma: float) -> float:
    """Return the scale of a loss that is as narrow as the noise, 60 degrees at most."""
    return min(tukey_scale(sigma), 0.5)


def _scores(pair: StreamPair, refined: RefinedOffset, scale: float) -> tuple[Floats, Floats]:
    """Return the Tukey score of each heading at the refined offset, and what it is compared with.

    Scores are -1 where the odometry does not cover a heading; body directions (n, 3) are turned
    into the camera frame.
    """
    d, known = pair.directions(refined.offset)
    u = cosine_residuals(pair.headings.v, d, refined.R_body_cam)
    scores = np.where(known, np.maximum(0.0, 1.0 - u / scale) ** 3, -1.0)
    return scores, np.ascontiguousarray(d @ refined.R_body_cam)


def _at(pair: StreamPair, offset: float, loss_scales: Floats) -> tuple[Floats, Mixture]:
    R = pair.profile(np.array([offset]), loss_scales)[2][0]
    d, known = pair.directions(offset)
    if not known.any():
        return R, Mixture(MIN_SIGMA, 0.0, 0.0, 1.0)
    u = cosine_residuals(pair.headings.v[known], d[known], R)
    return R, fit_mixture(u, pair.weight[known])


def _turning(pair: StreamPair, offset: float, half: float = 0.05) -> float:
    """Return the root mean square turning rate of the body directions [rad/s]."""
    before, has_before = pair.directions(offset - half)
    after, has_after = pair.directions(offset + half)
    known = has_before & has_after
    if not known.any():
        return 0.0
    chord = np.linalg.norm(after[known] - before[known], axis=1)
    return float(np.sqrt(np.mean(chord**2))) / (2 * half)

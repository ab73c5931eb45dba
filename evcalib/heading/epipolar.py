"""Direction of translation from point correspondences: two solvers, one result."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike

from evcalib import checks
from evcalib.arrays import Flags, Floats, Integers
from evcalib.errors import InputError
from evcalib.heading._translation import Translation, checked
from evcalib.kernels.heading import epipolar as kernels
from evcalib.kernels.heading import lens as lenses
from evcalib.kernels.heading import turn as turns
from evcalib.kernels.linalg import tangent_basis
from evcalib.uncertainty import robust_sd, sandwich, sd_of_median

TRIALS = 1000
"""Most samples that a RANSAC draws; it stops earlier once a better one is unlikely.  With 90 %
outliers 1000 samples of two still hold a clean one with a probability of 1 - 0.99^1000."""

CUT = 4.5
"""Largest squared residual that counts, per degree of freedom and in units of the noise: three
standard deviations of a turn's two.  What parallax there is may be that of a few near things."""

NEUTRAL_GAIN = 1.038
"""E min(chi2_2, 2 CUT) - E min(chi2_1, CUT), for chi squares of two and one degree of freedom."""

TURN_TRIALS = 100
"""Samples of the turn that competes with a translation.  Of half outliers a clean one of two is
among them with a probability of 1 - 0.75^100."""

LENS_SD = (0.03, 0.4, 0.3, 0.1, 0.1)
"""How badly a lens may be known: standard deviations of the numbers of its displacement (see
`evcalib.kernels.heading.lens`).  Focal lengths are off by a few percent, centres by 20 px of
200; a file that lacks its distortion is off by about 0.37 in k1 and 0.15 in k2, as the lenses of
DAVIS cameras are."""

LENS_MOST = 0.6
"""Bound of each of these numbers: beyond it the displacement folds the picture."""

TURN_STEPS = 12
"""Steps of the fit of that turn; its scale narrows in the first five."""

SWINGS = 6
"""Steps of the fit of a swinging direction."""

EVIDENCE = 2.5
"""Standard errors by which parallax must show.  Found on real recordings: slider_depth and its
transforms reach 3.5 in every window; a pan and a tilt whose file lacks the distortion stay below
1.3, and below -0.4 with it (`tests/test_heading_real.py`)."""

SCORED = 500
"""Most correspondences that a RANSAC scores, evenly taken; all of them enter the refinement.  Half
or double of it changes no heading (`tests/test_heading_thresholds.py`): it saves time."""

_LEAST_Z = np.cos(np.deg2rad(89.0))


def two_point(
    r1: ArrayLike,
    r2: ArrayLike,
    *,
    threshold: float,
    seed: int = 0,
    groups: Integers | None = None,
) -> Translation | None:
    """Find the translation of a camera that does not turn.

    RANSAC over samples of two with truncated squares (MSAC), then Gauss-Newton on the Sampson
    residuals under Tukey's loss.  The sign follows from cheirality.

    Parameters
    ----------
    r1, r2 : array_like, shape (n, 3)
        Unit bearings of the same points before and after.
    threshold : float
        Largest Sampson residual of an inlier [rad].
    seed : int
        Of the samples: the same seed gives the same result.
    groups : ndarray of int64, shape (n,), optional
        Correspondences with the same number share their error (they see the same corner), which
        widens the covariance.  By default all are independent.

    Returns
    -------
    Translation or None
        None if no direction is fixed: fewer than three correspondences, or none that moved.

    Raises
    ------
    InputError
        If a shape or a value is unusable.

    References
    ----------
    Li et al. 2024, section III-B (epipolar geometry without rotation); Torr & Zisserman 2000
    (MSAC).
    """
    r1, r2, threshold, groups = checked(r1, r2, threshold, groups)
    if len(r1) < 3:
        return None
    bearings = kernels.Bearings(r1, r2, kernels.normals(r1, r2))
    sample = kernels.evenly(bearings, SCORED)
    direction = kernels.two_point_ransac(sample, threshold, TRIALS, seed)
    if not direction.any():
        return None
    inliers = np.empty(len(r1), dtype=np.bool_)
    scale = threshold / 2
    for steps in (5, 10):
        kernels.refine(direction, bearings, scale, steps)
        residuals, size = kernels.judge(direction, bearings, threshold, inliers)
        if size < 0.0:
            return None
        noise = sd_of_median(size)
        scale = min(1.5 * noise, threshold / 2)
    covariance = _covariance(direction, bearings, scale, groups)
    return (
        None
        if covariance is None
        else Translation(direction, covariance, inliers, residuals, noise)
    )


def five_point(
    r1: ArrayLike,
    r2: ArrayLike,
    *,
    threshold: float,
    seed: int = 0,
    groups: Integers | None = None,
) -> Translation | None:
    """Find the translation of a camera that may turn, from the essential matrix, as the paper does.

    OpenCV's five-point solver inside its USAC (a locally optimised RANSAC).  Of the two rotations
    of an essential matrix the smaller one is taken: cameras do not turn around between matches.
    Of the two signs, the one by which the points flow away from the direction; no result if
    a quarter of them disagrees.

    Small fields of view trade rotation for sideways translation: where the camera does not turn,
    `two_point` is far more accurate, and the covariance does not know of the other solutions.
    The direction is that in the middle of the turn.

    Parameters and result are those of `two_point`; `seed` has no effect, as USAC draws the same
    samples each time.  Bearings 89 degrees and more from the optical axis are outliers.

    References
    ----------
    Nister 2004 (five points); Raguram et al. 2013 (USAC).
    """
    r1, r2, threshold, groups = checked(r1, r2, threshold, groups)
    front = (r1[:, 2] > _LEAST_Z) & (r2[:, 2] > _LEAST_Z)
    if front.sum() < 6:
        return None
    p1, p2 = (np.ascontiguousarray(r[front, :2] / r[front, 2:]) for r in (r1, r2))
    essential, kept = cv2.findEssentialMat(
        p1, p2, np.eye(3), method=cv2.USAC_ACCURATE, prob=0.999, threshold=threshold
    )
    if essential is None or essential.shape != (3, 3) or kept is None or kept.sum() < 6:
        return None
    small, large, shift = cv2.decomposeEssentialMat(essential)
    vectors = [cv2.Rodrigues(turn)[0].ravel() for turn in (small, large)]
    half = cv2.Rodrigues(0.5 * min(vectors, key=np.linalg.norm))[0].astype(np.float64)
    inliers = np.zeros(len(r1), dtype=np.bool_)
    inliers[front] = kept.ravel() > 0
    return _halfway(half, np.ravel(shift).astype(np.float64), r1, r2, inliers, groups)


def _halfway(
    half: Floats,
    shift: Floats,
    r1: Floats,
    r2: Floats,
    inliers: Flags,
    groups: Integers,
) -> Translation | None:
    """Turn the pose X2 = half^2 X1 +- shift into a direction halfway, with its covariance."""
    halfway1, halfway2 = r1 @ half.T, r2 @ half
    rises = (halfway2 - halfway1) @ (half.T @ shift)
    direction = half.T @ shift * (1.0 if rises[inliers].sum() < 0 else -1.0)
    residuals = _general_sampson(direction, halfway1, halfway2)
    away = inliers & ((halfway2 - halfway1) @ direction < 0)
    if away.sum() < max(6, 0.75 * inliers.sum()):
        return None
    inliers = away
    basis = tangent_basis(direction)
    near1, near2, at = halfway1[inliers], halfway2[inliers], residuals[inliers]

    def changed(change: Floats) -> Floats:
        twist = 0.5 * change[2:]
        t = direction + change[:2] @ basis
        return _general_sampson(t, _turned(near1, twist), _turned(near2, -twist))

    step = 1e-6
    slopes = np.stack([(changed(step * e) - at) / step for e in np.eye(5)], axis=1)
    gradients = np.zeros((int(groups.max()) + 1, 5))
    np.add.at(gradients, groups[inliers], slopes * at[:, None])
    covariance = sandwich(slopes.T @ slopes, gradients[np.unique(groups[inliers])])
    if covariance is None:
        return None
    tangent = basis.T @ covariance[:2, :2] @ basis
    return Translation(direction, tangent, inliers, residuals, robust_sd(at))


def _turned(r: Floats, twist: Floats) -> Floats:
    return r + np.cross(twist, r)


def _general_sampson(t: Floats, r1: Floats, r2: Floats) -> Floats:
    """Sampson residuals [rad] of a translation t of any length, between turned bearings."""
    t = t / np.linalg.norm(t)
    slopes = 2.0 - (r1 @ t) ** 2 - (r2 @ t) ** 2
    return np.cross(r1, r2) @ t / np.sqrt(np.maximum(slopes, 1e-12))


def _covariance(
    direction: Floats, bearings: kernels.Bearings, scale: float, groups: Integers
) -> Floats | None:
    information, gradients = kernels.normal_equations(direction, bearings, scale, groups)
    covariance = sandwich(information, gradients)
    if covariance is None:
        return None
    basis = tangent_basis(direction)
    return basis.T @ covariance @ basis


def turn_explains(
    r1: ArrayLike,
    r2: ArrayLike,
    spans: ArrayLike,
    translation: Translation,
    *,
    middles: ArrayLike | None = None,
    floor: float = 0.0,
    seed: int = 0,
    groups: Integers | None = None,
) -> bool:
    """Tell whether a turn explains correspondences as well as a translation does.

    The turn may be about any axis, change its rate, and be seen through a lens that is known
    badly (`LENS_SD`): a plane before a translating camera looks much like that, and only parallax
    does not.  The translation in turn may swing about its direction.

    Compares the squared residuals of the two models, in units of the noise and cut at `CUT` per
    degree of freedom, in the manner of the geometric robust information criterion.  Where both
    models hold, a turn's two residuals per correspondence cost `NEUTRAL_GAIN` more than a
    translation's one.  Only a difference that is larger by `EVIDENCE` of its standard errors shows
    the parallax without which there is no direction to find.  A lens that is unlikely costs too.

    Parameters
    ----------
    r1, r2 : array_like, shape (n, 3)
        Unit bearings before and after.
    spans : array_like, shape (n,)
        Time between them, above zero, in any unit.
    translation : Translation
        The rival, with its residuals of these correspondences.
    middles : array_like, shape (n,), optional
        Time halfway between them, in the same unit; by default all at the same time.
    floor : float
        Least noise [rad]: differences below it are no evidence, however well they repeat.
    seed : int
        Of the samples.
    groups : ndarray of int64, shape (n,), optional
        As in `two_point`: their number, not that of the correspondences, counts as evidence.

    Raises
    ------
    InputError
        If a shape or a value is unusable.

    References
    ----------
    Torr, "Bayesian model estimation and selection for epipolar geometry and generic manifold
    fitting", IJCV 50(1), 2002.
    """
    r1, r2, threshold, groups = checked(r1, r2, 3.0 * max(translation.noise, floor), groups)
    spans = checks.floats(spans, "spans", (len(r1),))
    if (spans <= 0).any():
        raise InputError(f"spans row {int(np.argmin(spans))} is not above zero: r1 comes before r2")
    middles = np.zeros_like(spans) if middles is None else middles
    middles = checks.floats(middles, "middles", (len(r1),))
    some = np.linspace(0, len(r1) - 1, min(len(r1), SCORED)).astype(np.int64)
    flow = lenses.flow(r1[some], r2[some], spans[some], middles[some])
    residuals, inliers = _swinging(translation, some, r1, r2, flow, threshold / 3.0)
    noise = max(robust_sd(residuals[inliers]) if inliers.sum() > 2 else 0.0, floor)
    variance = max(noise, 1e-12) ** 2
    cells = groups[some]
    of_turn, price = _turned_residuals(r1[some], r2[some], flow, np.sqrt(variance), cells, seed)
    either = inliers | (of_turn < 2.0 * CUT * variance)
    if either.sum() < 3:
        return True
    cost_of_turn = np.minimum(of_turn[either] / variance, 2.0 * CUT)
    cost_of_translation = np.minimum(residuals[either] ** 2 / variance, CUT)
    cost_of_translation[~inliers[either]] = CUT
    gain = cost_of_turn - cost_of_translation
    evidence = np.unique(cells[either]).size
    error = gain.std() / np.sqrt(evidence)
    return float(gain.mean()) + price / evidence <= NEUTRAL_GAIN + EVIDENCE * error


def _swinging(
    translation: Translation,
    some: Integers,
    r1: Floats,
    r2: Floats,
    flow: lenses.Flow,
    noise: float,
) -> tuple[Floats, Flags]:
    """Return residuals and inliers of some correspondences, of a direction that may swing."""
    given, inliers = translation.residuals[some], translation.inliers[some]
    largest = np.abs(translation.residuals[translation.inliers]).max(initial=0.0)
    rows = kernels.Bearings(r1[some], r2[some], np.cross(r1[some], r2[some]))
    late = flow.times / flow.times[:, :1]
    late[:, 2] -= late[:, 2].mean()
    late /= np.maximum(np.abs(late).max(axis=0), 1e-12)
    scale = 1.5 * noise
    residuals, rises = kernels.refine_swinging(translation.direction, rows, late, scale, SWINGS)
    limit = max(largest, noise)
    agreeing = (np.abs(residuals) < limit) & (rises < limit)
    # Of a camera that turns as well (`five_point`) the residuals are not those of the bearings.
    if agreeing.sum() < inliers.sum():
        return given, inliers
    return residuals, agreeing


def _turned_residuals(
    r1: Floats, r2: Floats, flow: lenses.Flow, noise: float, cells: Integers, seed: int
) -> tuple[Floats, float]:
    """Return the squared residuals of the best turn [rad^2], and how unlikely its lens is."""
    sample = turns.TimedBearings(r1, r2, np.ascontiguousarray(flow.times[:, 0]))
    turn = turns.turn_ransac(sample, 3.0 * noise, TURN_TRIALS, seed)
    of_turn, of_lens = np.empty(len(r1)), np.empty(len(r1))
    turns.squared_residuals(turn, sample, of_turn)
    # What is known of the lens counts as much as one cell, which holds many correspondences.
    sd = np.array(LENS_SD)
    shared = np.sqrt(0.5 * len(r1) / np.unique(cells).size)
    known = lenses.Lens(sd / shared, LENS_MOST)
    rates, lens = lenses.fit_turn(2.0 * turn, flow, 1.5 * noise, known, TURN_STEPS)
    lenses.squared_residuals(rates, lens, flow, of_lens)
    limit = 2.0 * CUT * noise**2
    if np.minimum(of_lens, limit).sum() < np.minimum(of_turn, limit).sum():
        return of_lens, float(np.sum((lens / sd) ** 2))
    return of_turn, 0.0

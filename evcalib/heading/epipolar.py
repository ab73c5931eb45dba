"""Direction of translation from point correspondences: two solvers, one result."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike

from evcalib import checks
from evcalib.arrays import Flags, Floats, Integers
from evcalib.heading._translation import Translation, checked
from evcalib.kernels.heading import epipolar as kernels
from evcalib.kernels.heading import turn as turns
from evcalib.kernels.linalg import tangent_basis
from evcalib.uncertainty import robust_sd, sandwich, sd_of_median

TRIALS = 1000
"""Most samples that a RANSAC draws; it stops earlier once a better one is unlikely.  With 90 %
outliers 1000 samples of two still hold a clean one with a probability of 1 - 0.99^1000."""

NEUTRAL_GAIN = 0.987
"""E min(chi2_2, 4) - E min(chi2_1, 2), for chi squares of two and one degree of freedom."""

TURN_TRIALS = 100
"""Samples of the turn that competes with a translation.  Of half outliers a clean one of two is
among them with a probability of 1 - 0.75^100."""

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
    seed: int = 0,
    groups: Integers | None = None,
) -> bool:
    """Tell whether a steady turn explains correspondences as well as a translation does.

    Compares the squared residuals of the two models, in units of the noise and cut at twice
    their degrees of freedom, as in the geometric robust information criterion.  Where both models
    hold, a turn's two residuals per correspondence cost 0.99 more than a translation's one.  Only
    a difference that is larger by two of its standard errors shows the parallax without which
    there is no direction to find.

    Parameters
    ----------
    r1, r2 : array_like, shape (n, 3)
        Unit bearings before and after.
    spans : array_like, shape (n,)
        Time between them, in any unit.
    translation : Translation
        The rival, with its residuals of these correspondences.
    seed : int
        Of the samples.
    groups : ndarray of int64, shape (n,), optional
        As in `two_point`: their number, not that of the correspondences, counts as evidence.

    References
    ----------
    Torr, "Bayesian model estimation and selection for epipolar geometry and generic manifold
    fitting", IJCV 50(1), 2002.
    """
    r1, r2, threshold, groups = checked(r1, r2, 3.0 * translation.noise, groups)
    spans = checks.floats(spans, "spans", (len(r1),))
    some = np.linspace(0, len(r1) - 1, min(len(r1), SCORED)).astype(np.int64)
    sample = turns.TimedBearings(r1[some], r2[some], spans[some])
    turn = turns.turn_ransac(sample, threshold, TURN_TRIALS, seed)
    of_turn = np.empty(some.size)
    turns.squared_residuals(turn, sample, of_turn)
    either = translation.inliers[some] | (of_turn < threshold**2)
    if either.sum() < 3:
        return True
    variance = translation.noise**2
    cost_of_turn = np.minimum(of_turn[either] / variance, 4.0)
    cost_of_translation = np.minimum(translation.residuals[some][either] ** 2 / variance, 2.0)
    gain = cost_of_turn - cost_of_translation
    error = gain.std() / np.sqrt(np.count_nonzero(np.bincount(groups[some][either])))
    return float(gain.mean()) <= NEUTRAL_GAIN + 2.0 * error

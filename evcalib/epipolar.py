"""Direction of translation from point correspondences: two solvers, one result."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from evcalib import _check
from evcalib.errors import InputError
from evcalib.kernels import epipolar as kernels
from evcalib.kernels import turn as turns

Floats = NDArray[np.float64]

TRIALS = 1000
"""Most samples that a RANSAC draws; it stops earlier once a better one is unlikely."""

NEUTRAL_GAIN = 0.987
"""E min(chi2_2, 4) - E min(chi2_1, 2), for chi squares of two and one degree of freedom."""

TURN_TRIALS = 100
"""Samples of the turn that competes with a translation."""

SCORED = 500
"""Most correspondences that a RANSAC scores, evenly taken; all of them enter the refinement."""

_LEAST_Z = np.cos(np.deg2rad(89.0))

LEAST_NOISE = 1e-6
"""Noise [rad] below which residuals are rounding, not measurement."""


@dataclass(frozen=True, eq=False)
class Translation:
    """Direction in which the camera moved between two sets of bearings.

    Attributes
    ----------
    direction : ndarray, shape (3,)
        Unit vector in the camera frame.
    covariance : ndarray, shape (3, 3)
        Of the direction [rad^2]; of rank 2, as the direction cannot change along itself.
    inliers : ndarray of bool, shape (n,)
        Correspondences with a residual below the threshold whose points flow away from the
        direction (are in front of the camera).
    noise : float
        Robust standard deviation of the inliers' Sampson residuals [rad].
    """

    direction: Floats
    covariance: Floats
    inliers: NDArray[np.bool_]
    noise: float

    @property
    def sd(self) -> float:
        """Standard deviation of the direction per tangent axis [rad]."""
        return float(np.sqrt(0.5 * np.trace(self.covariance)))


def two_point(
    r1: ArrayLike,
    r2: ArrayLike,
    *,
    threshold: float,
    seed: int = 0,
    groups: NDArray[np.int64] | None = None,
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
    r1, r2, threshold, groups = _checked(r1, r2, threshold, groups)
    if len(r1) < 3:
        return None
    normals = np.cross(r1, r2)
    some = np.linspace(0, len(r1) - 1, min(len(r1), SCORED)).astype(np.int64)
    sample = (r1[some], r2[some], normals[some])
    direction = kernels.two_point_ransac(*sample, threshold, TRIALS, seed)
    if not direction.any():
        return None
    kernels.refine(direction, r1, r2, normals, threshold / 2, 5)
    residuals, inliers = _judge(direction, r1, r2, normals, threshold)
    if inliers.sum() < 3:
        return None
    noise = _robust_sd(residuals[inliers])
    kernels.refine(direction, r1, r2, normals, min(1.5 * noise, threshold / 2), 10)
    residuals, inliers = _judge(direction, r1, r2, normals, threshold)
    if inliers.sum() < 3:
        return None
    noise = _robust_sd(residuals[inliers])
    covariance = _covariance(direction, r1, r2, normals, min(1.5 * noise, threshold / 2), groups)
    return None if covariance is None else Translation(direction, covariance, inliers, noise)


def five_point(
    r1: ArrayLike,
    r2: ArrayLike,
    *,
    threshold: float,
    seed: int = 0,
    groups: NDArray[np.int64] | None = None,
) -> Translation | None:
    """Find the translation of a camera that may turn, from the essential matrix, as the paper does.

    OpenCV's five-point solver inside its USAC (a locally optimised RANSAC), then cheirality.
    Small fields of view trade rotation for sideways translation: where the camera does not turn,
    `two_point` is far more accurate.  The direction is that in the middle of the turn.

    Parameters and result are those of `two_point`; `seed` has no effect, as USAC draws the same
    samples each time.  Bearings 89 degrees and more from the optical axis are outliers.

    References
    ----------
    Nister 2004 (five points); Raguram et al. 2013 (USAC).
    """
    r1, r2, threshold, groups = _checked(r1, r2, threshold, groups)
    front = (r1[:, 2] > _LEAST_Z) & (r2[:, 2] > _LEAST_Z)
    if front.sum() < 6:
        return None
    p1, p2 = (np.ascontiguousarray(r[front, :2] / r[front, 2:]) for r in (r1, r2))
    essential, kept = cv2.findEssentialMat(
        p1, p2, np.eye(3), method=cv2.USAC_ACCURATE, prob=0.999, threshold=threshold
    )
    if essential is None or essential.shape != (3, 3) or kept is None or kept.sum() < 6:
        return None
    _, turn, shift, in_front = cv2.recoverPose(essential, p1, p2, np.eye(3), mask=kept)
    inliers = np.zeros(len(r1), dtype=np.bool_)
    inliers[front] = in_front.ravel() > 0
    if inliers.sum() < 6:
        return None
    pose = np.asarray(turn, dtype=np.float64), np.ravel(shift).astype(np.float64)
    return _from_pose(*pose, r1, r2, inliers, groups)


def _from_pose(
    turn: Floats,
    shift: Floats,
    r1: Floats,
    r2: Floats,
    inliers: NDArray[np.bool_],
    groups: NDArray[np.int64],
) -> Translation | None:
    """Turn the pose X2 = turn X1 + shift into a direction halfway, with its covariance."""
    half = cv2.Rodrigues(0.5 * cv2.Rodrigues(turn)[0])[0]
    direction = -half.T @ shift
    halfway1, halfway2 = r1[inliers] @ half.T, r2[inliers] @ half
    basis = kernels.tangent_basis(direction)

    def residuals(change: Floats) -> Floats:
        t = direction + change[:2] @ basis
        twist = 0.5 * change[2:]
        return _general_sampson(t, _turned(halfway1, twist), _turned(halfway2, -twist))

    at = residuals(np.zeros(5))
    step = 1e-6
    slopes = np.stack([(residuals(step * e) - at) / step for e in np.eye(5)], axis=1)
    scores = np.zeros((int(groups.max()) + 1, 5))
    np.add.at(scores, groups[inliers], slopes * at[:, None])
    covariance = _sandwich(slopes.T @ slopes, scores[np.unique(groups[inliers])])
    if covariance is None:
        return None
    return Translation(direction, basis.T @ covariance[:2, :2] @ basis, inliers, _robust_sd(at))


def _turned(r: Floats, twist: Floats) -> Floats:
    return r + np.cross(twist, r)


def _general_sampson(t: Floats, r1: Floats, r2: Floats) -> Floats:
    """Sampson residuals [rad] of a translation t of any length, between turned bearings."""
    t = t / np.linalg.norm(t)
    slopes = 2.0 - (r1 @ t) ** 2 - (r2 @ t) ** 2
    return np.cross(r1, r2) @ t / np.sqrt(np.maximum(slopes, 1e-12))


def _checked(
    r1: ArrayLike, r2: ArrayLike, threshold: float, groups: NDArray[np.int64] | None
) -> tuple[Floats, Floats, float, NDArray[np.int64]]:
    first = _check.floats(r1, "r1", (None, 3))
    second = _check.floats(r2, "r2", (len(first), 3))
    for name, r in (("r1", first), ("r2", second)):
        off = np.abs(np.linalg.norm(r, axis=1) - 1.0) > 1e-6
        if off.any():
            raise InputError(f"{name} row {int(np.argmax(off))} is not a unit vector; normalise it")
    threshold = _check.positive(threshold, "threshold", "radians")
    if groups is None:
        groups = np.arange(len(first))
    groups = np.asarray(groups)
    if groups.shape != (len(first),) or groups.dtype.kind not in "iu":
        raise InputError(f"groups must be {len(first)} whole numbers, one per correspondence")
    if groups.size and (groups.min() < 0 or groups.max() > 4 * groups.size + 10_000):
        groups = np.unique(groups, return_inverse=True)[1]
    return first, second, threshold, groups.astype(np.int64)


def _judge(
    direction: Floats, r1: Floats, r2: Floats, normals: Floats, threshold: float
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return residuals [rad], and which correspondences are inliers."""
    residuals, rises = np.empty(len(r1)), np.empty(len(r1))
    kernels.sampson(direction, r1, r2, normals, residuals, rises)
    return residuals, (np.abs(residuals) < threshold) & (rises < threshold)


def _robust_sd(residuals: Floats) -> float:
    """Return the standard deviation of a normal distribution with this median magnitude."""
    return max(float(1.4826 * np.median(np.abs(residuals))), LEAST_NOISE)


def _covariance(
    direction: Floats,
    r1: Floats,
    r2: Floats,
    normals: Floats,
    scale: float,
    groups: NDArray[np.int64],
) -> Floats | None:
    information, scores = kernels.normal_equations(direction, r1, r2, normals, scale, groups)
    covariance = _sandwich(information, scores)
    if covariance is None:
        return None
    basis = kernels.tangent_basis(direction)
    return basis.T @ covariance @ basis


def _sandwich(information: Floats, scores: Floats) -> Floats | None:
    """Return the cluster-robust covariance (Liang & Zeger 1986), or None if nothing is fixed."""
    n, k = scores.shape
    if n <= k or np.linalg.eigvalsh(information)[0] <= 1e-9 * np.trace(information):
        return None
    inverse = np.linalg.inv(information)
    return n / (n - k) * inverse @ (scores.T @ scores) @ inverse


def turn_explains(
    r1: ArrayLike,
    r2: ArrayLike,
    spans: ArrayLike,
    translation: Translation,
    *,
    seed: int = 0,
    groups: NDArray[np.int64] | None = None,
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
        The rival, fitted to these correspondences.
    seed : int
        Of the samples.
    groups : ndarray of int64, shape (n,), optional
        As in `two_point`: their number, not that of the correspondences, counts as evidence.

    References
    ----------
    Torr, "Bayesian model estimation and selection for epipolar geometry and generic manifold
    fitting", IJCV 50(1), 2002.
    """
    r1, r2, threshold, groups = _checked(r1, r2, 3.0 * translation.noise, groups)
    spans = _check.floats(spans, "spans", (len(r1),))
    some = np.linspace(0, len(r1) - 1, min(len(r1), SCORED)).astype(np.int64)
    r1, r2, spans, groups = r1[some], r2[some], spans[some], groups[some]
    turn = turns.turn_ransac(r1, r2, spans, threshold, TURN_TRIALS, seed)
    of_turn = np.empty(len(r1))
    turns.turn_misfits(turn, r1, r2, spans, of_turn)
    residuals, inliers = _judge(translation.direction, r1, r2, np.cross(r1, r2), threshold)
    either = inliers | (of_turn < threshold**2)
    if either.sum() < 3:
        return True
    variance = translation.noise**2
    cost_of_turn = np.minimum(of_turn[either] / variance, 4.0)
    cost_of_translation = np.minimum(residuals[either] ** 2 / variance, 2.0)
    gain = cost_of_turn - cost_of_translation
    error = gain.std() / np.sqrt(np.unique(groups[either]).size)
    return float(gain.mean()) <= NEUTRAL_GAIN + 2.0 * error

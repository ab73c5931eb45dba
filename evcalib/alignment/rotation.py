"""The rotation that turns camera headings into body directions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evcalib import checks
from evcalib.alignment._stream_pair import MIN_SIGMA
from evcalib.arrays import Floats
from evcalib.display import Shown
from evcalib.errors import InputError
from evcalib.kernels.alignment import mixture as kernel

METHODS = ("tukey", "l1", "kabsch", "gnc", "cca")

TUKEY = 5.12
"""Scale of Tukey's biweight in standard deviations: 95 % efficiency for two-dimensional errors
(`tests/test_rotation.py`)."""


@dataclass(frozen=True)
class RotationEstimate(Shown):
    """A rotation and how it was reached.

    Attributes
    ----------
    R_body_cam : ndarray, shape (3, 3)
        ``d = R_body_cam @ e``.
    weight : ndarray, shape (n,)
        Final weight of each pair, the given weights (scaled to a mean of 1) included.
    sigma : float
        Standard deviation of the inliers per tangent axis [rad].
    converged : bool
        Whether the last step was below the tolerance.
    iterations : int
        Number of steps.
    """

    R_body_cam: Floats
    weight: Floats
    sigma: float
    converged: bool
    iterations: int


@dataclass(frozen=True)
class Mixture:
    """Shares of what the residuals u = 1 - cos(angle) in [0, 2] are made of.

    Inliers are exponential in u (the Fisher distribution on the sphere), flipped ones are
    exponential in 2 - u, outliers are uniform.
    """

    sigma: float
    inliers: float
    flipped: float
    outliers: float

    def evidence(self, u: Floats, weight: Floats) -> float:
        """Return the log-likelihood ratio of residuals u against all being uniform outliers."""
        scale = self.sigma**2
        norm = scale * -np.expm1(-2 / scale)
        density = self.inliers * np.exp(-u / scale) / norm + self.outliers * 0.5
        density = density + self.flipped * np.exp(-(2 - u) / scale) / norm
        return float(weight @ np.log(2 * np.maximum(density, 1e-300)))


def estimate_rotation(
    e: Floats, d: Floats, *, method: str = "tukey", weight: Floats | None = None
) -> RotationEstimate:
    """Return the rotation that turns headings `e` into directions `d`.

    Parameters
    ----------
    e, d : ndarray, shape (n, 3)
        Unit directions in the camera and the body frame, paired, n >= 2.
    method : {"tukey", "l1", "kabsch", "gnc", "cca"}
        ``kabsch`` is weighted least squares.  ``l1`` is the paper's re-weighting, with weights
        applied to the data as given each time.  ``tukey`` starts from ``l1`` and goes on with
        Tukey's biweight, its scale from the residuals' mixture.  ``gnc`` is graduated
        non-convexity with truncated least squares (Yang et al. 2020).  ``cca`` is the closed form
        S_oo^+ S_oe (Qiu et al. 2020); the paper's S_ee^-1 S_eo is far worse.
    weight : ndarray, shape (n,), optional
        Non-negative weights.

    Raises
    ------
    InputError
        If shapes differ, a weight is negative, fewer than two pairs are given, or the method is
        unknown.

    Examples
    --------
    One of five pairs is wrong.

    >>> e = np.array([[0, 0, 1], [1, 0, 0], [0.6, 0, 0.8], [0.8, 0, 0.6], [0, 1, 0.0]])
    >>> d = e[:, [2, 0, 1]] * [1, -1, -1]
    >>> d[4] = [1, 0, 0]
    >>> (estimate_rotation(e, d).R_body_cam @ [0, 0, 1]).round(4) + 0
    array([1., 0., 0.])
    """
    checks.one_of(method, "rotation_method", METHODS)
    e = checks.floats(e, "headings", (None, 3))
    d = checks.floats(d, "directions", (len(e), 3))
    w = np.ones(len(e)) if weight is None else checks.floats(weight, "weight", (len(e),))
    if (w < 0).any():
        raise InputError(f"weight is negative in row {int(np.argmax(w < 0))}")
    if np.count_nonzero(w) < 2:
        raise InputError("a rotation needs at least two pairs of directions with weight")
    return _ESTIMATORS[method](e, d, w * (len(w) / w.sum()))


def kabsch(e: Floats, d: Floats, weight: Floats) -> Floats:
    """Return R that maximises sum w d . R e, by the SVD of H = sum w d e^T.

    R = U diag(1, 1, det(U V^T)) V^T; without the determinant, which the paper's text omits, planar
    data give a reflection.
    """
    U, _, Vt = np.linalg.svd((d * weight[:, None]).T @ e)
    return U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt


def cosine_residuals(e: Floats, d: Floats, R: Floats) -> Floats:
    """Return 1 - d . R e for each pair, in [0, 2], from |d - R e|^2 / 2 (exact near 0)."""
    return np.minimum(0.5 * np.sum((d - e @ R.T) ** 2, axis=1), 2.0)


def fit_mixture(u: Floats, weight: Floats | None = None) -> Mixture:
    """Fit inliers, flips and uniform outliers to residuals by expectation-maximisation.

    The best of several starts is kept, so that neither few nor many outliers mislead it.
    """
    w = np.ones(len(u)) if weight is None else weight
    fits = [_fit_mixture(u, w, start) for start in (0.02, 0.1, 0.4)]
    return max(fits, key=lambda fit: fit[0])[1]


def _fit_mixture(u: Floats, w: Floats, sigma: float) -> tuple[float, Mixture]:
    likelihood, found = kernel.fit_mixture(u, w, sigma, MIN_SIGMA)
    return float(likelihood), Mixture(*(float(value) for value in found))


def _kabsch_estimate(e: Floats, d: Floats, w: Floats) -> RotationEstimate:
    R = kabsch(e, d, w)
    u = cosine_residuals(e, d, R)
    sigma = float(np.sqrt(max(np.average(u, weights=w), MIN_SIGMA**2)))
    return RotationEstimate(R, w, sigma, True, 1)


def _l1(e: Floats, d: Floats, w: Floats, floor: float = 1e-3) -> RotationEstimate:
    """Iterate w_i = 1 / max(floor, |d - R e|) (the paper's L1 registration, by re-weighting)."""

    def reweight(u: Floats) -> Floats:
        return np.asarray(1.0 / np.maximum(floor, np.sqrt(2 * u)))

    return _iterate(e, d, w, kabsch(e, d, w), reweight)


def _tukey(e: Floats, d: Floats, w: Floats) -> RotationEstimate:
    start = _l1(e, d, w)
    scale = tukey_scale(fit_mixture(cosine_residuals(e, d, start.R_body_cam), w).sigma)

    def biweight(u: Floats) -> Floats:
        return np.asarray(np.maximum(0.0, 1.0 - u / scale) ** 2)

    return _iterate(e, d, w, start.R_body_cam, biweight, start.iterations)


def tukey_scale(sigma: float) -> float:
    """Return the residual 1 - cos(angle) at which Tukey's weight becomes 0."""
    return 0.5 * (TUKEY * sigma) ** 2


def _gnc(e: Floats, d: Floats, w: Floats) -> RotationEstimate:
    """Anneal truncated least squares; the truncation is three inlier standard deviations."""
    R = _l1(e, d, w).R_body_cam
    limit = 9.0 * fit_mixture(cosine_residuals(e, d, R), w).sigma ** 2
    R = kabsch(e, d, w)
    square = 2 * cosine_residuals(e, d, R)
    mu = limit / max(2 * square.max() - limit, 1e-12)
    iterations, weights = 0, w
    while iterations < 200:
        iterations += 1
        low, high = mu / (mu + 1) * limit, (mu + 1) / mu * limit
        with np.errstate(divide="ignore", invalid="ignore"):
            between = np.sqrt(limit * mu * (mu + 1) / square) - mu
        gate = np.where(square <= low, 1.0, np.where(square >= high, 0.0, between))
        weights = w * gate
        if np.count_nonzero(weights) < 2:
            break
        R = kabsch(e, d, weights)
        square = 2 * cosine_residuals(e, d, R)
        if np.isin(gate, (0.0, 1.0)).all():
            break
        mu *= 1.4
    inlying = max(float(weights.sum()), 1e-12)
    sigma = float(np.sqrt(max(0.5 * float(weights @ square) / inlying, MIN_SIGMA**2)))
    return RotationEstimate(R, weights, sigma, iterations < 200, iterations)


def _cca(e: Floats, d: Floats, w: Floats) -> RotationEstimate:
    """Project S_oo^+ S_oe onto the rotations; standardising per axis would destroy it."""
    mean_e, mean_d = np.average(e, axis=0, weights=w), np.average(d, axis=0, weights=w)
    x, y = e - mean_e, d - mean_d
    S_oo, S_oe = (y * w[:, None]).T @ y, (y * w[:, None]).T @ x
    U, _, Vt = np.linalg.svd(np.linalg.pinv(S_oo, rcond=1e-9) @ S_oe)
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    sigma = float(np.sqrt(max(np.average(cosine_residuals(e, d, R), weights=w), MIN_SIGMA**2)))
    return RotationEstimate(R, w, sigma, True, 1)


def _iterate(
    e: Floats,
    d: Floats,
    w: Floats,
    R: Floats,
    reweight: Callable[[Floats], Floats],
    done: int = 0,
    limit: int = 100,
) -> RotationEstimate:
    """Re-weight and register until the rotation moves by less than 1e-10 rad."""
    weights, moved, step = w, np.inf, 0
    while moved >= 1e-10 and step < limit:
        step += 1
        candidate = w * reweight(cosine_residuals(e, d, R))
        if np.count_nonzero(candidate) < 2:
            break
        weights = candidate
        update = kabsch(e, d, weights)
        moved = float(np.linalg.norm(update - R))
        R = update
    sigma = fit_mixture(cosine_residuals(e, d, R), w).sigma
    return RotationEstimate(R, weights, sigma, moved < 1e-6, done + step)


_ESTIMATORS = {"tukey": _tukey, "l1": _l1, "kabsch": _kabsch_estimate, "gnc": _gnc, "cca": _cca}

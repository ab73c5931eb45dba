"""How sure an offset and a rotation are, with noise that remembers.

Noise of headings is correlated over time.  A plain least-squares covariance is then far too small;
here the correlation is estimated from the residuals and carried through (a sandwich covariance).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from evcalib.arrays import Floats
from evcalib.kernels.uncertainty import noise as kernel
from evcalib.uncertainty._noise import NoiseModel, fit_noise

UNKNOWN = 1e3
"""Variance [rad^2, s^2] of what is not known at all."""


def rotation_sd(covariance: Floats) -> float:
    """Return the standard deviation of a rotation of this covariance [rad], pi at most.

    Parameters
    ----------
    covariance : ndarray, shape (3, 3)
        Of the rotation vector [rad^2].

    Returns
    -------
    float
        Root of its trace.
    """
    return min(float(np.sqrt(np.trace(covariance))), np.pi)


@dataclass(frozen=True, eq=False)
class JointCovariance:
    """Covariance of rotation vector and offset.

    Attributes
    ----------
    full : ndarray, shape (4, 4)
        Covariance of the rotation vector in the body frame [rad] and of the offset [s].
        Along what the data do not hold at all, the variance is `UNKNOWN`.
    rotation_given_offset : ndarray, shape (3, 3)
        Covariance of the rotation vector [rad^2] if the offset were known.
    offset_sensitivity : ndarray, shape (3,)
        Change of the rotation vector per second of offset [rad/s].
    noise : NoiseModel
        Correlation over time of what lies in the plane of motion.
    samples : float
        Effective number of independent headings that agree.
    """

    full: Floats
    rotation_given_offset: Floats
    offset_sensitivity: Floats
    noise: NoiseModel
    samples: float


def joint_covariance(
    t: Floats,
    Re: Floats,
    d: Floats,
    rate: Floats,
    weight: Floats,
    reach: float,
    body_noise: Floats | None = None,
) -> JointCovariance:
    """Return the covariance of rotation and offset at the optimum of a Tukey loss.

    The residual of heading i is r_i = R e_i - d(t_i + offset).  A turn phi (left, in the body
    frame) and a change of the offset move it by J_i = [-[d]_x, -d'] (with d in place of R e_i,
    which for an outlier points anywhere).  With psi = w r the covariance is A^-1 B A^-1, where
    A = kappa sum J^T J, kappa = mean(w + u w'), and B = var(psi) sum_ij corr(t_i - t_j) J_i^T J_j.
    Smoothed noise of the odometry is too slow and small to show in the residuals, but adds up over
    the headings: it gets a term of its own.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times [s] of the headings.
    Re, d : ndarray, shape (n, 3)
        Turned headings and body directions.
    rate : ndarray, shape (n, 3)
        Derivative of the body direction [1/s].
    weight : ndarray, shape (n,)
        Given weights of the headings, without the robust ones.
    reach : float
        Tukey's reach, as a misfit 1 - cos(angle); infinite for least squares.
    body_noise : ndarray, shape (3,), optional
        Variance per body axis that the noise of the odometry gives to the mean of n directions,
        times n.

    Returns
    -------
    JointCovariance
        In the body frame.
    """
    u = 0.5 * np.sum((Re - d) ** 2, axis=1)
    rest = np.maximum(0.0, 1.0 - u / reach)
    robust = rest**2
    kappa = float(np.average(robust - 2.0 * u * rest / reach, weights=weight))
    # Only what lies across d: the rest of a chord, -u d, is no noise but a constant.
    psi = robust[:, None] * (Re - np.sum(Re * d, axis=1, keepdims=True) * d)

    J = np.zeros((t.size, 3, 4))
    J[:, 0, 1], J[:, 0, 2] = d[:, 2], -d[:, 1]
    J[:, 1, 0], J[:, 1, 2] = -d[:, 2], d[:, 0]
    J[:, 2, 0], J[:, 2, 1] = d[:, 1], -d[:, 0]
    J[:, :, 3] = -rate
    A = kappa * np.einsum("ica,i,icb->ab", J, weight, J)
    # Noise of the odometry lies in the plane of motion, that of headings also across it.
    sideways = np.cross(np.linalg.eigh(np.einsum("i,ia,ib->ab", weight, d, d))[1][:, 0], d)
    B, noise, samples = _part(t, psi, J, sideways, weight, robust)
    across = _part(t, psi, J, np.cross(d, sideways), weight, robust)
    B, samples = B + across[0], min(samples, across[2])
    J *= weight[:, None, None]
    if body_noise is not None:
        B = B + kappa**2 * np.einsum("ica,c,icb->ab", J, body_noise, J)
    return JointCovariance(
        full=_sandwich(A, B),
        rotation_given_offset=_sandwich(A[:3, :3], B[:3, :3]),
        offset_sensitivity=-_pseudo_inverse(A[:3, :3]) @ A[:3, 3],
        noise=noise,
        samples=samples,
    )


def _part(
    t: Floats, psi: Floats, J: Floats, side: Floats, weight: Floats, robust: Floats
) -> tuple[Floats, NoiseModel, float]:
    """Return what noise along one side of the directions adds to B, its model, and its samples."""
    side = side / np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)
    along = np.einsum("ic,ic->i", psi, side)
    moves = np.einsum("ica,ic->ia", J, side)
    noise = fit_noise(t, along[:, None], moves)
    samples = noise.independent(t, weight * robust)
    # Four parameters were fitted to two numbers per independent heading.
    lost = max(1.0 - 2.0 / max(samples, 1e-12), 0.25)
    variance = float(np.average(along**2, weights=weight)) / lost
    scores = np.ascontiguousarray((weight[:, None] * moves)[:, None, :])
    shared = kernel.correlated_information(t, scores, noise.share, noise.memory)
    return variance * shared, noise, samples


def rotation_radius(
    covariance: Floats, probability: float = 0.95, samples: float = np.inf
) -> float:
    """Return the angle [rad] that a rotation error stays below with the given probability.

    The angle squared is a sum of three weighted chi-squares; a scaled chi-square with the same mean
    and variance (Satterthwaite) or, for few samples, a scaled F stands for it.

    Parameters
    ----------
    covariance : ndarray, shape (3, 3)
        Of the rotation vector [rad^2].
    probability : float
        Of the error to stay below.
    samples : float
        Effective number of independent headings; infinite where the covariance is known.

    Returns
    -------
    float
        Angle [rad], pi at most.
    """
    values = np.maximum(np.linalg.eigvalsh(covariance), 0.0)
    mean = values.sum()
    if mean == 0:
        return 0.0
    dof = mean**2 / np.sum(values**2)
    # SciPy's F has no infinite degrees of freedom.
    quantile = stats.f.ppf(probability, dof, min(max(2 * samples - 4, 1.0), 1e9))
    return float(min(np.sqrt(mean * quantile), np.pi))


def t_quantile(samples: float, probability: float = 0.95) -> float:
    """Return the two-sided Student quantile for so many independent headings.

    Parameters
    ----------
    samples : float
        Effective number of independent headings.
    probability : float
        Of lying within the quantile on either side.

    Returns
    -------
    float
        Standard deviations.
    """
    return float(stats.t.ppf(0.5 + 0.5 * probability, max(2 * samples - 4, 1.0)))


def _pseudo_inverse(A: Floats) -> Floats:
    return np.asarray(np.linalg.pinv(A, rcond=1e-10, hermitian=True), dtype=np.float64)


def _sandwich(A: Floats, B: Floats) -> Floats:
    """Return A^-1 B A^-1, with UNKNOWN variance along what A does not hold."""
    scale = np.sqrt(np.maximum(np.diag(A), 1e-300))
    values, vectors = np.linalg.eigh(A / np.outer(scale, scale))
    known = values > 1e-10 * max(values[-1], 1e-300)
    half = vectors[:, known] / values[known]
    inverse = (half @ vectors[:, known].T) / np.outer(scale, scale)
    covariance = inverse @ B @ inverse
    for direction in (vectors[:, ~known] / scale[:, None]).T:
        axis = direction / np.linalg.norm(direction)
        covariance = covariance + UNKNOWN * np.outer(axis, axis)
    return covariance


def sandwich(information: Floats, scores: Floats) -> Floats | None:
    """Return the cluster-robust covariance (Liang & Zeger 1986).

    Parameters
    ----------
    information : ndarray, shape (k, k)
        Second derivatives of the loss.
    scores : ndarray, shape (n, k)
        Gradient of each cluster.

    Returns
    -------
    ndarray, shape (k, k), or None
        None where the clusters do not fix all k unknowns.
    """
    n, k = scores.shape
    if n <= k or np.linalg.eigvalsh(information)[0] <= 1e-9 * np.trace(information):
        return None
    inverse = np.linalg.inv(information)
    return n / (n - k) * inverse @ (scores.T @ scores) @ inverse

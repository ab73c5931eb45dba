"""The result of the epipolar solvers, and what they share."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from evcalib import checks
from evcalib.arrays import Flags, Floats, Integers
from evcalib.display import Shown
from evcalib.errors import InputError
from evcalib.kernels.heading.epipolar import first_not_unit


@dataclass(frozen=True, eq=False)
class Translation(Shown):
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
    residuals : ndarray, shape (n,)
        Sampson residuals [rad].
    noise : float
        Robust standard deviation of the inliers' residuals [rad].
    """

    direction: Floats
    covariance: Floats
    inliers: Flags
    residuals: Floats
    noise: float

    @property
    def sd(self) -> float:
        """Standard deviation of the direction per tangent axis [rad]."""
        return float(np.sqrt(0.5 * np.trace(self.covariance)))

    def select(self, mask: Flags) -> Translation:
        """Return the same direction with only the correspondences where `mask` is True."""
        return replace(self, inliers=self.inliers[mask], residuals=self.residuals[mask])


def checked(
    r1: ArrayLike, r2: ArrayLike, threshold: float, groups: Integers | None
) -> tuple[Floats, Floats, float, Integers]:
    """Return bearings, threshold and group numbers, or raise InputError."""
    first = checks.floats(r1, "r1", (None, 3))
    second = checks.floats(r2, "r2", (len(first), 3))
    for name, r in (("r1", first), ("r2", second)):
        off = first_not_unit(r, 1e-6)
        if off >= 0:
            raise InputError(f"{name} row {off} is not a unit vector; normalise it")
    return (
        first,
        second,
        checks.positive(threshold, "threshold", "radians"),
        numbered(groups, first),
    )


def numbered(groups: Integers | None, rows: Floats) -> Integers:
    """Return group numbers that can index a short array; each row its own by default."""
    n = len(rows)
    if groups is None:
        return np.arange(n)
    groups = np.asarray(groups)
    if groups.shape != (n,) or groups.dtype.kind not in "iu":
        raise InputError(f"groups must be {n} whole numbers, one per correspondence")
    if n and (groups.min() < 0 or groups.max() > 4 * n + 10_000):
        groups = np.unique(groups, return_inverse=True)[1]
    return groups.astype(np.int64)

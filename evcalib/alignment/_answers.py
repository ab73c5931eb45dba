"""What an alignment decides: the offset and the rotation, each with how sure it is."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from evcalib.arrays import Floats
from evcalib.uncertainty import rotation_radius


@dataclass(frozen=True)
class OffsetAnswer:
    """The offset, and how sure it is.

    Attributes
    ----------
    used : float
        Offset [s] that the rotation is for.
    estimate : float
        Offset [s] of the best score.
    sd : float
        Standard deviation of `used` [s].
    interval : tuple of (float, float)
        95 % interval [s].
    observable : bool
        Whether the motion determines it.
    fit_sd : float
        Standard deviation of `estimate` [s], whether or not it is believed.
    searched : float, optional
        Half width of the search [s]; None if there was none.
    given : float, optional
        Offset [s] that the user gave.
    """

    used: float
    estimate: float
    sd: float = np.nan
    interval: tuple[float, float] = (np.nan, np.nan)
    observable: bool = False
    fit_sd: float = np.nan
    searched: float | None = None
    given: float | None = None


@dataclass(frozen=True, eq=False)
class RotationAnswer:
    """The rotation, and how sure it is.

    Attributes
    ----------
    R_body_cam : ndarray, shape (3, 3)
        Rotation.
    covariance : ndarray, shape (3, 3)
        Of the rotation vector in the body frame [rad^2]; NaN where no one has asked for it.
    samples : float
        Effective number of independent samples behind it.
    unknown_axis : ndarray, shape (3,), optional
        Body axis about which the rotation is not known.
    determined : bool
        Whether it is determined: by the motion, or given the offset by the user.
    """

    R_body_cam: Floats
    covariance: Floats = field(default_factory=lambda: np.full((3, 3), np.nan))
    samples: float = np.inf
    unknown_axis: Floats | None = None
    determined: bool = False

    @property
    def radius(self) -> float:
        """Angle [rad] that the error stays below with 95 % probability."""
        if not np.isfinite(self.covariance).all():
            return np.nan
        return rotation_radius(self.covariance, samples=self.samples)

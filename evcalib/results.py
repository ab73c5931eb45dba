"""What an alignment returns."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evcalib.joint import JointRefinement
from evcalib.observability import DirectionSpread
from evcalib.offset import OffsetCurve
from evcalib.rotation import Mixture
from evcalib.solution import Residuals
from evcalib.uncertainty import NoiseModel
from evcalib.verdict import Verdict

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Diagnostics:
    """What the verdict rests on.

    Attributes
    ----------
    heading_rate_z : float
        Variation of the body's heading rate in standard deviations.
    follows_z : float
        Standard errors by which the headings prefer the real track to one that turns steadily.
    spread : DirectionSpread
        Spread of the body directions.
    mixture : Mixture
        Noise of the headings per tangent axis [rad], and shares of inliers, flips and outliers.
    noise : NoiseModel
        Correlation of the residuals over time.
    independent_headings : float
        Effective number of independent headings.
    second_peak_ratio : float
        Height of the curve's second peak over the first.
    plausible : ndarray, shape (k,)
        Offsets [s] on the grid that the data cannot tell from the best one.
    offset_matters : float
        Largest change of the rotation [rad] over the plausible offsets.
    offset_sensitivity : float
        Change of the rotation per second of offset [rad/s].
    agrees : bool
        Whether the headings agree with the odometry beyond what chance would do.
    body_turns : float
        Root mean square yaw rate of the body [rad/s]; 0 where the velocities do not tell it.
    at_edge : bool
        Whether the best offset lies on the border of the search.
    sharp_turns : bool
        Whether the motion has instant turns, so that errors are bootstrapped.
    """

    heading_rate_z: float
    follows_z: float
    spread: DirectionSpread
    mixture: Mixture
    noise: NoiseModel
    independent_headings: float
    second_peak_ratio: float
    plausible: Floats
    offset_matters: float
    offset_sensitivity: float
    agrees: bool
    body_turns: float
    at_edge: bool
    sharp_turns: bool


@dataclass(frozen=True, eq=False)
class Calibration:
    """Offset and rotation between camera and body, with uncertainty and verdict.

    Attributes
    ----------
    R_body_cam : ndarray, shape (3, 3)
        ``v_body = R_body_cam @ v_cam``.
    offset : float
        ``t_body = t_cam + offset`` [s]; where it is not observable, the one given (or 0).
    offset_sd : float
        Standard deviation of the offset [s].
    offset_interval : tuple of (float, float)
        95 % interval of the offset [s].
    offset_observable : bool
        Whether the motion determines the offset.
    rotation_sd : float
        Root mean square angle [rad] expected of the rotation's error.
    rotation_covariance : ndarray, shape (3, 3)
        Covariance of the rotation vector in the body frame [rad^2].
    rotation_radius : float
        Angle [rad] that the rotation's error stays below with 95 % probability.
    rotation_observable : bool
        Whether the rotation is determined: by the motion, or given the offset by the user.
    unknown_axis : ndarray, shape (3,), optional
        Body axis about which the rotation is not known.
    inlier_share : float
        Share of the headings that agree with the calibration.
    curve : OffsetCurve, optional
        Score over the candidate offsets; None with ``offset_method="none"``.
    residuals : Residuals
        Headings against body directions.
    diagnostics : Diagnostics
        What the verdict rests on.
    verdict : Verdict
        The same in words.
    settings : dict
        Parameters of the call.
    joint : JointRefinement, optional
        The refinement on the tracks of corners, where there was one.
    """

    R_body_cam: Floats
    offset: float
    offset_sd: float
    offset_interval: tuple[float, float]
    offset_observable: bool
    rotation_sd: float
    rotation_covariance: Floats
    rotation_radius: float
    rotation_observable: bool
    unknown_axis: Floats | None
    inlier_share: float
    curve: OffsetCurve | None
    residuals: Residuals
    diagnostics: Diagnostics
    verdict: Verdict
    settings: dict[str, Any] = field(default_factory=dict)
    joint: JointRefinement | None = None

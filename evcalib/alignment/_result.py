"""What an alignment returns."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from evcalib.alignment.offset import OffsetCurve
from evcalib.alignment.registration import Residuals
from evcalib.alignment.verdict import Diagnostics, Verdict
from evcalib.arrays import Floats


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

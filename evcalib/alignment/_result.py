"""What an alignment returns."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

import numpy as np

from evcalib.alignment._answers import OffsetAnswer, RotationAnswer
from evcalib.alignment.offset import OffsetCurve
from evcalib.alignment.registration import Residuals
from evcalib.alignment.verdict import Diagnostics, Verdict, judge
from evcalib.arrays import Floats
from evcalib.display import Rows, Shown
from evcalib.geometry import LOOKS_FORWARD, rpy_text
from evcalib.kinematics import WARN_SLIP
from evcalib.uncertainty import rotation_radius, rotation_sd

WORTH_A_WORD = 0.05
"""Least angle [deg] that is not shown as 0.0."""


@dataclass(frozen=True, eq=False)
class Calibration(Shown):
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
    odometry_sd : float
        Standard deviation [rad] of an error about the body's Z axis that all directions share,
        which the covariance counts.
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
    odometry_sd: float = 0.0

    @classmethod
    def of(
        cls,
        offset: OffsetAnswer,
        rotation: RotationAnswer,
        diagnostics: Diagnostics,
        residuals: Residuals,
        *,
        curve: OffsetCurve | None,
        verdict: Verdict | None = None,
        **more: Any,
    ) -> Self:
        """Put a calibration together; the verdict follows from the rest if it is not given."""
        return cls(
            R_body_cam=rotation.R_body_cam,
            offset=offset.used,
            offset_sd=offset.sd,
            offset_interval=offset.interval,
            offset_observable=offset.observable,
            rotation_sd=rotation_sd(rotation.covariance),
            rotation_covariance=rotation.covariance,
            rotation_radius=rotation.radius,
            rotation_observable=rotation.determined,
            unknown_axis=rotation.unknown_axis,
            inlier_share=diagnostics.mixture.inliers,
            curve=curve,
            residuals=residuals,
            diagnostics=diagnostics,
            verdict=judge(diagnostics, offset, rotation) if verdict is None else verdict,
            **more,
        )

    @property
    def samples(self) -> float:
        """Independent stretches of motion behind the error bars."""
        return self.diagnostics.independent_headings

    def widened(self, direction_sd: float, *, because: str = "", given: bool = False) -> Self:
        """Return the calibration with an error that all directions of the body share.

        Parameters
        ----------
        direction_sd : float
            Standard deviation about the body's Z axis [rad]; 0 changes nothing.
        because : str
            Where it comes from, in words, if not from the odometry.
        given : bool
            Whether the user gave it.

        Returns
        -------
        Calibration
            With a wider rotation, the reason in its verdict, and a doubt where it is that wheels
            contradict each other.
        """
        if direction_sd == 0:
            return self
        common = np.diag([0.0, 0.0, direction_sd**2])
        covariance = self.rotation_covariance + common
        reason, verdict = because or _shared(direction_sd, given), self.verdict
        if not because and not given and direction_sd > WARN_SLIP:
            verdict = verdict.doubted(reason)
        elif np.degrees(direction_sd) >= WORTH_A_WORD:
            verdict = replace(verdict, reasons=(*verdict.reasons, reason))
        return replace(
            self,
            rotation_covariance=covariance,
            rotation_sd=rotation_sd(covariance),
            rotation_radius=float(np.hypot(self.rotation_radius, rotation_radius(common))),
            odometry_sd=float(np.hypot(self.odometry_sd, direction_sd)),
            verdict=verdict,
        )

    def doubted(self, *doubts: str) -> Self:
        """Return the calibration with doubts in its verdict."""
        return replace(self, verdict=self.verdict.doubted(*doubts))

    @property
    def odometry_radius(self) -> float:
        """The part of `rotation_radius` [rad] that is of the odometry; 0 if there is none."""
        return rotation_radius(np.diag([0.0, 0.0, self.odometry_sd**2]))

    @property
    def data_radius(self) -> float:
        """The part of `rotation_radius` [rad] that is of the data: what a longer drive lessens."""
        return float(np.sqrt(max(self.rotation_radius**2 - self.odometry_radius**2, 0.0)))

    @property
    def radius_parts(self) -> str:
        """Both parts of `rotation_radius` in words, or nothing where there is one."""
        if self.odometry_sd == 0 or not np.isfinite(self.rotation_radius):
            return ""
        data, odometry = np.degrees(self.data_radius), np.degrees(self.odometry_radius)
        return f"{data:.2f} of the data, {odometry:.2f} of the odometry"

    _most_lines = 2

    def _shown_rows(self) -> Rows:
        """Return the answer and how sure it is, then what a subclass adds."""
        low, high = self.offset_interval
        interval = f"from {low:+.4f} to {high:+.4f} s"
        if self.offset_observable:
            exact = f" +- {self.offset_sd:.4f} s (sd), 95 % {interval}"
        else:
            exact = f", not determined: plausible {interval}" if np.isfinite(low) else ""
        parts = self.radius_parts and f": {self.radius_parts}"
        sure = f", error below {np.degrees(self.rotation_radius):.2f} deg (95 %{parts})"
        if not self.rotation_observable:
            sure = ", not determined" if np.isfinite(self.rotation_radius) else ""
        used = len(self.residuals.t)
        rows = [
            ("time offset", f"{self.offset:+.4f} s{exact}"),
            ("R_body_cam", f"{rpy_text(self.R_body_cam)}{sure}"),
            ("mounting", f"{rpy_text(self.R_body_cam @ LOOKS_FORWARD.T)} from straight ahead"),
            ("headings", f"{used:,} used, {100 * self.inlier_share:.0f} % agree"),
            ("verdict", self.verdict.summary),
        ]
        if self.verdict.doubts:
            rows.append(("doubts", " ".join(self.verdict.doubts)))
        told = {"without", *(f.name for f in fields(Calibration))}
        return rows + [row for row in super()._shown_rows() if row[0] not in told]


def _shared(direction_sd: float, given: bool) -> str:
    """Say what error all directions of the odometry may share."""
    off = f"off by {np.degrees(direction_sd):.1f} deg (sd), which the error bars of the rotation"
    if given:
        return f"All directions may be {off} count, as was given."
    if direction_sd > WARN_SLIP:
        return (
            f"The wheels contradict each other: all directions may be {off} count."
            " Look at steering zeros, units and signs of the wheel log."
        )
    return f"Wheels like these creep: all directions may be {off} count (--odometry-sd)."

"""What every rival takes and gives: two streams, and a calibration without error bars."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from evcalib.alignment import Calibration, OffsetAnswer, RotationAnswer, StreamPair, enough
from evcalib.alignment.observability import direction_spread, heading_rate_test
from evcalib.alignment.offset import OffsetCurve
from evcalib.alignment.registration import Residuals
from evcalib.alignment.rotation import cosine_residuals, fit_mixture
from evcalib.alignment.verdict import Diagnostics, Verdict
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.kinematics.velocity_track import velocity_track
from evcalib.poses import PoseSeries
from evcalib.series import HeadingSeries, VelocitySeries
from evcalib.uncertainty import NoiseModel


@dataclass(frozen=True, eq=False)
class RivalInput:
    """What the methods are given to compare.

    Attributes
    ----------
    headings : HeadingSeries
        Directions of the camera's motion, on the camera clock.
    velocities : VelocitySeries
        Velocities of the body, on the odometry clock.
    camera_poses : PoseSeries, optional
        Trajectory of the camera, on the camera clock, in any world and (monocular) any scale.
    body_poses : PoseSeries, optional
        Trajectory of the body [m], on the odometry clock, in any world.
    hold : float
        See :func:`evcalib.kinematics.velocity_track.velocity_track`.
    """

    headings: HeadingSeries
    velocities: VelocitySeries
    camera_poses: PoseSeries | None = None
    body_poses: PoseSeries | None = None
    hold: float = 0.0

    def pair(self) -> StreamPair:
        """Return the streams as the rivals look them up: linear between samples, not smoothed.

        Raises
        ------
        InputError
            If there are too few headings, or the velocities are unusable.
        """
        headings = enough(self.headings)
        return StreamPair.of(
            headings, velocity_track(self.velocities, hold=self.hold, smooth=False)
        )

    def trajectories(self, method: str) -> tuple[PoseSeries, PoseSeries]:
        """Return both trajectories, or raise an InputError that says which one `method` lacks."""
        if self.camera_poses is None or self.body_poses is None:
            which = "camera_poses" if self.camera_poses is None else "body_poses"
            raise InputError(
                f"{method} aligns trajectories and needs {which}: read one from a TUM file"
                " (data_tools.logs.trajectory_files.read_tum) or reckon one from the streams"
                " (data_tools.studies.baseline_runs.reckoned_poses)"
            )
        return self.camera_poses, self.body_poses


@dataclass(frozen=True, eq=False)
class RivalCalibration(Calibration):
    """What a rival finds, as it finds it.

    Rivals return their best score whether or not the motion determines it, and state no
    uncertainty: standard deviations, covariance, interval and radius are NaN, and both
    ``observable`` flags are False because nothing was asked.  Residuals and curve are there.

    Attributes
    ----------
    method : str
        Name of the rival.
    """

    method: str = ""


@dataclass(frozen=True, eq=False)
class TrajectoryCalibration(RivalCalibration):
    """What an alignment of trajectories finds.

    Attributes
    ----------
    lever_arm : ndarray, shape (3,)
        Position of the camera in the body frame [m]; NaN along body axes where it is unobservable.
    reason : str
        What is unobservable and why; empty if nothing is.
    scale : float
        Metres per unit of the camera's trajectory; 1 if it was taken to be metric.
    cost : float
        Sum of squares of the paper's Eq. 2 at the solution.
    """

    lever_arm: Floats | None = None
    reason: str = ""
    scale: float = np.nan
    cost: float = np.nan


@dataclass(frozen=True, eq=False)
class CertifiedCalibration(TrajectoryCalibration):
    """What a certifiable alignment of trajectories finds.

    Attributes
    ----------
    duality_gap : float
        Cost less the lower bound of the dual problem.
    relative_gap : float
        The same as a share of the cost.
    min_eigenvalue : float
        Smallest eigenvalue of the dual matrix, of which the bound takes account.
    certified : bool
        Whether the gap proves that no other rotation is better.
    """

    duality_gap: float = np.nan
    relative_gap: float = np.nan
    min_eigenvalue: float = np.nan
    certified: bool = False


def finish(
    streams: RivalInput,
    R: Floats,
    offset: float,
    *,
    method: str,
    curve: OffsetCurve | None = None,
    kind: type[RivalCalibration] = RivalCalibration,
    settings: dict[str, Any] | None = None,
    unknown_axis: Floats | None = None,
    **more: Any,
) -> Any:
    """Return a rival's rotation and offset as a calibration of class `kind`.

    Residuals and shares of outliers are computed as ours are, with equal weights.
    """
    pair = streams.pair()
    at, d = pair.covered(offset)
    u = cosine_residuals(at.headings.v, d, R)
    unknown = np.nan
    diagnostics = Diagnostics(
        heading_rate_z=heading_rate_test(pair.track, *at.span(offset)),
        follows_z=unknown,
        spread=direction_spread(d, pair.track),
        mixture=fit_mixture(u, at.weight),
        noise=NoiseModel(unknown, unknown),
        independent_headings=unknown,
        second_peak_ratio=0.0 if curve is None else curve.second_peak_ratio,
        plausible=np.empty(0),
        offset_matters=unknown,
        offset_sensitivity=unknown,
        agrees=False,
        body_turns=streams.velocities.turning,
        at_edge=curve is not None and curve.at_edge,
        sharp_turns=False,
    )
    angle = 2 * np.arcsin(np.sqrt(np.clip(u / 2, 0.0, 1.0)))
    return kind.of(
        OffsetAnswer(used=float(offset), estimate=float(offset)),
        RotationAnswer(R, unknown_axis=unknown_axis),
        diagnostics,
        Residuals(at.headings.t, at.headings.v @ R.T, d, angle, at.weight),
        curve=curve,
        verdict=_verdict(method, curve, more.get("reason", "")),
        settings=settings or {},
        method=method,
        **more,
    )


def _verdict(method: str, curve: OffsetCurve | None, reason: str) -> Verdict:
    reasons = ["The offset is taken as given." if curve is None else ""]
    if curve is not None and curve.at_edge:
        reasons.append("Its best offset lies on the border of the search.")
    reasons.append(reason)
    return Verdict(
        f"The rival {method} states no uncertainty, and does not ask what the motion determines.",
        tuple(filter(None, reasons)),
        ("Run evcalib's own method on the same streams to learn what is determined.",),
    )

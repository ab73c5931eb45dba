"""What every rival takes and gives: two streams, and a calibration without error bars."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from evcalib.alignment import Calibration, intervals, no_overlap, weights
from evcalib.alignment.observability import direction_spread, heading_rate_test
from evcalib.alignment.offset import OffsetCurve
from evcalib.alignment.registration import MIN_PAIRS, Residuals
from evcalib.alignment.rotation import fit_mixture, misfits
from evcalib.alignment.verdict import Diagnostics, Verdict
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.kinematics.velocity_track import VelocityTrack, velocity_track
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

    def usable_headings(self) -> HeadingSeries:
        """Return the headings to use, or raise an InputError if they are too few."""
        headings = self.headings.usable()
        if len(headings) < MIN_PAIRS:
            raise InputError(
                f"headings: {len(headings)} usable row(s), at least {MIN_PAIRS} are needed"
            )
        return headings

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


def track_of(streams: RivalInput) -> VelocityTrack:
    """Return the odometry as the rivals look it up: linear between samples, not smoothed."""
    return velocity_track(streams.velocities, hold=streams.hold, smooth=False)


def paired(
    headings: HeadingSeries, track: VelocityTrack, offset: float
) -> tuple[HeadingSeries, Floats]:
    """Return the headings that the odometry covers at an offset [s], and the body directions.

    Raises
    ------
    InputError
        If there are fewer than six.
    """
    d = track.directions(*intervals(headings), offset)
    known = np.any(d != 0, axis=1)
    if known.sum() < MIN_PAIRS:
        where = f"at an offset of {offset:g} s, but for {int(known.sum())} headings"
        raise InputError(no_overlap(headings, track, where))
    return headings.select(known), d[known]


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
    headings = streams.usable_headings()
    track = track_of(streams)
    part, d = paired(headings, track, offset)
    w = weights(part)
    u = misfits(part.v, d, R)
    mixture = fit_mixture(u, w)
    angle = 2 * np.arcsin(np.sqrt(np.clip(u / 2, 0.0, 1.0)))
    begin, end = intervals(part)
    unknown = np.nan
    yaw_rate = streams.velocities.yaw_rate
    diagnostics = Diagnostics(
        heading_rate_z=heading_rate_test(
            track, float(begin.min()) + offset, float(end.max()) + offset
        ),
        follows_z=unknown,
        spread=direction_spread(d, track),
        mixture=mixture,
        noise=NoiseModel(unknown, unknown),
        independent_headings=unknown,
        second_peak_ratio=0.0 if curve is None else curve.second_peak_ratio,
        plausible=np.empty(0),
        offset_matters=unknown,
        offset_sensitivity=unknown,
        agrees=False,
        body_turns=0.0 if yaw_rate is None else float(np.sqrt(np.mean(yaw_rate**2))),
        at_edge=curve is not None and curve.at_edge,
        sharp_turns=False,
    )
    return kind(
        R_body_cam=R,
        offset=float(offset),
        offset_sd=unknown,
        offset_interval=(unknown, unknown),
        offset_observable=False,
        rotation_sd=unknown,
        rotation_covariance=np.full((3, 3), unknown),
        rotation_radius=unknown,
        rotation_observable=False,
        unknown_axis=unknown_axis,
        inlier_share=mixture.inliers,
        curve=curve,
        residuals=Residuals(part.t, part.v @ R.T, d, angle, w),
        diagnostics=diagnostics,
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

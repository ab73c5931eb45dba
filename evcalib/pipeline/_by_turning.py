"""The calibration of a body that turns: sightings first, headings afterwards."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace

import numpy as np

from evcalib.alignment import Calibration, OffsetAnswer, RotationAnswer, align, unknown_axis
from evcalib.alignment.verdict import judge
from evcalib.arrays import Floats
from evcalib.errors import InputError, NoAnswerError
from evcalib.heading import HeadingEstimate
from evcalib.heading.gyro import as_seen
from evcalib.joint import JointRefinement, global_start
from evcalib.joint.tracks import tracks_of
from evcalib.kinematics.velocity_track import VelocityTrack, smoothed, velocity_track
from evcalib.pipeline._assessment import RefinedCalibration, finish, offset_observable
from evcalib.pipeline._derotation import at_camera, derotated
from evcalib.pipeline._gyro import doubted
from evcalib.pipeline._position import positioned
from evcalib.pipeline._refinement import Asked, Refiner
from evcalib.series import VelocitySeries
from evcalib.uncertainty import UNKNOWN

Stage = Callable[[str], AbstractContextManager[None]]


def by_turning(
    estimate: HeadingEstimate,
    velocities: VelocitySeries,
    track: VelocityTrack,
    turning: float,
    asked: Asked,
    stage: Stage,
) -> tuple[RefinedCalibration, HeadingEstimate]:
    """Calibrate from a global start, without headings; then make headings with its answer.

    Parameters
    ----------
    estimate : HeadingEstimate
        With its correspondences, those of windows without heading too.
    velocities, track : VelocitySeries, VelocityTrack
        Motion of the body, with its yaw rate.
    turning : float
        That beyond noise [rad/s], rms.
    asked : Asked
        What is asked for.
    stage : callable
        Context of each stage.

    Returns
    -------
    RefinedCalibration
        Also where the motion cannot answer.
    HeadingEstimate
        Headings with the turning taken out, which the calibration's residuals are of.

    Raises
    ------
    NoAnswerError
        If there are too few sightings, or no headings even so.
    """
    assert estimate.correspondences is not None
    found, gyro = estimate.correspondences, asked.gyro
    tracks = tracks_of(found)
    # The global start takes the turning out by the odometry's yaw.
    seen = tracks if gyro is None else tracks_of(as_seen(found, gyro.attitude))
    refine = Refiner(tracks, velocities, track, turning, asked)
    with stage("global start"):
        start = global_start(
            seen,
            velocities,
            track,
            focal=asked.focal,
            max_offset=asked.max_offset,
            lever=asked.told.lever,
            seed=asked.seed,
        )
    if start is None:
        raise NoAnswerError(
            f"only {len(tracks)} corners were seen again and again while the velocities tell the"
            " motion: too few to start from"
        )
    with stage("refinement"):
        joint, free = refine(start.R_body_cam, start.offset, start.position)
        known = joint is not None and offset_observable(joint, track, asked.max_offset, velocities)
        if not known:
            used = asked.offset or 0.0
            joint, free = refine(start.R_body_cam, used, start.position, estimate_offset=False)
    if joint is None:
        raise NoAnswerError(
            f"only {len(tracks)} corners were seen again and again: too few to refine"
        )
    with stage("alignment"):
        headings, moved = _headings(estimate, velocities, track, joint, asked)
        aligned = _aligned(headings, moved, asked)
    if known:
        final = finish(
            aligned, joint, headings.headings, velocity_track(moved), asked.max_offset, turning=turning
        )
    else:
        final = _at_offset(aligned, joint, turning, asked)
    final = final.widened(velocities.direction_sd)
    if gyro is not None:
        final = doubted(final, gyro.doubts(final))
    trusted = known or asked.offset is not None
    return positioned(final, asked.told, turning, free, trusted=trusted), headings


def _headings(
    estimate: HeadingEstimate,
    velocities: VelocitySeries,
    track: VelocityTrack,
    joint: JointRefinement,
    asked: Asked,
) -> tuple[HeadingEstimate, VelocitySeries]:
    """Return headings without turning, and the velocities of the camera's place."""
    assert velocities.yaw_rate is not None
    rate = smoothed(track, velocities.yaw_rate[:, None])[:, 0]
    yaw = np.zeros(rate.size)
    yaw[1:] = np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(track.t))

    def turned(t: Floats) -> Floats:
        return np.interp(t + joint.offset, track.t, yaw)

    axis = joint.R_body_cam[2]
    seen = estimate
    if asked.gyro is None:
        seen = derotated(estimate, axis, turned, focal=asked.focal, seed=asked.seed)
    told = replace(velocities, yaw_rate=rate)
    return seen, at_camera(told, joint.position)


def _aligned(seen: HeadingEstimate, moved: VelocitySeries, asked: Asked) -> Calibration:
    try:
        return align(
            seen.headings,
            replace(moved, direction_sd=0.0),
            max_offset=asked.max_offset,
            offset=asked.offset,
            seed=asked.seed,
        )
    except InputError as error:
        raise NoAnswerError(
            f"{error} (headings, with the turning that the odometry tells taken out: the camera"
            " hardly moves but for turning)"
        ) from None


def _at_offset(
    aligned: Calibration, joint: JointRefinement, turning: float, asked: Asked
) -> RefinedCalibration:
    """Return what is known where the motion does not determine the offset.

    A body that turns at one rate all the time looks at any other offset as if its camera were
    turned about the same axis.
    """
    covariance = joint.covariance[:3, :3]
    unknown = unknown_axis(covariance, replace(aligned.diagnostics.spread, spread=np.pi))
    if unknown is None and asked.offset is None:
        unknown = np.array([0.0, 0.0, 1.0])
    if unknown is not None:
        covariance = covariance + UNKNOWN * np.outer(unknown, unknown)
    rotation = RotationAnswer(
        joint.R_body_cam, covariance, joint.samples, unknown, determined=unknown is None
    )
    offset = OffsetAnswer(
        used=joint.offset,
        estimate=aligned.offset,
        sd=asked.max_offset,
        interval=(-asked.max_offset, asked.max_offset),
        observable=False,
        fit_sd=asked.max_offset,
        searched=asked.max_offset,
        given=asked.offset,
    )
    diagnostics = replace(aligned.diagnostics, body_turns=turning, turning_counted=True)
    return RefinedCalibration.of(
        offset,
        rotation,
        diagnostics,
        aligned.residuals,
        curve=aligned.curve,
        verdict=judge(diagnostics, offset, rotation),
        settings=aligned.settings,
        joint=joint,
    )

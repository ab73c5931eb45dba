"""The calibration of a body that turns: sightings first, headings afterwards."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from evcalib.alignment import Calibration, OffsetAnswer, RotationAnswer, align, unknown_axis
from evcalib.alignment.verdict import judge
from evcalib.arrays import Floats
from evcalib.errors import InputError, NoAnswerError
from evcalib.geometry import rotation_vector_to_matrix
from evcalib.heading import HeadingEstimate
from evcalib.joint import JointRefinement, Start
from evcalib.kinematics.velocity_track import VelocityTrack, smoothed, velocity_track
from evcalib.pipeline._assessment import (
    RefinedCalibration,
    compared,
    finish,
    offset_observable,
)
from evcalib.pipeline._derotation import at_camera, derotated
from evcalib.pipeline._gyro import doubted
from evcalib.pipeline._position import positioned
from evcalib.pipeline._refinement import Asked, Refiner
from evcalib.pipeline._turning import turns_variously
from evcalib.series import HeadingSeries, VelocitySeries
from evcalib.uncertainty import UNKNOWN

AROUND = 0.2
"""How far from its start the camera is put [m] where it cannot begin there.  A choice, as good as
any: distances go with it."""

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
    refine = Refiner.of(estimate.correspondences, velocities, track, turning, asked)
    tracks = refine.tracks
    with stage("global start"):
        start = refine.start()
    if start is None:
        raise NoAnswerError(
            f"only {len(tracks)} corners were seen again and again while the velocities tell the"
            " motion: too few to start from"
        )
    with stage("refinement"):
        joint, free = refine(start.R_body_cam, start.offset, start.position)
        if joint is None:
            joint, start = _from_around(refine, start)
        known = joint is not None and offset_observable(joint, track, asked.max_offset, velocities)
        if not known:
            used = asked.offset or 0.0
            joint, free = refine(start.R_body_cam, used, start.position, estimate_offset=False)
    if joint is None:
        raise NoAnswerError(
            f"only {len(tracks)} corners were seen again and again: too few to refine"
        )
    with stage("alignment"):
        seen, moved = _headings(estimate, velocities, track, joint, asked)
        aligned = _aligned(seen, moved, asked)
    part = joint.span[0] + joint.offset, joint.span[1] + joint.offset
    various = turns_variously(velocities, track, *part)
    if not various:
        joint = _without_yaw(joint)
    if known:
        final = finish(
            aligned, joint, seen.headings, velocity_track(moved), asked.max_offset, turning=turning
        )
    else:
        final = _at_offset(aligned, joint, seen.headings, turning, asked)
    final = final.widened(velocities.direction_sd, given=asked.odometry_sd is not None)
    final = doubted(final, asked.gyro)
    trusted = various and (known or asked.offset is not None)
    return positioned(final, asked.told, turning, free, trusted=trusted), seen


def _without_yaw(joint: JointRefinement) -> JointRefinement:
    """Return a refinement that knows nothing of the turn about the body's axis.

    Where all twists are multiples of one, noise of the odometry alone would tell it.
    """
    covariance = joint.covariance.copy()
    covariance[2, 2] += UNKNOWN
    return replace(joint, covariance=covariance)


def _from_around(refine: Refiner, start: Start) -> tuple[JointRefinement | None, Start]:
    """Refine with the camera held beside its start, and return the best with where it began.

    At the very point that a body turns about, a camera sees no distances.  If the body only turns,
    any place beside it does: angles of place and yaw trade, and so do distances.
    """
    place, best = start.position + [AROUND, 0.0, 0.0], start
    found: JointRefinement | None = None
    for angle in 0.5 * np.pi * np.arange(4):
        R = rotation_vector_to_matrix([0.0, 0.0, angle]) @ start.R_body_cam
        joint, _ = refine(R, start.offset, place, estimate_position=False)
        if joint is not None and (found is None or joint.inlier_share > found.inlier_share):
            found, best = joint, replace(start, R_body_cam=R, position=place)
    return found, best


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
    yaw = cumulative_trapezoid(rate, track.t, initial=0.0)

    def turned(t: Floats) -> Floats:
        return np.interp(t + joint.offset, track.t, yaw)

    axis = joint.R_body_cam[2]
    # A gyro has taken the turning out already, that of all axes.
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
    aligned: Calibration,
    joint: JointRefinement,
    headings: HeadingSeries,
    turning: float,
    asked: Asked,
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
    found = RefinedCalibration.of(
        offset,
        rotation,
        diagnostics,
        aligned.residuals,
        curve=aligned.curve,
        verdict=judge(diagnostics, offset, rotation),
        settings=aligned.settings,
        joint=joint,
    )
    if asked.offset is None:  # At a guessed offset nothing fits, whatever the model.
        return found
    return compared(found, aligned, headings)

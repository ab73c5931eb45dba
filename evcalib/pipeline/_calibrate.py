"""From raw events and body velocities to the calibration: all stages in one call."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, replace
from itertools import chain
from typing import Any

import numpy as np

from evcalib import checks
from evcalib.alignment import Calibration, align, enough
from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.errors import InputError, NoAnswerError
from evcalib.events import Events
from evcalib.geometry import rotation_angle
from evcalib.heading import HeadingEstimate, estimate_headings
from evcalib.imu import ImuSeries
from evcalib.joint import SURE, SYSTEMATIC, JointRefinement, Systematic
from evcalib.kinematics import MAX_REACH, BodyVelocities
from evcalib.kinematics.velocity_track import VelocityTrack, velocity_track
from evcalib.pipeline._assessment import RefinedCalibration, finish, keep, offset_observable
from evcalib.pipeline._by_turning import Stage, by_turning
from evcalib.pipeline._gyro import Gyro, against_events, doubted, gyro_of
from evcalib.pipeline._position import Told, positioned
from evcalib.pipeline._refinement import Asked, Refiner
from evcalib.pipeline._run import CalibrationRun, Gating, package_versions
from evcalib.pipeline._turning import LEADS, turning_beyond_noise
from evcalib.series import VelocitySeries, clocks_apart

REFINEMENTS = ("tracks", "none")

AWAY = np.radians(15.0)
"""A start nearer than this [rad] to the alignment's rotation leads to the same refinement: a choice
of half of what the refinement draws in."""

STRANGE_LAG = 4.0
"""Standard deviations beyond which the lag of corners is not believed.

At the true offset it is 0.2 to 0.5, 10 ms off 1 to 2, 30 ms off 3 to 5 (measured on the drives of
test_the_stated_intervals_hold_the_truth, the offset given): so it refuses offsets some 30 ms off.
"""


def calibrate(
    events: Events | Iterable[Events],
    camera: Camera,
    velocities: VelocitySeries | BodyVelocities,
    *,
    max_offset: float = 1.0,
    offset: float | None = None,
    camera_position: tuple[float, float, float] | None = None,
    camera_height: float | None = None,
    imu: ImuSeries | None = None,
    R_cam_imu: Floats | str | None = None,
    refinement: str = "tracks",
    systematic: Systematic = SYSTEMATIC,
    surface: str = "tos_ts",
    rate: float = 20.0,
    odometry_sd: float | None = None,
    seed: int = 0,
    denoise: bool = True,
    on_stage: Callable[[str], object] = lambda name: None,
) -> CalibrationRun:
    """Find time offset, rotation and position of an event camera on a vehicle.

    Headings are estimated from the events and aligned with the velocities (`evcalib.align`); then
    all observations of all corners refine offset and rotation at once
    (`evcalib.joint.refine_jointly`).  Where the body turns, headings do not hold: then a search
    over all rotations and offsets starts the refinement (`evcalib.joint.global_start`), which
    also finds where the camera sits; of the headings the turning is taken out afterwards.

    Parameters
    ----------
    events : Events or iterable of Events
        The recording, whole or in pieces, of which only one is held at a time.
    camera : Camera
        Calibrated for the size of the events.
    velocities : VelocitySeries or BodyVelocities
        Motion of the body, as given or as `evcalib.kinematics.body_velocities` returns it.
    max_offset : float
        Offsets from -max_offset to max_offset [s] are searched.
    offset : float, optional
        Offset [s] to use where the motion does not determine it; 0 if not given.
    camera_position : tuple of float, optional
        Where the camera sits in the body frame (x, y, z) [m], if it is known.  Turning of the body
        shows x and y: if not given they are found, else they are compared.
    camera_height : float, optional
        Height z of the camera above the body's origin [m], which no motion in a plane shows, for
        exports; not beside another z in `camera_position`.
    imu : ImuSeries, optional
        Of the camera, on its clock.  Its gyro then tells how the camera turns between sightings:
        pitch, roll and vibration too.  Its bias is taken from the mean of the drive, then from the
        events.
    R_cam_imu : array_like, shape (3, 3), or "estimate", optional
        From the axes of the IMU to those of the camera; the same axes if not given.  Estimated, the
        events correct a small turn of the same axes (tried with 10 degrees), as far as the turning
        of the camera shows it.
    refinement : {"tracks", "none"}
        Whether to refine; ``none`` is the paper's chain.
    systematic : Systematic
        Errors that all observations share; see `evcalib.joint`.
    surface, rate, seed, denoise
        See `evcalib.estimate_headings`.
    odometry_sd : float, optional
        Standard deviation [rad] of an error that all directions of the odometry share; see
        `evcalib.align`.
    on_stage : callable
        Called with the name of each stage as it begins.

    Returns
    -------
    CalibrationRun
        The calibration, with what led to it.

    Raises
    ------
    InputError
        If an input is of another type or unusable, the two clocks do not overlap, or wheels or
        events contradict the gyro.
    NoAnswerError
        If there are too few headings; it tells why most windows have none.

    Notes
    -----
    Of errors of the model the verdict tells (its `doubts`): clocks that drift apart, a body that
    turns and does not say so, and directions of travel that no rotation brings together, as a wrong
    focal length, principal point or sideways slip makes them.  A camera that only translates within
    a plane shows no more than that of its intrinsics; what shows of such directions widens the
    rotation's error bar.  It tells too where headings and tracks give different answers, and where
    all checks together speak against the model.  The rest is absorbed: a turn of all
    velocities (a steering zero) turns the rotation by as much; a principal point that is off by d
    pixels, by up to d / focal radians; 1 % of focal length or of sideways slip, by up to 0.29
    degrees; a delay of the odometry's times, also of times cut to whole multiples, is part of the
    offset.  A wrong wheel radius does nothing.

    The pixels' own delay is part of the offset, too, and cannot be told from it: they follow the
    light as a low-pass does, whose bandwidth grows with the light.  Simulated, events come 2 ms
    late at 200 Hz, 9 ms at 50 Hz and 22 ms at 20 Hz (dim light), and the offset comes out 2, 7 and
    14 ms early, whatever the stated error.
    """
    checks.one_of(refinement, "refinement", REFINEMENTS)
    checks.instance(camera, "camera", Camera)
    checks.instance(velocities, "velocities", VelocitySeries, BodyVelocities)
    if isinstance(events, str | np.ndarray) or not isinstance(events, Iterable):
        checks.instance(events, "events", Events)
    told = _told(camera_position, camera_height)
    body = velocities.velocities if isinstance(velocities, BodyVelocities) else velocities
    timings: dict[str, float] = {}
    gyro = _gyro(imu, R_cam_imu, body, max_offset)
    with _stage("headings", on_stage, timings):
        estimate = estimate_headings(
            _overlapping(events, body, max_offset),
            camera,
            attitude=None if gyro is None else gyro.attitude,
            surface=surface,
            rate=rate,
            seed=seed,
            denoise=denoise,
            keep_correspondences=True,
        )
        if gyro is not None and imu is not None:
            gyro, estimate = against_events(
                gyro, imu, estimate, focal=camera.focal, turn=isinstance(R_cam_imu, str)
            )
    final, estimate = _calibrated(
        estimate,
        body,
        Asked(
            camera.focal, max_offset, offset, told, refinement, systematic, odometry_sd, seed, gyro
        ),
        lambda name: _stage(name, on_stage, timings),
    )
    settings: dict[str, Any] = {
        **final.settings,
        "camera_position": None if camera_position is None else told.lever,
        "camera_height": told.height,
        "refinement": refinement,
        "systematic": asdict(systematic),
        "surface": surface,
        "rate": float(rate),
        "odometry_sd": odometry_sd,
        "denoise": denoise,
        **({} if gyro is None else {"imu": gyro.settings()}),
    }
    return CalibrationRun(
        calibration=final,
        gyro=gyro,
        estimate=estimate,
        velocities=body,
        gating=Gating.of(velocities) if isinstance(velocities, BodyVelocities) else None,
        settings=settings,
        versions=package_versions(),
        timings=timings,
        camera=camera,
    )


def calibrate_estimate(
    estimate: HeadingEstimate,
    velocities: VelocitySeries,
    *,
    focal: float,
    gyro: Gyro | None = None,
    max_offset: float = 1.0,
    offset: float | None = None,
    camera_position: tuple[float, float, float] | None = None,
    camera_height: float | None = None,
    refinement: str = "tracks",
    systematic: Systematic = SYSTEMATIC,
    odometry_sd: float | None = None,
    seed: int = 0,
    stage: Stage = lambda name: nullcontext(),
) -> RefinedCalibration:
    """Align headings with velocities and refine on their correspondences.

    What `calibrate` does after its headings are there, for correspondences of any other source.

    Parameters
    ----------
    estimate : HeadingEstimate
        With its correspondences, if they are to refine.
    velocities : VelocitySeries
        Motion of the body.
    focal : float
        Pixels per radian, to speak of pixels.
    gyro : Gyro, optional
        What turned the matches back, where one did.
    stage : callable
        Context in which each stage runs, given its name.
    max_offset, offset, camera_position, camera_height, refinement, systematic, odometry_sd, seed
        See `calibrate`.

    Returns
    -------
    RefinedCalibration
        Also where the motion cannot answer: then it says what is unknown.
    """
    told = _told(camera_position, camera_height)
    asked = Asked(focal, max_offset, offset, told, refinement, systematic, odometry_sd, seed, gyro)
    return _calibrated(estimate, velocities, asked, stage)[0]


def _told(position: tuple[float, float, float] | None, height: float | None) -> Told:
    """Return what is known of the camera's place, checked."""
    if height is not None:
        height = float(checks.floats([height], "camera_height", (1,))[0])
    if position is None:
        return _within(Told(None, height))
    x, y, z = map(float, checks.floats(position, "camera_position", (3,)))
    if height is not None and height != z:
        raise InputError(
            f"camera_position says z = {z:g} m, camera_height {height:g} m: give one of them"
        )
    return _within(Told((x, y), z))


def _within(told: Told) -> Told:
    if np.abs(told.lever).max() > MAX_REACH:
        raise InputError(
            f"camera_position {told.lever} is over {MAX_REACH:g} m from the body's"
            " origin; is it in metres (not millimetres)?"
        )
    return told


def _gyro(
    imu: ImuSeries | None,
    R_cam_imu: Floats | str | None,
    body: VelocitySeries,
    max_offset: float,
) -> Gyro | None:
    """Return the gyro as it is taken at first; None without an IMU."""
    if imu is None:
        if R_cam_imu is not None:
            raise InputError("R_cam_imu says how an IMU is turned: give imu too, or leave it out")
        return None
    if isinstance(R_cam_imu, str):
        checks.one_of(R_cam_imu, "R_cam_imu", ("estimate",))
        R_cam_imu = None
    return gyro_of(imu, R_cam_imu, body, max_offset)


def _calibrated(
    estimate: HeadingEstimate, velocities: VelocitySeries, asked: Asked, stage: Stage
) -> tuple[RefinedCalibration, HeadingEstimate]:
    """Return the calibration, and the headings, their turning taken out where it leads."""
    given = asked.odometry_sd is not None
    shared = velocities.direction_sd if asked.odometry_sd is None else asked.odometry_sd
    shared = float(checks.at_least_zero(shared, "odometry_sd"))
    velocities = replace(velocities, direction_sd=0.0)
    track = velocity_track(velocities)
    turning = turning_beyond_noise(velocities, track)
    if asked.refinement == "tracks" and turning > LEADS:
        told = replace(velocities, direction_sd=shared)
        return by_turning(estimate, told, track, turning, asked, stage)
    _answerable(estimate)
    with stage("alignment"):
        aligned = align(
            estimate.headings,
            velocities,
            max_offset=asked.max_offset,
            offset=asked.offset,
            seed=asked.seed,
        )
    if asked.gyro is not None and velocities.yaw_rate is None:
        velocities = asked.gyro.yaw_for(velocities, aligned)
        turning = turning_beyond_noise(velocities, track)
        if asked.refinement == "tracks" and turning > LEADS:
            told = replace(velocities, direction_sd=shared)
            return by_turning(estimate, told, track, turning, asked, stage)
    if asked.refinement == "none":
        final, free = RefinedCalibration.after(aligned), None
    else:
        with stage("refinement"):
            final, free = _refined(aligned, estimate, velocities, track, turning, asked)
    final = doubted(final.widened(shared, given=given), asked.gyro)
    return positioned(final, asked.told, turning, free), estimate


def _answerable(estimate: HeadingEstimate) -> None:
    """Refuse too few headings, with the reasons of the windows that have none."""
    try:
        enough(estimate.headings)
    except InputError as error:
        counts = Counter(gap.reason for gap in estimate.gaps).most_common(3)
        why = "; ".join(f"{reason} ({count} windows)" for reason, count in counts)
        raise NoAnswerError(
            f"{error}" + (f". Most windows have none: {why}" if why else "")
        ) from None


def _refined(
    aligned: Calibration,
    estimate: HeadingEstimate,
    velocities: VelocitySeries,
    track: VelocityTrack,
    turning: float,
    asked: Asked,
) -> tuple[RefinedCalibration, JointRefinement | None]:
    """Return the calibration after the joint refinement, or as it was where there is none.

    And the refinement that estimated the position, if one did.
    """
    assert estimate.correspondences is not None
    # A corner needs no heading to be followed: what windows without one saw counts as well.
    refine = Refiner.of(estimate.correspondences, velocities, track, turning, asked)
    joint, free = refine(aligned.R_body_cam, aligned.offset)
    if not _determines(joint, track, asked) and not aligned.rotation_observable:
        joint, free = _from_nothing(refine, aligned, joint, free)
    if joint is not None and _determines(joint, track, asked):
        return finish(aligned, joint, estimate.headings, track, asked.max_offset), free
    joint, free = refine(aligned.R_body_cam, aligned.offset, estimate_offset=False)
    lag = asked.systematic
    if joint is None or abs(joint.lag - lag.lag) > STRANGE_LAG * lag.lag_sd:
        # A lag that corners do not have makes up for an offset that is not the true one.
        return RefinedCalibration.after(aligned), None
    return keep(aligned, joint, estimate.headings), free


def _determines(joint: JointRefinement | None, track: VelocityTrack, asked: Asked) -> bool:
    return joint is not None and offset_observable(joint, track, asked.max_offset)


def _from_nothing(
    refine: Refiner, aligned: Calibration, *otherwise: JointRefinement | None
) -> tuple[JointRefinement | None, ...]:
    """Return a refinement from a start without headings, if there is one that stands out."""
    start = refine.start()
    if start is None or start.margin < SURE:
        return otherwise
    if rotation_angle(start.R_body_cam, aligned.R_body_cam) < AWAY:
        return otherwise
    return refine(start.R_body_cam, start.offset)


def _overlapping(
    events: Events | Iterable[Events], body: VelocitySeries, max_offset: float
) -> Events | Iterable[Events]:
    """Pass events on, unless the first ones come after the velocities end, at any offset."""
    if isinstance(events, Events):
        return events
    pieces = iter(events)
    first = next(pieces, None)
    if isinstance(first, Events) and len(first):
        start = 1e-6 * float(first.t[0])
        if start - max_offset > body.t[-1]:
            raise InputError(
                f"the events begin at {start:.3f} s, the velocities end at {body.t[-1]:.3f} s: no"
                f" overlap within +-{max_offset:g} s; bring the clocks together, or raise"
                f" max_offset{clocks_apart((start, start), (body.t[0], body.t[-1]))}"
            )
    return chain([] if first is None else [first], pieces)


@contextmanager
def _stage(
    name: str, on_stage: Callable[[str], object], timings: dict[str, float]
) -> Iterator[None]:
    on_stage(name)
    started = time.perf_counter()
    yield
    timings[name] = time.perf_counter() - started

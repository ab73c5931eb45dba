"""From raw events and body velocities to the calibration: all stages in one call."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import asdict, replace
from itertools import chain
from typing import Any

import numpy as np

from evcalib import checks
from evcalib.alignment import Calibration, align, enough
from evcalib.camera import Camera
from evcalib.errors import InputError, NoAnswerError
from evcalib.events import Events
from evcalib.heading import HeadingEstimate, estimate_headings
from evcalib.joint import SYSTEMATIC, Systematic, refine_jointly
from evcalib.joint.tracks import tracks_of
from evcalib.kinematics import MAX_REACH, BodyVelocities
from evcalib.kinematics.velocity_track import velocity_track
from evcalib.pipeline._assessment import RefinedCalibration, finish, keep, offset_observable
from evcalib.pipeline._run import CalibrationRun, Gating, package_versions
from evcalib.series import VelocitySeries, clocks_apart

REFINEMENTS = ("tracks", "none")

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
    refinement: str = "tracks",
    systematic: Systematic = SYSTEMATIC,
    surface: str = "tos_ts",
    rate: float = 20.0,
    odometry_sd: float | None = None,
    seed: int = 0,
    on_stage: Callable[[str], object] = lambda name: None,
) -> CalibrationRun:
    """Find the time offset and the rotation between an event camera and a vehicle.

    Headings are estimated from the events and aligned with the velocities (`evcalib.align`); then
    all observations of all corners refine offset and rotation at once
    (`evcalib.joint.refine_jointly`).  Where the velocities have a yaw rate, the refinement takes
    the turning of the camera into account.

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
        Where the camera sits in the body frame (x, y, z) [m].  When the body turns, a camera away
        from its origin moves otherwise than the origin; taken to be at it if not given.
    refinement : {"tracks", "none"}
        Whether to refine; ``none`` is the paper's chain.
    systematic : Systematic
        Errors that all observations share; see `evcalib.joint`.
    surface, rate, seed
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
        If an input is of another type or unusable, or the two clocks do not overlap.
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
    """
    checks.one_of(refinement, "refinement", REFINEMENTS)
    checks.instance(camera, "camera", Camera)
    checks.instance(velocities, "velocities", VelocitySeries, BodyVelocities)
    if isinstance(events, str | np.ndarray) or not isinstance(events, Iterable):
        checks.instance(events, "events", Events)
    lever = checks.floats((0.0, 0.0, 0.0) if camera_position is None else camera_position,
                          "camera_position", (3,))  # fmt: skip
    if np.abs(lever).max() > MAX_REACH:
        raise InputError(
            f"camera_position {tuple(map(float, lever))} is over {MAX_REACH:g} m from the body's"
            " origin; is it in metres (not millimetres)?"
        )
    body = velocities.velocities if isinstance(velocities, BodyVelocities) else velocities
    timings: dict[str, float] = {}
    with _stage("headings", on_stage, timings):
        estimate = estimate_headings(
            _overlapping(events, body, max_offset),
            camera,
            surface=surface,
            rate=rate,
            seed=seed,
            keep_correspondences=True,
        )
    final = calibrate_estimate(
        estimate,
        body,
        focal=camera.focal,
        max_offset=max_offset,
        offset=offset,
        lever=tuple(lever),
        refinement=refinement,
        systematic=systematic,
        odometry_sd=odometry_sd,
        seed=seed,
        stage=lambda name: _stage(name, on_stage, timings),
    )
    settings: dict[str, Any] = {
        **final.settings,
        "camera_position": None if camera_position is None else tuple(map(float, lever)),
        "refinement": refinement,
        "systematic": asdict(systematic),
        "surface": surface,
        "rate": float(rate),
        "odometry_sd": odometry_sd,
    }
    return CalibrationRun(
        calibration=final,
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
    max_offset: float = 1.0,
    offset: float | None = None,
    lever: tuple[float, ...] = (0.0, 0.0, 0.0),
    refinement: str = "tracks",
    systematic: Systematic = SYSTEMATIC,
    odometry_sd: float | None = None,
    seed: int = 0,
    stage: Callable[[str], AbstractContextManager[None]] = lambda name: nullcontext(),
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
    lever : tuple of float
        Position of the camera in the body frame [m].
    stage : callable
        Context in which each stage runs, given its name.
    max_offset, offset, refinement, systematic, odometry_sd, seed
        See `calibrate`.

    Returns
    -------
    RefinedCalibration
        Also where the motion cannot answer: then it says what is unknown.
    """
    _answerable(estimate)
    given = odometry_sd is not None
    shared = velocities.direction_sd if odometry_sd is None else odometry_sd
    shared = float(checks.at_least_zero(shared, "odometry_sd"))
    velocities = replace(velocities, direction_sd=0.0)
    with stage("alignment"):
        aligned = align(
            estimate.headings, velocities, max_offset=max_offset, offset=offset, seed=seed
        )
    if refinement == "none":
        return RefinedCalibration.after(aligned).widened(shared, given=given)
    with stage("refinement"):
        final = _refined(aligned, estimate, velocities, focal, max_offset, systematic, lever)
    return final.widened(shared, given=given)


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
    focal: float,
    max_offset: float,
    systematic: Systematic,
    lever: tuple[float, ...],
) -> RefinedCalibration:
    """Return the calibration after the joint refinement, or as it was where there is none."""
    assert estimate.correspondences is not None
    tracks = tracks_of(estimate.correspondences)
    track = velocity_track(velocities)
    common: Mapping[str, Any] = {
        "focal": focal,
        "max_offset": max_offset,
        "systematic": systematic,
        "lever": lever,
    }
    start = (tracks, velocities, track, aligned.R_body_cam, aligned.offset)
    joint = refine_jointly(*start, **common)
    if joint is not None and offset_observable(joint, track, max_offset):
        return finish(aligned, joint, estimate.headings, track, max_offset)
    joint = refine_jointly(*start, estimate_offset=False, **common)
    if joint is None or abs(joint.lag - systematic.lag) > STRANGE_LAG * systematic.lag_sd:
        # A lag that corners do not have makes up for an offset that is not the true one.
        return RefinedCalibration.after(aligned)
    return keep(aligned, joint, estimate.headings)


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

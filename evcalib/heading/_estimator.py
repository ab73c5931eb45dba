"""Headings from raw events: keyframes, matches over many baselines, one direction per window."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from evcalib.camera import Camera
from evcalib.checks import instance
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.heading._keyframes import REACH, Keyframe, KeyframeMaker
from evcalib.heading._matches import KeyframeMatches, match_keyframes
from evcalib.heading._options import LOCALISATIONS, HeadingOptions, takes_options
from evcalib.heading._result import HeadingEstimate
from evcalib.heading._snapshot import RateCounter, SnapshotKeeper
from evcalib.heading._threads import Threads
from evcalib.heading._windows import HeadingWindows
from evcalib.imu import Attitude


class HeadingEstimator:
    """Headings of a stream that comes in pieces, in bounded memory; see `estimate_headings`.

    Call `update` with each piece, then `finish`.  What grows with the recording is the result
    alone.

    Parameters
    ----------
    camera : Camera
        Of the sensor that the events come from.
    attitude : Attitude, optional
        How the camera turns, from its gyro (`evcalib.imu.attitude_of`).
    surface, detector, localisation, solver, rate, max_baseline, threshold, min_inliers
        As in `HeadingOptions`.
    max_sd, enough_sd, seed, keep_correspondences, denoise
        As in `HeadingOptions`.
    """

    @takes_options
    def __init__(self, camera: Camera, *, attitude: Attitude | None = None, **options: Any) -> None:
        instance(camera, "camera", Camera)
        if attitude is not None:
            instance(attitude, "attitude", Attitude)
        chosen = HeadingOptions(**options)
        self._maker = KeyframeMaker(camera, chosen)
        self._aligned = LOCALISATIONS[chosen.localisation] is not None
        self._reach = REACH * camera.width
        self._rate = RateCounter()
        self._snapshots = SnapshotKeeper()
        self._threads = Threads()
        self._windows = HeadingWindows(
            chosen,
            camera.focal,
            self._match,
            size=(camera.width, camera.height),
            attitude=attitude,
            on_heading=self._snapshots.offer,
            submit=self._threads.submit,
        )

    def update(self, events: Events) -> None:
        """Take in the next events of the stream."""
        for keyframe in self._maker.update(events):
            self._windows.add(keyframe)
        self._rate.update(events)

    def finish(self) -> HeadingEstimate:
        """Return the headings of all events taken in.

        Raises
        ------
        InputError
            If there were no events, or they do not span two keyframes.
        """
        counts = self._maker.counts
        if not counts.events:
            raise InputError("the stream holds no events")
        if self._maker.passed < 2:
            raise InputError(
                f"the stream of {self._maker.duration:.3f} s is shorter than one baseline: it must"
                f" span two keyframes ({2 * self._maker.step:.3f} s); raise the rate or record"
                " longer"
            )
        rate = self._rate.result()
        estimate = self._windows.result(counts)
        self.stop()
        snapshot = self._snapshots.result(float(rate.t[0]), float(rate.t[-1]) + rate.width)
        return replace(estimate, event_rate=rate, snapshot=snapshot, noise=self._maker.noise)

    def stop(self) -> None:
        """End the threads of a stream that is not finished."""
        self._threads.stop()

    def _match(self, before: Keyframe, after: Keyframe) -> KeyframeMatches | None:
        """Match two keyframes, unless they share events or the corners left the reach."""
        if before.t > after.since:
            return None
        expected = 0.5 * (before.flow + after.flow) * (after.t - before.t)
        if expected > self._reach:
            return None
        reach = min(self._reach, 3.0 * expected + 16.0)
        return match_keyframes(before, after, reach, aligned=self._aligned)


@takes_options
def estimate_headings(
    events: Events | Iterable[Events],
    camera: Camera,
    *,
    attitude: Attitude | None = None,
    **options: Any,
) -> HeadingEstimate:
    """Estimate the direction of motion of an event camera from its events.

    At each keyframe the corner events of late become keypoints, described by BRIEF on an event
    surface.  A window around a keyframe pools the matches of all pairs of keyframes that lie
    evenly about it, up to the longest baseline over which matches survive, and one translation is
    fitted to them all.  The paper takes one pair and the essential matrix; pooling and the
    two-point solver are what makes a heading accurate to a degree.

    Parameters
    ----------
    events : Events or iterable of Events
        The stream, whole or in pieces; of pieces only one is held at a time.
    camera : Camera
        Calibrated for the size of the events.
    attitude : Attitude, optional
        How the camera turns, from its gyro (`evcalib.imu.attitude_of`).  Matches are turned back by
        it; a heading is in the axes of the camera in the middle of its window.
    surface, detector, localisation, solver, rate, max_baseline, threshold, min_inliers
        As in `HeadingOptions`, which tells what each does and its default.
    max_sd, enough_sd, seed, keep_correspondences, denoise
        Likewise.

    Returns
    -------
    HeadingEstimate
        Headings, and the windows without: too few corners, standing still, no parallax (a turn,
        even an unsteady one behind a badly known lens, explains the matches as well), matches that
        disagree or move to and fro, motion in a small part of the image only, a direction too
        uncertain.

    Raises
    ------
    InputError
        If the events do not fit the camera, are not in order, or do not span two keyframes; or if
        an option is unusable.

    Notes
    -----
    The two-point solver takes the camera not to turn while it translates, but for what `attitude`
    tells.  A steady turn on top of a translation is not noticed: simulated at 0.5 m/s and 0.02
    rad/s it costs 3 degrees.  A turn alone is noticed and gives no heading.  Parallax must show, so
    a far or flat scene gives none either.

    References
    ----------
    Li et al. 2024, section III.
    """
    estimator = HeadingEstimator(camera, attitude=attitude, **options)
    if not isinstance(events, Events | Iterable):
        raise InputError(f"Events or pieces of them are needed, not {type(events).__name__}")
    try:
        for piece in [events] if isinstance(events, Events) else events:
            estimator.update(piece)
        return estimator.finish()
    finally:
        estimator.stop()

"""Headings from raw events: keyframes, matches over many baselines, one direction per window."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from evcalib import checks
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.features.corners import DETECTORS
from evcalib.heading._correspondences import Correspondences
from evcalib.heading._keyframes import LOCALISATIONS, Counts, Keyframe, KeyframeMaker
from evcalib.heading._matches import MAX_STEPS, Matches, match_keyframes
from evcalib.heading._result import Gap, HeadingEstimate, collected
from evcalib.heading._snapshot import EventRate, RateCounter, Snapshot, SnapshotKeeper
from evcalib.heading._window_fit import SOLVERS, FitOptions
from evcalib.heading._windows import HeadingWindows
from evcalib.surfaces import SURFACES

__all__ = [
    "SOLVERS",
    "Correspondences",
    "Counts",
    "EventRate",
    "Gap",
    "HeadingEstimate",
    "HeadingEstimator",
    "Snapshot",
    "estimate_headings",
]

REACH = 0.25
"""Matches are sought over displacements of up to this part of the sensor's width."""


class HeadingEstimator:
    """Headings of a stream that comes in pieces, in bounded memory; see `estimate_headings`.

    Call `update` with each piece, then `finish`.  What grows with the recording is the result
    alone.

    Parameters
    ----------
    camera : Camera
        Of the sensor that the events come from.
    surface, detector, localisation, solver
        As in `estimate_headings`.
    rate, max_baseline, threshold, min_inliers, max_sd, enough_sd, seed, keep_correspondences
        As in `estimate_headings`.
    """

    def __init__(
        self,
        camera: Camera,
        *,
        surface: str = "tos_ts",
        detector: str = "arc_star",
        localisation: str = "symmetric",
        solver: str = "two_point",
        rate: float = 20.0,
        max_baseline: float = 0.7,
        threshold: float = 1.5,
        min_inliers: int = 20,
        max_sd: float = 3.0,
        enough_sd: float = 0.2,
        seed: int = 0,
        keep_correspondences: bool = False,
    ) -> None:
        checks.instance(camera, "camera", Camera)
        checks.one_of(surface, "surface", tuple(SURFACES))
        checks.one_of(detector, "detector", tuple(DETECTORS))
        checks.one_of(localisation, "localisation", tuple(LOCALISATIONS))
        checks.one_of(solver, "solver", SOLVERS)
        rate = checks.positive(rate, "rate", "hertz")
        if not 0.1 <= rate <= 1000:
            raise InputError(f"rate must be 0.1 to 1000 hertz, not {rate!r}")
        steps = round(checks.positive(max_baseline, "max_baseline", "seconds") * rate)
        if not 1 <= steps < MAX_STEPS:
            raise InputError(
                f"max_baseline must be 1 to {MAX_STEPS - 1} keyframe intervals, not {steps}"
                f" ({max_baseline} s at {rate} hertz)"
            )
        options = FitOptions(
            solver=solver,
            threshold=checks.positive(threshold, "threshold", "pixels") / camera.focal,
            min_inliers=int(checks.positive(min_inliers, "min_inliers")),
            max_sd=np.deg2rad(checks.positive(max_sd, "max_sd", "degrees")),
            enough_sd=np.deg2rad(checks.positive(enough_sd, "enough_sd", "degrees")),
            seed=int(seed),
        )
        self._maker = KeyframeMaker(camera, detector, surface, rate, seed, localisation)
        self._aligned = LOCALISATIONS[localisation] is not None
        self._reach = REACH * camera.width
        self._rate = RateCounter()
        self._snapshots = SnapshotKeeper()
        self._windows = HeadingWindows(
            options,
            steps,
            self._maker.step,
            self._match,
            keep=keep_correspondences,
            on_heading=self._snapshots.offer,
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
        self._windows.drain()
        found, gaps, kept = self._windows.found, self._windows.gaps, self._windows.kept
        return collected(found, gaps, counts, kept, self._rate.result(), self._snapshots)

    def _match(self, before: Keyframe, after: Keyframe) -> Matches | None:
        """Match two keyframes, unless they share events or the corners left the reach."""
        if before.t > after.since:
            return None
        expected = 0.5 * (before.flow + after.flow) * (after.t - before.t)
        if expected > self._reach:
            return None
        reach = min(self._reach, 3.0 * expected + 16.0)
        return match_keyframes(before, after, reach, aligned=self._aligned)


def estimate_headings(
    events: Events | Iterable[Events],
    camera: Camera,
    *,
    surface: str = "tos_ts",
    detector: str = "arc_star",
    localisation: str = "symmetric",
    solver: str = "two_point",
    rate: float = 20.0,
    max_baseline: float = 0.7,
    threshold: float = 1.5,
    min_inliers: int = 20,
    max_sd: float = 3.0,
    enough_sd: float = 0.2,
    seed: int = 0,
    keep_correspondences: bool = False,
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
    surface : {"tos_ts", "tos", "ts", "silc", "dist"}
        Where keypoints are described, polarities merged.
    detector : {"arc_star", "harris"}
        Which events are corners: see `evcalib.features.corners`.
    localisation : {"symmetric", "images", "corners"}
        How the displacement of matched corners is measured.  By alignment of patches of two event
        images, weighed so that lags of the events cancel (see `evcalib.features.align`); the same
        without these weights; or between mean places of corner events, at their mean times.
    solver : {"two_point", "five_point"}
        A camera that does not turn, over all pairs; or the essential matrix of the one pair of
        most displacement, as in the paper.
    rate : float
        Keyframes per second [Hz].
    max_baseline : float
        Longest time between matched keyframes [s].
    threshold : float
        Largest epipolar residual of an inlier [px].
    min_inliers : int
        Fewest inliers of a heading.
    max_sd : float
        Largest standard deviation of a heading [deg].
    enough_sd : float
        The longest spans are left out as long as the standard deviation of a heading stays below
        this [deg]: shorter spans follow a changing direction better.
    seed : int
        Of the descriptor's pattern and of the solver's samples.
    keep_correspondences : bool
        Keep the matches behind the headings; of a long recording those of some corners.

    Returns
    -------
    HeadingEstimate
        Headings, and the windows without: too few corners, standing still, no parallax (a turn
        explains the matches as well), matches that disagree, a direction too uncertain.

    Raises
    ------
    InputError
        If the events do not fit the camera, are not in order, or do not span two keyframes; or if
        an option is unusable.

    Notes
    -----
    The two-point solver takes the camera not to turn while it translates.  A steady turn on top
    of a translation is not noticed: simulated at 0.5 m/s and 0.02 rad/s it costs 3 degrees.  A
    turn alone is noticed and gives no heading.

    References
    ----------
    Li et al. 2024, section III.
    """
    estimator = HeadingEstimator(
        camera,
        surface=surface,
        detector=detector,
        localisation=localisation,
        solver=solver,
        rate=rate,
        max_baseline=max_baseline,
        threshold=threshold,
        min_inliers=min_inliers,
        max_sd=max_sd,
        enough_sd=enough_sd,
        seed=seed,
        keep_correspondences=keep_correspondences,
    )
    if not isinstance(events, Events | Iterable):
        raise InputError(f"Events or pieces of them are needed, not {type(events).__name__}")
    for piece in [events] if isinstance(events, Events) else events:
        estimator.update(piece)
    return estimator.finish()

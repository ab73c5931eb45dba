"""From two streams to a calibration with its uncertainty and a verdict."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from evcalib import checks
from evcalib.alignment._answers import OffsetAnswer, RotationAnswer
from evcalib.alignment._bootstrap import bootstrap, sampling_floor
from evcalib.alignment._causes import likely_cause
from evcalib.alignment._evidence import Evidence, unknown_axis
from evcalib.alignment._result import Calibration
from evcalib.alignment._stream_pair import StreamPair, enough
from evcalib.alignment.observability import DirectionSpread, direction_spread
from evcalib.alignment.offset import METHODS as OFFSET_METHODS
from evcalib.alignment.offset import OffsetCurve, find_offset
from evcalib.alignment.offset_refinement import RefinedOffset, inliers_at, refine_offset
from evcalib.alignment.registration import Solution, rotation_change
from evcalib.alignment.rotation import METHODS as ROTATION_METHODS
from evcalib.alignment.verdict import Diagnostics
from evcalib.errors import InputError
from evcalib.kinematics.velocity_track import velocity_track
from evcalib.series import HeadingSeries, VelocitySeries
from evcalib.uncertainty import UNKNOWN

LEAST_CHANGE, MAX_CHANGE = np.radians(1.0), np.radians(5.0)
"""A change of the rotation over the plausible offsets below the first never matters, beyond the
second always; in between it is compared with the rotation's standard deviation.  A choice: real
headings share errors of about the first (`HEADING_BIAS`)."""


def align(
    headings: HeadingSeries,
    velocities: VelocitySeries,
    *,
    max_offset: float = 1.0,
    offset_method: str = "profile",
    rotation_method: str = "tukey",
    offset: float | None = None,
    max_gap: float | None = None,
    min_speed: float | None = None,
    hold: float = 0.0,
    smooth: bool = True,
    odometry_sd: float | None = None,
    seed: int = 0,
) -> Calibration:
    """Find the time offset and the rotation between camera headings and body velocities.

    The method takes for granted that the true offset lies within the search, that most headings
    have the right sign (flipping all of them turns the answer by 180 degrees), that neither clock
    drifts, and that the body hardly turns (else the camera moves otherwise than the body's origin).
    Error bars are those of the default methods: among outliers they are too small for the trace,
    canonical and scalar offsets and for the kabsch and cca rotations.

    Parameters
    ----------
    headings : HeadingSeries
        Directions of the camera's motion, in the camera frame, on the camera clock.
    velocities : VelocitySeries
        Velocities of the body, in the body frame, on the odometry clock.
    max_offset : float
        Offsets from -max_offset to max_offset [s] are searched.
    offset_method : {"profile", "trace", "canonical", "scalar", "none"}
        See :func:`evcalib.alignment.offset.find_offset`; ``none`` takes `offset` as it is.
    rotation_method : {"tukey", "l1", "kabsch", "gnc", "cca"}
        See :func:`evcalib.alignment.rotation.estimate_rotation`.
    offset : float, optional
        Offset [s] to use where the motion does not determine it; 0 if not given.
    max_gap, min_speed, hold, smooth
        See :func:`evcalib.kinematics.velocity_track.velocity_track`.
    odometry_sd : float, optional
        Standard deviation [rad] of an error that all directions of the odometry share, such as a
        steering zero; what the velocities say (`VelocitySeries.direction_sd`) if not given.
    seed : int
        Seed of the bootstrap that stands in where instant turns defeat the covariance.

    Returns
    -------
    Calibration
        Also where the motion cannot answer: then it says what is unknown.

    Raises
    ------
    InputError
        If the streams are unusable: too short, at rest, or without overlap at any offset.

    Examples
    --------
    A camera that looks to the left of a body that drives curves; its clock is 0.2 s behind.

    >>> from evcalib.geometry import rpy_to_matrix
    >>> t, R = np.arange(0, 10, 0.02), rpy_to_matrix([-np.pi / 2, 0, 0])
    >>> v = np.stack([np.cos(np.sin(t)), np.sin(np.sin(t)), 0 * t], axis=1)
    >>> found = align(HeadingSeries(t, v @ R), VelocitySeries(t + 0.2, v))
    >>> found.offset_observable, round(found.offset, 2)
    (True, 0.2)
    """
    checks.instance(headings, "headings", HeadingSeries)
    given = None if offset is None else float(offset)
    settings = {
        "max_offset": max_offset,
        "offset_method": offset_method,
        "rotation_method": rotation_method,
        "offset": given,
        "max_gap": max_gap,
        "min_speed": min_speed,
        "hold": hold,
        "smooth": smooth,
        "odometry_sd": odometry_sd,
        "seed": seed,
    }
    _check(settings)
    settings |= {"max_offset": float(max_offset), "seed": int(seed)}
    headings = enough(headings)
    track = velocity_track(
        velocities, max_gap=max_gap, min_speed=min_speed, hold=hold, smooth=smooth
    )
    pair = StreamPair.of(headings, track)
    curve, refined = _search(pair, offset_method, max_offset, given or 0.0)
    found = Solution.at(pair, refined.offset, rotation_method)
    evidence = Evidence.of(pair, curve, refined, found, max_offset)
    solution, used = found, refined.offset
    if not evidence.observable:
        solution, used = _fall_back(pair, found, refined, rotation_method, given)
    spread = direction_spread(solution.residuals.direction, track)
    matters = 0.0
    if not evidence.observable:
        matters = rotation_change(pair, solution, evidence.plausible)
    rotation = _rotation(solution, used, evidence, spread, matters, given)
    sd = evidence.sd
    if evidence.observable and evidence.sharp_turns:
        rotation, sd = _bootstrapped(pair, refined, solution, evidence, rotation, seed)
    interval = evidence.interval(sd, solution.covariance.samples, max_offset)
    if not evidence.observable:
        # Nothing is known beyond the search.
        sd = min(max(sd, (interval[1] - interval[0]) / np.sqrt(12)), max_offset)
    diagnostics = Diagnostics(
        heading_rate_z=evidence.heading_rate_z,
        follows_z=evidence.follows_z,
        spread=spread,
        mixture=solution.mixture,
        noise=solution.noise,
        independent_headings=solution.covariance.samples,
        second_peak_ratio=0.0 if curve is None else curve.second_peak_ratio,
        plausible=evidence.plausible,
        offset_matters=matters,
        offset_sensitivity=float(np.linalg.norm(solution.covariance.offset_sensitivity)),
        agrees=solution.agrees,
        body_turns=velocities.turning,
        at_edge=evidence.at_edge,
        sharp_turns=evidence.sharp_turns,
        cause="" if solution.agrees else likely_cause(headings, velocities, found, max_offset),
    )
    answer = OffsetAnswer(
        used=used,
        estimate=refined.offset,
        sd=sd,
        interval=interval,
        observable=evidence.observable,
        fit_sd=evidence.sd,
        searched=None if curve is None else max_offset,
        given=given,
    )
    calibration = Calibration.of(
        answer, rotation, diagnostics, solution.residuals, curve=curve, settings=settings
    )
    if _one_stream(headings, velocities):
        calibration = calibration.doubted(SAME)
    if odometry_sd is not None:
        return calibration.widened(float(odometry_sd), given=True)
    return calibration.widened(velocities.direction_sd)


SAME = (
    "Headings and velocities are the same numbers: was one stream given twice? Two sensors never"
    " agree to the last digit, and nothing is calibrated."
)


def _one_stream(headings: HeadingSeries, velocities: VelocitySeries) -> bool:
    """Tell whether the velocities point along the headings, row by row, to nine digits."""
    known = np.isin(velocities.t, headings.t) & (velocities.speed > 0)
    if known.sum() < len(headings):
        return False
    d = velocities.v[known] / velocities.speed[known, None]
    e = headings.v[np.isin(headings.t, velocities.t[known])]
    return bool(d.shape == e.shape and np.abs(d - e).max() < 1e-9)


def _check(settings: dict[str, Any]) -> None:
    checks.one_of(settings["offset_method"], "offset_method", OFFSET_METHODS)
    checks.one_of(settings["rotation_method"], "rotation_method", ROTATION_METHODS)
    checks.positive(settings["max_offset"], "max_offset", "seconds")
    if settings["offset"] is not None and not np.isfinite(settings["offset"]):
        raise InputError(f"offset must be a finite number of seconds, not {settings['offset']!r}")
    if settings["odometry_sd"] is not None:
        checks.at_least_zero(settings["odometry_sd"], "odometry_sd")
    if int(settings["seed"]) < 0:
        raise InputError(f"seed must not be negative, not {settings['seed']}")


def _search(
    pair: StreamPair, method: str, max_offset: float, given: float
) -> tuple[OffsetCurve | None, RefinedOffset]:
    streams = pair.headings, pair.track
    if method == "none":
        return None, inliers_at(*streams, given)
    curve = find_offset(*streams, max_offset=max_offset, method=method)
    if method == "profile":
        return curve, refine_offset(*streams, curve.offset)
    return curve, inliers_at(*streams, curve.offset)


def _fall_back(
    pair: StreamPair, found: Solution, refined: RefinedOffset, method: str, given: float | None
) -> tuple[Solution, float]:
    """Return the solution at the given offset, or at 0, or at the best where 0 has no overlap."""
    try:
        return Solution.at(pair, given or 0.0, method), given or 0.0
    except InputError:
        if given is not None:
            raise
        return found, refined.offset


def _rotation(
    solution: Solution,
    used: float,
    evidence: Evidence,
    spread: DirectionSpread,
    matters: float,
    given: float | None,
) -> RotationAnswer:
    """Say how sure the rotation is, if the plausible offsets change it by up to `matters` [rad]."""
    covariance = solution.rotation_covariance(evidence.observable)
    fixed = matters <= np.clip(np.sqrt(np.trace(covariance)), LEAST_CHANGE, MAX_CHANGE)
    # Plausible offsets that are all far from the one that is used speak against it.
    fixed = fixed and evidence.allows(used)
    unknown = unknown_axis(covariance, spread)
    if not evidence.observable and given is None:
        # The change over the plausible offsets is a uniform error of its own.
        covariance = covariance + np.eye(3) * matters**2 / 9
    if unknown is not None:
        covariance = covariance + UNKNOWN * np.outer(unknown, unknown)
    told = evidence.observable or bool(fixed) or given is not None
    return RotationAnswer(
        R_body_cam=solution.R,
        covariance=covariance,
        samples=solution.covariance.samples,
        unknown_axis=unknown,
        determined=unknown is None and told and solution.agrees,
    )


def _bootstrapped(
    pair: StreamPair,
    refined: RefinedOffset,
    solution: Solution,
    evidence: Evidence,
    rotation: RotationAnswer,
    seed: int,
) -> tuple[RotationAnswer, float]:
    """Raise the variances, and the offset's standard deviation [s], to those of a bootstrap."""
    joint = bootstrap(pair, refined, solution.noise, np.random.default_rng(seed))
    # At a smooth peak the plausible offsets reach as far as four standard deviations.
    farthest = float(np.abs(evidence.plausible - evidence.offset).max(initial=0.0))
    floor = max(sampling_floor(pair), 0.25 * farthest)
    sd = max(evidence.sd, float(np.sqrt(joint[3, 3])), floor)
    if np.trace(joint[:3, :3]) > np.trace(rotation.covariance):
        rotation = replace(rotation, covariance=joint[:3, :3])
    return rotation, sd

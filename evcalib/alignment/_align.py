"""From two streams to a calibration with its uncertainty and a verdict."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evcalib import checks
from evcalib.alignment._bootstrap import bootstrap, sampling_floor
from evcalib.alignment._evidence import _Evidence, _near, _offset_interval, _weigh, unknown_axis
from evcalib.alignment._result import Calibration
from evcalib.alignment.observability import (
    DirectionSpread,
    direction_spread,
)
from evcalib.alignment.offset import METHODS as OFFSET_METHODS
from evcalib.alignment.offset import OffsetCurve, find_offset
from evcalib.alignment.offset_refinement import (
    RefinedOffset,
    inliers_at,
    refine_offset,
)
from evcalib.alignment.registration import MIN_PAIRS, Solution, rotation_change
from evcalib.alignment.rotation import METHODS as ROTATION_METHODS
from evcalib.alignment.verdict import Diagnostics, judge
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.kinematics.velocity_track import VelocityTrack, velocity_track
from evcalib.series import HeadingSeries, VelocitySeries
from evcalib.uncertainty import UNKNOWN, rotation_radius, rotation_sd

MAX_CHANGE = np.radians(5.0)
"""A change of the rotation over the plausible offsets beyond this [rad] always matters."""


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
    checks.one_of(offset_method, "offset_method", OFFSET_METHODS)
    checks.one_of(rotation_method, "rotation_method", ROTATION_METHODS)
    checks.positive(max_offset, "max_offset", "seconds")
    if offset is not None and not np.isfinite(offset):
        raise InputError(f"offset must be a finite number of seconds, not {offset!r}")
    if int(seed) < 0:
        raise InputError(f"seed must not be negative, not {seed}")
    offset = None if offset is None else float(offset)
    settings = {
        "max_offset": float(max_offset),
        "offset_method": offset_method,
        "rotation_method": rotation_method,
        "offset": offset,
        "max_gap": max_gap,
        "min_speed": min_speed,
        "hold": hold,
        "smooth": smooth,
        "seed": int(seed),
    }
    headings = headings.usable()
    if len(headings) < MIN_PAIRS:
        raise InputError(
            f"headings: {len(headings)} usable row(s), at least {MIN_PAIRS} are needed"
        )
    track = velocity_track(
        velocities, max_gap=max_gap, min_speed=min_speed, hold=hold, smooth=smooth
    )
    curve, refined = _search(headings, track, offset_method, max_offset, offset or 0.0)
    found = Solution.at(headings, track, refined.offset, rotation_method)
    evidence = _weigh(headings, track, curve, refined, found, max_offset)
    solution, used = found, refined.offset
    if not evidence.observable:
        solution, used = _fall_back(headings, track, found, refined, rotation_method, offset)
    answer = _answer(headings, track, solution, used, evidence, offset)
    if evidence.observable and evidence.sharp_turns:
        rng = np.random.default_rng(seed)
        joint = bootstrap(headings, track, refined, solution.noise, rng)
        # At a smooth peak the plausible offsets reach as far as four standard deviations.
        reach = float(np.abs(evidence.plausible - evidence.offset).max(initial=0.0))
        answer.at_least(joint, max(sampling_floor(headings, track), 0.25 * reach))

    interval = _offset_interval(evidence, answer.offset_sd, solution.covariance.samples, max_offset)
    if not evidence.observable:
        # Nothing is known beyond the search.
        sd = max(answer.offset_sd, (interval[1] - interval[0]) / np.sqrt(12))
        answer.offset_sd = min(sd, max_offset)
    diagnostics = Diagnostics(
        heading_rate_z=evidence.heading_rate_z,
        follows_z=evidence.follows_z,
        spread=answer.spread,
        mixture=solution.mixture,
        noise=solution.noise,
        independent_headings=solution.covariance.samples,
        second_peak_ratio=0.0 if curve is None else curve.second_peak_ratio,
        plausible=evidence.plausible,
        offset_matters=answer.offset_matters,
        offset_sensitivity=float(np.linalg.norm(solution.covariance.offset_sensitivity)),
        agrees=solution.agrees,
        body_turns=_body_turns(velocities),
        at_edge=evidence.at_edge,
        sharp_turns=evidence.sharp_turns,
    )
    verdict = judge(
        diagnostics,
        offset_observable=evidence.observable,
        rotation_observable=answer.determined,
        offset_sd=evidence.offset_sd,
        offset_interval=interval,
        unknown_axis=answer.unknown_axis,
        searched=None if curve is None else max_offset,
        given=offset,
        used=used,
        estimate=refined.offset,
    )
    return Calibration(
        R_body_cam=solution.R,
        offset=used,
        offset_sd=answer.offset_sd,
        offset_interval=interval,
        offset_observable=evidence.observable,
        rotation_sd=rotation_sd(answer.covariance),
        rotation_covariance=answer.covariance,
        rotation_radius=rotation_radius(answer.covariance, samples=solution.covariance.samples),
        rotation_observable=answer.determined,
        unknown_axis=answer.unknown_axis,
        inlier_share=solution.mixture.inliers,
        curve=curve,
        residuals=solution.residuals,
        diagnostics=diagnostics,
        verdict=verdict,
        settings=settings,
    )


def _search(
    headings: HeadingSeries, track: VelocityTrack, method: str, max_offset: float, given: float
) -> tuple[OffsetCurve | None, RefinedOffset]:
    if method == "none":
        return None, inliers_at(headings, track, given)
    curve = find_offset(headings, track, max_offset=max_offset, method=method)
    if method == "profile":
        return curve, refine_offset(headings, track, curve.offset)
    return curve, inliers_at(headings, track, curve.offset)


def _fall_back(
    headings: HeadingSeries,
    track: VelocityTrack,
    found: Solution,
    refined: RefinedOffset,
    method: str,
    given: float | None,
) -> tuple[Solution, float]:
    """Return the solution at the given offset, or at 0, or at the best where 0 has no overlap."""
    try:
        return Solution.at(headings, track, given or 0.0, method), given or 0.0
    except InputError:
        if given is not None:
            raise
        return found, refined.offset


@dataclass(eq=False)
class _Answer:
    """How sure rotation and offset are."""

    covariance: Floats
    offset_sd: float
    offset_matters: float
    spread: DirectionSpread
    unknown_axis: Floats | None
    determined: bool

    def at_least(self, joint: Floats, offset_sd: float) -> None:
        """Raise the variances to those of a joint covariance (4, 4) and an offset's sd [s]."""
        self.offset_sd = max(self.offset_sd, float(np.sqrt(joint[3, 3])), offset_sd)
        if np.trace(joint[:3, :3]) > np.trace(self.covariance):
            self.covariance = joint[:3, :3]


def _answer(
    headings: HeadingSeries,
    track: VelocityTrack,
    solution: Solution,
    used: float,
    evidence: _Evidence,
    given: float | None,
) -> _Answer:
    covariance = solution.rotation_covariance(evidence.observable)
    matters = 0.0
    if not evidence.observable:
        matters = rotation_change(track, headings, solution, evidence.plausible)
    fixed = matters <= np.clip(np.sqrt(np.trace(covariance)), np.radians(1.0), MAX_CHANGE)
    # Plausible offsets that are all far from the one that is used speak against it.
    fixed = fixed and _near(used, evidence.plausible)
    spread = direction_spread(solution.residuals.direction, track)
    unknown = unknown_axis(covariance, spread)
    if not evidence.observable and given is None:
        # The change over the plausible offsets is a uniform error of its own.
        covariance = covariance + np.eye(3) * matters**2 / 9
    if unknown is not None:
        covariance = covariance + UNKNOWN * np.outer(unknown, unknown)
    told = evidence.observable or bool(fixed) or given is not None
    determined = unknown is None and told and solution.agrees
    return _Answer(covariance, evidence.offset_sd, matters, spread, unknown, determined)


def _body_turns(velocities: VelocitySeries) -> float:
    """Return the root mean square yaw rate [rad/s], 0 where it is not known."""
    if velocities.yaw_rate is None:
        return 0.0
    return float(np.sqrt(np.mean(velocities.yaw_rate**2)))

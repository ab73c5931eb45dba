"""From two streams to a calibration with its uncertainty and a verdict."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evcalib import _check, uncertainty
from evcalib.bootstrap import bootstrap
from evcalib.errors import InputError
from evcalib.geometry import rotation_angle
from evcalib.observability import (
    FOLLOW_GATE,
    HEADING_BIAS,
    MAX_ROTATION_SD,
    RATE_GATE,
    DirectionSpread,
    coloured_noise,
    direction_spread,
    heading_rate_test,
    steady_turning,
)
from evcalib.offset import METHODS as OFFSET_METHODS
from evcalib.offset import (
    OffsetCurve,
    RefinedOffset,
    candidate_offsets,
    find_offset,
    inliers_at,
    no_overlap,
    plausible_offsets,
    preference,
    refine_offset,
    weights,
)
from evcalib.rotation import (
    METHODS as ROTATION_METHODS,
)
from evcalib.rotation import (
    Mixture,
    estimate_rotation,
    fit_mixture,
    kabsch,
    misfits,
    tukey_reach,
)
from evcalib.series import HeadingSeries, VelocitySeries
from evcalib.track import VelocityTrack, intervals, velocity_track
from evcalib.verdict import Verdict, judge

Floats = NDArray[np.float64]

MIN_PAIRS = 6
"""Fewest headings that a calibration can rest on."""

RATE_STEP = 0.2
"""Half step [s] of the secant that stands for the derivative of the body direction; noise of the
odometry would pass for turning in a shorter one."""

SHARP = 1.3
"""Ratio of turning rates over 0.1 s and 0.4 s from which turns count as instant."""


@dataclass(frozen=True, eq=False)
class Diagnostics:
    """What the verdict rests on.

    Attributes
    ----------
    heading_rate_z : float
        Variation of the body's heading rate in standard deviations.
    follows_z : float
        Standard errors by which the headings prefer the real track to one that turns steadily.
    spread : DirectionSpread
        Spread of the body directions.
    mixture : Mixture
        Noise of the headings per tangent axis [rad], and shares of inliers, flips and outliers.
    noise : uncertainty.NoiseModel
        Correlation of the residuals over time.
    independent_headings : float
        Effective number of independent headings.
    second_peak_ratio : float
        Height of the curve's second peak over the first.
    plausible : ndarray, shape (k,)
        Offsets [s] on the grid that the data cannot tell from the best one.
    offset_matters : float
        Largest change of the rotation [rad] over the plausible offsets.
    offset_sensitivity : float
        Change of the rotation per second of offset [rad/s].
    at_edge : bool
        Whether the best offset lies on the border of the search.
    sharp_turns : bool
        Whether the motion has instant turns, so that errors are bootstrapped.
    """

    heading_rate_z: float
    follows_z: float
    spread: DirectionSpread
    mixture: Mixture
    noise: uncertainty.NoiseModel
    independent_headings: float
    second_peak_ratio: float
    plausible: Floats
    offset_matters: float
    offset_sensitivity: float
    at_edge: bool
    sharp_turns: bool


@dataclass(frozen=True, eq=False)
class Residuals:
    """Headings against body directions after the calibration.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times [s] on the camera clock.
    turned, direction : ndarray, shape (n, 3)
        Headings in the body frame, and the body directions at the same instants.
    angle : ndarray, shape (n,)
        Angle between the two [rad].
    weight : ndarray, shape (n,)
        Final weight in the rotation.
    """

    t: Floats
    turned: Floats
    direction: Floats
    angle: Floats
    weight: Floats


@dataclass(frozen=True, eq=False)
class Calibration:
    """Offset and rotation between camera and body, with uncertainty and verdict.

    Attributes
    ----------
    R_body_cam : ndarray, shape (3, 3)
        ``v_body = R_body_cam @ v_cam``.
    offset : float
        ``t_body = t_cam + offset`` [s]; where it is not observable, the one given (or 0).
    offset_sd : float
        Standard deviation of the offset [s].
    offset_interval : tuple of (float, float)
        95 % interval of the offset [s].
    offset_observable : bool
        Whether the motion determines the offset.
    rotation_sd : float
        Root mean square angle [rad] expected of the rotation's error.
    rotation_covariance : ndarray, shape (3, 3)
        Covariance of the rotation vector in the body frame [rad^2].
    rotation_radius : float
        Angle [rad] that the rotation's error stays below with 95 % probability.
    rotation_observable : bool
        Whether the rotation is determined: by the motion, or given the offset by the user.
    unknown_axis : ndarray, shape (3,), optional
        Body axis about which the rotation is not known.
    inlier_share : float
        Share of the headings that agree with the calibration.
    curve : OffsetCurve, optional
        Score over the candidate offsets; None with ``offset_method="none"``.
    residuals : Residuals
        Headings against body directions.
    diagnostics : Diagnostics
        What the verdict rests on.
    verdict : Verdict
        The same in words.
    settings : dict
        Parameters of the call.
    """

    R_body_cam: Floats
    offset: float
    offset_sd: float
    offset_interval: tuple[float, float]
    offset_observable: bool
    rotation_sd: float
    rotation_covariance: Floats
    rotation_radius: float
    rotation_observable: bool
    unknown_axis: Floats | None
    inlier_share: float
    curve: OffsetCurve | None
    residuals: Residuals
    diagnostics: Diagnostics
    verdict: Verdict
    settings: dict[str, Any] = field(default_factory=dict)


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

    Parameters
    ----------
    headings : HeadingSeries
        Directions of the camera's motion, in the camera frame, on the camera clock.
    velocities : VelocitySeries
        Velocities of the body, in the body frame, on the odometry clock.
    max_offset : float
        Offsets from -max_offset to max_offset [s] are searched.
    offset_method : {"profile", "trace", "canonical", "scalar", "none"}
        See :func:`evcalib.offset.find_offset`; ``none`` takes `offset` as it is.
    rotation_method : {"tukey", "l1", "kabsch", "gnc", "cca"}
        See :func:`evcalib.rotation.estimate_rotation`.
    offset : float, optional
        Offset [s] to use where the motion does not determine it; 0 if not given.
    max_gap, min_speed, hold, smooth
        See :func:`evcalib.track.velocity_track`.
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
    """
    _check.one_of(offset_method, "offset_method", OFFSET_METHODS)
    _check.one_of(rotation_method, "rotation_method", ROTATION_METHODS)
    _check.positive(max_offset, "max_offset", "seconds")
    if offset is not None and not np.isfinite(offset):
        raise InputError(f"offset must be a finite number of seconds, not {offset!r}")
    settings = {
        "max_offset": max_offset,
        "offset_method": offset_method,
        "rotation_method": rotation_method,
        "offset": offset,
        "max_gap": max_gap,
        "min_speed": min_speed,
        "hold": hold,
        "smooth": smooth,
        "seed": seed,
    }
    headings = headings.usable()
    if len(headings) < MIN_PAIRS:
        raise InputError(
            f"headings: {len(headings)} usable row(s), at least {MIN_PAIRS} are needed"
        )
    track = velocity_track(
        velocities, max_gap=max_gap, min_speed=min_speed, hold=hold, smooth=smooth
    )
    given = 0.0 if offset is None else float(offset)

    curve, refined = _search(headings, track, offset_method, max_offset, given)
    found = _Solution.at(headings, track, refined.offset, rotation_method)
    offsets = candidate_offsets(max_offset)
    inflation = found.covariance.noise.inflation(found.t)
    mask = plausible_offsets(headings, track, offsets, refined, inflation=inflation)

    part = _covered(headings, refined.offset)
    test = heading_rate_test(track, *part)
    steady = steady_turning(track, *part)
    follows = preference(headings, track, steady, refined, inflation=inflation)
    offset_sd = float(np.sqrt(found.covariance.full[3, 3]))
    at_edge = curve is not None and curve.at_edge
    plausible = offsets[mask]
    observable = (
        curve is not None
        and not at_edge
        and refined.curvature < 0
        and test >= RATE_GATE
        and follows >= FOLLOW_GATE
        and offset_sd < max_offset / 4
        and _single(plausible, refined.offset, 8 * offset_sd + 0.05)
    )

    sharp = _has_sharp_turns(track, found, refined.offset)
    solution = found if observable else _Solution.at(headings, track, given, rotation_method)
    matters = 0.0
    if not observable:
        matters = _rotation_change(track, headings, solution, given, plausible)
    covariance = solution.rotation_covariance(observable)
    if observable and sharp:
        rng = np.random.default_rng(seed)
        joint = bootstrap(headings, track, refined, found.covariance.noise, rng)
        offset_sd = max(offset_sd, float(np.sqrt(joint[3, 3])))
        covariance = np.where(
            np.trace(joint[:3, :3]) > np.trace(covariance), joint[:3, :3], covariance
        )
    samples = solution.covariance.samples
    spread = direction_spread(solution.direction, track)
    fixed = matters <= max(np.radians(1.0), float(np.sqrt(np.trace(covariance))))
    if not observable and offset is None and fixed:
        # The change over the plausible offsets is a uniform error of its own.
        covariance = covariance + np.eye(3) * matters**2 / 9
    unknown = _unknown_axis(covariance, spread)
    answered = unknown is None and (observable or fixed or offset is not None)
    interval = _offset_interval(
        observable, refined.offset, offset_sd, samples, plausible, max_offset
    )
    if not observable:
        offset_sd = max(offset_sd, (interval[1] - interval[0]) / np.sqrt(12))

    diagnostics = Diagnostics(
        heading_rate_z=test,
        follows_z=follows,
        spread=spread,
        mixture=solution.mixture,
        noise=solution.covariance.noise,
        independent_headings=samples,
        second_peak_ratio=0.0 if curve is None else curve.second_peak_ratio,
        plausible=plausible,
        offset_matters=matters,
        offset_sensitivity=float(np.linalg.norm(solution.covariance.offset_sensitivity)),
        at_edge=at_edge,
        sharp_turns=sharp,
    )
    verdict = judge(
        diagnostics,
        offset_observable=observable,
        rotation_observable=answered,
        offset_sd=offset_sd,
        unknown_axis=unknown,
        searched=None if curve is None else max_offset,
        given=offset,
        estimate=refined.offset,
    )
    return Calibration(
        R_body_cam=solution.R,
        offset=refined.offset if observable else given,
        offset_sd=offset_sd,
        offset_interval=interval,
        offset_observable=observable,
        rotation_sd=min(float(np.sqrt(np.trace(covariance))), np.pi),
        rotation_covariance=covariance,
        rotation_radius=uncertainty.rotation_radius(covariance, samples=samples),
        rotation_observable=answered,
        unknown_axis=unknown,
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


@dataclass(frozen=True, eq=False)
class _Solution:
    """The rotation at one offset, with what it rests on."""

    R: Floats
    t: Floats
    direction: Floats
    mixture: Mixture
    covariance: uncertainty.JointCovariance
    residuals: Residuals

    @classmethod
    def at(
        cls, headings: HeadingSeries, track: VelocityTrack, offset: float, method: str
    ) -> _Solution:
        begin, end = intervals(headings)
        d = track.directions(begin, end, offset)
        known = np.any(d != 0, axis=1)
        if known.sum() < MIN_PAIRS:
            raise InputError(no_overlap(headings, track, abs(offset)))
        part, d = headings.select(known), d[known]
        w = weights(part)
        estimate = estimate_rotation(part.v, d, method=method, weight=w)
        u = misfits(part.v, d, estimate.R_body_cam)
        mixture = fit_mixture(u, w)
        turned = part.v @ estimate.R_body_cam.T
        reach = np.inf if method in ("kabsch", "cca") else tukey_reach(mixture.sigma)
        rate = _direction_rate(track, part, d, offset, RATE_STEP)
        covariance = uncertainty.joint_covariance(
            part.t, turned, d, rate, w, reach, _body_noise(track, part.t)
        )
        angle = 2 * np.arcsin(np.sqrt(np.clip(u / 2, 0.0, 1.0)))
        residuals = Residuals(part.t, turned, d, angle, estimate.weight)
        return cls(estimate.R_body_cam, part.t, d, mixture, covariance, residuals)

    def rotation_covariance(self, offset_estimated: bool) -> Floats:
        """Return the covariance [rad^2] with the offset estimated along, or as given."""
        covariance = self.covariance
        return covariance.full[:3, :3] if offset_estimated else covariance.rotation_given_offset


def _body_noise(track: VelocityTrack, t: Floats) -> Floats:
    """Return what noise of the odometry adds per axis to a sum over headings at times `t`.

    In such a sum, smoothing does not lessen the noise: what counts is its variance per time.
    """
    sigma, rho = coloured_noise(track.raw, track.segment)
    speed = max(float(np.median(np.linalg.norm(track.v, axis=1))), 1e-12)
    steps = float(np.median(np.diff(track.t)) / np.median(np.diff(t)))
    return steps * (1 + rho) / (1 - rho) * (sigma / speed) ** 2


def _direction_rate(
    track: VelocityTrack, headings: HeadingSeries, d: Floats, offset: float, half: float
) -> Floats:
    """Return the secant derivative of the body direction [1/s], one-sided at the ends."""
    begin, end = intervals(headings)
    before = track.directions(begin, end, offset - half)
    after = track.directions(begin, end, offset + half)
    has_before, has_after = np.any(before != 0, axis=1), np.any(after != 0, axis=1)
    before, after = np.where(has_before[:, None], before, d), np.where(has_after[:, None], after, d)
    span = half * (has_before.astype(float) + has_after)
    return (after - before) / np.maximum(span, 1e-12)[:, None]


def _rotation_change(
    track: VelocityTrack,
    headings: HeadingSeries,
    solution: _Solution,
    offset: float,
    others: Floats,
) -> float:
    """Return the largest change of the rotation [rad] from `offset` to any of `others`.

    Both rotations of a comparison rest on the same headings, those covered at either offset.
    """
    part = headings.select(np.isin(headings.t, solution.t))
    begin, end = intervals(part)
    change = 0.0
    for other in others:
        d = track.directions(begin, end, float(other))
        weight = np.where(np.any(d != 0, axis=1), solution.residuals.weight, 0.0)
        if np.count_nonzero(weight) < MIN_PAIRS:
            continue
        here = kabsch(part.v, solution.direction, weight)
        change = max(change, rotation_angle(here, kabsch(part.v, d, weight)))
    return change


def _has_sharp_turns(track: VelocityTrack, solution: _Solution, offset: float) -> bool:
    """Whether the directions turn much faster over 0.1 s than over 0.4 s, noise allowed for."""
    series = HeadingSeries(solution.t + offset, solution.direction)
    narrow, wide = (
        float(np.mean(np.sum(_direction_rate(track, series, solution.direction, 0.0, h) ** 2, 1)))
        for h in (RATE_STEP / 4, RATE_STEP)
    )
    speed = float(np.median(np.linalg.norm(track.v, axis=1)))
    noise = float(np.max(track.noise)) / max(speed, 1e-12)
    return narrow - 0.5 * (2 * noise / RATE_STEP) ** 2 > SHARP**2 * wide


def _covered(headings: HeadingSeries, offset: float) -> tuple[float, float]:
    begin, end = intervals(headings)
    return float(begin[0]) + offset, float(end[-1]) + offset


def _single(plausible: Floats, offset: float, reach: float) -> bool:
    """Whether all plausible offsets lie around the best one."""
    return bool(np.all(np.abs(plausible - offset) <= reach))


def _unknown_axis(covariance: Floats, spread: DirectionSpread) -> Floats | None:
    """Return the body axis about which the rotation is not determined, if there is one."""
    bias = HEADING_BIAS / max(spread.spread, 1e-9)
    along = float(spread.axis @ covariance @ spread.axis)
    if np.hypot(np.sqrt(max(along, 0.0)), bias) > MAX_ROTATION_SD:
        return spread.axis
    values, vectors = np.linalg.eigh(covariance)
    return vectors[:, -1] if values[-1] > MAX_ROTATION_SD**2 else None


def _offset_interval(
    observable: bool,
    offset: float,
    sd: float,
    samples: float,
    plausible: Floats,
    max_offset: float,
) -> tuple[float, float]:
    if observable:
        half = uncertainty.t_quantile(samples) * sd
        return offset - half, offset + half
    if plausible.size == 0:
        return -max_offset, max_offset
    return float(plausible.min()), float(plausible.max())

"""The rotation at one offset, and what it rests on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from evcalib.alignment._stream_pair import MIN_PAIRS, StreamPair
from evcalib.alignment.offset import WIDE_LOSS_SCALES
from evcalib.alignment.rotation import (
    Mixture,
    cosine_residuals,
    estimate_rotation,
    fit_mixture,
    tukey_scale,
)
from evcalib.arrays import Floats
from evcalib.display import Shown
from evcalib.geometry import rotation_angle
from evcalib.kernels.alignment.rotation import best_rotation
from evcalib.kinematics.velocity_track import VelocityTrack
from evcalib.series import HeadingSeries
from evcalib.uncertainty import JointCovariance, NoiseModel, coloured_noise, joint_covariance

MIN_AGREEING = 6.0
"""Fewest independent headings that must agree with the result, as many as `MIN_PAIRS`: correlated
noise makes two of hundreds (`tests/test_silently_wrong.py`)."""

SHARED = np.radians(0.5)
"""Error [rad] that all headings may share without speaking against them: a part of `HEADING_BIAS`,
so that exact headings with a slow small error agree (`tests/test_align.py`)."""

CHANCE = 3.0
"""Log-likelihood by which agreement must exceed what a free choice of the unknowns can do: odds of
20 to 1, as for a 95 % interval (`tests/test_silently_wrong.py` holds headings that agree by
chance)."""

RATE_STEP = 0.2
"""Half step [s] of the secant that stands for the derivative of the body direction; noise of the
odometry would pass for turning in a shorter one."""

SHARP = 1.3
"""Ratio of turning rates over 0.1 s and 0.4 s from which turns count as instant: between the 1 of a
smooth motion and the 2 of instant turns (their mean square goes with one over the time)."""


@dataclass(frozen=True, eq=False)
class Residuals(Shown):
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
class Solution:
    """The rotation at one offset, with what it rests on."""

    R: Floats
    mixture: Mixture
    covariance: JointCovariance
    residuals: Residuals
    independent: float
    evidence: float
    agreeing: float

    @property
    def agrees(self) -> bool:
        """Whether the headings agree with the odometry beyond what chance would do.

        A rotation and an offset can be chosen such that a few of any headings fit: four unknowns,
        each as finely as the noise, must be paid for by the likelihood.
        """
        price = 4.0 * np.log(np.pi / self.mixture.sigma)
        return self.agreeing >= MIN_AGREEING and self.evidence >= price + CHANCE

    @property
    def noise(self) -> NoiseModel:
        """Correlation of the residuals over time."""
        return self.covariance.noise

    @classmethod
    def at(cls, pair: StreamPair, offset: float, method: str) -> Solution:
        """Register the headings at an offset [s], by a method of `estimate_rotation`.

        Raises
        ------
        InputError
            If the odometry covers too few headings there.
        """
        pair, d = pair.covered(offset)
        part, w = pair.headings, pair.weight
        estimate = estimate_rotation(part.v, d, method=method, weight=w)
        u = cosine_residuals(part.v, d, estimate.R_body_cam)
        mixture = fit_mixture(u, w)
        turned = part.v @ estimate.R_body_cam.T
        scale = np.inf if method in ("kabsch", "cca") else tukey_scale(mixture.sigma)
        rate = _direction_rate(pair, d, offset, RATE_STEP)
        covariance = joint_covariance(
            part.t, turned, d, rate, w, scale, _body_noise(pair.track, part.t)
        )
        angle = 2 * np.arcsin(np.sqrt(np.clip(u / 2, 0.0, 1.0)))
        residuals = Residuals(part.t, turned, d, angle, estimate.weight)
        independent = covariance.noise.independent(part.t, w)
        # Residuals far below what all headings may share say nothing against their number.
        share = covariance.noise.share * mixture.sigma**2 / (mixture.sigma**2 + SHARED**2)
        distinct = replace(covariance.noise, share=share).independent(part.t, w)
        return cls(
            R=estimate.R_body_cam,
            mixture=mixture,
            covariance=covariance,
            residuals=residuals,
            independent=independent,
            evidence=mixture.evidence(u, w) * distinct / u.size,
            agreeing=covariance.samples * distinct / independent,
        )

    def rotation_covariance(self, offset_estimated: bool) -> Floats:
        """Return the covariance [rad^2] with the offset estimated along, or as given."""
        covariance = self.covariance
        return covariance.full[:3, :3] if offset_estimated else covariance.rotation_given_offset


def _body_noise(track: VelocityTrack, t: Floats) -> Floats:
    """Return what noise of the odometry adds per axis to a sum over headings at times `t`.

    In such a sum, smoothing does not lessen the noise: what counts is its variance per time.
    """
    sigma, rho = coloured_noise(track.raw, track.segment, float(np.median(np.diff(track.t))))
    steps = float(np.median(np.diff(track.t)) / np.median(np.diff(t)))
    return steps * (1 + rho) / (1 - rho) * (sigma / track.moving_speed) ** 2


def _direction_rate(pair: StreamPair, d: Floats, offset: float, half: float) -> Floats:
    """Return the secant derivative of the body direction [1/s], one-sided at the ends."""
    before, has_before = pair.directions(offset - half)
    after, has_after = pair.directions(offset + half)
    before, after = np.where(has_before[:, None], before, d), np.where(has_after[:, None], after, d)
    span = half * (has_before.astype(float) + has_after)
    return (after - before) / np.maximum(span, 1e-12)[:, None]


def rotation_change(pair: StreamPair, solution: Solution, others: Floats) -> float:
    """Return the largest change of the rotation [rad] from the solution's offset to any other.

    Both rotations of a comparison rest on the same headings, those covered at either offset.
    Headings that the other offset moves to where the vehicle went another way do not count.
    """
    part = pair.select(np.isin(pair.headings.t, solution.residuals.t))
    v, change = part.headings.v, 0.0
    for other in others:
        d, known = part.directions(float(other))
        weight = np.where(known, solution.residuals.weight, 0.0)
        apart = cosine_residuals(v, d, _registered(v, d, weight))
        weight = np.where(apart < WIDE_LOSS_SCALES[-1], weight, 0.0)
        if np.count_nonzero(weight) < MIN_PAIRS:
            continue
        here = _registered(v, solution.residuals.direction, weight)
        change = max(change, rotation_angle(here, _registered(v, d, weight)))
    return change


def _registered(e: Floats, d: Floats, weight: Floats) -> Floats:
    """Return the rotation of `evcalib.alignment.rotation.kabsch`, several times as fast."""
    return np.asarray(best_rotation((d * weight[:, None]).T @ e))


def has_sharp_turns(track: VelocityTrack, solution: Solution, offset: float) -> bool:
    """Whether the directions turn much faster over 0.1 s than over 0.4 s, noise allowed for."""
    direction = solution.residuals.direction
    pair = StreamPair.of(HeadingSeries(solution.residuals.t + offset, direction), track)
    narrow, wide = (
        float(np.mean(np.sum(_direction_rate(pair, direction, 0.0, h) ** 2, 1)))
        for h in (RATE_STEP / 4, RATE_STEP)
    )
    noise = float(np.max(track.noise)) / track.moving_speed
    return narrow - 0.5 * (2 * noise / RATE_STEP) ** 2 > SHARP**2 * wide

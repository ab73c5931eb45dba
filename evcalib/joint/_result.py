"""What the joint refinement returns, and what it takes for granted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evcalib._moved import renamed_fields
from evcalib.alignment.offset import OffsetCurve
from evcalib.arrays import Floats
from evcalib.display import Shown
from evcalib.joint._model_checks import ModelError


@renamed_fields(spin_sd="yaw_rate_sd")
@dataclass(frozen=True)
class Systematic:
    """What all observations of a drive share, however many they are.

    Attributes
    ----------
    lag, lag_sd : float
        How far corners trail their true place along their flow, and how sure that is [px].
    time_sd : float
        Standard deviation of what remains as a delay [s], whatever the flow.
    rotation_sd : float
        Standard deviation of what remains as a rotation, per axis [rad].
    yaw_rate_sd : float
        Standard deviation of the yaw rate that the odometry does not tell [rad/s], besides noise.
    """

    lag: float = 0.0
    lag_sd: float = 0.1
    time_sd: float = 0.0015
    rotation_sd: float = float(np.radians(0.06))
    yaw_rate_sd: float = 0.001


SYSTEMATIC = Systematic()
"""What simulated recordings of many scenes leave (notebook 06)."""


@renamed_fields(sightings="observations")
@dataclass(frozen=True, eq=False)
class JointRefinement(Shown):
    """Rotation, offset and position from all tracks.

    Attributes
    ----------
    R_body_cam : ndarray, shape (3, 3)
        Rotation.
    offset : float
        ``t_body = t_cam + offset`` [s].
    lag : float
        How far corners trail [px].
    lag_sd : float
        Its standard deviation [px].
    position : ndarray, shape (3,)
        Of the camera in the body frame [m]; z as it was given.
    covariance : ndarray, shape (6, 6)
        Of the rotation vector in the body frame [rad], the offset [s], and x and y [m], the lag's
        uncertainty and the dependence of observations counted in; zeros for what was given.
    samples : float
        Stretches of motion that count as independent.
    noise : float
        Standard deviation of an observation per axis [px].
    inlier_share : float
        Share of the observations that the fit follows.
    tracks, observations : int
        What entered.
    span : tuple of float
        First and last time of these [s], on the camera clock.
    curve : OffsetCurve, optional
        How well the tracks are met over the candidate offsets, each with its best rotation; None
        where the offset was given.
    plausible : ndarray, shape (k,)
        Candidates [s] that fit as well as the best.
    converged : bool
        Whether the last step was small.
    drift : ModelError
        How fast the offset grows [s/s]; `offset` holds in the middle.
    distortion : ModelError
        By how much directions of travel differ between the streams beyond a rotation [rad], as the
        cosine and the sine of twice their angle.
    turning : float
        Standard deviation of the yaw rate that the odometry does not tell [rad/s], as taken.
    """

    R_body_cam: Floats
    offset: float
    lag: float
    lag_sd: float
    position: Floats
    covariance: Floats
    samples: float
    noise: float
    inlier_share: float
    tracks: int
    observations: int
    span: tuple[float, float]
    curve: OffsetCurve | None
    plausible: Floats
    converged: bool
    drift: ModelError
    distortion: ModelError
    turning: float

"""The gyro of the camera within a calibration: its bias, and whether it agrees with all else."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from evcalib import checks
from evcalib.alignment import Calibration
from evcalib.arrays import Floats
from evcalib.display import Shown
from evcalib.errors import InputError
from evcalib.geometry import angle_between
from evcalib.heading import HeadingEstimate
from evcalib.heading.gyro import (
    LARGEST_BIAS,
    SURE,
    TURNED,
    corrected,
    in_degrees,
    restabilised,
)
from evcalib.imu import Attitude, ImuSeries, YawAgreement, attitude_of, yaw_agreement
from evcalib.pipeline._assessment import RefinedCalibration
from evcalib.series import VelocitySeries

SCALE, WRONG_SCALE = 0.1, 1.5
"""A yaw of the gyro that is off by this share of the wheels' is told; by this factor it is refused:
degrees for radians are 57.  Choices: wheels that slip are off by some percent."""


FAR = np.radians(60.0)
"""An axis of yaw so far off the body's z [rad] is told however uncertain the rotation is: a gyro
with a wrong sign leaves it so, and lets nothing be determined."""

WITHOUT = "Or try it without the IMU: where its axes, signs, unit or clock are wrong, nothing fits."


@dataclass(frozen=True, eq=False)
class Gyro(Shown):
    """What a calibration took from the gyro, and how far that is borne out.

    Attributes
    ----------
    attitude : Attitude
        Of the camera, without bias, and turned as the events show it where that was asked for.
    R_cam_imu : ndarray, shape (3, 3)
        From the axes of the IMU to those of the camera.
    bias : ndarray, shape (3,)
        What was subtracted from its rates [rad/s], in its own axes.
    yaw : YawAgreement
        The gyro against the wheels.
    rate_sd : float
        What its rates may still be off by all the time, about any axis [rad/s].
    notes : tuple of str
        What the user should know.
    """

    attitude: Attitude
    R_cam_imu: Floats
    bias: Floats
    yaw: YawAgreement
    rate_sd: float
    notes: tuple[str, ...] = ()

    def settings(self) -> dict[str, object]:
        """Return what the report and the result files say of it."""
        return {
            "bias_deg_s": tuple(np.degrees(self.bias).tolist()),
            "R_cam_imu": self.R_cam_imu.tolist(),
            "bias_sd_deg_s": float(np.degrees(self.rate_sd)),
            "samples": int(self.attitude.t.size),
        }

    def yaw_for(self, velocities: VelocitySeries, aligned: Calibration) -> VelocitySeries:
        """Return velocities with the yaw rate of the gyro, where they have none.

        The body's z axis is that of the alignment, if it determines rotation and offset.
        """
        answers = aligned.rotation_observable and aligned.offset_observable
        if velocities.yaw_rate is not None or not answers:
            return velocities
        up = aligned.R_body_cam[2]
        yaw = np.interp(velocities.t - aligned.offset, self.attitude.t, self.attitude.rate @ up)
        return replace(velocities, yaw_rate=yaw)

    def doubts(self, calibration: RefinedCalibration) -> tuple[str, ...]:
        """Return what the gyro says against a calibration: its axis of yaw is not the body's z."""
        axis = self.yaw.axis
        if axis is None:
            return ()
        up = calibration.R_body_cam @ self.R_cam_imu @ (axis / np.linalg.norm(axis))
        apart = float(angle_between(up, np.array([0.0, 0.0, 1.0])))
        sd = float(np.hypot(self.yaw.axis_sd, calibration.rotation_sd))
        if apart < max(TURNED, min(SURE * sd, FAR)):
            return ()
        return (
            f"Where the wheels turn, the gyro turns about an axis {np.degrees(apart):.1f} deg off"
            f" the body's z (error {np.degrees(sd):.1f}): the rotation, or how the IMU is turned"
            " against the camera (--imu-rotation), is not right.",
        )


def gyro_of(
    imu: ImuSeries, R_cam_imu: Floats | None, velocities: VelocitySeries, max_offset: float
) -> Gyro:
    """Take the bias of a gyro from a drive, and compare its yaw with that of the wheels.

    Raises
    ------
    InputError
        If the gyro turns by a multiple of what the wheels say, or a part of it, or far too much.
    """
    checks.instance(imu, "imu", ImuSeries)
    R = np.eye(3) if R_cam_imu is None else np.asarray(R_cam_imu, dtype=np.float64)
    yaw = yaw_agreement(imu, velocities.t, velocities.yaw_rate, max_offset)
    notes = [f"gyro: bias of {in_degrees(yaw.bias)} deg/s, from the mean of the drive"]
    if yaw.axis is not None:
        scale, sd = float(np.linalg.norm(yaw.axis)), yaw.axis_sd
        off = abs(scale - 1.0)
        if max(scale, 1 / scale) > WRONG_SCALE and off > SURE * sd:
            raise InputError(
                f"the gyro turns by {scale:.3g} times (+-{sd:.2g}) what the yaw rate of the wheels"
                " says: is one of them in degrees per second (--imu-unit deg/s, or a column map for"
                " yaw_rate), or is the IMU that of something else?"
            )
        if off > max(SCALE, SURE * sd):
            notes.append(
                f"the gyro turns by {scale:.2f} times (+-{sd:.2f}) what the wheels say: the gyro's"
                " was taken for the camera, the wheels' for the path"
            )
    if np.linalg.norm(yaw.bias) > LARGEST_BIAS + SURE * yaw.bias_sd:
        raise InputError(
            f"the gyro turns by {in_degrees(yaw.bias)} deg/s all the time, which no bias is, and of"
            " which the wheels know nothing: is its unit right (--imu-unit), is it the camera's,"
            " and are its rates rates (not angles)?"
        )
    attitude = attitude_of(imu, R, yaw.bias)
    return Gyro(attitude, R, yaw.bias, yaw, yaw.bias_sd, notes=tuple(notes))


def against_events(
    gyro: Gyro, imu: ImuSeries, estimate: HeadingEstimate, *, focal: float, turn: bool
) -> tuple[Gyro, HeadingEstimate]:
    """Correct bias, and turn if asked for, by what the events show; turn the matches back anew.

    Parameters
    ----------
    gyro : Gyro
        As it was taken at first.
    imu : ImuSeries
        Its samples.
    estimate : HeadingEstimate
        Made with its attitude, the correspondences kept.
    focal : float
        Pixels per radian.
    turn : bool
        Whether how it is turned is corrected, where the events tell it.

    Raises
    ------
    InputError
        If the events contradict the gyro.
    """
    better = corrected(
        imu,
        gyro.attitude,
        estimate,
        focal=focal,
        R_cam_imu=gyro.R_cam_imu,
        bias=gyro.bias,
        bias_sd=2.0 * gyro.yaw.bias_sd,
        turn=turn,
    )
    found = estimate.correspondences
    assert found is not None
    turned = restabilised(found, gyro.attitude, better.attitude)
    changed = replace(
        gyro,
        attitude=better.attitude,
        R_cam_imu=better.R_cam_imu,
        bias=better.bias,
        rate_sd=better.bias_sd,
        notes=(*gyro.notes, *better.notes),
    )
    return changed, replace(estimate, correspondences=turned)


def doubted(calibration: RefinedCalibration, gyro: Gyro | None) -> RefinedCalibration:
    """Return a calibration with what the gyro says against it among the doubts of its verdict."""
    if gyro is None:
        return calibration
    verdict, doubts = calibration.verdict, gyro.doubts(calibration)
    if not (calibration.rotation_observable and calibration.offset_observable):
        verdict = replace(verdict, advice=(*verdict.advice, WITHOUT))
    return replace(calibration, verdict=verdict.doubted(*doubts))

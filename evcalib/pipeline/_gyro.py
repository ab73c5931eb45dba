"""The gyro of the camera within a calibration: its bias, and whether it agrees with all else."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from evcalib import checks
from evcalib.alignment import Calibration
from evcalib.arrays import Floats
from evcalib.display import Shown
from evcalib.errors import InputError
from evcalib.geometry import angle_between, rotation_vector_to_matrix
from evcalib.heading import HeadingEstimate
from evcalib.heading.gyro import MOUNTED, GyroError, gyro_error, in_degrees, restabilised
from evcalib.imu import Attitude, ImuSeries, YawAgreement, attitude_of, yaw_agreement
from evcalib.pipeline._assessment import RefinedCalibration
from evcalib.series import VelocitySeries

SURE = 4.0
"""Standard deviations beyond which a contradiction is one."""

SCALE, WRONG_SCALE = 0.1, 1.5
"""A yaw of the gyro that is off by this share of the wheels' is told; by this factor it is refused:
degrees for radians are 57.  Choices: wheels that slip are off by some percent."""

TURNED, WRONGLY_TURNED = np.radians(3.0), np.radians(15.0)
"""A gyro that is turned by so much [rad] against what was given is told, or refused.  Choices: a
gyro is mounted by hand to a degree or two; in a wrong axis it is off by 90 degrees."""


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
    error : GyroError, optional
        What the events said of the first guess of the bias and of the turn; None with few matches.
    notes : tuple of str
        What the user should know.
    """

    attitude: Attitude
    R_cam_imu: Floats
    bias: Floats
    yaw: YawAgreement
    error: GyroError | None = None
    notes: tuple[str, ...] = ()

    def settings(self) -> dict[str, object]:
        """Return what the report and the result files say of it."""
        return {
            "bias_deg_s": tuple(np.degrees(self.bias).tolist()),
            "R_cam_imu": self.R_cam_imu.tolist(),
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
        if apart < max(TURNED, SURE * sd):
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
        If the gyro turns by a multiple of what the wheels say, or a part of it.
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
    return Gyro(attitude_of(imu, R, yaw.bias), R, yaw.bias, yaw, notes=tuple(notes))


def against_events(
    gyro: Gyro, imu: ImuSeries, estimate: HeadingEstimate, *, turn: bool
) -> tuple[Gyro, HeadingEstimate]:
    """Correct bias, and turn if asked for, by what the events show; turn the matches back anew.

    Raises
    ------
    InputError
        If the events contradict how the gyro is turned.
    """
    bias_sd = 2.0 * gyro.yaw.bias_sd
    error = gyro_error(estimate, gyro.attitude, bias_sd=bias_sd)
    if error is None:
        return gyro, estimate
    told = bool(np.isfinite(error.angle_sd))
    off = f"{np.degrees(error.angle):.1f} deg (+-{np.degrees(error.angle_sd):.1f})"
    notes, small = [], np.zeros(3)
    if turn and not told:
        notes.append(
            f"the camera turns too little to tell how the gyro is turned against it ({off})"
        )
    elif turn:
        small = error.seen
        notes.append(
            f"the gyro is turned by {off} against what was given, by the events: corrected"
        )
    elif told and error.angle > max(WRONGLY_TURNED, SURE * error.angle_sd):
        raise InputError(
            f"the events contradict the gyro: it is turned by {off} against the camera as it was"
            " given; give how the IMU is turned (--imu-rotation), or let it be found"
            " (--imu-rotation estimate)"
        )
    elif told and error.angle > max(TURNED, SURE * error.angle_sd):
        notes.append(
            f"the gyro is turned by {off} against what was given, by the events"
            " (--imu-rotation estimate corrects that)"
        )
    if not small.any():
        # A turn that is not corrected must not take a part of the bias with it.
        alone = gyro_error(estimate, gyro.attitude, bias_sd=bias_sd, turn_sd=MOUNTED)
        assert alone is not None
        error = replace(error, bias=alone.bias)
    R = rotation_vector_to_matrix(small) @ gyro.R_cam_imu
    # The bias was found in the axes of the camera as these were taken to be.
    bias = gyro.bias + gyro.R_cam_imu.T @ error.bias
    attitude = attitude_of(imu, R, bias)
    found = estimate.correspondences
    assert found is not None
    estimate = replace(estimate, correspondences=restabilised(found, gyro.attitude, attitude))
    notes.append(f"gyro: bias of {in_degrees(bias)} deg/s, by the events")
    better = replace(
        gyro, attitude=attitude, R_cam_imu=R, bias=bias, error=error,
        notes=(*gyro.notes, *notes),
    )  # fmt: skip
    return better, estimate


def doubted(calibration: RefinedCalibration, doubts: tuple[str, ...]) -> RefinedCalibration:
    """Return a calibration with further doubts in its verdict."""
    if not doubts:
        return calibration
    verdict = calibration.verdict
    more = replace(verdict, reasons=(*verdict.reasons, *doubts), doubts=(*verdict.doubts, *doubts))
    return replace(calibration, verdict=more)

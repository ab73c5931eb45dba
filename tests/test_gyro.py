"""A gyro in the camera, on drives that tilt, shake and turn; the truth is known."""

from dataclasses import replace

import numpy as np
import pytest
from shaken import calibrated, estimate_of, shaken_drive

from data_tools.simulation.random_drives import RECORDED, wobble
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.geometry import (
    LOOKS_FORWARD,
    angle_between,
    rotation_angle,
    rotation_vector_to_matrix,
    rpy_to_matrix,
)
from evcalib.heading.gyro import as_seen, gyro_error, restabilised
from evcalib.imu import ImuSeries, attitude_of
from evcalib.pipeline._gyro import against_events, gyro_of

CAMERA = Camera(240, 180, fx=200.0, fy=200.0, cx=119.5, cy=89.5)


def drive_of(seed, kind="sweep", yaw=0.0, **more):
    """Return a drive, its gyro, and the truth: rotation, offset, bias."""
    rng = np.random.default_rng([seed, 7])
    drive = RECORDED[kind](rng, 10.0, 0.5)
    if yaw:
        drive = replace(drive, yaw_rate=wobble(rng, yaw))
    R = rpy_to_matrix(np.radians(rng.uniform(-20, 20, 3))) @ LOOKS_FORWARD
    offset, bias = float(rng.uniform(-0.4, 0.4)), np.radians(rng.normal(0, 1.5, 3))
    made = shaken_drive(drive, rng, camera=CAMERA, R_body_cam=R, offset=offset, bias=bias, **more)
    return *made, (R, offset, bias)


@pytest.mark.parametrize(
    ("kind", "more"), [("fingers", {"tilt": 1.0}), ("sweep", {"vibration": 0.5})]
)
def test_tilt_and_vibration_do_no_harm(kind, more):
    drive, imu, (R, offset, bias) = drive_of(11, kind, **more)
    found, gyro = calibrated(drive, imu)
    assert found.rotation_observable
    assert abs(found.offset - offset) < max(4 * found.offset_sd, 0.005)
    assert np.degrees(rotation_angle(found.R_body_cam, R)) < 0.6
    assert np.degrees(np.linalg.norm(gyro.bias - bias)) < 0.3


def test_a_gyro_that_is_turned_is_told_or_corrected():
    """Turned by 10 degrees about the optical axis, on a vehicle that yaws.

    How it is turned about the axis of the yaw does not show; where that axis lies in the camera
    must come out right.
    """
    small = rotation_vector_to_matrix(np.radians([0.0, 0.0, 10.0]))
    drive, imu, (R, _, bias) = drive_of(12, yaw=0.8, R_cam_imu=small)
    first = gyro_of(imu, None, drive.velocities, 1.0)
    estimate = estimate_of(drive, first.attitude)
    up = R.T @ [0.0, 0.0, 1.0]

    def off(R_cam_imu):
        return np.degrees(angle_between(R_cam_imu @ small.T @ up, up))

    assert off(np.eye(3)) > 8
    error = gyro_error(estimate, first.attitude)
    assert np.isfinite(error.angle_sd)
    assert error.angle < np.radians(15)
    assert off(rotation_vector_to_matrix(error.seen)) < 2
    told, _ = against_events(first, imu, estimate, focal=CAMERA.focal, turn=False)
    assert "--imu-rotation estimate" in " ".join(told.notes)
    mended, _ = against_events(first, imu, estimate, focal=CAMERA.focal, turn=True)
    assert off(mended.R_cam_imu) < 2
    assert np.degrees(np.linalg.norm(mended.bias - bias)) < 1.0


def test_a_gyro_in_degrees_is_refused():
    drive, imu, _ = drive_of(13, yaw=0.3)
    with pytest.raises(InputError, match="degrees per second"):
        gyro_of(ImuSeries(imu.t, 20 * imu.rate), None, drive.velocities, 1.0)


def test_correspondences_are_turned_back_and_forth():
    drive, imu, _ = drive_of(14, vibration=0.3)
    old, new = attitude_of(imu), attitude_of(imu, bias=[0.1, 0.0, -0.1])
    raw, found = estimate_of(drive).correspondences, estimate_of(drive, old).correspondences
    again = restabilised(found, old, new)
    np.testing.assert_allclose(as_seen(again, new).r2, as_seen(found, old).r2, atol=1e-12)
    rows = {tuple(row) for row in np.round(raw.r2, 9)}
    assert all(tuple(row) in rows for row in np.round(as_seen(found, old).r2[:50], 9))


def test_wrong_axes_are_refused_and_the_right_ones_named():
    drive, imu, _ = drive_of(15, "sweep", vibration=0.4)
    given = replace(imu, rate=imu.rate[:, [1, 2, 0]])
    with pytest.raises(InputError, match=r"contradict the gyro.*--imu-rotation=z,x,y\)"):
        calibrated(drive, given)


def test_a_yaw_with_the_wrong_sign_is_told():
    """A body that yaws and neither tilts nor shakes: matches hardly tell which way it turns."""
    drive, imu, _ = drive_of(16, yaw=0.3)
    try:
        found, _ = calibrated(drive, replace(imu, rate=-imu.rate))
    except InputError as error:
        told = str(error)
    else:
        told = " ".join(found.verdict.doubts)
        if not (found.rotation_observable and found.offset_observable):
            told += " ".join(found.verdict.advice)
    words = ("contradict the gyro", "off the body's z", "without the IMU")
    assert any(word in told for word in words)

"""Drives whose body tilts and shakes, one level below events, with a gyro in the camera."""

from dataclasses import replace

import numpy as np
from scipy import signal
from scipy.spatial.transform import Rotation

from data_tools.simulation.trajectory import Trajectory
from data_tools.studies import sighting_drives as made
from data_tools.studies.sightings import RATE, USUAL, sighted
from evcalib.heading import Counts, HeadingWindows
from evcalib.imu import ImuSeries
from evcalib.pipeline import calibrate_estimate
from evcalib.pipeline._gyro import against_events, gyro_of

GYRO_RATE = 1000.0
GYRO_NOISE = np.radians(0.1)
"""Standard deviation of a sample [rad/s]: that of the DAVIS346 at rest in davis346.aedat4."""


def shaken(drive, rng, tilt, vibration):
    """Return a trajectory whose body pitches and rolls with its acceleration, and vibrates.

    `tilt` [deg per m/s^2] through a spring and damper of 2 Hz and 0.4; `vibration` [deg rms per
    axis] of 5 to 15 Hz.
    """
    path = Trajectory.of_drive(drive)
    t = path.t
    h = t[1] - t[0]
    v = drive.velocity(t)
    a = np.gradient(v, t, axis=0)
    w, d = 2 * np.pi * 2.0, 0.4
    spring = signal.cont2discrete(([w * w], [1, 2 * d * w, w * w]), h)[:2]
    lagged = signal.lfilter(spring[0].ravel(), spring[1], a, axis=0)
    angles = np.radians(tilt) * np.column_stack([lagged[:, 1], -lagged[:, 0], np.zeros(t.size)])
    for axis in range(3):
        f, phase = rng.uniform(5, 15, 6), rng.uniform(0, 2 * np.pi, 6)
        waves = np.sin(2 * np.pi * np.multiply.outer(t, f) + phase).sum(axis=1) / np.sqrt(3)
        angles[:, axis] += np.radians(vibration) * waves
    turn = Rotation.from_matrix(path.rotation) * Rotation.from_rotvec(angles)
    return Trajectory(t, path.position, turn.as_matrix())


def gyro_series(path, rng, R_body_cam, offset, *, R_cam_imu=None, bias=(0.0, 0.0, 0.0)):
    """Return what a gyro in the camera measures, on the camera's clock, `bias` in rad/s."""
    t = np.arange(max(path.t[0] - offset, 0.0), path.t[-1] - offset, 1 / GYRO_RATE)
    rate = path.rate_at(t + offset) @ R_body_cam @ (np.eye(3) if R_cam_imu is None else R_cam_imu)
    return ImuSeries(t, rate + bias + GYRO_NOISE * rng.standard_normal(rate.shape))


def shaken_drive(drive, rng, *, camera, R_body_cam, offset, tilt=0.0, vibration=0.0,
                 corners=USUAL, lever=(0.0, 0.0, 0.0), told=True, **gyro):  # fmt: skip
    """Return observations, velocities and a gyro of one drive."""
    path = shaken(drive, rng, tilt, vibration)
    t = np.arange(np.ceil(max(-offset, 0.0) * RATE), (drive.duration - offset) * RATE) / RATE
    t = t[(t + offset >= 0) & (t + offset <= drive.duration)]
    still = lambda when: np.zeros((when.size, 3))  # noqa: E731 (the path itself shakes)
    found = sighted(path, rng, camera, R_body_cam, corners, lever, still, t, t + offset)
    fault = replace(made.Fault(), yaw_told=told)
    return made.SightingDrive(
        sightings=found,
        camera=camera,
        velocities=made._velocities(drive, rng, 0.01, (), fault),
        R_body_cam=R_body_cam,
        offset=offset,
        false=corners.false,
        seed=int(rng.integers(1 << 31)),
    ), gyro_series(path, rng, R_body_cam, offset, **gyro)


def estimate_of(drive, attitude=None):
    """Return headings, turned back by an attitude."""
    windows = HeadingWindows(made.OPTIONS, drive.camera.focal, drive._match, attitude=attitude)
    for keyframe in made._keyframes(drive.sightings, drive.camera):
        windows.add(keyframe)
    return windows.result(Counts(keyframes=drive.sightings.t.size))


def calibrated(drive, imu=None, *, R_cam_imu=None, turn=False, max_offset=1.0, position=None):
    """Return the calibration, with a gyro or without, and what became of the gyro."""
    gyro = None
    if imu is not None:
        gyro = gyro_of(imu, R_cam_imu, drive.velocities, max_offset)
    estimate = estimate_of(drive, None if gyro is None else gyro.attitude)
    if gyro is not None:
        gyro, estimate = against_events(gyro, imu, estimate, focal=drive.camera.focal, turn=turn)
    final = calibrate_estimate(
        estimate, drive.velocities, focal=drive.camera.focal, gyro=gyro,
        max_offset=max_offset, camera_position=position,
    )  # fmt: skip
    return final, gyro

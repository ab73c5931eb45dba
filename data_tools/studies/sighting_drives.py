"""Simulated drives one level below events: corners as a camera observes them, and wheels.

Simulating and reading events takes most of a calibration's time.  Here corners, points in space,
are projected into keyframes by the moving camera, with noise, deaths, wrong matches and movers;
from there on the library's own code makes headings and tracks of them.  So thousands of
calibrations can be judged, also with models that are wrong on purpose (`Fault`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lsim

from data_tools.simulation.drives import Drive
from data_tools.simulation.random_drives import wobble
from data_tools.simulation.trajectory import Trajectory
from data_tools.studies.sightings import (
    RATE,
    USUAL,
    Corners,
    Integers,
    Sightings,
    Spans,
    outside,
    sighted,
)
from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.heading import (
    REACH,
    Counts,
    HeadingEstimate,
    HeadingOptions,
    HeadingWindows,
    KeyframeMatches,
)
from evcalib.pipeline import RefinedCalibration, calibrate_estimate
from evcalib.series import VelocitySeries

STEPS = 5
"""Longest span of a pair: 0.6 s, where `evcalib.calibrate` has 0.7."""

OPTIONS = HeadingOptions(rate=RATE, max_baseline=STEPS / RATE, keep_correspondences=True)
"""Of `evcalib.estimate_headings`, for fewer keyframes."""

GATHERED = 0.06
"""Time over which a keyframe gathers its corners [s]; pairs do not share events."""

WHEEL_RATE = 50.0

SUSPENSION = 2.0, 0.4
"""Frequency [Hz] and damping of a body on its wheels."""

VIBRATION = 5.0, 15.0
"""Band of the vibration [Hz]."""


@dataclass(frozen=True)
class Fault:
    """Errors of the model, which the calibration is not told of.

    Attributes
    ----------
    drift : float
        The odometry clock gains so much on the camera's [s/s]; no error in the middle of the drive.
    latency, latency_period : float
        The camera's delay swings by so much [s] with this period [s].
    quantum : float
        Times of the odometry are cut to whole multiples of it [s].
    jitter : float
        Standard deviation of the odometry's times [s].
    radius : float
        Velocities as told, over the true ones.
    slip : float
        Sideways velocity is told too great by this share.
    steering : float
        Velocities are told turned by so much [rad].
    yaw, yaw_told : float, bool
        The body wobbles by so much [rad/s], and whether the odometry tells.
    lever : tuple of float
        Position of the camera in the body frame [m].
    focal : float
        Focal length as told, over the true one.
    centre : tuple of float
        Principal point as told less the true one [px].
    tilt : float
        The body pitches and rolls by so much per acceleration [rad per m/s^2], after a swing: nose
        up when it speeds up, out of a curve.
    vibration : float
        The body turns to and fro about three axes, each by so much, rms [rad].
    """

    drift: float = 0.0
    latency: float = 0.0
    latency_period: float = 6.0
    quantum: float = 0.0
    jitter: float = 0.0
    radius: float = 1.0
    slip: float = 0.0
    steering: float = 0.0
    yaw: float = 0.0
    yaw_told: bool = True
    lever: tuple[float, float, float] = (0.0, 0.0, 0.0)
    focal: float = 1.0
    centre: tuple[float, float] = (0.0, 0.0)
    tilt: float = 0.0
    vibration: float = 0.0


@dataclass(frozen=True, eq=False)
class SightingDrive:
    """Observations of corners and velocities of one drive, and the truth.

    Attributes
    ----------
    sightings : Sightings
        Corners, in the pixels of the camera.
    camera : Camera
        As the calibration is told.
    velocities : VelocitySeries
        As the odometry tells.
    R_body_cam, offset : ndarray, float
        The truth.
    false, seed : float, int
        Share of wrong matches, and what they are drawn from.
    """

    sightings: Sightings
    camera: Camera
    velocities: VelocitySeries
    R_body_cam: Floats
    offset: float
    false: float
    seed: int

    def estimate(self) -> HeadingEstimate:
        """Return headings and correspondences, made as the library makes them of matches."""
        windows: HeadingWindows[_Keyframe]
        windows = HeadingWindows(OPTIONS, self.camera.focal, self._match)
        keyframes = _keyframes(self.sightings, self.camera)
        for keyframe in keyframes:
            windows.add(keyframe)
        return windows.result(
            Counts(keyframes=len(keyframes), keypoints=len(self.sightings.corner))
        )

    def calibrate(self, *, max_offset: float = 1.0) -> RefinedCalibration:
        """Return what `evcalib.calibrate` makes of it."""
        return calibrate_estimate(
            self.estimate(), self.velocities, focal=self.camera.focal, max_offset=max_offset
        )

    def _match(self, before: _Keyframe, after: _Keyframe) -> KeyframeMatches | None:
        """Match the corners of two keyframes, some of them wrongly."""
        if before.t > after.t - GATHERED:
            return None
        _, i, j = np.intersect1d(before.corner, after.corner, True, return_indices=True)
        xy, bearings = after.xy[j], after.bearings[j]
        reach = REACH * self.camera.width
        if self.false:
            # Another corner in the search window is as likely here as there.
            rng = np.random.default_rng([self.seed, before.number, after.number])
            wrong = np.flatnonzero(rng.random(i.size) < self.false)
            shift = reach * rng.uniform(-1.0, 1.0, (wrong.size, 2))
            xy[wrong] = np.clip(
                before.xy[i[wrong]] + shift, 0, [self.camera.width - 1, self.camera.height - 1]
            )
            bearings[wrong] = self.camera.bearings(xy[wrong])
        near = np.hypot(*(xy - before.xy[i]).T) < reach
        i, xy, bearings = i[near], xy[near], bearings[near]
        if not i.size:
            return None
        t = np.full(i.size, before.t), np.full(i.size, after.t)
        return KeyframeMatches.between(
            before, after, (before.xy[i], xy), (before.bearings[i], bearings), t
        )


@dataclass(frozen=True, eq=False)
class _Keyframe:
    number: int
    t: float
    corner: Integers
    xy: Floats
    bearings: Floats


def _keyframes(sightings: Sightings, camera: Camera) -> list[_Keyframe]:
    bearings = camera.bearings(sightings.xy)
    ends = np.searchsorted(sightings.keyframe, np.arange(sightings.t.size + 1))
    number = np.rint(sightings.t * RATE).astype(np.int64)
    return [
        _Keyframe(int(number[k]), float(sightings.t[k]), sightings.corner[rows],
                  sightings.xy[rows], bearings[rows])
        for k in range(sightings.t.size)
        for rows in [slice(ends[k], ends[k + 1])]
    ]  # fmt: skip


def sight(
    drive: Drive,
    rng: np.random.Generator,
    *,
    camera: Camera,
    R_body_cam: Floats,
    offset: float,
    corners: Corners = USUAL,
    odometry_noise: float = 0.01,
    odometry_gaps: Spans = (),
    fault: Fault = Fault(),
) -> SightingDrive:
    """Observe the corners around a drive, and read its wheels.

    Parameters
    ----------
    drive : Drive
        The motion, on the body's clock.
    rng : numpy.random.Generator
        Source of all randomness.
    camera : Camera
        The true one.
    R_body_cam, offset : ndarray, float
        Mounting, and ``t_body = t_cam + offset`` [s].
    corners : Corners
        What is seen.
    odometry_noise : float
        Standard deviation of a velocity per axis [m/s].
    odometry_gaps : tuple of (float, float)
        Intervals [s] of body time without velocities.
    fault : Fault
        What is wrong with the model.
    """
    if fault.yaw:
        drive = replace(drive, yaw_rate=wobble(rng, fault.yaw))
    path = Trajectory.of_drive(drive)
    t = np.arange(np.ceil(max(-offset, 0.0) * RATE), (drive.duration - offset) * RATE) / RATE
    t = t[outside(t, corners.gaps)]
    body = t + offset + _clock_error(fault, t, rng)
    t, body = (some[(body >= 0) & (body <= drive.duration)] for some in (t, body))
    shake = _shake(drive, rng, fault)
    made = sighted(path, rng, camera, R_body_cam, corners, fault.lever, shake, t, body)
    told = replace(
        camera,
        fx=camera.fx * fault.focal,
        fy=camera.fy * fault.focal,
        cx=camera.cx + fault.centre[0],
        cy=camera.cy + fault.centre[1],
    )
    return SightingDrive(
        sightings=made,
        camera=told,
        velocities=_velocities(drive, rng, odometry_noise, odometry_gaps, fault),
        R_body_cam=R_body_cam,
        offset=offset,
        false=corners.false,
        seed=int(rng.integers(1 << 31)),
    )


def _shake(drive: Drive, rng: np.random.Generator, fault: Fault) -> Callable[[Floats], Floats]:
    """Return by what the body is turned beyond its drive, as rotation vectors [rad] of times."""
    t = np.arange(0.0, drive.duration + 0.05, 0.002)
    turned = np.zeros((t.size, 3))
    if fault.tilt:
        v, rate = drive.velocity(t), 2 * np.pi * SUSPENSION[0]
        ahead, left = np.gradient(v[:, :2], t, axis=0).T + drive.yaw_rate(t) * [-v[:, 1], v[:, 0]]
        swing = [rate**2], [1.0, 2 * SUSPENSION[1] * rate, rate**2]
        for axis, pull in ((0, left), (1, -ahead)):
            turned[:, axis] = fault.tilt * lsim(swing, pull, t)[1]
    if fault.vibration:
        rates, phase = 2 * np.pi * rng.uniform(*VIBRATION, (20, 3)), rng.uniform(0, 7, (20, 3))
        waves = np.cos(rates * t[:, None, None] + phase).sum(axis=1)
        turned += fault.vibration * np.sqrt(2.0 / 20) * waves
    return lambda when: np.stack([np.interp(when, t, axis) for axis in turned.T], axis=1)


def _clock_error(fault: Fault, t: Floats, rng: np.random.Generator) -> Floats:
    """Return what the offset deviates from its mean at camera times [s]."""
    phase = 2 * np.pi * t / fault.latency_period + rng.uniform(0, 2 * np.pi)
    swing = fault.latency * np.sin(phase)
    return fault.drift * (t - 0.5 * (t[0] + t[-1])) + swing - swing.mean()


def _velocities(
    drive: Drive, rng: np.random.Generator, noise: float, gaps: Spans, fault: Fault
) -> VelocitySeries:
    t = np.arange(rng.uniform(0, 1 / WHEEL_RATE), drive.duration, 1 / WHEEL_RATE)
    v = drive.velocity(t) * [1.0, 1.0 + fault.slip, 1.0]
    c, s = np.cos(fault.steering), np.sin(fault.steering)
    v = fault.radius * v @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    v[:, :2] += noise * rng.standard_normal((t.size, 2))
    yaw = drive.yaw_rate(t) + 0.01 * rng.standard_normal(t.size) if fault.yaw_told else None
    told = t + fault.jitter * rng.standard_normal(t.size)
    if fault.quantum:
        told = fault.quantum * np.floor(told / fault.quantum)
    keep = outside(t, gaps) & (np.diff(np.maximum.accumulate(told), prepend=-np.inf) > 1e-9)
    return VelocitySeries(told[keep], v[keep], None if yaw is None else yaw[keep])

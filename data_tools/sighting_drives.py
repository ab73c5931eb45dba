"""Simulated drives one level below events: corners as a camera sights them, wheels as they count.

Simulating and reading events takes most of a calibration's time.  Here corners, points in space,
are projected into keyframes by the moving camera, with noise, deaths, wrong matches and movers;
from there on the library's own code makes headings and tracks of them.  So thousands of
calibrations can be judged, also with models that are wrong on purpose (`Fault`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data_tools.motion import Drive, wobble
from data_tools.trajectory import Trajectory
from evcalib._heading_fit import FitOptions
from evcalib._heading_result import HeadingEstimate, collected
from evcalib._keyframes import Counts
from evcalib._matches import CELL_PX, MAX_STEPS, Matches
from evcalib._windows import HeadingWindows
from evcalib.camera import Camera
from evcalib.heading import REACH
from evcalib.pipeline import calibrate_estimate
from evcalib.results import Calibration
from evcalib.series import VelocitySeries

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]
Spans = tuple[tuple[float, float], ...]

RATE, STEPS = 8.0, 5
"""Keyframes per second, and the longest span of a pair: 0.6 s, as `evcalib.calibrate` has 0.7."""

OPTIONS = {"threshold": 1.5, "min_inliers": 20, "max_sd": 3.0, "enough_sd": 0.2}
"""The defaults of `evcalib.estimate_headings`."""

NEAREST, FARTHEST = 0.7, 8.0
"""Distances of corners along the optical axis [m]."""

SLOWEST = 3.0
"""Corners that flow slower than this [px/s] leave too few events to be seen."""

GATHERED = 0.06
"""Time over which a keyframe gathers its corners [s]; pairs do not share events."""

WHEEL_RATE = 50.0


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


@dataclass(frozen=True)
class Corners:
    """What the camera sees, and how well.

    Attributes
    ----------
    count : int
        Corners in view at a time.
    life : float
        Mean time [s] for which one is seen at most.
    noise : float
        Standard deviation of a sighting per axis [px].
    memory : float
        Time constant [s] over which half of the noise's variance lasts; 0 for white noise.
    lag : float
        Corners trail their flow by so much [px].
    false : float
        Share of the matches that go to another corner, anywhere within reach.
    movers : tuple of (float, float)
        Intervals [s] of camera time in which all that is seen moves by itself.
    gaps : tuple of (float, float)
        Intervals [s] of camera time without keyframes.
    """

    count: int = 45
    life: float = 1.5
    noise: float = 0.2
    memory: float = 0.0
    lag: float = 0.0
    false: float = 0.0
    movers: Spans = ()
    gaps: Spans = ()


@dataclass(frozen=True, eq=False)
class Sightings:
    """Corners in keyframes; row i is corner `corner[i]` in keyframe `keyframe[i]` at `xy[i]`.

    Rows are in order of keyframes, then corners; `t` (keyframes,) are times on the camera clock.
    """

    t: Floats
    keyframe: Whole
    corner: Whole
    xy: Floats


@dataclass(frozen=True, eq=False)
class SightingDrive:
    """Sightings and velocities of one drive, and the truth.

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
        options = FitOptions(
            solver="two_point",
            threshold=OPTIONS["threshold"] / self.camera.focal,
            min_inliers=int(OPTIONS["min_inliers"]),
            max_sd=np.radians(OPTIONS["max_sd"]),
            enough_sd=np.radians(OPTIONS["enough_sd"]),
            seed=0,
        )
        windows: HeadingWindows[_Keyframe]
        windows = HeadingWindows(options, STEPS, 1.0 / RATE, self._match, keep=True)
        keyframes = _keyframes(self.sightings, self.camera)
        for keyframe in keyframes:
            windows.add(keyframe)
        windows.drain()
        counts = Counts(keyframes=len(keyframes), keypoints=len(self.sightings.corner))
        return collected(windows.found, windows.gaps, counts, windows.kept)

    def calibrate(self, *, max_offset: float = 1.0) -> Calibration:
        """Return what `evcalib.calibrate` makes of it."""
        return calibrate_estimate(
            self.estimate(), self.velocities, focal=self.camera.focal, max_offset=max_offset
        )

    def _match(self, before: _Keyframe, after: _Keyframe) -> Matches | None:
        """Match the corners of two keyframes, some of them wrongly."""
        if before.t > after.t - GATHERED:
            return None
        _, i, j = np.intersect1d(before.corner, after.corner, True, return_indices=True)
        xy, bearings = after.xy[j], after.bearings[j]
        reach = REACH * self.camera.width
        if self.false:
            # Another corner within reach is as likely here as there.
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
        columns, rows = ((before.xy[i] + xy) / (2 * CELL_PX)).astype(np.int64).T
        number = before.number * MAX_STEPS + after.number - before.number
        return Matches(
            r1=before.bearings[i],
            r2=bearings,
            xy1=before.xy[i],
            xy2=xy,
            t1=np.full(i.size, before.t),
            t2=np.full(i.size, after.t),
            pair=np.full(i.size, number),
            cell=rows * (self.camera.width // CELL_PX + 1) + columns,
        )


@dataclass(frozen=True, eq=False)
class _Keyframe:
    number: int
    t: float
    corner: Whole
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
    corners: Corners = Corners(),
    odometry_noise: float = 0.01,
    odometry_gaps: Spans = (),
    fault: Fault = Fault(),
) -> SightingDrive:
    """Sight the corners around a drive, and read its wheels.

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
    t = t[_outside(t, corners.gaps)]
    body = t + offset + _clock_error(fault, t, rng)
    t, body = (some[(body >= 0) & (body <= drive.duration)] for some in (t, body))
    made = _sighted(path, rng, camera, R_body_cam, corners, fault.lever, t, body)
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


def _clock_error(fault: Fault, t: Floats, rng: np.random.Generator) -> Floats:
    """Return what the offset deviates from its mean at camera times [s]."""
    phase = 2 * np.pi * t / fault.latency_period + rng.uniform(0, 2 * np.pi)
    swing = fault.latency * np.sin(phase)
    return fault.drift * (t - 0.5 * (t[0] + t[-1])) + swing - swing.mean()


def _sighted(
    path: Trajectory,
    rng: np.random.Generator,
    camera: Camera,
    R_body_cam: Floats,
    corners: Corners,
    lever: tuple[float, float, float],
    t: Floats,
    body: Floats,
) -> Sightings:
    """Draw corners that come into being all along the drive, and see them in all keyframes."""
    positions, turns = path.position_at(body), path.rotation_at(body)
    centres, axes = positions + turns @ np.asarray(lever), turns @ R_body_cam
    # In view of some keyframe: a pixel, a distance.
    births = int(corners.count * max(t.size / (RATE * corners.life), 1.0))
    at = rng.integers(0, t.size, births)
    rays = camera.bearings(rng.uniform(0, [camera.width - 1, camera.height - 1], (births, 2)))
    depth = np.exp(rng.uniform(np.log(NEAREST), np.log(FARTHEST), births))
    rays *= (depth / rays[:, 2])[:, None]
    points = centres[at] + np.einsum("nij,nj->ni", axes[at], rays)
    moving = ~_outside(t[at], corners.movers)
    speed = np.where(moving[:, None], rng.normal(0.0, 0.5, (births, 3)), 0.0)
    span = rng.exponential(corners.life, (births, 2))

    first = np.searchsorted(t, t[at] - span[:, 0])
    last = np.searchsorted(t, t[at] + span[:, 1], side="right")
    corner = np.repeat(np.arange(births), last - first)
    keyframe = np.arange(corner.size) - np.repeat(np.cumsum(last - first) - last, last - first)
    alone = moving[corner] <= ~_outside(t[keyframe], corners.movers)
    corner, keyframe = corner[alone], keyframe[alone]

    def seen(late: float) -> Floats:
        """Return pixels at the keyframes, or a little later."""
        when = np.clip(body + late, path.t[0], path.t[-1])
        R = path.rotation_at(when)
        where = path.position_at(when) + R @ np.asarray(lever)
        now = points[corner] + speed[corner] * (when[keyframe] - body[at[corner]])[:, None]
        ray = np.einsum("nji,nj->ni", (R @ R_body_cam)[keyframe], now - where[keyframe])
        return np.where(ray[:, 2:] > 0.2, camera.project(ray), np.nan)

    h = 1e-3
    xy, flow = seen(0.0), (seen(h) - seen(-h)) / (2 * h)
    size = np.hypot(*flow.T)
    noise = corners.noise * _noise(rng, corner, keyframe, corners.memory)
    xy = xy - corners.lag * flow / np.maximum(size, 1e-9)[:, None] + noise
    inside = (xy >= 0).all(axis=1) & (xy <= [camera.width - 1, camera.height - 1]).all(axis=1)
    kept = np.flatnonzero(inside & (size >= SLOWEST))
    kept = kept[np.lexsort((corner[kept], keyframe[kept]))]
    # As many as a keyframe holds, the oldest first.
    rank = np.arange(kept.size) - np.searchsorted(keyframe[kept], keyframe[kept])
    kept = kept[rank < 2 * corners.count]
    return Sightings(t, keyframe[kept], corner[kept], xy[kept])


def _noise(rng: np.random.Generator, corner: Whole, keyframe: Whole, memory: float) -> Floats:
    """Return unit noise (n, 2): white, or half of its variance an AR(1) along each corner."""
    white = rng.standard_normal((corner.size, 2))
    if not memory:
        return white
    # A sum of cosines of random rates has the correlation that a Cauchy spectrum gives:
    # exp(-|lag| / memory).
    waves = 8
    rate = rng.standard_cauchy((int(corner.max()) + 1, waves, 2)) / memory
    phase = rng.uniform(0, 2 * np.pi, rate.shape)
    slow = np.cos(rate[corner] * (keyframe / RATE)[:, None, None] + phase[corner]).sum(axis=1)
    return np.sqrt(0.5) * (white + np.sqrt(2.0 / waves) * slow)


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
    keep = _outside(t, gaps) & (np.diff(np.maximum.accumulate(told), prepend=-np.inf) > 1e-9)
    return VelocitySeries(told[keep], v[keep], None if yaw is None else yaw[keep])


def _outside(t: Floats, spans: Spans) -> NDArray[np.bool_]:
    out = np.ones(t.shape, dtype=np.bool_)
    for start, end in spans:
        out &= (t < start) | (t > end)
    return out

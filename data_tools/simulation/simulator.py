"""An event camera that moves through a scene: events, and the truth behind them.

Each pixel follows the log intensity of its own patch of the scene and reports an event whenever it
has changed by a threshold since the last one (Lichtsteiner et al. 2008; simulated as in Rebecq et
al., "ESIM: an Open Event Camera Simulator", CoRL 2018).  Two departures from ESIM: renders are
scheduled per tile of 8 x 8 pixels, by a bound on the motion of everything that the tile may show,
instead of once for the whole image; and a pixel in its refractory period memorises the intensity
at the end of it, as the circuit does, instead of only staying silent.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from itertools import repeat

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_tools.simulation import _simulator_kernels as kernels
from data_tools.simulation._raycast_kernels import SceneArrays
from data_tools.simulation._simulator_tiles import camera_view, simulate_part
from data_tools.simulation.scenes import Scene, furnished_room
from data_tools.simulation.sensor import Sensor, merge
from data_tools.simulation.trajectory import Trajectory
from evcalib import checks
from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.geometry import LOOKS_FORWARD
from evcalib.series import HeadingSeries, VelocitySeries

FORWARD = LOOKS_FORWARD
"""R_body_cam of a level camera that looks forward."""

BLOCK_US = 20_000
"""The renders of a tile are planned anew after this time."""

POSE_US = 1_000
"""Poses are linear between multiples of this time."""

PARTS = 16
"""Sets of tiles that threads take one by one; fixed, so that threads do not change the result."""


@dataclass(frozen=True, eq=False)
class Truth:
    """What the camera and its body really did.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times [s] on the clock of the events.
    position : ndarray, shape (n, 3)
        Position of the camera in the world [m].
    R_world_cam : ndarray, shape (n, 3, 3)
        Rotation of the camera.
    v_cam : ndarray, shape (n, 3)
        Velocity of the camera, in its own frame [m/s].
    v_body : ndarray, shape (n, 3)
        Velocity of the body's origin, in the body frame [m/s].
    rate_body : ndarray, shape (n, 3)
        Angular rate, in the body frame [rad/s].
    """

    t: Floats
    position: Floats
    R_world_cam: Floats
    v_cam: Floats
    v_body: Floats
    rate_body: Floats

    def headings(self, slowest: float = 0.02) -> HeadingSeries:
        """Return the headings where the camera is faster than `slowest` [m/s]."""
        speed = np.linalg.norm(self.v_cam, axis=1)
        keep = speed > slowest
        return HeadingSeries(self.t[keep], self.v_cam[keep] / speed[keep, None])

    def velocities(self) -> VelocitySeries:
        """Return the body velocities, on the clock of the events."""
        return VelocitySeries(self.t, self.v_body, self.rate_body[:, 2])


@dataclass(frozen=True, eq=False)
class Simulation:
    """A simulated recording.

    Attributes
    ----------
    events : Events
        Ordered by time; at equal microseconds by row, then column.  The events of one pixel stay
        in the order in which they arose.
    truth : Truth
        Every millisecond.
    frame_times : ndarray, shape (m,)
        Times of the frames [s].
    frames : ndarray of float32, shape (m, height, width)
        Linear intensities, where asked for.
    """

    events: Events
    truth: Truth
    frame_times: Floats
    frames: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Simulator:
    """An event camera, mounted on a body that moves through a scene.

    Attributes
    ----------
    trajectory : Trajectory
        Motion of the body; its times, from 0 on, are the camera's clock.
    camera : Camera
        Size and bearings of the sensor.
    scene : Scene
        What there is to see.
    R_body_cam : ndarray, shape (3, 3)
        Rotation of the camera against the body; looking forward by default.
    lever : tuple of float
        Position of the camera in the body frame [m]; its height above the ground included.
    sensor : Sensor
        Thresholds and noise.
    seed : int
        Same seed, same events, byte by byte, for any number of threads.
    fraction : float
        No image point moves further than this [px] between two renders.

    Raises
    ------
    InputError
        If a value is unusable, the camera sees no direction in a pixel, or its path touches the
        scene.
    """

    trajectory: Trajectory
    camera: Camera
    scene: Scene
    R_body_cam: Floats = field(default_factory=FORWARD.copy)
    lever: tuple[float, float, float] = (0.0, 0.0, 0.8)
    sensor: Sensor = field(default_factory=Sensor)
    seed: int = 0
    fraction: float = 0.5

    def __post_init__(self) -> None:
        R = checks.floats(self.R_body_cam, "R_body_cam", (3, 3))
        if np.abs(R @ R.T - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0:
            raise InputError("R_body_cam is not a rotation matrix")
        object.__setattr__(self, "R_body_cam", R)
        checks.floats(self.lever, "lever", (3,))
        checks.positive(self.fraction, "fraction", "pixels")
        edges = self._blocks()
        truth = self.truth(1e-6 * np.arange(edges[0], edges[-1], POSE_US))
        free = self.scene.clearance(truth.position)
        if free.min() < 0.02:
            raise InputError(
                f"at {truth.t[free.argmin()]:.3f} s the camera is not 0.02 m clear of walls and"
                " boxes; build the scene around this path or change `lever`"
            )

    def run(self, *, frame_times: ArrayLike = (), threads: int | None = None) -> Simulation:
        """Simulate the whole trajectory.

        Parameters
        ----------
        frame_times : array_like, shape (m,)
            Times [s] at which to render frames.
        threads : int, optional
            By default one per core, four at most; the events do not depend on it.
        """
        events = Events.concatenate(list(self.stream(threads=threads)))
        times = checks.floats(frame_times, "frame_times", (None,))
        frames = np.empty((times.size, self.camera.height, self.camera.width), dtype=np.float32)
        for frame, t in zip(frames, times, strict=True):
            frame[:] = self.frame(t)
        edges = self._blocks()
        truth = self.truth(1e-6 * np.arange(edges[0], edges[-1] + 1, POSE_US))
        return Simulation(events, truth, times, frames)

    def stream(self, *, threads: int | None = None) -> Iterator[Events]:
        """Yield the events in pieces of 0.2 s, in bounded memory; `threads` as in `run`."""
        camera, sensor = self.camera, self.sensor.parameters(self.seed)
        state = self.sensor.new_state(camera.width * camera.height, self.seed)
        view, scene, edges = self._view, self._arrays, self._blocks()
        light, _ = self._render(1e-6 * edges[0], view.bearings)
        levels = np.log(light * sensor.light + kernels.DARK)
        kernels.start_pixels(edges[0], levels, sensor, state)
        readout = self.sensor.readout(self.seed)
        tiles = [np.arange(k, len(view.bounds), PARTS) for k in range(min(PARTS, len(view.bounds)))]
        with ThreadPoolExecutor(threads or min(os.cpu_count() or 1, 4)) as pool:
            for first in range(0, edges.size - 1, 10):
                span = edges[first : first + 11]
                world = (span, self.fraction, view, self._poses(span), scene, sensor)
                buffers = pool.map(simulate_part, tiles, repeat(world), repeat(state))
                yield readout.carry(merge(list(buffers), camera.width, camera.height))

    def frame(self, t: float) -> NDArray[np.float32]:
        """Return the linear intensity at `t` [s], shape (height, width)."""
        light, _ = self._render(t, self._view.bearings)
        return light.reshape(self.camera.height, self.camera.width).astype(np.float32)

    def depth(self, t: float) -> Floats:
        """Return the distance [m] along the bearing of each pixel at `t` [s], (height, width)."""
        _, depth = self._render(t, self._view.centres)
        return depth.reshape(self.camera.height, self.camera.width)

    def truth(self, t: ArrayLike) -> Truth:
        """Return what the camera does at times `t` [s] within the trajectory."""
        path = self.trajectory
        R_world_body, rate = path.rotation_at(t), path.rate_at(t)
        v_body = np.einsum("nji,nj->ni", R_world_body, path.velocity_at(t))
        return Truth(
            t=np.asarray(t, dtype=np.float64),
            position=path.position_at(t) + R_world_body @ np.asarray(self.lever),
            R_world_cam=R_world_body @ self.R_body_cam,
            v_cam=(v_body + np.cross(rate, self.lever)) @ self.R_body_cam,
            v_body=v_body,
            rate_body=rate,
        )

    @cached_property
    def _view(self) -> kernels.View:
        return camera_view(self.camera)

    @cached_property
    def _arrays(self) -> SceneArrays:
        return self.scene.arrays()

    def _render(self, t: float, bearings: Floats) -> tuple[Floats, Floats]:
        light, depth = np.empty((2, self.camera.width * self.camera.height))
        pose = pose_rows(self.truth([t]))[0]
        kernels.render(pose, bearings, self._view, self._arrays, light, depth)
        return light, depth

    def _blocks(self) -> Floats:
        """Return the edges of the blocks of time, in whole microseconds."""
        t = self.trajectory.t
        start = np.ceil(1e6 * t[0] - 1e-3)
        count = np.floor((1e6 * t[-1] - start + 1e-3) / POSE_US)
        if start < 0 or count < 1:
            raise InputError("a trajectory starts at time 0 or later and lasts a millisecond")
        end = start + count * POSE_US
        return np.append(np.arange(start, end, BLOCK_US), end)

    def _poses(self, edges: Floats) -> kernels.Poses:
        """Return the poses every millisecond over some blocks."""
        t = 1e-6 * np.arange(edges[0], edges[-1] + 1, POSE_US)
        return kernels.Poses(pose_rows(self.truth(t)), float(edges[0]), float(POSE_US))


def pose_rows(truth: Truth) -> Floats:
    """Return the rows of `kernels.Poses`."""
    v_world = np.einsum("nij,nj->ni", truth.R_world_cam, truth.v_cam)
    rate = np.linalg.norm(truth.rate_body, axis=1)
    return np.column_stack([truth.position, truth.R_world_cam.reshape(-1, 9), v_world, rate])


def simulate_translation(
    direction: ArrayLike,
    speed: float,
    duration: float,
    camera: Camera,
    seed: int = 0,
    sensor: Sensor | None = None,
) -> Simulation:
    """Return a camera that moves in a straight line without turning, in a furnished room.

    Parameters
    ----------
    direction : array_like, shape (3,)
        Direction of motion in the camera frame, of any length.  The camera is level.
    speed : float
        Speed [m/s].
    duration : float
        Length of the recording [s].
    camera : Camera
        The camera.
    seed : int
        Of scene, thresholds and noise.
    sensor : Sensor
        What the pixels do; the default sensor if not given.
    """
    ahead = checks.floats(direction, "direction", (3,))
    length = checks.positive(float(np.linalg.norm(ahead)), "length of direction")
    travel = speed * checks.positive(duration, "duration", "seconds") * FORWARD @ ahead / length
    ends = np.outer([-0.5, 0.5], travel) + [0.0, 0.0, 1.2 + abs(travel[2])]
    path = Trajectory(np.array([0.0, duration]), ends)
    scene = furnished_room(path.position_at(np.linspace(0.0, duration, 100)), seed)
    sensor = sensor or Sensor()
    return Simulator(path, camera, scene, lever=(0.0, 0.0, 0.0), sensor=sensor, seed=seed).run()

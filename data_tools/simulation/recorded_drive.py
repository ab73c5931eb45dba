"""Simulated drives of a whole vehicle: raw events on one clock, wheel states on another.

Every drive is drawn from a seed: its motion, the mounting of its camera, the offset between its
clocks, the room around it.  So a method can be judged on many drives that it has never seen.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from data_tools.simulation._random import generator
from data_tools.simulation.drives import Drive, arc, fingers, straight, wobble
from data_tools.simulation.scenes import furnished_room
from data_tools.simulation.sensor import Sensor
from data_tools.simulation.simulator import FORWARD, Simulator
from data_tools.simulation.trajectory import Trajectory
from evcalib import checks
from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.geometry import rpy_to_matrix
from evcalib.kinematics import Swerve, Wheel, WheelLog, WheelStates

MOTIONS = ("sweep", "fingers", "straight", "arc")
MOUNTINGS = ("forward", "sideways", "down")

CAMERA = Camera(240, 180, 200.0, 200.0, 119.5, 89.5)
"""A DAVIS240C with a lens of 62 degrees."""

VEHICLE = Swerve(
    tuple(Wheel(name, x, y) for name, x, y in
          [("fl", 0.3, 0.25), ("fr", 0.3, -0.25), ("rl", -0.3, 0.25), ("rr", -0.3, -0.25)])
)  # fmt: skip
"""The vehicle of all drives: four wheels that steer."""

WHEEL_RATE = 50.0
RAMP = 0.8
"""Time [s] in which a sweep gets up to speed."""


@dataclass(frozen=True)
class Disturbances:
    """What spoils a recorded drive.

    Attributes
    ----------
    sensor : Sensor
        The pixels.
    slip : float
        Standard deviation of each wheel's speed, as a share of it.
    yaw_rate : float
        The vehicle wobbles by up to so much [rad/s].
    """

    sensor: Sensor = field(default_factory=Sensor)
    slip: float = 0.0
    yaw_rate: float = 0.0


ROUGH = Disturbances(Sensor(mismatch=0.1, noise_rate=1.0), slip=0.05, yaw_rate=np.radians(5.0))
"""Noisy pixels of unequal thresholds, slipping wheels, a body that does not keep its heading."""


@dataclass(frozen=True, eq=False)
class RecordedDrive:
    """A drive as a camera and the wheels record it, and the truth.

    Attributes
    ----------
    simulator : Simulator
        Makes the events: ``simulator.stream()`` yields them in pieces.
    wheels : WheelLog
        Wheel states on the body's clock.
    drive : Drive
        The motion, on the body's clock.
    R_body_cam : ndarray, shape (3, 3)
        True rotation.
    offset : float
        True offset [s], ``t_body = t_cam + offset``.
    """

    simulator: Simulator
    wheels: WheelLog
    drive: Drive
    R_body_cam: Floats
    offset: float


def record_drive(
    seed: int,
    *,
    motion: str = "sweep",
    mounting: str = "forward",
    duration: float = 16.0,
    speed: float = 0.5,
    camera: Camera = CAMERA,
    disturbances: Disturbances = Disturbances(),
) -> RecordedDrive:
    """Draw a drive.

    Parameters
    ----------
    seed : int
        Of everything that is random.
    motion : {"sweep", "fingers", "straight", "arc"}
        The direction of travel swings without end; or out and back along spread directions, with
        pauses.  Accelerations are finite.  Or a straight line, or an arc, at constant speed: these
        cannot answer.
    mounting : {"forward", "sideways", "down"}
        The camera looks ahead, with roll, pitch and yaw of up to 30 degrees; to the left or right;
        or ahead and 30 degrees down; the last two with angles of up to 10 degrees.
    duration : float
        Length [s].
    speed : float
        Top speed [m/s].
    camera : Camera
        The lens.
    disturbances : Disturbances
        What spoils the recording.

    Raises
    ------
    InputError
        If a choice is unknown, or a number unusable.
    """
    checks.one_of(motion, "motion", MOTIONS)
    checks.one_of(mounting, "mounting", MOUNTINGS)
    rng = generator(seed, f"recorded drive, {motion}, {mounting}")
    drive = _MAKERS[motion](rng, checks.positive(duration, "duration", "seconds"), speed)
    if disturbances.yaw_rate:
        drive = replace(drive, yaw_rate=wobble(rng, disturbances.yaw_rate))
    R_body_cam = _mounting(rng, mounting)
    offset = float(rng.uniform(-0.5, 0.5))
    trajectory = Trajectory.of_drive(drive, offset=offset)
    # The height of a camera on a small vehicle.
    path = trajectory.position + [0.0, 0.0, 0.8]
    simulator = Simulator(
        trajectory,
        camera,
        furnished_room(path, seed),
        R_body_cam,
        sensor=disturbances.sensor,
        seed=seed,
    )
    return RecordedDrive(
        simulator, _wheels(rng, drive, disturbances.slip), drive, R_body_cam, offset
    )


def _sweep(rng: np.random.Generator, duration: float, speed: float) -> Drive:
    """Return a direction that swings by two sines; the speed rises at the start."""
    heading = rng.uniform(-np.pi / 6, np.pi / 6)
    amplitude = np.radians(rng.uniform([30.0, 5.0], [55.0, 15.0]))
    rate = 2 * np.pi / rng.uniform([4.0, 2.0], [8.0, 3.5])
    phase = rng.uniform(0, 2 * np.pi, 2)

    def angle(t: Floats) -> Floats:
        return heading + np.sin(np.multiply.outer(t, rate) + phase) @ amplitude

    def ramp(t: Floats) -> Floats:
        u = np.clip(t / RAMP, 0.0, 1.0)
        return speed * u * u * (3 - 2 * u)

    return Drive("sweep", duration, angle, ramp)


def _fingers(rng: np.random.Generator, duration: float, speed: float) -> Drive:
    """Return fingers spread by 120 degrees or so, as many as the time allows."""
    out, pause = 2.0, 0.5
    count = max(int(duration / (2 * (out + pause))), 1)
    spread = np.linspace(-1.0, 1.0, count) if count > 1 else np.zeros(1)
    angles = rng.permutation(np.radians(60.0) * spread + rng.uniform(-0.2, 0.2, count))
    return replace(fingers(angles.tolist(), out=out, pause=pause, speed=speed), duration=duration)


def _straight(rng: np.random.Generator, duration: float, speed: float) -> Drive:
    return straight(duration, heading=rng.uniform(-0.5, 0.5), speed=speed)


def _arc(rng: np.random.Generator, duration: float, speed: float) -> Drive:
    """Return an arc that turns the direction of travel by 90 to 180 degrees in all."""
    turned = rng.choice([-1.0, 1.0]) * rng.uniform(0.5 * np.pi, np.pi)
    return arc(duration, radius=speed * duration / turned, heading=-0.5 * turned, speed=speed)


_MAKERS = {"sweep": _sweep, "fingers": _fingers, "straight": _straight, "arc": _arc}


def _mounting(rng: np.random.Generator, mounting: str) -> Floats:
    side = float(rng.choice([-90.0, 90.0]))
    middle = {"forward": (0, 0, 0), "sideways": (0, 0, side), "down": (0, 30, 0)}[mounting]
    reach = 30.0 if mounting == "forward" else 10.0
    return rpy_to_matrix(np.radians(middle + rng.uniform(-reach, reach, 3))) @ FORWARD


def _wheels(rng: np.random.Generator, drive: Drive, slip: float) -> WheelLog:
    t = np.arange(rng.uniform(0, 1 / WHEEL_RATE), drive.duration, 1 / WHEEL_RATE)
    states = VEHICLE.wheel_states(drive.velocity(t)[:, :2], drive.yaw_rate(t))
    factor = 1.0 + slip * rng.standard_normal(states.speed.shape)
    return WheelLog(t, WheelStates(states.speed * factor, states.steer))

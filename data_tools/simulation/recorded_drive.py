"""Simulated drives of a whole vehicle: raw events on one clock, wheel states on another.

Everything is drawn from a seed: the motion (by `random_drives`), the mounting of the camera, the
offset between the clocks, the room around it.  So a method can be judged on many drives that it has
never seen.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from data_tools.simulation._random import generator
from data_tools.simulation.drives import Drive
from data_tools.simulation.random_drives import RECORDED, TURNING, wobble
from data_tools.simulation.scenes import furnished_room
from data_tools.simulation.sensor import Sensor
from data_tools.simulation.simulator import FORWARD, Simulator
from data_tools.simulation.trajectory import Trajectory
from evcalib import checks
from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.geometry import rpy_to_matrix
from evcalib.kinematics import (
    Mecanum,
    Swerve,
    Vehicle,
    Wheel,
    WheelLog,
    WheelStates,
    body_velocities,
)
from evcalib.series import VelocitySeries

MOTIONS = tuple(RECORDED)
MOUNTINGS = ("forward", "sideways", "down")

CAMERA = Camera(240, 180, 200.0, 200.0, 119.5, 89.5)
"""A DAVIS240C with a lens of 62 degrees."""

VEHICLE = Swerve(
    tuple(Wheel(name, x, y) for name, x, y in
          [("fl", 0.3, 0.25), ("fr", 0.3, -0.25), ("rl", -0.3, 0.25), ("rr", -0.3, -0.25)])
)  # fmt: skip
"""The vehicle of most drives: four wheels that steer, as those of any vehicle may be thought to."""

VEHICLES: dict[str, Vehicle] = {"strafe": Mecanum(0.3, 0.25)}
"""The vehicles of motions that are not driven by `VEHICLE`."""

WHEEL_RATE = 50.0

HEIGHT = 0.8
"""Height [m] of a camera over the origin of a vehicle that keeps its heading."""

LARGEST_REACH = 0.4
"""Largest distance [m] of the camera from the origin of a vehicle that turns, seen from above."""


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
    vehicle : Swerve or Mecanum
        Whose wheels they are.
    """

    simulator: Simulator
    wheels: WheelLog
    drive: Drive
    R_body_cam: Floats
    offset: float
    vehicle: Vehicle = VEHICLE

    @property
    def lever(self) -> tuple[float, float, float]:
        """Position of the camera in the body frame [m]."""
        return self.simulator.lever

    def velocities(self) -> VelocitySeries:
        """Return what the wheels tell of the body: velocity and yaw rate, in all rows."""
        return body_velocities(self.wheels, self.vehicle).velocities


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
    motion : {"sweep", "fingers", "straight", "arc", "figure-eight", "slalom", "strafe", "spin", \
"circle", "stops"}
        The direction of travel swings without end; or out and back along spread directions, with
        pauses.  Accelerations are finite.  Or a straight line, or an arc, at constant speed: these
        cannot answer.  The rest are vehicles that turn, their camera up to `LARGEST_REACH` off the
        body's origin (`RecordedDrive.lever`): a differential drive's eights and a car's slalom, at
        changing speeds; mecanum wheels that strafe and turn; turning in place; a circle at
        constant speed; a straight line with stops.
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
    drive = RECORDED[motion](rng, checks.positive(duration, "duration", "seconds"), speed)
    if disturbances.yaw_rate:
        drive = replace(drive, yaw_rate=wobble(rng, disturbances.yaw_rate))
    R_body_cam = _mounting(rng, mounting)
    offset = float(rng.uniform(-0.5, 0.5))
    lever = _position(rng) if motion in TURNING else (0.0, 0.0, HEIGHT)
    trajectory = Trajectory.of_drive(drive, offset=offset)
    path = trajectory.position + trajectory.rotation @ np.array(lever)
    simulator = Simulator(
        trajectory,
        camera,
        furnished_room(path, seed),
        R_body_cam,
        lever,
        sensor=disturbances.sensor,
        seed=seed,
    )
    vehicle = VEHICLES.get(motion, VEHICLE)
    wheels = _wheels(rng, drive, vehicle, disturbances.slip)
    return RecordedDrive(simulator, wheels, drive, R_body_cam, offset, vehicle)


def _mounting(rng: np.random.Generator, mounting: str) -> Floats:
    side = float(rng.choice([-90.0, 90.0]))
    middle = {"forward": (0, 0, 0), "sideways": (0, 0, side), "down": (0, 30, 0)}[mounting]
    most = 30.0 if mounting == "forward" else 10.0
    return rpy_to_matrix(np.radians(middle + rng.uniform(-most, most, 3))) @ FORWARD


def _position(rng: np.random.Generator) -> tuple[float, float, float]:
    """Draw where the camera sits: off the origin by up to `LARGEST_REACH`, 0.3 to 0.9 m high."""
    reach, way = rng.uniform(0.0, LARGEST_REACH), rng.uniform(-np.pi, np.pi)
    return (
        float(reach * np.cos(way)),
        float(reach * np.sin(way)),
        float(rng.uniform(0.3, 0.9)),
    )


def _wheels(rng: np.random.Generator, drive: Drive, vehicle: Vehicle, slip: float) -> WheelLog:
    t = np.arange(rng.uniform(0, 1 / WHEEL_RATE), drive.duration, 1 / WHEEL_RATE)
    states = vehicle.wheel_states(drive.velocity(t)[:, :2], drive.yaw_rate(t))
    factor = 1.0 + slip * rng.standard_normal(states.speed.shape)
    return WheelLog(t, WheelStates(states.speed * factor, states.steer))

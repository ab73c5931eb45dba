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
from data_tools.simulation.random_drives import RECORDED, wobble
from data_tools.simulation.scenes import furnished_room
from data_tools.simulation.sensor import Sensor
from data_tools.simulation.simulator import FORWARD, Simulator
from data_tools.simulation.trajectory import Trajectory
from evcalib import checks
from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.geometry import rpy_to_matrix
from evcalib.kinematics import Swerve, Wheel, WheelLog, WheelStates

MOTIONS = tuple(RECORDED)
MOUNTINGS = ("forward", "sideways", "down")

CAMERA = Camera(240, 180, 200.0, 200.0, 119.5, 89.5)
"""A DAVIS240C with a lens of 62 degrees."""

VEHICLE = Swerve(
    tuple(Wheel(name, x, y) for name, x, y in
          [("fl", 0.3, 0.25), ("fr", 0.3, -0.25), ("rl", -0.3, 0.25), ("rr", -0.3, -0.25)])
)  # fmt: skip
"""The vehicle of all drives: four wheels that steer."""

WHEEL_RATE = 50.0


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
    drive = RECORDED[motion](rng, checks.positive(duration, "duration", "seconds"), speed)
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


def _mounting(rng: np.random.Generator, mounting: str) -> Floats:
    side = float(rng.choice([-90.0, 90.0]))
    middle = {"forward": (0, 0, 0), "sideways": (0, 0, side), "down": (0, 30, 0)}[mounting]
    most = 30.0 if mounting == "forward" else 10.0
    return rpy_to_matrix(np.radians(middle + rng.uniform(-most, most, 3))) @ FORWARD


def _wheels(rng: np.random.Generator, drive: Drive, slip: float) -> WheelLog:
    t = np.arange(rng.uniform(0, 1 / WHEEL_RATE), drive.duration, 1 / WHEEL_RATE)
    states = VEHICLE.wheel_states(drive.velocity(t)[:, :2], drive.yaw_rate(t))
    factor = 1.0 + slip * rng.standard_normal(states.speed.shape)
    return WheelLog(t, WheelStates(states.speed * factor, states.steer))

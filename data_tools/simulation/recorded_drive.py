"""Simulated drives of a whole vehicle: raw events on one clock, wheel states on another.

Everything is drawn from a seed: the motion (by `random_drives`), the mounting of the camera, the
offset between the clocks, the room around it.  So a method can be judged on many drives that it has
never seen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from data_tools.simulation._random import generator
from data_tools.simulation.body_effects import obeyed, sway, vibration
from data_tools.simulation.drives import Drive
from data_tools.simulation.random_drives import CAR_WHEELBASE, RECORDED, TURNING, wobble
from data_tools.simulation.scenes import furnished_room
from data_tools.simulation.sensor import Sensor
from data_tools.simulation.simulator import FORWARD, Simulator
from data_tools.simulation.trajectory import Trajectory
from data_tools.simulation.wheel_effects import WHEEL_RATE, LogEffects, lateness, wheel_log
from evcalib import checks
from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.geometry import rpy_to_matrix
from evcalib.kinematics import (
    Mecanum,
    Rolling,
    Swerve,
    Vehicle,
    Wheel,
    WheelLog,
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
"""The vehicle of drives that do not turn: four wheels that steer."""

DIFFERENTIAL = Rolling.differential(track=0.4)
VEHICLES: dict[str, Vehicle] = {
    "figure-eight": DIFFERENTIAL,
    "slalom": Rolling.ackermann(CAR_WHEELBASE, track=0.4),
    "strafe": Mecanum(0.3, 0.25),
    "spin": DIFFERENTIAL,
    "circle": DIFFERENTIAL,
    "stops": DIFFERENTIAL,
}
"""The vehicles of the other motions."""

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
        The pixels and their readout.
    slip : float
        Standard deviation of each wheel's speed, as a share of it.
    yaw_rate : float
        The vehicle wobbles by up to so much [rad/s], and its wheels tell.
    untold_yaw_rate : float
        The same, but the log says that it does not turn.
    tilt : float
        The body leans by so much as it accelerates [rad per m/s^2], see
        `data_tools.simulation.body_effects.sway`.
    vibration : float
        Standard deviation, about each axis, of a body that shakes [rad].
    vibration_band : (float, float)
        Frequencies at which it does [Hz].
    dead_time, bandwidth : float
        The vehicle obeys so late [s], and its controllers are so fast [Hz], 0 for any; see
        `data_tools.simulation.body_effects.obeyed`.
    logs_commands : bool
        Whether the log holds what the wheels were told, not what they did.
    wheel_rate, wheel_low_pass, wheel_jitter, encoder_step, backlash, drop_out : float
        What becomes of the wheels in the log: see
        `data_tools.simulation.wheel_effects.LogEffects`.
    """

    sensor: Sensor = field(default_factory=Sensor)
    slip: float = 0.0
    yaw_rate: float = 0.0
    untold_yaw_rate: float = 0.0
    tilt: float = 0.0
    vibration: float = 0.0
    vibration_band: tuple[float, float] = (5.0, 15.0)
    dead_time: float = 0.0
    bandwidth: float = 0.0
    logs_commands: bool = False
    wheel_rate: float = WHEEL_RATE
    wheel_low_pass: float = 0.0
    wheel_jitter: float = 0.0
    encoder_step: float = 0.0
    backlash: float = 0.0
    drop_out: float = 0.0

    @property
    def log(self) -> LogEffects:
        """What spoils the wheel log."""
        return LogEffects(
            self.slip,
            self.wheel_rate,
            self.wheel_low_pass,
            self.wheel_jitter,
            self.encoder_step,
            self.backlash,
            self.drop_out,
        )

    def shake(self, rng: np.random.Generator) -> Callable[[Floats, Floats], Floats] | None:
        """Return how the body leaves its attitude, for `Trajectory.of_drive`."""
        if not (self.tilt or self.vibration):
            return None

        def shaken(t: Floats, acceleration: Floats) -> Floats:
            trembling = vibration(t, self.vibration, self.vibration_band, rng)
            return sway(t, acceleration, self.tilt) + trembling

        return shaken


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
        True offset [s], ``t_body = t_cam + offset``: the shift of the clocks, plus how late the
        log is as a whole.  How late the pixels are is no part of it.
    vehicle : Swerve, Mecanum or Rolling
        Whose wheels they are.
    late : float
        How late the log is as a whole [s], by least squares of logged against true velocity
        (`data_tools.simulation.wheel_effects.lateness`).
    """

    simulator: Simulator
    wheels: WheelLog
    drive: Drive
    R_body_cam: Floats
    offset: float
    vehicle: Vehicle = VEHICLE
    late: float = 0.0

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
    motion : {"sweep", "fingers", "stop and go", "straight", "arc", "figure-eight", "slalom", \
"strafe", "spin", "circle", "stops"}
        The direction of travel swings without end; or out and back along spread directions, with
        pauses; or it swings and stops every few seconds.  Accelerations are finite.  Or a straight line, or an arc, at constant speed: these
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
    shift = float(rng.uniform(-0.5, 0.5))
    lever = _position(rng) if motion in TURNING else (0.0, 0.0, HEIGHT)
    vehicle = VEHICLES.get(motion, VEHICLE)
    wheels, done, late = _driven(drive, vehicle, disturbances, rng)
    trajectory = Trajectory.of_drive(
        done, offset=shift, shake=disturbances.shake(generator(seed, "vibration"))
    )
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
    return RecordedDrive(simulator, wheels, done, R_body_cam, shift + late, vehicle, late)


def _driven(
    drive: Drive, vehicle: Vehicle, disturbances: Disturbances, rng: np.random.Generator
) -> tuple[WheelLog, Drive, float]:
    """Return the log of a vehicle that is told a drive, what it does, and how late the log is."""
    done = obeyed(drive, disturbances.dead_time, disturbances.bandwidth)
    effects = disturbances.log
    wheels = wheel_log(drive if disturbances.logs_commands else done, vehicle, effects, rng)
    apart = disturbances.logs_commands and done is not drive
    late = lateness(wheels, vehicle, done) if apart or effects.shaping else 0.0
    if disturbances.untold_yaw_rate:
        wobbling, told = wobble(rng, disturbances.untold_yaw_rate), done.yaw_rate
        done = replace(done, yaw_rate=lambda t: told(t) + wobbling(t))
    return wheels, done, late


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

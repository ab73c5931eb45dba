"""One front for all that tells how a vehicle moved: CSV of velocities or wheels, topics of bags."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from data_tools.bags import MAGIC, is_bag
from data_tools.files.pipes import refuse_pipe
from data_tools.files.wpilog import is_wpilog
from data_tools.logs.bag_velocities import read_bag_motion
from data_tools.logs.column_maps import Columns
from data_tools.logs.series_files import read_velocities
from data_tools.logs.vehicle_files import read_vehicle
from data_tools.logs.wheel_logs import read_wheel_log
from data_tools.logs.wpilog_motion import read_wpilog_motion
from evcalib import checks
from evcalib.arrays import Floats
from evcalib.checks import whole_us
from evcalib.errors import InputError
from evcalib.kinematics import (
    BodyVelocities,
    Vehicle,
    WheelLog,
    WheelStates,
    body_velocities,
    check_vehicle,
    turning_centre,
)
from evcalib.series import VelocitySeries, bins

MIN_STEP = 1e-4
"""A median step between rows below this [s] is taken for a mistake of units."""
MAX_GAP = 3600.0
"""Rows may have been left out, but not for longer than this [s]: then a clock was set."""
SPEEDING, BREATH = 20.0, 0.5
"""A speed that changes by more than this [m/s^2], over so long [s], is told of: two g, which tyres
do not hold.  A choice."""
FAST = 40.0
"""A usual speed above this [m/s], 144 km/h, is told of.  A choice."""
LARGE = 5.0
"""Wheels farther than this [m] from the origin are told of: a choice, beyond what cars have."""


@dataclass(frozen=True, eq=False)
class VelocitySource:
    """Velocities of the body, and where they come from.

    Attributes
    ----------
    name : str
        The file it was read from.
    velocities : VelocitySeries
        Linear velocity of the body's origin and, if known, the yaw rate; times are shifted.
    wheels : BodyVelocities or None
        Slip, and what the limits left out, if wheels were read.
    notes : tuple of str
        What was taken for granted or left out.
    vehicle, states : Vehicle and WheelStates, or None
        What the velocities were made from, if wheels were read: all rows.
    """

    name: str
    velocities: VelocitySeries
    wheels: BodyVelocities | None = None
    notes: tuple[str, ...] = ()
    vehicle: Vehicle | None = None
    states: WheelStates | None = None

    def limited(
        self, *, max_slip: float | None = None, max_yaw_rate: float | None = None
    ) -> VelocitySource:
        """Return what is within the limits; see `read_body_velocities`."""
        if self.wheels is not None:
            wheels = self.wheels.limited(max_slip, max_yaw_rate)
            notes = (*self.notes[:-1], wheels.summary())
            return replace(self, velocities=wheels.velocities, wheels=wheels, notes=notes)
        if max_slip is not None:
            raise InputError(
                f"{self.name} holds velocities, which have no slip: max_slip needs wheels"
            )
        if max_yaw_rate is None:
            return self
        limit = checks.positive(max_yaw_rate, "max_yaw_rate", "rad/s")
        if self.velocities.yaw_rate is None:
            raise InputError(f"{self.name} has no yaw rate to be limited by max_yaw_rate")
        keep = np.abs(self.velocities.yaw_rate) <= limit
        if not keep.any():
            raise InputError(f"{self.name}: all {keep.size} rows turn faster than {limit:g} rad/s")
        left_out = f"{keep.size - int(keep.sum())} of {keep.size} rows over the yaw-rate limit"
        return replace(self, velocities=self.velocities.select(keep), notes=(*self.notes, left_out))


def read_body_velocities(
    path: str | Path,
    *,
    topic: str | None = None,
    vehicle: Vehicle | str | Path | None = None,
    columns: Columns | None = None,
    time_unit: str | None = None,
    wheel_radius: float | None = None,
    origin_us: int = 0,
    clock_shift: float = 0.0,
    twist_frame: str | None = None,
    max_slip: float | None = None,
    max_yaw_rate: float | None = None,
) -> VelocitySource:
    """Read how a vehicle moved.

    Parameters
    ----------
    path : path
        A CSV file of velocities (``t,vx,vy``, see `data_tools.logs.series_files`); or, with
        `vehicle`, one of wheel states (see `data_tools.logs.wheel_logs`); or a ROS 1 or ROS 2 bag;
        or a WPILib log (`data_tools.logs.wpilog_motion`).
    topic : str, optional
        Topic of a bag, or entry of a log; by default the only one that fits.
    vehicle : Swerve, Mecanum, Omni, Rolling or path, optional
        The vehicle, or its YAML file; turns wheel states into velocities.
    columns : mapping or path, optional
        Column map, or its YAML file (see `data_tools.logs.column_maps`); for joints, of joints.
    time_unit : {"s", "ms", "us", "ns"}
        Unit of the times of a CSV file, seconds unless the map tells it.
    wheel_radius : float, optional
        Radius [m] for wheels whose speed is given in rad/s.
    origin_us : int
        Subtracted from all times [us]: give the recording's `origin_us`, if its camera and the
        vehicle were on one clock.
    clock_shift : float
        Added to all times [s], to bring clocks together that are hours apart.
    twist_frame : {"body", "ground"}, optional
        The frame of a bag's twists, where it does not tell; see `data_tools.logs.odometry_frames`.
    max_slip, max_yaw_rate : float, optional
        Limits [m/s], [rad/s] over which rows of wheels are left out; see `body_velocities`.

    Returns
    -------
    VelocitySource
        The velocities, and what was left out.

    Raises
    ------
    InputError
        If the file cannot be read, its unit or its clock is implausible (with file, row and
        reason), or an argument does not fit what the file holds.
    """
    path, origin = Path(path), whole_us(origin_us, "origin_us")
    if vehicle is not None and isinstance(vehicle, str | Path):
        vehicle = read_vehicle(vehicle)
    motion: VelocitySeries | WheelLog
    notes: list[str] = []
    if not np.isfinite(clock_shift):
        raise InputError(f"clock_shift must be a finite number of seconds, not {clock_shift!r}")
    head = _head(path)
    bag = is_bag(path, head)
    if is_wpilog(head):
        if twist_frame is not None or time_unit is not None or wheel_radius is not None:
            raise InputError(
                f"{path} is a WPILib log, in us, m/s and rad: it takes no time unit, twist frame or"
                " wheel radius"
            )
        stream = read_wpilog_motion(path, topic=topic, vehicle=vehicle, columns=columns)
        motion, notes = stream.motion, list(stream.notes)
    elif bag:
        stream = read_bag_motion(
            path,
            topic=topic,
            vehicle=vehicle,
            columns=columns,
            wheel_radius=wheel_radius,
            origin_us=origin,
            twist_frame=twist_frame,
        )
        motion, notes = stream.motion, list(stream.notes)
        if time_unit is not None:
            raise InputError(f"{path} is a bag, whose stamps are in ns: it takes no time unit")
    elif topic is not None or twist_frame is not None:
        what = f"topic {topic}" if topic is not None else "twists"
        raise InputError(f"{path} is no bag: it has no {what}")
    elif vehicle is not None:
        motion = read_wheel_log(path, vehicle, columns, time_unit, wheel_radius, notes)
    else:
        motion = read_velocities(path, columns, time_unit, notes)
    _check_steps(motion.t, path)
    if not bag:
        motion = replace(motion, t=motion.t - origin / 1e6)
    if clock_shift:
        motion = replace(motion, t=motion.t + clock_shift)
        notes.append(
            f"{clock_shift:+g} s were added to all times: an offset is of the clock so shifted"
        )
    if isinstance(motion, WheelLog):
        assert not isinstance(vehicle, str | Path | None)
        try:
            body = body_velocities(motion, vehicle)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        advice = (*_large(vehicle), *check_vehicle(motion, vehicle).advice)
        notes += [f"look at the vehicle: {line}" for line in advice]
        notes += _hasty(body.velocities)
        notes.append(body.summary())
        whole = VelocitySource(
            str(path), body.velocities, body, tuple(notes), vehicle, motion.states
        )
    else:
        notes += _hasty(motion) + _centre(motion)
        whole = VelocitySource(str(path), motion, notes=tuple(notes))
    return whole.limited(max_slip=max_slip, max_yaw_rate=max_yaw_rate)


def _centre(velocities: VelocitySeries) -> list[str]:
    """Tell where the origin of velocities is not the point about which the vehicle turns."""
    x = turning_centre(velocities)
    if x is None:
        return []
    return [
        f"the vehicle turns about a point {abs(x):.2f} m {'ahead of' if x > 0 else 'behind'} the"
        " origin of its body frame, by its sideways velocity: a camera's position counts from the"
        " origin, not from there"
    ]


def _large(vehicle: Vehicle) -> list[str]:
    """Tell of wheels that stand far out."""
    wheels = vehicle.positions
    far = np.hypot(*wheels.T)
    if far.max() <= LARGE:
        return []
    name = vehicle.names[int(np.argmax(far))]
    return [f"wheel {name} is {far.max():.3g} m from the origin; are lengths in metres?"]


def _hasty(velocities: VelocitySeries) -> list[str]:
    """Tell of speeds that no vehicle on wheels has, or comes to so fast."""
    speed, t = velocities.speed, velocities.t
    usual = float(np.median(speed))
    if usual > FAST:
        return [f"its usual speed is {usual:.0f} m/s, {3.6 * usual:.0f} km/h: are speeds in m/s?"]
    stretch = bins(t - t[0], BREATH)
    _, first = np.unique(stretch, return_index=True)
    mean = np.add.reduceat(speed, first) / np.diff(np.append(first, t.size))
    change = np.abs(np.diff(mean))[np.diff(stretch[first]) == 1]
    if not change.size or change.max() <= SPEEDING * BREATH:
        return []
    return [
        f"its speed changes by up to {change.max():.3g} m/s within {BREATH:g} s, more than tyres"
        " hold: are speeds in m/s, and times in s?"
    ]


def _check_steps(t: Floats, path: Path) -> None:
    steps = np.diff(t)
    if steps.size and np.median(steps) < MIN_STEP:
        raise InputError(
            f"{path}: the median step between rows is {np.median(steps):.3g} s; is the unit of"
            " the times right (--time-unit, time_unit; or unit: of t in a column map)?"
        )
    if steps.size and steps.max() > MAX_GAP:
        row = int(np.argmax(steps)) + 1
        raise InputError(
            f"{path}, row {row}: its time is {steps.max():.0f} s after that of the row before:"
            " the clock was set, or two logs were joined; cut the file there"
        )


def _head(path: Path) -> bytes:
    refuse_pipe(path)
    try:
        if path.is_dir():
            return b""
        with path.open("rb") as file:
            return file.read(max(map(len, MAGIC)))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None

"""What the wheels say, and what it means for the body."""

from __future__ import annotations

from dataclasses import dataclass

from evcalib import checks
from evcalib.arrays import Floats
from evcalib.display import Shown
from evcalib.errors import InputError


@dataclass(frozen=True, eq=False)
class WheelStates(Shown):
    """Speeds and steering angles of wheels, in the order of the vehicle's wheels.

    Attributes
    ----------
    speed : ndarray, shape (n, k)
        Rolling speed at the rim [m/s] (rotation rate times wheel radius); negative = backwards.
        Only wheels that tell it have one (`speed_names` of the vehicle).
    steer : ndarray, shape (n, l), optional
        Steering angle [rad] from body X, counter-clockwise; only wheels that steer have one
        (`steer_names` of the vehicle).

    Raises
    ------
    InputError
        If a shape or a value is unusable.
    """

    speed: Floats
    steer: Floats | None = None

    def __post_init__(self) -> None:
        speed = checks.floats(self.speed, "wheel speed", (None, None))
        object.__setattr__(self, "speed", speed)
        if self.steer is not None:
            object.__setattr__(
                self, "steer", checks.floats(self.steer, "steer", (len(speed), None))
            )

    def __len__(self) -> int:
        return int(self.speed.shape[0])


@dataclass(frozen=True, eq=False)
class WheelLog(Shown):
    """Wheel states over time.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times [s] on the odometry clock, strictly increasing.
    states : WheelStates
        The states of the wheels at these times.
    yaw_rate : ndarray, shape (n,), optional
        Rotation rate about body Z [rad/s] that another sensor tells, such as a gyro.  The wheels
        are held against it (`check_vehicle`); it enters no velocity.
    """

    t: Floats
    states: WheelStates
    yaw_rate: Floats | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", checks.times(self.t, "wheel t"))
        if self.yaw_rate is not None:
            yaw_rate = checks.floats(self.yaw_rate, "yaw_rate", self.t.shape)
            object.__setattr__(self, "yaw_rate", yaw_rate)
        if len(self.states) != self.t.size:
            raise InputError(f"{self.t.size} times but {len(self.states)} rows of wheel states")

    def __len__(self) -> int:
        return int(self.t.size)


@dataclass(frozen=True, eq=False)
class BodyTwist(Shown):
    """Motion of the body in the plane, seen from the origin of the body frame.

    Attributes
    ----------
    v : ndarray, shape (n, 2)
        Velocity of the origin along body X and Y [m/s].
    yaw_rate : ndarray, shape (n,)
        Rotation rate about body Z [rad/s], counter-clockwise.
    slip : ndarray, shape (n,)
        Root mean square, over the wheels, of the difference between what a wheel measures and
        what a rigid body with this twist would make it measure [m/s].
    """

    v: Floats
    yaw_rate: Floats
    slip: Floats

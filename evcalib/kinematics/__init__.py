"""From wheel states to the velocity of the body, and back.

A rigid body moving in the plane has the twist (v_x, v_y, omega).  The ground under a wheel at
(x, y) then passes with the contact velocity

    u = (v_x - omega y, v_y + omega x).

Every wheel measures u, or one component of it, or rules one out, so every vehicle is a matrix H
with ``measured = H @ (v_x, v_y, omega)``, which least squares turns round.  What is left over is
slip.

====================  =====================================  ====================
vehicle               a wheel measures                       wheels
====================  =====================================  ====================
`Swerve`              u: its speed along its steering angle  2 or more, anywhere
`Mecanum`             u_x minus or plus u_y (rollers at 45)  4 at a rectangle
`Omni`                u along its drive direction            3 or more, anywhere
`Rolling`             u along its direction, and 0 across    2 or more, anywhere
====================  =====================================  ====================

`Rolling` makes differential drives, skid-steer vehicles, cars (one steering angle, or Ackermann's)
and tricycles.

``vehicle.twist(states)`` and ``vehicle.wheel_states(v, yaw_rate)`` are each other's inverse;
`body_velocities` applies the first to a whole wheel log.  All quantities are in the body frame
(X forward, Y left, yaw counter-clockwise from above), in m, s, rad.
"""

from evcalib.kinematics._checks import Parameter, VehicleCheck, check_vehicle, turning_centre
from evcalib.kinematics._rolling import Rolling
from evcalib.kinematics._states import BodyTwist, WheelLog, WheelStates
from evcalib.kinematics._vehicles import Mecanum, Omni, Swerve
from evcalib.kinematics._velocities import (
    REFUSE_SLIP,
    WARN_SLIP,
    BodyVelocities,
    Vehicle,
    body_velocities,
)
from evcalib.kinematics._wheels import MAX_REACH, OmniWheel, RollingWheel, Wheel

__all__ = [
    "MAX_REACH",
    "REFUSE_SLIP",
    "WARN_SLIP",
    "BodyTwist",
    "BodyVelocities",
    "Mecanum",
    "Omni",
    "OmniWheel",
    "Parameter",
    "Rolling",
    "RollingWheel",
    "Swerve",
    "Vehicle",
    "VehicleCheck",
    "Wheel",
    "WheelLog",
    "WheelStates",
    "body_velocities",
    "check_vehicle",
    "turning_centre",
]

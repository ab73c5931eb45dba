"""Real events of slider_depth and its exact transforms, stitched into a drive of four fingers.

The slider carries the camera along its own +X at 0.318 m/s.  Played backwards with polarities
flipped it goes along -X; with the image mirrored or transposed, along -X or +Y, under a mirrored
or transposed calibration.  Moved by whole pixels on a larger canvas these calibrations fall
together to 0.3 px, which is 0.05 degrees: so one camera sees all of them.
"""

from dataclasses import dataclass

import numpy as np

from evcalib.camera import Camera
from evcalib.events import Events
from evcalib.geometry import rotation_vector_to_matrix
from evcalib.series import VelocitySeries

SPEED = 0.318
STEADY = 0.2, 1.2
"""Part of the recording [s]; the slider has its speed from its start on."""

PAUSE = 0.6

SIDE = 261

LOOKS_DOWN = np.diag([1.0, -1.0, -1.0])
R_BODY_CAM = rotation_vector_to_matrix([0.0, 0.0, 0.6]) @ LOOKS_DOWN
"""The directions of the transforms lie in the image plane, so the camera looks at the ground."""


@dataclass(frozen=True)
class Part:
    """What is done to the recording, and the direction of motion that it has then."""

    direction: tuple[float, float, float]
    mirrored: bool = False
    transposed: bool = False
    backwards: bool = False


FINGERS = (
    Part((1, 0, 0)),
    Part((-1, 0, 0), backwards=True),
    Part((0, 1, 0), transposed=True),
    Part((0, -1, 0), transposed=True, backwards=True),
    Part((-1, 0, 0), mirrored=True),
    Part((1, 0, 0), mirrored=True, backwards=True),
    Part((0, -1, 0), mirrored=True, transposed=True),
    Part((0, 1, 0), mirrored=True, transposed=True, backwards=True),
)
"""Four fingers, out and back.  The slider's axis is known to a degree; this error cancels."""


def canvas(camera):
    """Return the one camera of all parts."""
    k1, k2, _, _, k3 = camera.distortion
    focal = np.sqrt(camera.fx * camera.fy)
    return Camera(SIDE, SIDE, focal, focal, 130.0, 130.0, (k1, k2, 0.0, 0.0, k3))


def stitched(events, camera, *, offset, rate=100.0):
    """Return the events of all parts, and the velocities of the body on its own clock."""
    keep = (events.t >= 1e6 * STEADY[0]) & (events.t < 1e6 * STEADY[1])
    x, y, t, p = (getattr(events, name)[keep] for name in "xytp")
    x, y, t = x.astype(np.int64), y.astype(np.int64), t - t[0]
    length = int(t[-1])
    columns, moves, start = [], [], round(1e6 * PAUSE)
    for part in FINGERS:
        u, v = (camera.width - 1 - x if part.mirrored else x), y
        cx, cy = (camera.width - 1 - camera.cx if part.mirrored else camera.cx), camera.cy
        if part.transposed:
            u, v, cx, cy = v, u, cy, cx
        u, v = u + round(130 - cx), v + round(130 - cy)
        order = slice(None, None, -1) if part.backwards else slice(None)
        times = length - t[order] if part.backwards else t
        columns.append((u[order], v[order], times + start, p[order] ^ part.backwards))
        moves.append((1e-6 * start, 1e-6 * (start + length), R_BODY_CAM @ part.direction))
        start += length + round(1e6 * PAUSE)
    joined = (np.concatenate(c) for c in zip(*columns, strict=True))
    whole = Events.from_arrays(*joined, SIDE, SIDE)
    body = np.arange(0.0, 1e-6 * start, 1.0 / rate)
    velocity = np.zeros((body.size, 3))
    for begin, end, direction in moves:
        velocity[(body >= begin + offset) & (body <= end + offset)] = SPEED * direction
    return whole, VelocitySeries(body, velocity)

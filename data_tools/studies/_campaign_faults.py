"""What a trial of the campaign draws: a motion, a camera, gaps, an error of the model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from data_tools.simulation import drives
from data_tools.simulation.drives import Drive
from data_tools.studies.sighting_drives import Fault
from evcalib.arrays import Floats
from evcalib.camera import Camera

Generator = np.random.Generator

SENSORS = ((96, 72), (128, 128), (240, 180), (346, 260), (640, 480))
"""Sizes of sensors [px]."""

MOTIONS = {
    "straight": 0.05,
    "arc": 0.05,
    "s-curve": 0.2,
    "fingers": 0.2,
    "polyline": 0.1,
    "spline": 0.2,
    "stop and go": 0.15,
    "cut": 0.05,
}
"""Motions and their shares.  Cut: fingers that start and stop at once."""


def _sign(rng: Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _within(rng: Generator, low: float, high: float) -> float:
    """Return a size drawn evenly over its logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _drift(rng: Generator, camera: Camera) -> tuple[Fault, float]:
    size = _sign(rng) * _within(rng, 20e-6, 500e-6)
    return Fault(drift=size), 1e6 * size


def _latency(rng: Generator, camera: Camera) -> tuple[Fault, float]:
    size = _within(rng, 0.002, 0.02)
    return Fault(latency=size, latency_period=float(rng.uniform(2.0, 20.0))), 1e3 * size


def _quantum(rng: Generator, camera: Camera) -> tuple[Fault, float]:
    size = float(rng.choice([0.005, 0.01, 0.015, 0.02]))
    return Fault(quantum=size), 1e3 * size


def _jitter(rng: Generator, camera: Camera) -> tuple[Fault, float]:
    size = _within(rng, 0.001, 0.008)
    return Fault(jitter=size), 1e3 * size


def _radius(rng: Generator, camera: Camera) -> tuple[Fault, float]:
    size = float(rng.uniform(-5.0, 5.0))
    return Fault(radius=1.0 + 0.01 * size), size


def _slip(rng: Generator, camera: Camera) -> tuple[Fault, float]:
    size = float(rng.uniform(-5.0, 5.0))
    return Fault(slip=0.01 * size), size


def _steering(rng: Generator, camera: Camera) -> tuple[Fault, float]:
    size = float(rng.uniform(-3.0, 3.0))
    return Fault(steering=float(np.radians(size))), size


def _yaw(rng: Generator, camera: Camera) -> tuple[Fault, float]:
    size = float(rng.uniform(1.0, 6.0))
    return Fault(yaw=float(np.radians(size))), size


def _untold_yaw(rng: Generator, camera: Camera) -> tuple[Fault, float]:
    size = float(rng.uniform(1.0, 6.0))
    return Fault(yaw=float(np.radians(size)), yaw_told=False), size


def _lever(rng: Generator, camera: Camera) -> tuple[Fault, float]:
    x, y, z = (float(value) for value in rng.uniform(-0.5, 0.5, 3))
    return Fault(yaw=float(np.radians(rng.uniform(1.0, 6.0))), lever=(x, y, z)), float(
        np.hypot(x, y)
    )


def _focal(rng: Generator, camera: Camera) -> tuple[Fault, float]:
    size = float(rng.uniform(-5.0, 5.0))
    return Fault(focal=1.0 + 0.01 * size), size


def _centre(rng: Generator, camera: Camera) -> tuple[Fault, float]:
    x, y = (float(value) for value in 0.05 * camera.width * rng.uniform(-1.0, 1.0, 2))
    return Fault(centre=(x, y)), float(np.hypot(x, y))


FAULTS: dict[str, Callable[[Generator, Camera], tuple[Fault, float]]] = {
    "none": lambda rng, camera: (Fault(), 0.0),
    "drift": _drift,
    "latency": _latency,
    "quantum": _quantum,
    "jitter": _jitter,
    "radius": _radius,
    "slip": _slip,
    "steering": _steering,
    "yaw": _yaw,
    "untold yaw": _untold_yaw,
    "lever": _lever,
    "focal": _focal,
    "centre": _centre,
}
"""Draw an error of the model; its size in the unit that its group names, or px, or m."""


def camera_of(rng: Generator) -> Camera:
    """Draw a sensor and a lens of 45 to 90 degrees."""
    width, height = SENSORS[int(rng.integers(len(SENSORS)))]
    focal = 0.5 * width / np.tan(0.5 * np.radians(rng.uniform(45.0, 90.0)))
    return Camera(width, height, focal, focal, 0.5 * (width - 1), 0.5 * (height - 1))


def drive_of(rng: Generator) -> Drive:
    """Draw a motion of 12 to 16 s."""
    kind = str(rng.choice(list(MOTIONS), p=list(MOTIONS.values())))
    duration, speed = float(rng.uniform(12.0, 16.0)), float(rng.uniform(0.3, 1.0))
    heading = float(rng.uniform(-np.pi, np.pi))
    if kind == "straight":
        return drives.straight(duration, heading=heading, speed=speed)
    if kind == "arc":
        radius = _sign(rng) * float(rng.uniform(1.5, 6.0))
        return drives.arc(duration, radius=radius, heading=heading, speed=speed)
    if kind == "s-curve":
        return drives.s_curve(
            duration,
            amplitude=float(np.radians(rng.uniform(20.0, 90.0))),
            period=float(rng.uniform(3.5, 9.0)),
            heading=heading,
            phase=float(rng.uniform(0, 2 * np.pi)),
            speed=speed,
        )
    if kind == "polyline":
        return drives.polyline(
            duration,
            turn=_sign(rng) * float(np.radians(rng.uniform(20.0, 100.0))),
            side=float(rng.uniform(1.5, 3.0)),
            heading=heading,
            turn_time=float(rng.choice([0.0, 0.2, 0.6])),
            speed=speed,
        )
    if kind in ("fingers", "cut"):
        return _fingers(rng, kind, duration, heading, speed)
    return _wander(rng, kind, duration, speed)


def _fingers(rng: Generator, kind: str, duration: float, heading: float, speed: float) -> Drive:
    out = float(rng.uniform(1.2, 2.0))
    count = max(int(duration / (2 * (out + 0.4))), 2)
    angles = heading + np.radians(rng.uniform(-80.0, 80.0, count))
    smooth = drives.fingers(angles.tolist(), out=out, pause=0.4, speed=speed)
    if kind == "fingers":
        return smooth
    leg = out + 0.4

    def at_once(t: Floats) -> Floats:
        return np.where(np.mod(t, leg) < out, speed, 0.0)

    return Drive(kind, smooth.duration, smooth.angle, at_once)


def _wander(rng: Generator, kind: str, duration: float, speed: float) -> Drive:
    """Return a direction and a speed that swing by three sines each; or the speed goes and stops.

    The spline of a path is as smooth.
    """
    rates = 2 * np.pi / rng.uniform(2.5, 12.0, (2, 3))
    phases = rng.uniform(0, 2 * np.pi, (2, 3))
    swing = np.radians(rng.uniform(15.0, 45.0))

    def waves(which: int, t: Floats) -> Floats:
        return np.asarray(np.sin(np.multiply.outer(t, rates[which]) + phases[which]).sum(axis=-1))

    def angle(t: Floats) -> Floats:
        return phases[0, 0] + swing * waves(0, t)

    if kind == "spline":
        return Drive(kind, duration, angle, lambda t: speed * (1.0 + 0.25 * waves(1, t)))
    period, ramp = float(rng.uniform(3.0, 5.0)), float(rng.uniform(0.2, 0.6))

    def stop_and_go(t: Floats) -> Floats:
        u = np.mod(t, period)
        return speed * np.asarray(np.clip(np.minimum(u, 0.7 * period - u) / ramp, 0.0, 1.0))

    return Drive(kind, duration, angle, stop_and_go)


def spans(
    rng: Generator, duration: float, most: int, longest: float
) -> tuple[tuple[float, float], ...]:
    starts = np.sort(rng.uniform(1.0, duration - 1.0, int(rng.integers(0, most + 1))))
    return tuple((float(start), float(start + rng.uniform(0.3, longest))) for start in starts)

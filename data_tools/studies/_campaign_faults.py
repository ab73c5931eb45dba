"""What a trial of the campaign draws beside its drive: a camera, and an error of the model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from data_tools.simulation.random_drives import sign
from data_tools.studies.sighting_drives import Fault
from evcalib.camera import Camera

Generator = np.random.Generator

SENSORS = ((96, 72), (128, 128), (240, 180), (346, 260), (640, 480))
"""Sizes of sensors [px]."""


def _within(rng: Generator, low: float, high: float) -> float:
    """Return a size drawn evenly over its logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _drift(rng: Generator, camera: Camera) -> tuple[Fault, float]:
    size = sign(rng) * _within(rng, 20e-6, 500e-6)
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


def _tilt(rng: Generator, camera: Camera) -> tuple[Fault, float]:
    size = _within(rng, 0.1, 1.0)
    return Fault(tilt=float(np.radians(size))), size


def _vibration(rng: Generator, camera: Camera) -> tuple[Fault, float]:
    size = _within(rng, 0.1, 0.5)
    return Fault(vibration=float(np.radians(size))), size


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
    "tilt": _tilt,
    "vibration": _vibration,
}
"""Draw an error of the model; its size in the unit that its group names, or px, or m."""


def camera_of(rng: Generator) -> Camera:
    """Draw a sensor and a lens of 45 to 90 degrees."""
    width, height = SENSORS[int(rng.integers(len(SENSORS)))]
    focal = 0.5 * width / np.tan(0.5 * np.radians(rng.uniform(45.0, 90.0)))
    return Camera(width, height, focal, focal, 0.5 * (width - 1), 0.5 * (height - 1))

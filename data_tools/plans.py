"""Drives to choose from when one is planned, all described by the same four numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from data_tools.motion import Drive, arc, fingers, s_curve, straight, zigzag

Plan = Callable[[float, float, float, float], Drive]
"""Makes a drive of a swing [deg], a period [s], a speed [m/s] and a duration [s]."""


def _s_curve(swing: float, period: float, speed: float, duration: float) -> Drive:
    return s_curve(duration, amplitude=np.radians(swing), period=period, speed=speed)


def _fingers(swing: float, period: float, speed: float, duration: float) -> Drive:
    """Go out and back along three directions; the last finger may be cut short."""
    out = 0.4 * period
    pause = 0.1 * period
    count = int(np.ceil(duration / period))
    angles = np.radians(swing) * np.array([0.0, 1.0, -1.0])
    drive = fingers([angles[k % 3] for k in range(count)], out=out, pause=pause, speed=speed)
    return replace(drive, duration=duration)


def _zigzag(swing: float, period: float, speed: float, duration: float) -> Drive:
    """Go left and right by the swing, with turns that take a fifth of a side."""
    side = 0.5 * period
    turn = 2.0 * np.radians(swing)
    return zigzag(duration, turn=turn, side=side, turn_time=0.2 * side, speed=speed)


def _arc(swing: float, period: float, speed: float, duration: float) -> Drive:
    """Turn by the swing in a quarter of the period, as the S-curve does on average."""
    rate = np.radians(swing) / (0.25 * period)
    if rate == 0:
        return _straight(swing, period, speed, duration)
    return arc(duration, radius=speed / rate, speed=speed)


def _straight(swing: float, period: float, speed: float, duration: float) -> Drive:
    return straight(duration, heading=np.radians(swing), speed=speed)


PLANS: dict[str, Plan] = {
    "S-curve": _s_curve,
    "fingers": _fingers,
    "zigzag": _zigzag,
    "arc": _arc,
    "straight": _straight,
}

"""Two trajectories at the same instants: time association by interpolation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evcalib.errors import InputError
from evcalib.poses import MIN_POSES, PoseSeries

Floats = NDArray[np.float64]

KEYFRAMES = 50
"""Poses that are taken, evenly spread: every pair of them is a motion."""


@dataclass(frozen=True, eq=False)
class Motions:
    """Poses of the camera and of the body at the same instants.

    Attributes
    ----------
    camera, body : ndarray, shape (n, 3)
        Positions, each in a world of its own.
    camera_turn, body_turn : ndarray, shape (n, 3, 3)
        Rotations R_world_sensor.
    """

    camera: Floats
    camera_turn: Floats
    body: Floats
    body_turn: Floats


def associate(
    camera: PoseSeries, body: PoseSeries, offsets: Floats, *, keyframes: int = KEYFRAMES
) -> Floats:
    """Return camera times, evenly spread over those that the body's poses cover at all offsets.

    Offsets between the smallest and the largest count too: no time moves across a gap.

    Raises
    ------
    InputError
        If fewer than three are covered.
    """
    low, high = float(offsets.min()), float(offsets.max())
    first, last = body.segment_at(camera.t + low), body.segment_at(camera.t + high)
    t = camera.t[(first >= 0) & (first == last)]
    if t.size < MIN_POSES:
        raise InputError(
            f"trajectories: the camera's ({camera.t[0]:.3f} to {camera.t[-1]:.3f} s) and the"
            f" body's ({body.t[0]:.3f} to {body.t[-1]:.3f} s) share {t.size} pose(s) at offsets of"
            f" {low:g} to {high:g} s, and {MIN_POSES} are needed; check the clocks,"
            " or search less far"
        )
    return t[np.unique(np.linspace(0, t.size - 1, min(keyframes, t.size)).round().astype(int))]


def motions(camera: PoseSeries, body: PoseSeries, t: Floats, offset: float) -> Motions:
    """Return both poses at camera times `t` [s], the body's by interpolation at t + offset."""
    return Motions(*camera.at(t), *body.at(t + offset))

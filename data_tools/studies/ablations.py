"""What each choice of our method is worth: all else equal, on the same streams.

Each trial runs the default and every variant of it on one drive: how velocities are looked up, how
fine the offset is searched and how far, by which score, whether the peak is refined, and under
which loss the rotation is found.  Nothing is asked about error bars, so that the bare estimates
stand side by side.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from data_tools.simulation.random_drives import noise, streams
from data_tools.studies._engine.study import Cell, Row, Study
from evcalib.alignment import StreamPair
from evcalib.alignment.offset import find_offset
from evcalib.alignment.offset_refinement import inliers_at, refine_offset
from evcalib.alignment.registration import Solution
from evcalib.errors import EvcalibError
from evcalib.geometry import rotation_angle
from evcalib.kinematics.velocity_track import VelocityTrack, velocity_track
from evcalib.series import HeadingSeries, VelocitySeries

Floats = np.ndarray

FINE = 500.0
"""Samples per second [1/s] at which a curve other than the polygon is handed to the lookup: ten
times the odometry's, so that the polygon through them is the curve."""


@dataclass(frozen=True)
class Choices:
    """One setting of everything that is varied."""

    interpolation: str = "linear"
    smooth: bool = True
    step: float = 0.01
    window: float = 1.0
    score: str = "profile"
    refine: bool = True
    loss: str = "tukey"


VARIANTS: dict[str, dict[str, Choices]] = {
    "default": {"default": Choices()},
    "interpolation": {
        name: Choices(interpolation=name) for name in ("held", "pchip", "cubic", "slerp")
    },
    "smoothing": {"none": Choices(smooth=False)},
    "grid": {
        f"{1e3 * step:g} ms{'' if refine else ', not refined'}": Choices(step=step, refine=refine)
        for step, refine in (
            (0.001, False),
            (0.01, False),
            (0.05, False),
            (0.001, True),
            (0.05, True),
        )
    },
    "window": {f"+-{window:g} s": Choices(window=window) for window in (0.6, 2.0, 5.0)},
    "score": {name: Choices(score=name) for name in ("trace", "canonical", "scalar", "none")},
    "loss": {name: Choices(loss=name) for name in ("l1", "kabsch", "gnc", "cca")},
}
"""What is varied, and the variants of each beside the default."""

NOISES = {
    "white": noise(0.1),
    "30 % outliers": noise(0.1, outliers=0.3),
    "AR(1) 0.8": noise(0.1, rho=0.8),
}


def study(*, velocity_sigma: float = 0.02) -> Study:
    """Return the study; `velocity_sigma` [m/s] is the noise of the odometry."""
    courses = {
        "s-curve 45 deg": {"motion": "s-curve", "swing_deg": 45.0},
        "polyline 45 deg": {"motion": "polyline", "turn_deg": 45.0},
    }
    settings = [
        (f"{course}, {spoiled}", {**courses[course], "heading_noise": NOISES[spoiled]})
        for course in courses
        for spoiled in NOISES
    ]
    settings += [
        (f"fingers {count}", {"motion": "fingers", "count": count, "heading_noise": noise(0.1)})
        for count in (2, 3, 4, 5)
    ]
    common = {"velocity_noise": noise(velocity_sigma)}
    return Study(
        "ablations", tuple(Cell(name, {**more, **common}) for name, more in settings), trial
    )


def trial(parameters: Mapping[str, Any], seed: np.random.SeedSequence) -> list[Row]:
    """Return a row per variant: errors of its rotation and offset."""
    made = streams(parameters, np.random.default_rng(seed))
    rows: list[Row] = []
    for ablation, variants in VARIANTS.items():
        for name, choices in variants.items():
            row: Row = {"ablation": ablation, "variant": name}
            try:
                offset, R = estimate(made.headings, made.velocities, choices)
            except EvcalibError as error:
                rows.append({**row, "failure": str(error)})
                continue
            error_deg = np.degrees(rotation_angle(R, made.R_body_cam))
            rows.append({**row, "rotation_deg": error_deg, "offset_error_s": offset - made.offset})
    return rows


def estimate(
    headings: HeadingSeries, velocities: VelocitySeries, choices: Choices
) -> tuple[float, Floats]:
    """Return offset [s] and rotation under the given choices, as `evcalib.align` finds them."""
    headings, track = headings.usable(), track_of(velocities, choices)
    if choices.score == "none":
        offset = 0.0
    else:
        curve = find_offset(
            headings, track, max_offset=choices.window, method=choices.score, step=choices.step
        )
        offset = curve.offset
        if choices.score == "profile":
            if choices.refine:
                offset = refine_offset(headings, track, offset).offset
            else:
                offset = float(curve.offsets[curve.peak])
        else:
            offset = inliers_at(headings, track, offset).offset
    return offset, Solution.at(StreamPair.of(headings, track), offset, choices.loss).R


def track_of(velocities: VelocitySeries, choices: Choices) -> VelocityTrack:
    """Return velocities prepared for lookups, on another curve than the polygon if asked."""
    track = velocity_track(velocities, smooth=choices.smooth)
    if choices.interpolation == "linear":
        return track
    t = np.arange(track.t[0], track.t[-1], 1.0 / FINE)
    dense = _CURVES[choices.interpolation](track.t, track.v, t)
    fine = velocity_track(VelocitySeries(t, dense), smooth=False, min_speed=track.min_speed)
    return replace(fine, noise=track.noise)


def _slerp(t: Floats, v: Floats, at: Floats) -> Floats:
    """Return velocities whose direction turns, and whose speed changes, at a constant rate."""
    speed = np.linalg.norm(v, axis=1)
    unit = v / np.maximum(speed, 1e-12)[:, None]
    row = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    share = ((at - t[row]) / (t[row + 1] - t[row]))[:, None]
    angle = np.arccos(np.clip(np.sum(unit[row] * unit[row + 1], axis=1), -1.0, 1.0))[:, None]
    flat = angle < 1e-6
    sine = np.where(flat, 1.0, np.sin(angle))
    first = np.where(flat, 1 - share, np.sin((1 - share) * angle) / sine)
    second = np.where(flat, share, np.sin(share * angle) / sine)
    return (first * unit[row] + second * unit[row + 1]) * np.interp(at, t, speed)[:, None]


_CURVES: dict[str, Callable[[Floats, Floats, Floats], Floats]] = {
    "held": lambda t, v, at: v[np.searchsorted(t, at, side="right") - 1],
    "pchip": lambda t, v, at: PchipInterpolator(t, v)(at),
    "cubic": lambda t, v, at: CubicSpline(t, v)(at),
    "slerp": _slerp,
}

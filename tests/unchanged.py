"""Results of the back end as they are today, so that no change of a digit goes unnoticed.

``python tests/unchanged.py`` writes ``tests/unchanged.json`` anew.  Whether the results are right
is for other tests; these tell that they are the same, for users who compare versions.  Streams that
do not agree are left out: what comes of them hangs on the last digits of a library.  A change
that is meant is written anew, and told in CHANGELOG.md.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.simulation.drives import Drive, arc, fingers, polyline, s_curve, straight, zigzag
from data_tools.simulation.streams import Noise, SyntheticStreams, simulate
from data_tools.studies.sighting_drives import Fault, sight
from data_tools.studies.sightings import Corners
from evcalib.alignment import Calibration, align
from evcalib.camera import Camera
from evcalib.geometry import random_rotation
from evcalib.pipeline import RefinedCalibration
from evcalib.series import HeadingSeries

STORED = Path(__file__).with_suffix(".json")
CAMERA = Camera(240, 180, 150.0, 150.0, 119.5, 89.5)
MOST = 12
"""Longer arrays are told by some of their values."""


def streams(drive: Drive, seed: int, **noise: Any) -> SyntheticStreams:
    return simulate(
        drive,
        np.random.default_rng(seed),
        offset=0.17,
        heading_noise=Noise(**{"sigma": 0.03, "outliers": 0.15, **noise}),
        velocity_noise=Noise(0.015),
    )


def aligned(drive: Drive, seed: int = 1, noise: Any = None, **options: Any) -> Calibration:
    made = streams(drive, seed, **(noise or {}))
    return RefinedCalibration.after(align(made.headings, made.velocities, **options))


def with_intervals() -> Calibration:
    """Headings that are means over intervals, each with its own standard deviation."""
    made = streams(s_curve(12.0, period=5.0), 4)
    t, rng = made.headings.t, np.random.default_rng(7)
    sd = rng.uniform(0.01, 0.06, t.size)
    told = HeadingSeries(t, made.headings.v, t_start=t - 0.1, t_end=t + 0.15, sd=sd)
    return RefinedCalibration.after(align(told, made.velocities, max_offset=0.5))


def refined(kind: str, seed: int, corners: Corners, **options: Any) -> Calibration:
    drives = {
        "s": lambda: replace(s_curve(9.0, amplitude=1.1, period=4.5), speed=_swinging),
        "zigzag": lambda: zigzag(9.0, side=2.0, turn=np.pi / 2, turn_time=0.3),
        "straight": lambda: straight(9.0),
    }
    rng = np.random.default_rng(seed)
    made = sight(
        drives[kind](),
        rng,
        camera=CAMERA,
        R_body_cam=random_rotation(rng),
        offset=0.12,
        corners=corners,
        **options,
    )
    return made.calibrate(max_offset=0.5)


def _swinging(t: np.ndarray) -> np.ndarray:
    return 0.6 + 0.25 * np.sin(1.9 * t)


NOISY = Corners(count=8, noise=0.25, false=0.15)

CASES: dict[str, Callable[[], Calibration]] = {
    "s-curve": lambda: aligned(s_curve(15.0)),
    "s-curve, half of them outliers": lambda: aligned(
        s_curve(15.0), 2, {"outliers": 0.5, "cluster": True, "flips": 0.1}
    ),
    "coloured, gaps": lambda: aligned(
        s_curve(15.0, period=6.0), 3, {"rho": 0.7, "gaps": ((4.0, 5.5),), "dropout": 0.2}
    ),
    "instant turns": lambda: aligned(polyline(16.0), 5),
    "turns that take their time": lambda: aligned(zigzag(16.0, turn_time=0.6), 6),
    "fingers": lambda: aligned(fingers(), 8),
    "arc": lambda: aligned(arc(12.0), 9),
    "straight": lambda: aligned(straight(8.0), 10),
    "straight, offset given": lambda: aligned(straight(8.0), 10, offset=0.2),
    "narrow search": lambda: aligned(s_curve(12.0), 11, max_offset=0.25),
    "intervals": with_intervals,
    **{
        f"{offset} and {rotation}": lambda offset=offset, rotation=rotation: aligned(
            s_curve(10.0, period=4.0),
            12,
            {"outliers": 0.05},
            offset_method=offset,
            rotation_method=rotation,
            max_offset=0.4,
            offset=0.17,
        )
        for offset, rotation in (
            ("trace", "tukey"),
            ("canonical", "kabsch"),
            ("scalar", "l1"),
            ("none", "gnc"),
        )
    },
    "tracks": lambda: refined("s", 1, NOISY),
    "tracks, clock drift": lambda: refined("s", 2, NOISY, fault=Fault(drift=3e-3)),
    "tracks, yaw untold": lambda: refined("s", 3, NOISY, fault=Fault(yaw=0.15, yaw_told=False)),
    "tracks, yaw told": lambda: refined("s", 4, NOISY, fault=Fault(yaw=0.1)),
    "tracks, slip": lambda: refined("s", 5, NOISY, fault=Fault(slip=0.1)),
    "tracks, wrong centre": lambda: refined("s", 6, NOISY, fault=Fault(centre=(12.0, -9.0))),
    "tracks, turns": lambda: refined("zigzag", 7, NOISY, odometry_noise=0.03),
    "tracks, straight": lambda: refined("straight", 8, NOISY),
    "tracks, few and bad": lambda: refined("s", 9, Corners(count=5, noise=0.5, false=0.4)),
}


def flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the numbers and words of a result by name, in its own order."""
    if is_dataclass(value):
        for part in fields(value):
            yield from flat(getattr(value, part.name), f"{name}.{part.name}".lstrip("."))
    elif isinstance(value, tuple):
        for k, part in enumerate(value):
            yield from flat(part, f"{name}[{k}]")
    elif isinstance(value, dict):
        for key, part in value.items():
            yield from flat(part, f"{name}[{key!r}]")
    elif isinstance(value, np.ndarray):
        yield f"{name}.shape", list(value.shape)
        numbers = value.astype(np.float64).ravel()
        step = max(-(-numbers.size // MOST), 1)
        yield name, [_short(x) for x in numbers[::step]]
        if step > 1:
            yield f"{name}.mean", _short(np.nanmean(numbers))
    elif isinstance(value, float | np.floating):
        yield name, _short(value)
    else:
        yield name, value.item() if isinstance(value, np.generic) else value


def _short(value: Any) -> float | str:
    """Return eight digits of a number; JSON has no word for infinity."""
    number = float(f"{float(value):.8g}")
    return number if np.isfinite(number) else str(number)


def told(case: str) -> dict[str, Any]:
    """Return what is stored of a case."""
    return dict(flat(CASES[case]()))


def main() -> None:
    """Write the results of all cases."""
    cases = [f"{json.dumps(case)}: {_object(told(case))}" for case in CASES]
    STORED.write_text("{\n" + ",\n".join(cases) + "\n}\n")


def _object(values: dict[str, Any]) -> str:
    """Return JSON with a line for each name."""
    lines = [f" {json.dumps(name)}: {json.dumps(value)}" for name, value in values.items()]
    return "{\n" + ",\n".join(lines) + "\n}"


if __name__ == "__main__":
    main()

"""The hunt for results that are silently wrong: models with one error each, and what comes out.

Each trial draws a motion, a mounting, a camera, noise, outliers, gaps and an offset; on top comes
the error of its cell, which the calibration is not told of.  The truth is the physical one.  A
result is confident if offset and rotation are said to be determined and nothing in its verdict
speaks against the model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools import motion
from data_tools.motion import Drive
from data_tools.sighting_drives import Corners, Fault, sight
from data_tools.studies._model import Cell, Row, Study
from data_tools.studies._result import StudyResult
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.geometry import random_rotation, rotation_angle
from evcalib.results import Calibration
from evcalib.uncertainty import rotation_radius, t_quantile

Floats = NDArray[np.float64]
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

CELLS = (
    Cell("none", {"fault": "none"}),
    Cell("none, 20 to 40 % outliers", {"fault": "none", "false": [0.2, 0.4]}),
    Cell("none, noise 0.5 to 0.8 px", {"fault": "none", "noise": [0.5, 0.8]}),
    Cell("none, gaps and movers", {"fault": "none", "gaps": True}),
    Cell("clock drift 20 to 500 ppm", {"fault": "drift"}),
    Cell("latency swings by 2 to 20 ms", {"fault": "latency"}),
    Cell("times cut to 5 to 20 ms", {"fault": "quantum"}),
    Cell("times jitter by 1 to 8 ms", {"fault": "jitter"}),
    Cell("wheel radius +-5 %", {"fault": "radius"}),
    Cell("sideways slip +-5 %", {"fault": "slip"}),
    Cell("steering zero +-3 deg", {"fault": "steering"}),
    Cell("yaw 1 to 6 deg/s, told", {"fault": "yaw"}),
    Cell("yaw 1 to 6 deg/s, not told", {"fault": "untold yaw"}),
    Cell("yaw told, lever arm not", {"fault": "lever"}),
    Cell("focal length +-5 %", {"fault": "focal"}),
    Cell("principal point +-5 %", {"fault": "centre"}),
)
"""One error of the model each."""


def study() -> Study:
    """Return the study."""
    return Study("campaign", CELLS, trial)


def trial(parameters: Mapping[str, Any], seed: np.random.SeedSequence) -> list[Row]:
    """Return one row: the error of the model, what came out, and how sure it claims to be."""
    rng = np.random.default_rng(seed)
    drive = drive_of(rng)
    camera = camera_of(rng)
    fault, size = FAULTS[parameters["fault"]](rng, camera)
    false = float(rng.uniform(*parameters.get("false", [0.0, 0.2])))
    # Few matches of a small sensor tell apart what 0.8 px of noise move.
    noise = float(rng.uniform(*parameters.get("noise", [0.1, 0.5])))
    gaps = bool(parameters.get("gaps", False))
    corners = Corners(
        count=int(rng.integers(7, 11)),
        life=float(rng.uniform(0.8, 1.5)),
        noise=noise,
        memory=float(rng.choice([0.0, 0.5])),
        lag=0.1 * float(rng.standard_normal()),
        false=false,
        movers=_spans(rng, drive.duration, 2, 0.8) if gaps else (),
        gaps=_spans(rng, drive.duration, 2, 1.0) if gaps else (),
    )
    made = sight(
        drive,
        rng,
        camera=camera,
        R_body_cam=random_rotation(rng),
        offset=float(rng.uniform(-0.5, 0.5)),
        corners=corners,
        odometry_noise=float(rng.uniform(0.002, 0.015)),
        odometry_gaps=_spans(rng, drive.duration, 2, 1.0) if gaps else (),
        fault=fault,
    )
    drawn: Row = {
        "size": size,
        "motion": drive.kind,
        "width": camera.width,
        "noise_px": noise,
        "false": false,
    }
    try:
        found = made.calibrate(max_offset=MAX_OFFSET)
    except InputError as error:
        return [{**drawn, **_NOTHING, "verdict": str(error)}]
    return [{**drawn, **outcome(found, made.R_body_cam, made.offset)}]


ABSORBED = ("steering", "centre", "focal", "slip", "radius")
"""Errors that the answer takes in without a trace, wholly or in part."""

MAX_OFFSET = 0.6
"""Offsets within which all are searched [s]."""


def outcome(found: Calibration, R_body_cam: Floats, offset: float) -> Row:
    """Return errors, intervals and verdict of one calibration."""
    error = rotation_angle(found.R_body_cam, R_body_cam)
    samples = found.diagnostics.independent_headings
    if found.joint is not None and found.offset_observable:
        samples = found.joint.samples
    return {
        "offset_error_s": found.offset - offset,
        "offset_sd_s": found.offset_sd,
        "offset_95_s": t_quantile(samples) * found.offset_sd,
        "offset_99_s": t_quantile(samples, 0.99) * found.offset_sd,
        "offset_observable": bool(found.offset_observable),
        "rotation_deg": np.degrees(error),
        "rotation_95_deg": np.degrees(found.rotation_radius),
        "rotation_99_deg": np.degrees(rotation_radius(found.rotation_covariance, 0.99, samples)),
        "rotation_observable": bool(found.rotation_observable),
        "determined": bool(found.offset_observable and found.rotation_observable),
        "doubts": " | ".join(getattr(found.verdict, "doubts", ())),
        "joint_px": np.nan if found.joint is None else found.joint.noise,
        "inliers": np.nan if found.joint is None else found.joint.inlier_share,
        "verdict": found.verdict.summary,
    }


_NOTHING: Row = {
    "offset_error_s": np.nan,
    "offset_sd_s": np.nan,
    "offset_95_s": np.nan,
    "offset_99_s": np.nan,
    "offset_observable": False,
    "rotation_deg": np.nan,
    "rotation_95_deg": np.nan,
    "rotation_99_deg": np.nan,
    "rotation_observable": False,
    "determined": False,
    "doubts": "",
    "joint_px": np.nan,
    "inliers": np.nan,
}
"""The row of a trial whose data were refused."""


def verdicts(results: Sequence[StudyResult]) -> list[Row]:
    """Return a row per group and one for those whose error can be told, over runs of the study.

    Shares are of confident results.  ``offset_ms`` and ``rotation_deg`` are median errors of these,
    ``..._per_unit`` the median of what they are over the size of the error.
    """
    names = [name for name in results[0].table if name != "cell"]
    table = {name: np.concatenate([one.table[name] for one in results]) for name in names}
    group = table["group"]
    rows = [_verdict(cell.group, table, group == cell.group) for cell in CELLS]
    absorbed = {cell.group for cell in CELLS if cell.parameters["fault"] in ABSORBED}
    told = np.array([name not in absorbed for name in group.tolist()])
    return [*rows, _verdict("all but those that are absorbed", table, told)]


def _verdict(name: str, table: Mapping[str, NDArray[Any]], rows: NDArray[np.bool_]) -> Row:
    rows = rows & (table["failure"] == "")
    determined = rows & table["determined"].astype(bool)
    sure = determined & (table["doubts"] == "")
    offset, rotation = np.abs(table["offset_error_s"]), table["rotation_deg"]
    size = np.abs(table["size"])
    known = sure & (size > 0)

    def outside(level: int) -> float:
        out = (offset > table[f"offset_{level}_s"]) | (rotation > table[f"rotation_{level}_deg"])
        return _rounded(np.mean(out[sure])) if sure.any() else np.nan

    return {
        "group": name,
        "trials": int(rows.sum()),
        "determined": int(determined.sum()),
        "confident": int(sure.sum()),
        "outside_95": outside(95),
        "outside_99": outside(99),
        "offset_ms": _median(1e3 * offset[sure]),
        "rotation_deg": _median(rotation[sure]),
        "offset_ms_per_unit": _median(1e3 * offset[known] / size[known]),
        "rotation_deg_per_unit": _median(rotation[known] / size[known]),
    }


def _median(values: Floats) -> float:
    return _rounded(np.median(values)) if values.size else np.nan


def _rounded(value: Any) -> float:
    return float(f"{value:.3g}")


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
        return motion.straight(duration, heading=heading, speed=speed)
    if kind == "arc":
        radius = _sign(rng) * float(rng.uniform(1.5, 6.0))
        return motion.arc(duration, radius=radius, heading=heading, speed=speed)
    if kind == "s-curve":
        return motion.s_curve(
            duration,
            amplitude=float(np.radians(rng.uniform(20.0, 90.0))),
            period=float(rng.uniform(3.5, 9.0)),
            heading=heading,
            phase=float(rng.uniform(0, 2 * np.pi)),
            speed=speed,
        )
    if kind == "polyline":
        return motion.polyline(
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
    smooth = motion.fingers(angles.tolist(), out=out, pause=0.4, speed=speed)
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


def _spans(
    rng: Generator, duration: float, most: int, longest: float
) -> tuple[tuple[float, float], ...]:
    starts = np.sort(rng.uniform(1.0, duration - 1.0, int(rng.integers(0, most + 1))))
    return tuple((float(start), float(start + rng.uniform(0.3, longest))) for start in starts)

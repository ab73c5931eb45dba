"""The hunt for results that are silently wrong: models with one error each, and what comes out.

Each trial draws a motion, a mounting, a camera, noise, outliers, gaps and an offset; on top comes
the error of its cell, which the calibration is not told of.  The truth is the physical one.  A
result is confident if offset and rotation are said to be determined and nothing in its verdict
speaks against the model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools.simulation import random_drives
from data_tools.studies import _campaign_faults as draws
from data_tools.studies._engine.result import StudyResult
from data_tools.studies._engine.study import Cell, Row, Study
from data_tools.studies.sighting_drives import sight
from data_tools.studies.sightings import Corners
from evcalib.arrays import Flags, Floats
from evcalib.errors import InputError
from evcalib.geometry import random_rotation, rotation_angle
from evcalib.pipeline import RefinedCalibration
from evcalib.uncertainty import rotation_radius, t_quantile

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
    Cell("tilt 0.1 to 1 deg per m/s^2", {"fault": "tilt"}),
    Cell("vibration 0.1 to 0.5 deg", {"fault": "vibration"}),
)
"""One error of the model each."""


def study() -> Study:
    """Return the study."""
    return Study("campaign", CELLS, trial)


def trial(parameters: Mapping[str, Any], seed: np.random.SeedSequence) -> list[Row]:
    """Return one row: the error of the model, what came out, and how sure it claims to be."""
    rng = np.random.default_rng(seed)
    drive = random_drives.any_drive(rng)
    camera = draws.camera_of(rng)
    fault, size = draws.FAULTS[parameters["fault"]](rng, camera)
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
        movers=random_drives.spans(rng, drive.duration, 2, 0.8) if gaps else (),
        gaps=random_drives.spans(rng, drive.duration, 2, 1.0) if gaps else (),
    )
    made = sight(
        drive,
        rng,
        camera=camera,
        R_body_cam=random_rotation(rng),
        offset=float(rng.uniform(-0.5, 0.5)),
        corners=corners,
        odometry_noise=float(rng.uniform(0.002, 0.015)),
        odometry_gaps=random_drives.spans(rng, drive.duration, 2, 1.0) if gaps else (),
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


ABSORBED = ("steering", "centre", "focal", "slip", "quantum")
"""Errors that the answer takes in without a trace, wholly or in part.

A steering zero turns the rotation; times that are cut, to multiples that divide the odometry's
step, are late by a constant; of wrong intrinsics and of slip a part looks like a rotation.  They
are the groups of ``tests/campaign.csv`` in which more than a tenth of the confident results lie
outside their 99 % intervals; of all others at most 2 % do.
"""

MAX_OFFSET = 0.6
"""Offsets within which all are searched [s]; true ones are drawn within 0.5 s."""


def outcome(found: RefinedCalibration, R_body_cam: Floats, offset: float) -> Row:
    """Return errors, intervals and verdict of one calibration."""
    error = rotation_angle(found.R_body_cam, R_body_cam)
    samples = found.samples
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


def _verdict(name: str, table: Mapping[str, NDArray[Any]], rows: Flags) -> Row:
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

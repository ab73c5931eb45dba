"""Many recordings, one calibration each: on one machine or many, and none harms the others.

The recordings stand in a list (see `data_tools.studies.batch_list`).  A batch is a study whose
trials are recordings: its results are kept as they come, and the same command goes on where it was
stopped.
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.studies._engine.result import StudyResult, load_study
from data_tools.studies._engine.run import run
from data_tools.studies._engine.study import Cell, Study
from data_tools.studies.batch_again import take_along
from data_tools.studies.batch_list import (
    IMU_OPTIONS,
    MOTION_OPTIONS,
    READING_OPTIONS,
    read_list,
)
from evcalib.alignment import Calibration
from evcalib.errors import EvcalibError
from evcalib.geometry import matrix_to_rpy

Calibrate = Callable[..., Calibration]
"""Called with what an entry of the list has but its name, and the folder for results as
``output``, as `data_tools.runs.calibrate.run_files` is."""

SUMMARY = "summary.csv"


@dataclass(frozen=True, eq=False)
class BatchResult:
    """What became of each recording.

    Attributes
    ----------
    result : StudyResult
        A row per recording; ``group`` is its name.
    folder : Path
        Where ``summary.csv`` stands, and a folder of results per recording.
    """

    result: StudyResult
    folder: Path

    @property
    def failures(self) -> list[tuple[str, str]]:
        """Name and reason of each recording that could not be calibrated."""
        return [(name, reason) for name, _, reason in self.result.failures]

    def rows(self) -> list[dict[str, Any]]:
        """Return the summary, a dictionary per recording in the order of the list.

        All have the same keys: ``pandas.DataFrame(batch.rows())`` takes them.
        """
        table = self.result.table
        names = ["name", *(n for n in table if n not in ("cell", "group", "trial", "failure"))]
        columns = [table["group" if name == "name" else name].tolist() for name in names]
        rows = [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
        for row, reason in zip(rows, table["failure"].tolist(), strict=True):
            row["status"] = "failed" if reason else _status(row)
            row["reason"] = reason
        return rows

    def csv(self) -> str:
        """Return the summary as CSV; what is not known is empty."""
        out, rows = io.StringIO(), self.rows()
        writer = csv.DictWriter(out, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows({name: _known(value) for name, value in row.items()} for row in rows)
        return out.getvalue()

    def text(self) -> str:
        """Return the summary for people to read, failures with their reasons last."""
        rows = self.rows()
        width = max(4, *(len(row["name"]) for row in rows))
        head = f"{'name':{width}}  {'status':10}  {'offset [s]':>10}  {'sd':>7}"
        lines = [f"{head}  {'roll, pitch, yaw [deg]':>24}  {'sd':>6}"]
        for row in rows:
            if row["status"] == "failed":
                lines.append(f"{row['name']:{width}}  failed")
                continue
            sd = f"{row['offset_sd_s']:7.4f}" if row["offset_observable"] else f"{'-':>7}"
            rpy = "".join(f"{row[f'{name}_deg']:8.2f}" for name in ("roll", "pitch", "yaw"))
            lines.append(
                f"{row['name']:{width}}  {row['status']:10}  {row['offset_s']:+10.4f}  {sd}"
                f"  {rpy}  {row['rotation_sd_deg']:6.2f}"
            )
        if self.failures:
            lines += ["", f"{len(self.failures)} of {len(rows)} failed:"]
            lines += [f"  {name}: {reason}" for name, reason in self.failures]
        return "\n".join(lines)


def run_batch(
    path: str | Path,
    *,
    folder: str | Path,
    calibrate: Calibrate | None = None,
    workers: int = 1,
    scheduler: str | None = None,
    progress: bool | None = None,
) -> BatchResult:
    """Calibrate every recording of a list that is not calibrated yet.

    Results of recording NAME go to ``folder/NAME``; a table of all to ``folder/summary.csv``.  Run
    again, finished recordings are left alone, and those that failed are tried again; so are those
    whose entry in the list changed, or is new.

    Parameters
    ----------
    path : str or Path
        The list, see `data_tools.studies.batch_list`.
    folder : str or Path
        Where results go; made if there is none.
    calibrate : callable, optional
        What calibrates one recording; `data_tools.runs.calibrate.calibrate_files` if not given.
        Workers import it by name.
    workers, scheduler, progress
        See `data_tools.studies.run_study`.  Workers on other machines need the same paths.

    Raises
    ------
    InputError
        If the list is unusable, or the folder holds results of another version of evcalib.
    EvcalibError
        If results cannot be written, or all workers are lost; what was finished is kept.
    """
    home = Path(os.path.abspath(folder))
    cells = tuple(Cell(entry["name"], entry) for entry in read_list(path))
    work = partial(trial, calibrate=calibrate or _default(), folder=str(home))
    batch = Study("batch", cells, work, retry_failures=True, largest_piece=1, unit="recording")
    take_along(batch, home)
    table = run(
        batch,
        home,
        trials=1,
        seed=0,
        workers=workers,
        scheduler=scheduler,
        progress=progress,
    )
    done = BatchResult(load_study(table), home)
    try:
        (home / SUMMARY).write_text(done.csv(), encoding="utf-8")
    except OSError as error:
        raise EvcalibError(f"cannot write {home / SUMMARY}: {error.strerror}") from None
    return done


def trial(
    parameters: Mapping[str, Any],
    seed: np.random.SeedSequence,
    *,
    calibrate: Calibrate,
    folder: str,
) -> list[dict[str, Any]]:
    """Calibrate one recording; return its row of the summary."""
    given = {name: value for name, value in parameters.items() if name != "name"}
    for name in ("size", "camera_position"):
        if name in given:
            given[name] = tuple(given[name])
    if "odometry_sd" in given:
        given["odometry_sd"] = np.radians(given["odometry_sd"])
    groups = {"reading": READING_OPTIONS, "motion": MOTION_OPTIONS, "imu": IMU_OPTIONS}
    for group, names in groups.items():
        options = {new: given.pop(name) for name, new in names.items() if name in given}
        if options:
            given[group] = options
    found = calibrate(**given, output=Path(folder) / parameters["name"])
    roll, pitch, yaw = np.degrees(matrix_to_rpy(found.R_body_cam))
    row = {
        "offset_s": found.offset,
        "offset_sd_s": found.offset_sd,
        "offset_observable": bool(found.offset_observable),
        "roll_deg": roll,
        "pitch_deg": pitch,
        "yaw_deg": yaw,
        "rotation_sd_deg": np.degrees(found.rotation_sd),
        "rotation_observable": bool(found.rotation_observable),
        "inlier_share": found.inlier_share,
        "verdict": found.verdict.summary,
    }
    return [row]


def _status(row: Mapping[str, Any]) -> str:
    return "determined" if row["rotation_observable"] else "no answer"


def _known(value: Any) -> Any:
    return "" if isinstance(value, float) and math.isnan(value) else value


def _default() -> Calibrate:
    """Return the calibration of files, which replaces what a killed batch left of a recording."""
    from data_tools.runs.calibrate import calibrate_files

    return partial(calibrate_files, overwrite=True)

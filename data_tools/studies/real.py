"""The paper's Table I on its own real data: what was printed, what its script gives, and ours.

The vehicle drove two to five "fingers"; headings and velocities come paired within 10 ms.  With so
few directions, and velocities that hardly change within each, the data cannot tell the offset, and
the rotation to some degrees only; the column ``verdict`` says so.  Differences of tenths of a
degree between methods here mean nothing.

The files are the authors' and have no licence: they are fetched, or taken from a folder, and never
part of this project.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.logs.series_files import read_paired_rows, read_paired_streams
from data_tools.studies._engine.study import Cell, Row, Study
from evcalib.alignment import align
from evcalib.baselines.authors import with_alignment, without_alignment
from evcalib.errors import EvcalibError, InputError
from evcalib.geometry import rotation_angle, rotation_vector_to_matrix

FINGERS = (2, 3, 4, 5)

TRUTH = rotation_vector_to_matrix([-np.pi / 2, 0.0, 0.0])
"""R_body_cam of the rig, by its construction."""

PRINTED = {
    "VC-woTA, as printed": (6.29, 2.02, 2.11, 1.82),
    "VC, as printed": (5.97, 1.98, 2.01, 1.68),
}
"""Errors [deg] in the paper's Table I, for 2, 3, 4 and 5 fingers."""

RIVALS = ("vc_wota", "vc", "cross_correlation", "cca")
"""Methods of :data:`evcalib.baselines.METHODS` that take headings and velocities."""


def study(*, data: str | Path | None = None) -> Study:
    """Return the study on the sets that are there; one trial says all.

    Parameters
    ----------
    data : str or Path, optional
        Folder of ``calib_data_time_{2,3,4,5}traj.npz``, or some of them; fetched if not given.

    Raises
    ------
    InputError
        If there is no set, or it cannot be fetched.
    """
    home = _fetched() if data is None else Path(data)
    found = [count for count in FINGERS if (home / _file(count)).is_file()]
    if not found:
        raise InputError(f"{home} holds none of {', '.join(map(_file, FINGERS))}")
    cells = tuple(Cell(f"{count} fingers", {"fingers": count}) for count in found)
    return Study("real", cells, partial(trial, folder=str(home)))


def trial(parameters: Mapping[str, Any], seed: np.random.SeedSequence, *, folder: str) -> list[Row]:
    """Return a row per method; nothing is random but our bootstrap."""
    path, place = Path(folder) / _file(parameters["fingers"]), FINGERS.index(parameters["fingers"])
    rows: list[Row] = [
        {"method": name, "rotation_deg": degrees[place]} for name, degrees in PRINTED.items()
    ]
    paired, given = read_paired_rows(path), read_paired_streams(path)
    rows.append(_row("VC-woTA, released script", without_alignment(paired)))
    rows.append(_row("VC, released script", with_alignment(paired)))
    rows += [_rival(name, given.headings, given.velocities) for name in RIVALS]
    draws = int(seed.generate_state(1)[0])
    found = align(given.headings, given.velocities, hold=given.hold, seed=draws)
    return [*rows, _ours(found)]


def _ours(found: Any) -> Row:
    return {
        **_row("ours", found),
        "rotation_sd_deg": np.degrees(found.rotation_sd),
        "offset_sd_s": found.offset_sd,
        "offset_observable": "yes" if found.offset_observable else "no",
        "verdict": found.verdict.summary,
    }


def _rival(name: str, headings: Any, velocities: Any) -> Row:
    from evcalib.baselines import RivalInput, calibrate_with

    try:
        return _row(name, calibrate_with(name, RivalInput(headings, velocities)))
    except EvcalibError as error:
        return {"method": name, "failure": str(error)}


def _row(name: str, found: Any) -> Row:
    degrees = np.degrees(rotation_angle(found.R_body_cam, TRUTH))
    return {"method": name, "rotation_deg": degrees, "offset_s": found.offset}


def _file(count: int) -> str:
    return f"calib_data_time_{count}traj.npz"


def _fetched() -> Path:
    """Return the folder of the fetched files."""
    from data_tools.files.datasets import fetch

    return fetch("paper-data")

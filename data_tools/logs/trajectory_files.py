"""Trajectories as files in the TUM format: rows of ``t x y z qx qy qz qw``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from data_tools.files.csv_table import check_times, in_our_units, read_table
from evcalib.errors import InputError
from evcalib.poses import PoseSeries

COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")


def read_tum(path: str | Path, notes: list[str] | None = None) -> PoseSeries:
    """Read a trajectory.

    Parameters
    ----------
    path : path
        The file: eight columns, named as here or in this order without names; separators, comments
        and encodings are those of `data_tools.files.csv_table`.
    notes : list of str, optional
        Takes what was left out or taken for granted.

    Raises
    ------
    InputError
        If the file cannot be read, a line does not hold eight finite numbers, or the poses are
        unusable (see :class:`evcalib.poses.PoseSeries`).
    """
    table = in_our_units(read_table(path, ours=COLUMNS, alias=_ours, names={len(COLUMNS): COLUMNS}))
    lacking = [name for name in COLUMNS if name not in table.columns]
    if lacking:
        raise InputError(
            f"{path} lacks {', '.join(lacking)} of a TUM trajectory ({' '.join(COLUMNS)}); it has"
            f" {', '.join((*table.columns, *table.foreign))}"
        )
    table = check_times(table)
    if notes is not None:
        notes += table.notes
    values = np.stack([table.columns[name] for name in COLUMNS], axis=1)
    try:
        return PoseSeries(values[:, 0], values[:, 1:4], values[:, [7, 4, 5, 6]])
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def write_tum(path: str | Path, poses: PoseSeries) -> None:
    """Write a trajectory so that reading it gives the same again, rotations to rounding."""
    quaternion = Rotation.from_matrix(poses.matrices).as_quat()
    rows = np.hstack([poses.t[:, None], poses.position, quaternion])
    with open(path, "w", encoding="utf-8") as file:
        file.write(f"# {' '.join(COLUMNS)}\n")
        file.writelines(" ".join(map(repr, row)) + "\n" for row in rows.tolist())


def _ours(name: str) -> str:
    """Return our name of a column such as ``timestamp``, ``tx``, ``p_x`` or ``q_w``."""
    plain = name.lower().replace("_", "")
    if plain in ("t", "time", "timestamp", "stamp"):
        return "t"
    return plain if plain[:1] == "q" else plain[-1:]

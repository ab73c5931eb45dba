"""Trajectories as files in the TUM format: rows of ``t x y z qx qy qz qw``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from data_tools.files.text import read_text
from evcalib.errors import InputError
from evcalib.poses import PoseSeries

COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")


def read_tum(path: str | Path) -> PoseSeries:
    """Read a trajectory.

    Columns are separated by spaces, tabs or commas; lines that begin with ``#`` are comments.

    Raises
    ------
    InputError
        If the file cannot be read, a line does not hold eight finite numbers, or the poses are
        unusable (see :class:`evcalib.poses.PoseSeries`).
    """
    text = read_text(path)
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        where, cells = f"{path} line {number}", line.replace(",", " ").split()
        if rows and line.lstrip().startswith("#") and len(cells) == len(COLUMNS):
            raise InputError(f"{where}: a comment that looks like a damaged pose; take it out")
        if cells and not line.lstrip().startswith("#"):
            rows.append(_numbers(where, cells))
    if not rows:
        raise InputError(f"{path} holds no pose: each line must be {' '.join(COLUMNS)}")
    values = np.array(rows)
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


def _numbers(where: str, cells: list[str]) -> list[float]:
    if len(cells) != len(COLUMNS):
        raise InputError(
            f"{where} has {len(cells)} values, not the {len(COLUMNS)} of a TUM trajectory"
            f" ({' '.join(COLUMNS)})"
        )
    try:
        row = [float(cell) for cell in cells]
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
    if not np.isfinite(row).all():
        raise InputError(f"{where} holds a value that is not a finite number")
    return row

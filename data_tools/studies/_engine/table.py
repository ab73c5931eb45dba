"""The columnar file of a finished study: HDF5, one data set per column.

The rows are in the order of cells and trials, and nothing in the file tells when, where or by how
many workers it was made, so that equal studies are equal files, byte for byte.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools.files.atomic import replacing
from data_tools.studies._engine.study import Cell, Outcome, Study
from evcalib.errors import EvcalibError, InputError

Columns = dict[str, NDArray[Any]]

KEYS = ("cell", "group", "trial", "failure")
"""Columns that every study has: number and name of the cell, number of the trial, and why it gave
nothing (empty if it did)."""

FORM = "evcalib study 1"


def columns_of(outcomes: Iterable[Outcome], cells: tuple[Cell, ...]) -> Columns:
    """Return the table of outcomes; of several with one key the last one counts."""
    last = {outcome.key: outcome for outcome in outcomes}
    rows: list[dict[str, Any]] = []
    for key in sorted(last):
        outcome = last[key]
        head = dict(zip(KEYS, (key[0], cells[key[0]].group, key[1], outcome.failure), strict=True))
        rows += [{**head, **row} for row in outcome.rows or ({},)]
    names = [*KEYS, *dict.fromkeys(name for row in rows for name in row if name not in KEYS)]
    failed = [bool(row["failure"]) for row in rows]
    return {name: _column([row.get(name) for row in rows], failed) for name in names}


def _column(values: list[Any], failed: list[bool]) -> NDArray[Any]:
    """Return values as text, booleans, whole numbers or numbers.

    Gaps are "" or NaN; those of failed rows alone are False among booleans.
    """
    kinds = {type(v) for v, gone in zip(values, failed, strict=True) if not (gone and v is None)}
    if str in kinds:
        return np.array(["" if value is None else str(value) for value in values])
    if kinds == {bool}:
        return np.array([bool(value) for value in values])
    if kinds == {int} and None not in values:
        return np.array(values, dtype=np.int64)
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def write_table(path: Path, identity: Mapping[str, Any], study: Study, columns: Columns) -> None:
    """Write the file at once: it is there whole, or not at all.

    Raises
    ------
    EvcalibError
        If it cannot be written.
    """
    import h5py

    try:
        with replacing(path) as part, h5py.File(part, "w", libver=("v110", "v110")) as file:
            file.attrs["form"] = FORM
            file.attrs["identity"] = json.dumps(dict(identity))
            file.attrs["columns"] = json.dumps(list(columns))
            file["cells"] = np.frombuffer(study.cells_json(), dtype=np.uint8)
            table = file.create_group("table")
            for name, values in columns.items():
                text = values.dtype.kind == "U"
                data = np.char.encode(values, "utf-8") if text else values
                packing: dict[str, Any] = {"compression": "gzip", "shuffle": True}
                if data.dtype.itemsize == 0 or data.size == 0:
                    data, packing = data.astype("S1") if text else data, {}
                table.create_dataset(name, data=data, **packing).attrs["text"] = text
    except (OSError, RuntimeError) as error:
        raise EvcalibError(
            f"cannot write {path}: {error}; the finished trials are kept beside it: mend the cause"
            " and give the same command again"
        ) from None


def read_table(path: str | Path) -> tuple[dict[str, Any], tuple[Cell, ...], Columns]:
    """Return identity, cells and columns of a file.

    Raises
    ------
    InputError
        If it is no file of a finished study.
    """
    import h5py

    if not Path(path).is_file():
        raise InputError(f"there is no file {path}")
    try:
        with h5py.File(path, "r") as file:
            if file.attrs["form"] != FORM:
                raise InputError(f"{path} is no study, or one of another version of evcalib")
            identity = json.loads(file.attrs["identity"])
            cells = tuple(Cell(*cell) for cell in json.loads(file["cells"][()].tobytes()))
            names = json.loads(file.attrs["columns"])
            columns = {name: _read_column(file["table"][name]) for name in names}
    except (OSError, KeyError, ValueError, TypeError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path} is no file of a finished study") from None
    return identity, cells, columns


def _read_column(data: Any) -> NDArray[Any]:
    values = np.asarray(data[()])
    return np.char.decode(values, "utf-8") if data.attrs["text"] else values

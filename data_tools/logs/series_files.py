"""Headings and velocities as files: CSV, and the paired rows of the paper's authors (.npz).

A headings file has the columns ``t,vx,vy,vz`` and, optionally, ``t_start,t_end`` [s], ``weight``,
``sd_deg`` [deg], ``inliers`` and ``valid`` (0 or 1).  A velocities file has ``t,vx,vy``, and
optionally ``vz`` [m/s], ``yaw_rate`` [rad/s] and ``direction_sd_deg`` (the error that all
directions share, see `evcalib.series.VelocitySeries`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_tools.files.archives import SUFFIX, load_array, opened_zip
from data_tools.files.csv_table import Table, check_times, in_our_units, read_table, write_table
from data_tools.logs.column_maps import Columns, converted, only_ours, read_mapped
from evcalib.arrays import Floats
from evcalib.baselines.authors import PairedRows
from evcalib.errors import InputError
from evcalib.series import HeadingSeries, VelocitySeries

MAX_STEP = 5.0
"""A median step between rows above this [s] is taken for a mistake of units."""

PAIRING = 0.01
"""Largest distance in time [s] of the two halves of an authors' row."""


def read_headings(path: str | Path, notes: list[str] | None = None) -> HeadingSeries:
    """Read a headings file.

    Parameters
    ----------
    path : path
        The CSV file; see `data_tools.files.csv_table`.
    notes : list of str, optional
        Takes what was left out or taken for granted.

    Raises
    ------
    InputError
        If the file is empty, lacks a column or has an unknown one, or a row is unusable.
    """
    needed = ("t", "vx", "vy", "vz")
    optional = ("t_start", "t_end", "weight", "sd_deg", "inliers", "valid")
    table = in_our_units(read_table(path, ours=needed + optional, names={4: needed}))
    table = check_times(_checked(table, needed, optional), max_step=MAX_STEP)
    if notes is not None:
        notes += table.notes
    columns = table.columns
    sd = columns.get("sd_deg")
    valid = columns.get("valid")
    if valid is not None and not np.isin(valid, (0, 1)).all():
        raise InputError(f"{table.where(~np.isin(valid, (0, 1)))}: valid must be 0 or 1")
    try:
        return HeadingSeries(
            columns["t"],
            np.stack([columns[name] for name in ("vx", "vy", "vz")], axis=1),
            t_start=columns.get("t_start"),
            t_end=columns.get("t_end"),
            weight=columns.get("weight"),
            sd=None if sd is None else np.radians(sd),
            inliers=columns.get("inliers"),
            valid=None if valid is None else valid == 1,
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def write_headings(path: str | Path, headings: HeadingSeries) -> None:
    """Write a headings file with the columns that the series has."""
    columns = {"t": headings.t, "vx": headings.v[:, 0], "vy": headings.v[:, 1]}
    columns["vz"] = headings.v[:, 2]
    for name in ("t_start", "t_end", "weight", "inliers"):
        values = getattr(headings, name)
        if values is not None:
            columns[name] = values
    if headings.sd is not None:
        columns["sd_deg"] = np.degrees(headings.sd)
    if headings.valid is not None:
        columns["valid"] = headings.valid.astype(np.float64)
    write_table(path, columns)


def read_velocities(
    path: str | Path,
    columns: Columns | None = None,
    time_unit: str | None = None,
    notes: list[str] | None = None,
) -> VelocitySeries:
    """Read a velocities file.

    Parameters
    ----------
    path : path
        The CSV file.
    columns : mapping or path, optional
        Which of its columns, in which units, are ours; see `data_tools.logs.column_maps`.
    time_unit : {"s", "ms", "us", "ns"}
        Unit of ``t``, unless the map tells it.
    notes : list of str, optional
        Takes what was held, left out or taken for granted.

    Raises
    ------
    InputError
        If the file is empty, lacks a column or has one misspelt, or a row is unusable.
    """
    needed, optional = ("t", "vx", "vy"), ("vz", "yaw_rate", "direction_sd_deg")
    names = {3: needed, 5: needed + optional[:2]}
    ours = needed + optional
    table, entries = read_mapped(path, columns, ours=ours, time_unit=time_unit, names=names)
    table = check_times(_checked(table, needed, optional, columns is None), max_step=MAX_STEP)
    if notes is not None:
        notes += table.notes
    values = {name: column for name, column in table.columns.items() if name != "t"}
    t, found, _ = converted(table.columns["t"], values, entries)
    found["t"] = t
    v_z = found.get("vz", np.zeros_like(found["t"]))
    try:
        v = np.stack([found["vx"], found["vy"], v_z], axis=1)
        shared = np.radians(np.max(found.get("direction_sd_deg", 0.0)))
        return VelocitySeries(found["t"], v, found.get("yaw_rate"), direction_sd=float(shared))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def write_velocities(path: str | Path, velocities: VelocitySeries) -> None:
    """Write a velocities file."""
    x, y, z = velocities.v.T
    columns = {"t": velocities.t, "vx": x, "vy": y, "vz": z}
    if velocities.yaw_rate is not None:
        columns["yaw_rate"] = velocities.yaw_rate
    if velocities.direction_sd:
        sd = np.degrees(velocities.direction_sd)
        columns["direction_sd_deg"] = np.full(velocities.t.size, sd)
    write_table(path, columns)


@dataclass(frozen=True, eq=False)
class PairedStreams:
    """The two streams of an authors' file.

    Attributes
    ----------
    headings, velocities
        The streams, sorted; headings of one time are averaged to one.
    merged : int
        Number of rows that were merged away.
    hold : float
        Tolerance [s] within which the rows were paired: what `align` takes as `hold`.
    """

    headings: HeadingSeries
    velocities: VelocitySeries
    merged: int
    hold: float = PAIRING


def read_paired_rows(path: str | Path) -> PairedRows:
    """Read the rows of an authors' file as they are (array ``best_set``, shape (n, 8)).

    Raises
    ------
    InputError
        If the file is no such archive.
    """
    with opened_zip(Path(path)) as archive:
        names = [name.removesuffix(SUFFIX) for name in archive.namelist()]
        if "best_set" not in names:
            found = ", ".join(names)[:200] or "nothing"
            raise InputError(f"{path} holds {found}, not the authors' array best_set")
        table = load_array(archive, "best_set")
    try:
        return PairedRows.from_rows(table)
    except (ValueError, TypeError) as error:
        raise InputError(f"{path}: {error}") from None


def read_paired_streams(path: str | Path) -> PairedStreams:
    """Read an authors' file as two streams.

    Rows that share a heading time are merged: their headings are averaged.  Stored headings are not
    quite unit and are normalised.
    """
    rows = read_paired_rows(path)
    t_e, which = np.unique(rows.t_e, return_inverse=True)
    total = np.zeros((t_e.size, 3))
    np.add.at(total, which, _unit(rows.v_e, path))
    t_o, first = np.unique(rows.t_o, return_index=True)
    return PairedStreams(
        HeadingSeries(t_e, _unit(total, path)),
        VelocitySeries(t_o, rows.v_o[first]),
        merged=int(rows.t_e.size - t_e.size),
    )


def _unit(v: Floats, path: str | Path) -> Floats:
    length = np.linalg.norm(v, axis=1, keepdims=True)
    if (length < 1e-9).any():
        row = int(np.argmin(length))
        raise InputError(f"{path}: row {row} has a heading of length 0; remove it")
    return v / length


def _checked(
    table: Table, needed: tuple[str, ...], optional: tuple[str, ...], named: bool = True
) -> Table:
    missing = [name for name in needed if name not in table.columns]
    if missing:
        raise InputError(
            f"{table.path} lacks the column(s) {', '.join(missing)}; it has"
            f" {', '.join((*table.columns, *table.foreign))}; columns are {', '.join(needed)}, and"
            f" optionally {', '.join(optional)}"
        )
    return only_ours(table, needed + optional) if named else table

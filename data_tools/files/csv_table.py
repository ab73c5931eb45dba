"""Plain tables of numbers: a CSV file with one header line, checked to the last cell."""

from __future__ import annotations

import csv
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools.files.text import check_end
from evcalib.arrays import Flags, Floats, Integers
from evcalib.errors import InputError


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of finite numbers and where in the file each row stands.

    Attributes
    ----------
    path : str
        The file, for messages.
    columns : dict of str to ndarray, shape (n,)
        Values by column name, in the order of the file.
    line : ndarray of int, shape (n,)
        Line of the file (the header is line 1) of each row.
    """

    path: str
    columns: dict[str, Floats]
    line: Integers

    def where(self, bad: Flags) -> str:
        """Return ``"FILE line LINE"`` of the first bad row."""
        return f"{self.path} line {self.line[int(np.argmax(bad))]}"


def read_table(path: str | Path, only: Collection[str] | None = None) -> Table:
    """Read a CSV file of finite numbers with at least two rows below its header.

    With `only`, the other columns are passed over, whatever they hold.

    Raises
    ------
    InputError
        If the file cannot be read, is empty or has one row, repeats a column, or holds a cell
        that is no finite number; the message names file, line and column.  And if it ends within
        a number, without the end of a line: digits may be missing.
    """
    header, rows, lines = _read_cells(path)
    if only is not None:
        places = [k for k, name in enumerate(header) if name in only]
        header = [header[k] for k in places]
        rows = [[row[k] for k in places] for row in rows]
    if len(rows) < 2:
        have = "no row" if not rows else "one row"
        raise InputError(f"{path} has {have} below its header; at least two are needed")
    try:
        values = np.array(rows, dtype=np.float64)
    except ValueError:
        values = np.array([[_number(cell) for cell in row] for row in rows])
    bad = ~np.isfinite(values)
    if bad.any():
        row, column = (int(i) for i in np.argwhere(bad)[0])
        raise InputError(
            f"{path} line {lines[row]}: {header[column]} is {rows[row][column]!r}, not a finite"
            " number; correct or remove this row"
        )
    return Table(str(path), dict(zip(header, values.T.copy(), strict=True)), np.array(lines))


def read_columns(path: str | Path) -> dict[str, NDArray[Any]]:
    """Read a small table of labels and numbers, such as a study leaves.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        By name: numbers where every cell is a number or empty (NaN), else text.

    Raises
    ------
    InputError
        If the file cannot be read, or its rows do not fit its header.
    """
    header, rows, _ = _read_cells(path)
    return {name: _column([row[k] for row in rows]) for k, name in enumerate(header)}


def _column(cells: list[str]) -> NDArray[Any]:
    try:
        return np.array([float(cell) if cell.strip() else np.nan for cell in cells])
    except ValueError:
        return np.array(cells)


def check_times(
    table: Table,
    column: str = "t",
    max_step: float | None = None,
    max_jump: float | None = None,
) -> None:
    """Refuse times that do not increase, whose median step [s] betrays another unit, or that jump.

    A step above `max_jump` [s] is taken for a clock that was set, not for a gap.
    """
    t = table.columns[column]
    steps = np.diff(t)
    for bad, what in ((steps < 0, "goes back"), (steps == 0, "repeats")):
        if bad.any():
            where = table.where(np.concatenate([[False], bad]))
            value = t[1:][bad][0]
            raise InputError(
                f"{where}: time {value:.6f} s {what} in column {column}; times must increase:"
                " sort the rows and drop duplicates"
            )
    if max_step is not None and np.median(steps) > max_step:
        raise InputError(
            f"{table.path}: the median step of column {column} is {np.median(steps):.6g};"
            " are the times in seconds?"
        )
    if max_jump is not None and steps.max() > max_jump:
        row = int(np.argmax(steps)) + 1
        raise InputError(
            f"{table.path} line {table.line[row]}: time {t[row]:.6f} s is {steps[row - 1]:.0f} s"
            f" after the row before it in column {column}: the clock was set, or two logs were"
            " joined; cut the file there"
        )


def write_table(path: str | Path, columns: dict[str, Floats]) -> None:
    """Write columns of equal length so that reading them gives the same numbers again."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(np.stack(list(columns.values()), axis=1).tolist())


def _read_cells(path: str | Path) -> tuple[list[str], list[list[str]], list[int]]:
    rows, lines = [], []
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(_noting_end(path, file))
            header = [name.strip() for name in next(reader, [])]
            _check_header(path, header)
            for row in reader:
                if not any(cell.strip() for cell in row):
                    continue
                if len(row) != len(header):
                    raise InputError(
                        f"{path} line {reader.line_num} has {len(row)} values,"
                        f" but the header names {len(header)} columns"
                    )
                rows.append(row)
                lines.append(reader.line_num)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except (UnicodeDecodeError, csv.Error):
        raise InputError(f"{path} is not a CSV text file") from None
    return header, rows, lines


def _noting_end(path: str | Path, lines: Iterable[str]) -> Iterator[str]:
    """Pass lines on; after the last, see that it was whole."""
    line = ""
    for line in lines:
        yield line
    check_end(path, line)


def _check_header(path: str | Path, header: list[str]) -> None:
    if not any(header):
        raise InputError(f"{path} is empty: its first line must name the columns")
    twice = [name for name in header if header.count(name) > 1]
    if twice:
        raise InputError(f"{path} names the column {twice[0] or '(empty)'!s} twice")


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")

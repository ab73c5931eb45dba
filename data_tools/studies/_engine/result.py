"""The table of a finished study, and its summary by groups."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools.studies._engine.study import Cell
from data_tools.studies._engine.table import Columns, read_table
from evcalib import checks
from evcalib.display import Shown
from evcalib.errors import InputError

LABELS = ("group", "method", "ablation", "variant", "localisation")
"""Columns that tell what is compared."""


@dataclass(frozen=True, eq=False)
class StudyResult(Shown):
    """A finished study.

    Attributes
    ----------
    name : str
        Name of the study.
    trials, seed : int
        Trials per cell, and the seed.
    cells : tuple of Cell
        Groups and their parameters.
    table : dict of ndarray
        Columns of equal length: ``cell``, ``group``, ``trial``, ``failure`` (why the trial gave
        nothing, or empty) and those of the study; ``pandas.DataFrame(result.table)`` takes them.
    path : Path
        The file.
    """

    name: str
    trials: int
    seed: int
    cells: tuple[Cell, ...]
    table: Columns
    path: Path

    @property
    def groups(self) -> tuple[str, ...]:
        """Names of the groups in the order of the study."""
        return tuple(dict.fromkeys(cell.group for cell in self.cells))

    @property
    def failures(self) -> list[tuple[str, int, str]]:
        """Group, number of the trial, and reason of each that gave nothing."""
        names = ("group", "trial", "failure")
        rows = zip(*(self.table[name].tolist() for name in names), strict=True)
        return [row for row in rows if row[2]]

    def column(self, name: str) -> NDArray[Any]:
        """Return a column of the table; ``"|name|"`` gives absolute values."""
        bare = name[1:-1] if name[:1] == name[-1:] == "|" else name
        checks.one_of(bare, "column", tuple(self.table))
        return self.table[name] if bare == name else np.abs(self.table[bare])

    def values(self, column: str, **where: Any) -> NDArray[Any]:
        """Return a column's values in the rows that gave something and match, as in
        ``values("rotation_deg", group="arc 4 m", method="vc")``.
        """  # noqa: D205
        mask = self.column("failure") == ""
        for name, value in where.items():
            mask = mask & (self.column(name) == value)
        return self.column(column)[mask]

    def labels(self, column: str) -> tuple[Any, ...]:
        """Return the distinct values of a column, in the order in which they appear."""
        return tuple(dict.fromkeys(self.values(column).tolist()))

    def csv(self) -> str:
        """Return the whole table as CSV, a line for each row of each trial."""
        names = [name for name in self.table if name != "cell"]
        return Summary(tuple(dict(zip(names, row, strict=True)) for row in self._rows(names))).csv()

    def summary(self, *columns: str, by: Sequence[str] = LABELS) -> Summary:
        """Return count, median and quartiles of columns for each combination of `by`.

        Parameters
        ----------
        *columns : str
            Columns of numbers, or of truth values, whose share is given; ``"|name|"`` takes
            absolute values.  If none are named, all that the study has, errors by their absolute
            value.  NaN is left out.
        by : sequence of str
            Columns to group by; those that the study lacks are passed over.
        """
        by = [name for name in by if name in self.table]
        columns = columns or self._columns(by)
        labels = np.array(["\x1f".join(map(str, row)) for row in self._rows(by)])
        entries = []
        for label in dict.fromkeys(labels.tolist()):
            rows = labels == label
            entry: dict[str, Any] = dict(zip(by, label.split("\x1f"), strict=True))
            entry["trials"] = int(rows.sum())
            entry["failed"] = int((self.table["failure"][rows] != "").sum())
            for name in columns:
                entry |= _spread(name, self.column(name)[rows & (self.table["failure"] == "")])
            entries.append(entry)
        return Summary(tuple(entries))

    def _columns(self, by: Sequence[str]) -> tuple[str, ...]:
        numbers = [n for n in self.table if self.table[n].dtype.kind in "fib" and n not in by]
        kept = [name for name in numbers if name not in ("cell", "trial")]
        return tuple(f"|{name}|" if "error" in name else name for name in kept)

    def _rows(self, names: Sequence[str]) -> list[tuple[Any, ...]]:
        return list(zip(*(self.table[name].tolist() for name in names), strict=True))


@dataclass(frozen=True)
class Summary:
    """A small table.

    Parameters
    ----------
    entries : tuple of dict
        One per combination of labels.
    """

    entries: tuple[dict[str, Any], ...]

    def csv(self) -> str:
        """Return the table as CSV, numbers in full."""
        out = io.StringIO()
        names = list(dict.fromkeys(name for entry in self.entries for name in entry))
        writer = csv.DictWriter(out, names, lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.entries)
        return out.getvalue()

    def text(self) -> str:
        """Return the table for people to read: medians, with their quartiles in brackets."""
        lines = [_cells_of(entry) for entry in self.entries]
        names = list(dict.fromkeys(name for line in lines for name in line))
        rows = [names, *([line.get(name, "") for name in names] for line in lines)]
        widths = [max(len(row[k]) for row in rows) for k in range(len(names))]
        return "\n".join(
            "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        )


QUANTILES = {"q1": 0.25, "median": 0.5, "q3": 0.75}


def _spread(name: str, values: NDArray[Any]) -> dict[str, float]:
    """Return the quartiles of numbers, or the share of a truth value."""
    if values.dtype.kind == "b":
        return {f"{name} share": float(values.mean()) if values.size else np.nan}
    if values.dtype.kind not in "fi":
        raise InputError(f"column {name} holds no numbers")
    finite = values[np.isfinite(values)]
    return {
        f"{name} {label}": float(np.quantile(finite, q)) if finite.size else np.nan
        for label, q in QUANTILES.items()
    }


def _cells_of(entry: dict[str, Any]) -> dict[str, str]:
    """Return the texts of one line; three quartiles become one cell."""
    out = {}
    for name, value in entry.items():
        stem, _, kind = name.rpartition(" ")
        if kind == "median":
            low, high = entry[f"{stem} q1"], entry[f"{stem} q3"]
            known = value == value
            out[stem] = f"{value:.3g} [{low:.3g}, {high:.3g}]" if known else "-"
        elif kind not in QUANTILES:
            out[name] = f"{value:.3g}" if isinstance(value, float) else str(value)
    return out


def load_study(path: str | Path) -> StudyResult:
    """Read the file of a finished study.

    Parameters
    ----------
    path : path
        ``NAME.h5`` of `run_study`.

    Returns
    -------
    StudyResult
        What was stored.

    Raises
    ------
    InputError
        If it is none.
    """
    identity, cells, table = read_table(path)
    return StudyResult(
        str(identity["study"]), identity["trials"], identity["seed"], cells, table, Path(path)
    )

"""A finished study as a small text file, and comparisons of its methods.

A line holds a group, a method, a quantity and its value in each trial, to three digits: what a
notebook needs of a hundred drives, in a tenth of the room.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools.studies._engine.result import StudyResult, load_study
from data_tools.studies._engine.run import run
from data_tools.studies._engine.study import Cell, Study
from evcalib import checks
from evcalib.arrays import Floats
from evcalib.errors import EvcalibError, InputError

HEAD = "group,method,quantity,trials..."
"""First line of the file."""

QUANTITIES = {
    "rotation_deg": ("rotation_deg", 1.0),
    "offset_ms": ("offset_error_s", 1000.0),
    "offset_observable": ("offset_observable", 1.0),
}
"""Quantities of the file: column of the table, and what it is multiplied by."""


def scratch_study(
    study: Study, *, trials: int, seed: int, groups: Sequence[str] | None = None
) -> StudyResult:
    """Run a study, or some of its groups, in a folder that is gone afterwards.

    Parameters
    ----------
    study : Study
        A small one.
    trials, seed : int
        As for :func:`data_tools.studies.run_study`; trials of some groups are other ones than those
        of the same groups among all.
    groups : sequence of str, optional
        Groups to run; all if not given.

    Returns
    -------
    StudyResult
        Its table; its file is gone.
    """
    names = [cell.group for cell in study.cells]
    for group in groups or ():
        checks.one_of(group, "group", tuple(names))
    cells = tuple(c for c in study.cells if groups is None or c.group in groups)
    with tempfile.TemporaryDirectory() as folder:
        path = run(replace(study, cells=cells), Path(folder), trials=trials, seed=seed)
        return load_study(path)


def short_lines(result: StudyResult, only: Mapping[str, Sequence[str]] | None = None) -> list[str]:
    """Return the lines of the file that :func:`load_short` reads.

    Parameters
    ----------
    result : StudyResult
        A study of methods.
    only : mapping of str to sequence of str, optional
        Methods of which a quantity is kept; all, if it is not named.

    Returns
    -------
    list of str
        The head, and one per group, method and quantity.
    """
    kept, lines = dict(only or {}), [HEAD]
    for group in result.groups:
        for method in result.labels("method"):
            for quantity, (column, factor) in QUANTITIES.items():
                if column not in result.table or method not in kept.get(quantity, (method,)):
                    continue
                row = factor * result.values(column, group=group, method=method).astype(float)
                lines.append(",".join([group, method, quantity, *(f"{x:.3g}" for x in row)]))
    return lines


def load_short(*paths: str | Path) -> StudyResult:
    """Read short files of studies into one table: ``group``, ``method``, ``trial``, quantities.

    The offset's error is in seconds again, as in any study; what a file lacks is NaN.

    Parameters
    ----------
    *paths : path
        Files of `short_lines`.

    Returns
    -------
    StudyResult
        Named after the first file.

    Raises
    ------
    InputError
        If a file cannot be read or is none.
    """
    if not paths:
        raise InputError("at least one file is needed")
    rows: dict[tuple[str, str], dict[str, Floats]] = {}
    for path in paths:
        for number, (group, method, quantity, values) in enumerate(_cells(path), start=2):
            column, factor = QUANTITIES[quantity]
            known = rows.setdefault((group, method), {})
            if any(values.size != row.size for row in known.values()):
                raise InputError(f"{path} line {number} has another number of trials")
            known[column] = values / factor
    parts = [_part(*key, known) for key, known in rows.items()]
    table = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    cells = tuple(Cell(group, {}) for group in dict.fromkeys(group for group, _ in rows))
    trials = int(table["trial"].max()) + 1
    return StudyResult(Path(paths[0]).stem, trials, 0, cells, table, Path(paths[0]))


def _cells(path: str | Path) -> list[tuple[str, str, str, Floats]]:
    try:
        first, *lines = Path(path).read_text(encoding="utf-8").splitlines() or [""]
    except OSError as error:
        raise EvcalibError(f"cannot read {path}: {error.strerror}") from None
    if first != HEAD or not lines:
        raise InputError(f"{path} is no short file of a study: its first line must be {HEAD!r}")
    out = []
    for number, line in enumerate(lines, start=2):
        group, _, rest = line.partition(",")
        method, _, rest = rest.partition(",")
        quantity, *values = rest.split(",")
        if quantity not in QUANTITIES or not values:
            raise InputError(f"{path} line {number}: quantity must be one of {list(QUANTITIES)}")
        try:
            out.append((group, method, quantity, np.array(values, dtype=np.float64)))
        except ValueError:
            raise InputError(f"{path} line {number} holds a value that is no number") from None
    return out


def _part(group: str, method: str, known: Mapping[str, Floats]) -> dict[str, NDArray[Any]]:
    count = next(iter(known.values())).size
    missing = np.full(count, np.nan)
    numbers = {column: known.get(column, missing) for column, _ in QUANTITIES.values()}
    texts = {"group": group, "method": method, "failure": ""}
    same: dict[str, NDArray[Any]] = {k: np.full(count, text) for k, text in texts.items()}
    return {**same, "trial": np.arange(count), **numbers}


def medians(
    result: StudyResult,
    column: str = "rotation_deg",
    *,
    groups: Sequence[str] | None = None,
    methods: Sequence[str] | None = None,
    factor: float = 1.0,
    digits: int = 2,
    short: Mapping[str, str] | None = None,
) -> str:
    """Return a table of the medians of a column's size: a line per group, a column per method.

    Parameters
    ----------
    result : StudyResult
        A study of methods.
    column : str
        What to take the median of, by absolute value.
    groups, methods : sequence of str, optional
        Which, in this order; all if not given.
    factor : float
        Multiplies the values, for another unit.
    digits : int
        Digits after the point.
    short : mapping of str to str, optional
        Shorter names of methods.

    Returns
    -------
    str
        Several lines, the head first.
    """
    groups = result.groups if groups is None else groups
    methods = result.labels("method") if methods is None else methods
    heads = [(short or {}).get(name, name) for name in methods]
    wide = [max(len(head), digits + 5) + 2 for head in heads]
    first = max(len(group) for group in groups) + 1
    lines = [" " * first + "".join(f"{h:>{w}s}" for h, w in zip(heads, wide, strict=True))]
    for group in groups:
        values = [
            factor * np.median(np.abs(result.values(column, group=group, method=method)))
            for method in methods
        ]
        cells = "".join(f"{x:{w}.{digits}f}" for x, w in zip(values, wide, strict=True))
        lines.append(f"{group:{first}s}{cells}")
    return "\n".join(lines)


def median_ratio(
    values: Floats, reference: Floats, rng: np.random.Generator, *, draws: int = 2000
) -> tuple[float, float, float]:
    """Return the ratio of two medians over the same trials, and the middle 95 % of its bootstrap.

    Parameters
    ----------
    values, reference : ndarray, shape (n,)
        Errors of two methods in the same trials.
    rng : Generator
        Draws the trials anew, with replacement.
    draws : int
        How often.

    Returns
    -------
    tuple of float
        The ratio, and the lower and the upper end.
    """
    values = checks.floats(values, "values", (None,))
    reference = checks.floats(reference, "reference", (None,))
    if values.shape != reference.shape or not values.size:
        raise InputError("values and reference must be of the same trials, at least one")
    drawn = rng.integers(values.size, size=(draws, values.size))
    ratios = np.median(values[drawn], axis=1) / np.median(reference[drawn], axis=1)
    low, high = np.quantile(ratios, [0.025, 0.975])
    return float(np.median(values) / np.median(reference)), float(low), float(high)

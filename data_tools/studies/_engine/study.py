"""What a study is: a name, cells of parameters, and one pure function from a seed to rows."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import evcalib
from evcalib.errors import EvcalibError, InputError

Row = dict[str, Any]
"""Column names to plain numbers, booleans or strings.

A row may have ``failure``, a reason why its numbers are missing, while the trial's other rows have
theirs.
"""

TrialFunction = Callable[[Mapping[str, Any], np.random.SeedSequence], Sequence[Row]]
"""Parameters of a cell and the seed of one trial to the rows of that trial."""

Key = tuple[int, int]
"""Number of a cell, and number of a trial in it."""


@dataclass(frozen=True)
class Cell:
    """One setting of a study.

    Attributes
    ----------
    group : str
        What tables and figures call it.
    parameters : dict
        What the trial function is given; plain values that JSON can hold.
    """

    group: str
    parameters: dict[str, Any]


@dataclass(frozen=True)
class Study:
    """A named experiment.

    Attributes
    ----------
    name : str
        Also the name of its files.
    cells : tuple of Cell
        Its settings.
    trial : callable
        A function of a module (workers import it by name), or a `functools.partial` of one: cell
        parameters and a `numpy.random.SeedSequence` to rows.  It must have no other source of
        randomness and no state.
    version : int
        To be raised when `trial` computes something else than before.
    retry_failures : bool
        Whether a study that is run again tries failed trials again.  For work on files, which can
        be mended; a failure of a seeded trial is a result.
    largest_piece : int
        Most trials that a worker is given at once (in long studies of quick trials).
    unit : str
        What the progress bar calls a trial.
    """

    name: str
    cells: tuple[Cell, ...]
    trial: TrialFunction
    version: int = 1
    retry_failures: bool = False
    largest_piece: int = 8
    unit: str = "trial"

    def __post_init__(self) -> None:
        if not self.cells:
            raise InputError(f"the study {self.name} has no cells, so there is nothing to run")

    def only(self, names: Sequence[str]) -> Study:
        """Return the study with the cells alone whose group holds one of these words.

        Raises
        ------
        InputError
            If no group does.
        """
        for name in names:
            if not any(name in cell.group for cell in self.cells):
                groups = "; ".join(dict.fromkeys(cell.group for cell in self.cells))
                raise InputError(f"no group of {self.name} holds {name!r}; there are: {groups}")
        cells = [cell for cell in self.cells if any(name in cell.group for name in names)]
        return replace(self, cells=tuple(cells)) if names else self

    def identity(self, trials: int, seed: int) -> dict[str, Any]:
        """Return what two runs must have in common for their results to be mixed."""
        return {
            "study": self.name,
            "version": self.version,
            "evcalib": evcalib.__version__,
            "trials": trials,
            "seed": seed,
            "parameters": hashlib.sha256(self.cells_json()).hexdigest(),
        }

    def cells_json(self) -> bytes:
        """Return the cells as text, the same for the same cells."""
        content = [[cell.group, cell.parameters] for cell in self.cells]
        return json.dumps(content, sort_keys=True, ensure_ascii=False).encode()


def check_identity(stored: Mapping[str, Any], wanted: Mapping[str, Any], path: object) -> None:
    """Raise InputError if a file belongs to another run than the one that is wanted."""
    names = {"study": "study", "version": "version of the study", "evcalib": "version of evcalib"}
    differences = [
        f"{names.get(key, key)} {stored.get(key)!r} and not {value!r}"
        if key != "parameters"
        else "other parameters"
        for key, value in wanted.items()
        if stored.get(key) != value
    ]
    if differences:
        raise InputError(
            f"{path} holds results with {', '.join(differences)}; take another folder, or remove"
            " the file"
        )


@dataclass(frozen=True)
class Outcome:
    """What one trial gave: rows, or the reason why there are none."""

    key: Key
    rows: tuple[Row, ...] = ()
    failure: str = ""


def seed_of(seed: int, key: Key) -> np.random.SeedSequence:
    """Return ``SeedSequence(seed).spawn(cells)[cell].spawn(trials)[trial]``, without the others."""
    return np.random.SeedSequence(seed, spawn_key=key)


def run_trials(
    trial: TrialFunction,
    seed: int,
    version: str,
    tasks: Sequence[tuple[Key, Mapping[str, Any]]],
) -> list[Outcome]:
    """Run trials one after the other; this is what a worker does.

    Raises
    ------
    EvcalibError
        If the worker has another version of evcalib: mixed results are nobody's.
    """
    if evcalib.__version__ != version:
        raise EvcalibError(f"a worker has evcalib {evcalib.__version__}, not {version}")
    return [_run_trial(trial, seed, key, parameters) for key, parameters in tasks]


def _run_trial(trial: TrialFunction, seed: int, key: Key, parameters: Mapping[str, Any]) -> Outcome:
    try:
        rows = trial(parameters, seed_of(seed, key))
        return Outcome(key, tuple(_plain(row) for row in rows))
    except EvcalibError as error:
        return Outcome(key, failure=_one_line(str(error)))
    except Exception as error:
        return Outcome(key, failure=_one_line(f"{type(error).__name__}: {error}"))


def _plain(row: Row) -> Row:
    return {name: _scalar(name, value) for name, value in row.items()}


def _scalar(name: str, value: Any) -> Any:
    if isinstance(value, np.generic):
        value = value.item()
    if not isinstance(value, bool | int | float | str):
        raise TypeError(f"column {name} must be a number or text, not {type(value).__name__}")
    return value


def _one_line(text: str) -> str:
    return " ".join(text.split()) or "no reason given"

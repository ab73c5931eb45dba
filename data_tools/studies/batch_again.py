"""A list of recordings that changed: what was finished and did not change is taken along."""

from __future__ import annotations

import json
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import Any

from data_tools.files.atomic import replacing
from data_tools.studies._engine.journal import Journal
from data_tools.studies._engine.study import Cell, Outcome, Study
from data_tools.studies._engine.table import KEYS, Columns, read_table
from evcalib.errors import EvcalibError, InputError

ENTRIES = "entries.json"
"""Ending of the file that holds the entries of a list by their hash, for a journal knows the hash
only."""


def take_along(batch: Study, folder: Path) -> None:
    """Turn the results of another list in the same folder into those of this one.

    Results of entries that are in both lists, the same in every value, are kept, wherever they
    stand; what else there was is left out, and so are failures.  Killed at any moment, the same
    call does the rest.

    Parameters
    ----------
    batch : Study
        The list of now.
    folder : Path
        Where the files of the study stand.

    Raises
    ------
    InputError
        If the folder's batch is running elsewhere.
    EvcalibError
        If the files cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {folder}: {error.strerror or error}") from None
    table, notes = folder / f"{batch.name}.h5", folder / f"{batch.name}.journal"
    entries = folder / f"{batch.name}.{ENTRIES}"
    wanted = batch.identity(1, 0)
    known = _known(entries)
    found: dict[str, tuple[Any, ...]] = {}
    old_table = old_notes = False
    if table.exists():
        stored, cells, columns = read_table(table)
        known[stored["parameters"]] = cells
        old_table = _another_list(stored, wanted)
        if old_table:
            found |= _by_entry(cells, _outcomes(columns))
    head = _head(notes)
    if head is not None and head["parameters"] in known and _another_list(head, wanted):
        old_notes = True
        with closing(Journal(notes, head)) as journal:
            found |= _by_entry(known[head["parameters"]], journal.outcomes())
    try:
        _write(entries, {**known, wanted["parameters"]: batch.cells})
        if old_notes or (old_table and head is None):
            with replacing(notes) as part, closing(Journal(part, wanted)) as journal:
                rows = ((k, found.get(_text(cell))) for k, cell in enumerate(batch.cells))
                journal.append([Outcome((k, 0), done) for k, done in rows if done is not None])
        if old_table:
            table.unlink()
        if head is None or old_notes:
            _write(entries, {wanted["parameters"]: batch.cells})
    except OSError as error:
        raise EvcalibError(f"cannot write in {folder}: {error.strerror or error}") from None


def _another_list(stored: dict[str, Any], wanted: dict[str, Any]) -> bool:
    """Tell whether two runs differ in their lists alone; the engine refuses other differences."""
    return stored != wanted and {**stored, "parameters": wanted["parameters"]} == wanted


def _text(cell: Cell) -> str:
    return json.dumps([cell.group, cell.parameters], sort_keys=True)


def _by_entry(cells: tuple[Cell, ...], outcomes: Iterable[Outcome]) -> dict[str, tuple[Any, ...]]:
    return {_text(cells[one.key[0]]): one.rows for one in outcomes if not one.failure}


def _outcomes(columns: Columns) -> Iterable[Outcome]:
    names = [name for name in columns if name not in KEYS]
    for row, failure in enumerate(columns["failure"].tolist()):
        values = {name: columns[name][row].item() for name in names}
        yield Outcome((int(columns["cell"][row]), 0), (values,), failure)


def _known(entries: Path) -> dict[str, tuple[Cell, ...]]:
    try:
        stored = json.loads(entries.read_text(encoding="utf-8"))
        return {key: tuple(Cell(*cell) for cell in cells) for key, cells in stored.items()}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}


def _write(entries: Path, known: dict[str, tuple[Cell, ...]]) -> None:
    content = {key: [[c.group, c.parameters] for c in cells] for key, cells in known.items()}
    with replacing(entries) as part:
        part.write_text(json.dumps(content), encoding="utf-8")


def _head(notes: Path) -> dict[str, Any] | None:
    """Return what a journal says of its study; None if there is none, or it is not to be read."""
    try:
        with notes.open("rb") as file:
            content = json.loads(file.readline().partition(b" ")[2])
        return content if "parameters" in content else None
    except (OSError, ValueError, TypeError):
        return None

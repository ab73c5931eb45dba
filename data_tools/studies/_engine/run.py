"""Runs the trials of a study that are not done yet, wherever there is room, and keeps each."""

from __future__ import annotations

import itertools
from collections import Counter, deque
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

import evcalib
from data_tools.studies._engine.journal import Journal
from data_tools.studies._engine.pools import Pool, open_pool
from data_tools.studies._engine.study import Key, Outcome, Study, check_identity, run_trials
from data_tools.studies._engine.table import Columns, columns_of, read_table, write_table
from evcalib.errors import EvcalibError, InputError

AHEAD = 2
"""Pieces of work handed out per worker: one runs, and one waits, so that no worker does."""

PIECES = 500
"""Pieces per worker that a study is cut into at least, if its trials are so many.

A choice: a kill, or waiting for the last worker, costs a 500th of the time at most."""

DEATHS = 2
"""Workers that a trial may take with it, while it runs alone, before it counts as failed.

A choice: once may be an accident of the machine, and a third time would only cost more."""

GONE = "the scheduler, or the connection to it, is gone"

Piece = tuple[Key, ...]


def run(
    study: Study,
    folder: Path,
    *,
    trials: int,
    seed: int,
    workers: int = 1,
    scheduler: str | None = None,
    progress: bool | None = None,
) -> Path:
    """Run what is left of a study; return the path of its finished file.

    See `data_tools.studies.run_study` for parameters and errors.
    """
    if trials < 1 or seed < 0:
        raise InputError(f"trials must be at least 1 and the seed at least 0: {trials}, {seed}")
    path, identity = folder / f"{study.name}.h5", study.identity(trials, seed)
    notes = folder / f"{study.name}.journal"
    _make(folder)
    if path.exists():
        stored, _, columns = read_table(path)
        check_identity(stored, identity, path)
        if not _to_retry(study, columns):
            notes.unlink(missing_ok=True)
            return path
    journal = Journal(notes, identity)
    try:
        done = _done(study, journal, trials)
        if not done.all():
            bar = tqdm(
                total=done.size,
                initial=int(done.sum()),
                desc=study.name,
                unit=study.unit,
                disable=None if progress is None else not progress,
            )
            with bar, open_pool(workers, scheduler) as pool:
                _Run(study, seed, pool, journal, bar, done).all()
        columns = columns_of(journal.outcomes(), study.cells)
        write_table(path, identity, study, columns)
        if not _to_retry(study, columns):
            journal.remove()
    finally:
        journal.close()
    return path


def _to_retry(study: Study, columns: Columns) -> bool:
    return study.retry_failures and bool((columns["failure"] != "").any())


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {folder}: {error.strerror}") from None


def _done(study: Study, journal: Journal, trials: int) -> np.ndarray:
    """Return which trials need not be run, shape (cells, trials)."""
    done = np.zeros((len(study.cells), trials), dtype=bool)
    for outcome in journal.outcomes():
        done[outcome.key] = not (outcome.failure and study.retry_failures)
    return done


class _Run:
    """One run over the trials that are left."""

    def __init__(
        self, study: Study, seed: int, pool: Pool, journal: Journal, bar: tqdm, done: np.ndarray
    ) -> None:
        self.study, self.seed, self.pool, self.journal = study, seed, pool, journal
        self.bar, self.done, self.count = bar, done, int(done.sum())
        self.running: dict[Future, Piece] = {}
        self.suspects: deque[Piece] = deque()
        self.deaths: Counter[Key] = Counter()

    def all(self) -> None:
        """Run every trial that is not done."""
        pieces = _pieces(self.done, self.pool.width, self.study.largest_piece)
        try:
            self._fill(pieces)
            while self.running:
                finished, _ = wait(self.running, return_when=FIRST_COMPLETED)
                self._collect(finished)
                self._fill(pieces)
        except KeyboardInterrupt:
            self.pool.stop()
            for future in [f for f in self.running if _gave_something(f)]:
                self._keep(future)
            raise KeyboardInterrupt(f"stopped; {self._kept()}") from None

    def _fill(self, pieces: Iterator[Piece]) -> None:
        """Hand out work; trials that may have killed a worker run alone, one at a time."""
        if self.suspects:
            if not self.running:
                self._submit(self.suspects.popleft())
            return
        room = AHEAD * self.pool.width - len(self.running)
        for piece in itertools.islice(pieces, max(room, 0)):
            self._submit(piece)

    def _submit(self, piece: Piece) -> None:
        tasks = [(key, self.study.cells[key[0]].parameters) for key in piece]
        version = evcalib.__version__
        future = self.pool.submit(run_trials, self.study.trial, self.seed, version, tasks)
        self.running[future] = piece

    def _collect(self, finished: set[Future]) -> None:
        """Keep what finished well, and put aside what a worker took with it."""
        alone = len(self.running) == 1
        dead = self._sort(finished)
        if not dead:
            return
        self.pool.revive()
        dead += self._sort({future for future in self.running if future.done()})
        if alone and len(dead[0]) == 1:
            (key,) = dead[0]
            self.deaths[key] += 1
            if self.deaths[key] >= DEATHS:
                why = "the worker died each time this was tried (killed, or out of memory)"
                self._write([Outcome(key, failure=why)])
                return
        self.suspects.extend((key,) for piece in dead for key in piece)

    def _sort(self, finished: set[Future]) -> list[Piece]:
        """Keep what finished well; return the pieces whose worker died."""
        dead = []
        for future in finished:
            if _gave_something(future):
                self._keep(future)
                continue
            error = CancelledError(GONE) if future.cancelled() else future.exception()
            if not isinstance(error, self.pool.deaths):
                raise EvcalibError(f"the workers failed ({_describe(error)}); {self._kept()}")
            dead.append(self.running.pop(future))
        return dead

    def _keep(self, future: Future) -> None:
        self._write(future.result())
        del self.running[future]

    def _write(self, outcomes: list[Outcome]) -> None:
        self.journal.append(outcomes)
        self.count += len(outcomes)
        self.bar.update(len(outcomes))

    def _kept(self) -> str:
        return (
            f"{self.count} of {self.done.size} trials are kept in {self.journal.path}: the same"
            " command goes on from there"
        )


def _gave_something(future: Future) -> bool:
    return future.done() and not future.cancelled() and future.exception() is None


def _pieces(done: np.ndarray, width: int, largest: int) -> Iterator[Piece]:
    """Yield the keys that are not done, a piece at a time."""
    left = int((~done).sum())
    size = min(max(left // (PIECES * width), 1), largest) if width > 1 else 1
    keys = ((int(cell), int(trial)) for cell, trial in np.argwhere(~done))
    return iter(lambda: tuple(itertools.islice(keys, size)), ())


def _describe(error: Any) -> str:
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__

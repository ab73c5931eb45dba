"""What a finished study leaves beside its table, and what it costs to run one."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from data_tools.studies._engine.result import StudyResult
from data_tools.studies._engine.run import run
from data_tools.studies._engine.study import Study
from evcalib.errors import EvcalibError


def write_summary(
    result: StudyResult, folder: str | Path, *, pictures: bool = True, rows: bool = False
) -> list[Path]:
    """Write ``NAME.csv`` and ``NAME.txt`` with medians and quartiles, and box plots ``NAME.png``.

    There is a picture where methods stand side by side.

    Parameters
    ----------
    result : StudyResult
        From `run_study` or `load_study`.
    folder : path
        Where to; it must be there.
    pictures : bool
        Draw box plots too.
    rows : bool
        Write ``NAME.rows.csv`` too, a line for each row of each trial.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    EvcalibError
        If they cannot be written.
    """
    home, summary = Path(folder), result.summary()
    contents = {"csv": summary.csv().encode(), "txt": f"{describe(result)}\n".encode()}
    if rows:
        contents["rows.csv"] = result.csv().encode()
    if pictures and {"method", "rotation_deg"} <= result.table.keys():
        from evcalib.plots import style
        from evcalib.plots.studies import study_figure

        figure = study_figure(result.table, groups=result.groups)
        contents["png"] = style.png(figure)
    paths = []
    for ending, content in contents.items():
        path = home / f"{result.name}.{ending}"
        try:
            home.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        except OSError as error:
            raise EvcalibError(f"cannot write {path}: {error.strerror}") from None
        paths.append(path)
    return paths


def describe(result: StudyResult) -> str:
    """Return a study for people to read: its summary, and what failed and why.

    Parameters
    ----------
    result : StudyResult
        From `run_study` or `load_study`.

    Returns
    -------
    str
        Several lines.
    """
    lines = [
        f"{result.name}: {len(result.cells)} groups, {result.trials} trial(s) each, seed"
        f" {result.seed}; medians, with quartiles in brackets",
        "",
        result.summary().text(),
    ]
    reasons: dict[str, int] = {}
    for _, _, reason in result.failures:
        reasons[reason] = reasons.get(reason, 0) + 1
    if reasons:
        lines += ["", "Failures"]
        lines += [f"  {count} x {reason}" for reason, count in reasons.items()]
    return "\n".join(lines)


@dataclass(frozen=True)
class Cost:
    """What one run took.

    Parameters
    ----------
    trials : int
        In all.
    workers : int
        Processes.
    seconds : float
        Time with the start of the workers [s].
    """

    trials: int
    workers: int
    seconds: float


def measure_cost(
    study: Study,
    *,
    trials: Sequence[int],
    workers: Sequence[int] = (1, 2),
    seed: int = 0,
    **pool: Any,
) -> list[Cost]:
    """Run a study in scratch folders, with so many trials per cell and so many workers each.

    Parameters
    ----------
    study : Study
        What to run.
    trials, workers : sequence of int
        Trials per cell, and processes; every pair of them is run.
    seed : int
        Of all runs.
    **pool
        Where it runs, as in `run_study`.

    Returns
    -------
    list of Cost
        One per run.
    """
    costs = []
    for count in workers:
        for each in trials:
            with tempfile.TemporaryDirectory() as folder:
                start = time.perf_counter()
                run(study, Path(folder), trials=each, seed=seed, workers=count, **pool)
                took = time.perf_counter() - start
            costs.append(Cost(each * len(study.cells), count, took))
    return costs

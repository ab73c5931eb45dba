"""Studies: named experiments of many trials, on one machine or many.

``run_study("paper", trials=100, seed=1, folder="results")`` runs what is left of a study and
returns its table.  The table depends on the study, the trials and the seed only: not on how many
workers there were, on which machine of a cluster, or how often it was killed and taken up again.

A study is a function from a name of `STUDIES`; its modules stand on top of both packages.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from data_tools.studies._engine.report import Cost, describe, measure_cost, write_summary
from data_tools.studies._engine.result import StudyResult, Summary, load_study
from data_tools.studies._engine.run import run
from data_tools.studies._engine.short import (
    load_short,
    median_ratio,
    medians,
    scratch_study,
    short_lines,
)
from data_tools.studies._engine.study import Cell, Study
from evcalib import checks

__all__ = [
    "STUDIES",
    "Cell",
    "Cost",
    "Study",
    "StudyResult",
    "Summary",
    "describe",
    "load_short",
    "load_study",
    "measure_cost",
    "median_ratio",
    "medians",
    "run_study",
    "scratch_study",
    "short_lines",
    "study",
    "write_summary",
]

STUDIES = {
    "paper": "rivals side by side on the paper's arcs and polylines",
    "drives": "the same on zigzags, S-curves and fingers, which the paper lacks",
    "ablations": "what each choice of our method is worth",
    "coverage": "whether the error bars hold what they promise",
    "real": "the paper's Table I on its real data",
    "recorded": "from raw events to the calibration, on simulated recordings",
    "campaign": "whether results are silently wrong where the model is",
    "lag": "how late the events' headings are",
    "repeat": "whether `evcalib repeat` tells runs that agree from one that is off",
    "conditions": "what each thing that is not ideal costs, one at a time",
    "mixtures": "what is left of it on an indoor robot, outdoors, at dusk and in the dark",
    "turning": "rotation, offset and position of cameras on vehicles that turn",
    "plan": "whether planned drives tell what was predicted",
}
"""Names of the studies, and what they ask."""

_HOMES = {"drives": ("paper", "drives")}


def study(name: str, **options: Any) -> Study:
    """Return the study of this name.

    Parameters
    ----------
    name : str
        A key of `STUDIES`.
    **options
        Its parameters: those of the function ``study`` of the module of its name.

    Returns
    -------
    Study
        What `run_study` runs.
    """
    checks.one_of(name, "study", tuple(STUDIES))
    home, function = _HOMES.get(name, (name, "study"))
    made: Study = getattr(import_module(f"data_tools.studies.{home}"), function)(**options)
    return made


def run_study(
    name: str | Study,
    *,
    trials: int,
    seed: int,
    folder: str | Path,
    workers: int = 1,
    scheduler: str | None = None,
    progress: bool | None = None,
    **options: Any,
) -> StudyResult:
    """Run what is left of a study, and return its table.

    Results are kept as they come, in ``NAME.journal``; when the last trial is done they become
    ``NAME.h5``.  Killed at any moment, the same call goes on from there and does no trial twice.
    Ctrl-C stops it with everything finished kept.  A trial that raises is a row with the reason; a
    worker that dies has its trials done again.

    Parameters
    ----------
    name : str or Study
        A key of `STUDIES`, or a study of your own.
    trials : int
        Trials per cell.
    seed : int
        Trial k of cell c draws from ``SeedSequence(seed).spawn(...)[c].spawn(...)[k]``.
    folder : str or Path
        Where its files go; made if there is none.
    workers : int
        Processes; 1 runs in this one.
    scheduler : str, optional
        Address of a Dask scheduler, to run on its workers (extra ``distributed``).
    progress : bool, optional
        Show a progress bar; by default on a terminal only.
    **options
        Parameters of the named study.

    Returns
    -------
    StudyResult
        Its table.

    Raises
    ------
    InputError
        If the folder holds this study with another seed, other trials or parameters, or the
        scheduler cannot be reached.
    EvcalibError
        If results cannot be written (disk full), or all workers are lost; what was finished is
        kept.
    """
    what = name if isinstance(name, Study) else study(name, **options)
    path = run(
        what,
        Path(folder),
        trials=trials,
        seed=seed,
        workers=workers,
        scheduler=scheduler,
        progress=progress,
    )
    return load_study(path)

"""Trials for the tests of the study engine; workers import them by name."""

import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from data_tools.studies import Cell, Study, run_study
from evcalib.errors import InputError

TRIALS, SEED = 12, 5


def run(folder, study=None, **more):
    """Run a study, the small one if none is given, in a folder."""
    call = {"trials": TRIALS, "seed": SEED, "folder": folder, **more}
    return run_study(study or small(), **call)


def draw(parameters, seed):
    """Return two rows of numbers that only the seed and the parameters decide."""
    x = np.random.default_rng(seed).standard_normal(2)
    time.sleep(parameters.get("seconds", 0))
    return [
        {"method": name, "error": scale * x[0], "hit": bool(x[1] > 0), "count": int(9 * abs(x[1]))}
        for name, scale in (("ä", parameters["scale"]), ("b", 2.0))
    ]


def log_and_draw(parameters, seed):
    """Also leave a line in a file: one for each time that a trial is run to its end."""
    rows = draw(parameters, seed)
    cell, trial = seed.spawn_key
    line = f"{cell} {trial}\n".encode()
    log = os.open(parameters["log"], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(log, line)
    os.close(log)
    return rows


def fail_sometimes(parameters, seed):
    cell, trial = seed.spawn_key
    if trial % 3 == 1:
        raise (InputError("no headings\nat all") if cell else ZeroDivisionError("by zero"))
    return draw(parameters, seed)


def kill_worker(parameters, seed):
    """Kill the own process in trial 3: always, or only the first time."""
    mark = Path(parameters["mark"])
    if seed.spawn_key[1] == 3 and (parameters["always"] or not mark.exists()):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return draw(parameters, seed)


def study(trial=draw, cells=3, name="small", **parameters):
    return Study(
        name, tuple(Cell(f"g{k}", {"scale": 1.0 + k, **parameters}) for k in range(cells)), trial
    )


small = study
"""The same function, for those who call a study `study`."""


def kill_once_on_the_way(parameters, seed):
    """Kill the own process the first time that half of the last cell is reached."""
    mark = Path(parameters["mark"])
    if seed.spawn_key == (1, 6) and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.01)
    return draw(parameters, seed)


def note_pid(parameters, seed):
    log = os.open(parameters["log"], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(log, f"{os.getpid()}\n".encode())
    os.close(log)
    time.sleep(0.05)
    return draw(parameters, seed)


def interrupt_after(study, count):
    """Return the study with a trial function that raises Ctrl-C after so many trials."""
    left = iter(range(count))

    def trial(parameters, seed):
        if next(left, None) is None:
            raise KeyboardInterrupt
        return study.trial(parameters, seed)

    return replace(study, trial=trial)

"""What the study engine costs beside its trials, against calling them in a loop."""

import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))
import study_trials

from data_tools.studies import run_study
from data_tools.studies._engine.study import seed_of

TRIALS = 500


def loop():
    for cell in study_trials.study().cells:
        for trial in range(TRIALS):
            study_trials.draw(cell.parameters, seed_of(1, (0, trial)))


@pytest.mark.benchmark(group="1500 trials of next to nothing")
def test_plain_loop(benchmark):
    benchmark(loop)


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.benchmark(group="1500 trials of next to nothing")
def test_engine(benchmark, workers):
    def run():
        with tempfile.TemporaryDirectory() as folder:
            return run_study(
                study_trials.study(), trials=TRIALS, seed=1, folder=folder, workers=workers
            )

    result = benchmark(run)
    assert np.unique(result.table["trial"]).size == TRIALS

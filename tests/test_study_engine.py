"""The study engine: one table whoever computes it, and nothing lost or done twice."""

import numpy as np
import pytest
import study_trials
from study_trials import SEED, TRIALS, run

import evcalib
from data_tools.studies import Study, load_study
from data_tools.studies._engine.study import run_trials, seed_of
from evcalib.errors import EvcalibError, InputError


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Return the finished file of the small study, made here, as bytes."""
    return run(tmp_path_factory.mktemp("serial")).path.read_bytes()


def test_the_table_is_that_of_a_plain_loop(tmp_path):
    table = run(tmp_path).table
    children = [child.spawn(TRIALS) for child in np.random.SeedSequence(SEED).spawn(3)]
    rows = [
        (f"g{cell}", trial, row)
        for cell in range(3)
        for trial in range(TRIALS)
        for row in study_trials.draw({"scale": 1.0 + cell}, children[cell][trial])
    ]
    assert table["group"].tolist() == [group for group, _, _ in rows]
    assert table["trial"].tolist() == [trial for _, trial, _ in rows]
    for name in ("method", "error", "hit", "count"):
        assert table[name].tolist() == [row[name] for _, _, row in rows]
    assert [table[n].dtype.kind for n in ("method", "error", "hit", "count")] == list("Ufbi")


def test_seeds_are_those_of_spawn():
    child = np.random.SeedSequence(7).spawn(4)[2].spawn(3)[1]
    assert seed_of(7, (2, 1)).generate_state(4).tolist() == child.generate_state(4).tolist()


def test_two_processes_write_the_same_file(tmp_path, reference):
    assert run(tmp_path, workers=2).path.read_bytes() == reference
    assert sorted(p.name for p in tmp_path.iterdir()) == ["small.h5"]


@pytest.mark.filterwarnings("default")
def test_a_dask_cluster_that_loses_a_worker_writes_the_same_file(tmp_path, reference):
    distributed = pytest.importorskip("distributed")
    slow = study_trials.study(study_trials.kill_once_on_the_way, mark=str(tmp_path / "mark"))
    calm = study_trials.study(mark=str(tmp_path / "mark"))
    with distributed.LocalCluster(
        2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        found = run(tmp_path / "dask", slow, scheduler=cluster.scheduler_address)
    assert (tmp_path / "mark").exists()
    assert found.path.read_bytes() == run(tmp_path / "here", calm).path.read_bytes()


def test_a_process_that_dies_is_replaced(tmp_path, reference):
    mark = str(tmp_path / "mark")
    killed = study_trials.study(study_trials.kill_worker, mark=mark, always=False)
    calm = study_trials.study(mark=mark, always=False)
    found = run(tmp_path / "killed", killed, workers=2)
    assert (tmp_path / "mark").exists()
    assert found.failures == []
    assert found.path.read_bytes() == run(tmp_path / "calm", calm).path.read_bytes()


def test_a_trial_that_always_kills_its_worker_fails_alone(tmp_path):
    study = study_trials.study(
        study_trials.kill_worker, cells=1, mark=str(tmp_path / "m"), always=True
    )
    found = run(tmp_path, study, workers=2)
    assert [(group, trial) for group, trial, _ in found.failures] == [("g0", 3)]
    assert "the worker died each time" in found.failures[0][2]
    assert len(found.values("error")) == 2 * (TRIALS - 1)


def journal_of(tmp_path, count=20):
    """Return the journal of a study that was stopped after `count` trials, and its study."""
    study = study_trials.study(study_trials.log_and_draw, log=str(tmp_path / "log"))
    stop = study_trials.interrupt_after(study, count)
    with pytest.raises(KeyboardInterrupt, match=f"stopped; {count} of 36 trials are kept in"):
        run(tmp_path, stop)
    return tmp_path / "small.journal", study


def test_ctrl_c_keeps_what_is_finished(tmp_path):
    journal, study = journal_of(tmp_path)
    assert len(journal.read_bytes().splitlines()) == 21
    run(tmp_path, study)
    ran = (tmp_path / "log").read_text().split("\n")[:-1]
    assert len(ran) == len(set(ran)) == 36


@pytest.mark.parametrize("cut", [1, 2, 30, 100])
def test_a_torn_line_is_as_if_it_had_not_been_written(tmp_path, cut):
    journal, study = journal_of(tmp_path)
    journal.write_bytes(journal.read_bytes()[:-cut])
    found = run(tmp_path, study)
    assert len((tmp_path / "log").read_text().splitlines()) == 37
    calm = study_trials.study(log=str(tmp_path / "log"))
    assert found.path.read_bytes() == run(tmp_path / "calm", calm).path.read_bytes()


def test_a_damaged_line_is_done_again(tmp_path):
    journal, study = journal_of(tmp_path)
    lines = journal.read_bytes().splitlines(keepends=True)
    lines[7] = lines[7].replace(b"0.", b"1.", 1)
    journal.write_bytes(b"".join(lines))
    found = run(tmp_path, study)
    calm = study_trials.study(log=str(tmp_path / "log"))
    assert found.path.read_bytes() == run(tmp_path / "calm", calm).path.read_bytes()


@pytest.mark.parametrize("length", [0, 5])
def test_a_journal_killed_at_its_birth_is_begun_anew(tmp_path, reference, length):
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, study_trials.interrupt_after(study_trials.study(), 0))
    journal = tmp_path / "small.journal"
    journal.write_bytes(journal.read_bytes()[:length])
    assert run(tmp_path).path.read_bytes() == reference


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"seed": 6}, "seed 5 and not 6"),
        ({"trials": 13}, "trials 12 and not 13"),
        ({"study": study_trials.study(scale=9.0)}, "other parameters"),
        (
            {"study": Study("small", study_trials.study().cells, study_trials.draw, version=2)},
            "version of the study 1 and not 2",
        ),
    ],
)
@pytest.mark.parametrize("finished", [True, False])
def test_results_of_another_run_are_refused(tmp_path, change, words, finished):
    if finished:
        run(tmp_path)
    else:
        with pytest.raises(KeyboardInterrupt):
            run(tmp_path, study_trials.interrupt_after(study_trials.study(), 4))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(InputError, match=words):
        run(tmp_path, **change)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_killed_after_the_table_was_written_a_study_is_finished(tmp_path):
    journal, study = journal_of(tmp_path)
    notes = journal.read_bytes()
    done = run(tmp_path, study).path.read_bytes()
    journal.write_bytes(notes)
    assert run(tmp_path, study).path.read_bytes() == done
    assert not journal.exists()
    assert len((tmp_path / "log").read_text().splitlines()) == 36


def test_files_that_are_no_studies_are_refused(tmp_path):
    (tmp_path / "small.journal").write_text("my diary\n")
    with pytest.raises(InputError, match="no journal of a study"):
        run(tmp_path)
    (tmp_path / "small.h5").write_text("my notes")
    with pytest.raises(InputError, match="no file of a finished study"):
        run(tmp_path)
    with pytest.raises(InputError, match="there is no file"):
        load_study(tmp_path / "none.h5")
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot make the folder"):
        run(tmp_path / "file" / "folder")


def test_two_runs_in_one_folder_are_refused(tmp_path):
    from data_tools.studies._engine.journal import Journal

    study = study_trials.study()
    journal = Journal(tmp_path / "small.journal", study.identity(TRIALS, SEED))
    with pytest.raises(InputError, match="runs elsewhere"):
        run(tmp_path)
    journal.close()
    run(tmp_path)


def test_a_trial_that_raises_is_a_failure_with_its_reason(tmp_path):
    found = run(tmp_path, study_trials.study(study_trials.fail_sometimes, cells=2))
    assert found.failures == [
        *(("g0", k, "ZeroDivisionError: by zero") for k in (1, 4, 7, 10)),
        *(("g1", k, "no headings at all") for k in (1, 4, 7, 10)),
    ]
    calm = run(tmp_path / "calm", study_trials.study(cells=2))
    kept = np.isin(calm.table["trial"] % 3, (0, 2))
    assert found.values("error").tolist() == calm.table["error"][kept].tolist()


def test_a_scheduler_that_cannot_be_reached_is_reported(tmp_path, monkeypatch):
    pytest.importorskip("distributed")

    from data_tools.studies._engine import pools

    monkeypatch.setattr(pools, "CONNECT", 0.2)
    for address in ("tcp://127.0.0.1:9", "nonsense://x", "127.0.0.1:port"):
        with pytest.raises(InputError, match="cannot be reached"):
            run(tmp_path, scheduler=address)


def test_bad_numbers_and_versions_are_refused(tmp_path):
    for change in ({"trials": 0}, {"seed": -1}, {"workers": 0}):
        with pytest.raises(InputError, match="must be at least"):
            run(tmp_path, **change)
    with pytest.raises(InputError, match="either workers or a scheduler"):
        run(tmp_path, workers=2, scheduler="tcp://127.0.0.1:9")
    with pytest.raises(InputError, match="no cells"):
        Study("empty", (), study_trials.draw)
    with pytest.raises(EvcalibError, match=f"a worker has evcalib {evcalib.__version__}, not 9"):
        run_trials(study_trials.draw, 0, "9", [])


def test_summaries_are_medians_and_quartiles_of_each_group_and_method(tmp_path):
    found = run(tmp_path, study_trials.study(study_trials.fail_sometimes, cells=2))
    entries = found.summary("error", "hit").entries
    assert [(e["group"], e["method"]) for e in entries if e["method"]] == [
        (group, method) for group in ("g0", "g1") for method in ("ä", "b")
    ]
    one = next(e for e in entries if (e["group"], e["method"]) == ("g1", "b"))
    values = found.values("error", group="g1", method="b")
    quartiles = [one[f"error {name}"] for name in ("q1", "median", "q3")]
    np.testing.assert_allclose(quartiles, np.percentile(values, [25, 50, 75]))
    assert one["hit share"] == found.values("hit", group="g1", method="b").mean()
    assert found.groups == ("g0", "g1")
    assert found.labels("method") == ("ä", "b")
    assert "error median" in found.summary("error").csv().splitlines()[0]
    assert "[" in found.summary("error").text()
    with pytest.raises(InputError, match="column must be one of"):
        found.values("speed")

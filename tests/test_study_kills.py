"""Studies that are killed, starved of disk, or started wrongly, in processes of their own."""

import json
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import study_trials
from study_trials import SEED, TRIALS, run

HERE = str(Path(__file__).parent)


def script(folder, call):
    """Start a run in a process of its own, with the tests' modules on its path."""
    code = (
        "import sys; sys.path.insert(0, {here!r})\n"
        "import study_trials\n"
        "from data_tools.studies import run_study\n"
        "if __name__ == '__main__':\n    {call}\n"
    )
    file = Path(folder) / "call.py"
    file.write_text(code.format(here=HERE, call=call), encoding="utf-8")
    return subprocess.Popen([sys.executable, file], stderr=subprocess.PIPE, text=True)


def test_killed_at_any_moment_a_study_goes_on_where_it_was(tmp_path):
    """Every kill loses at most what ran; a trial that was kept is never run again."""
    log, chance = tmp_path / "log", random.Random(3)
    make = "study_trials.study(study_trials.log_and_draw, log={!r}, seconds=0.01)"
    call = (
        f"run_study({make.format(str(log))}, trials={TRIALS}, seed={SEED},"
        f" folder={str(tmp_path)!r}, workers={{}})"
    )
    journal, kills = tmp_path / "small.journal", 0
    for workers in (1, 2, 1, 2):
        process = script(tmp_path, call.format(workers))
        before = journal.stat().st_size if journal.exists() else 0
        until = time.monotonic() + 10
        while process.poll() is None and time.monotonic() < until:
            if journal.exists() and journal.stat().st_size > before + 300:
                break
            time.sleep(0.002)
        time.sleep(chance.uniform(0, 0.05))
        kills += process.poll() is None
        process.kill()
        process.communicate()
    assert kills >= 2
    lines = journal.read_bytes().rpartition(b"\n")[0].splitlines()[1:]
    kept = {f"{cell} {trial}" for line in lines for cell, trial, _ in json.loads(line[9:])}
    before = len(log.read_text().splitlines())
    found = run(tmp_path, study_trials.study(study_trials.log_and_draw, log=str(log), seconds=0.01))
    after = log.read_text().splitlines()[before:]
    assert len(kept) > 4
    assert len(after) == len(set(after)) == 3 * TRIALS - len(kept)
    assert not kept & set(after)
    assert not journal.exists()
    calm = study_trials.study(log=str(log), seconds=0.01)
    assert found.path.read_bytes() == run(tmp_path / "calm", calm).path.read_bytes()


def test_a_full_disk_is_reported_and_loses_nothing(tmp_path):
    """A limit on the size of files stands in for the disk; the run after it goes on."""
    call = (
        f"run_study(study_trials.study(), trials={TRIALS}, seed={SEED}, folder={str(tmp_path)!r})"
    )
    limit = f"resource.setrlimit(resource.RLIMIT_FSIZE, (2000, {resource.RLIM_INFINITY}))"
    process = script(tmp_path, f"import resource; {limit}; {call}")
    _, errors = process.communicate()
    assert process.returncode == 1
    assert "cannot write" in errors
    assert "what was finished before is kept" in errors
    kept = (tmp_path / "small.journal").read_bytes()
    assert kept.endswith(b"\n")
    assert kept.count(b"\n") > 5
    assert run(tmp_path).path.read_bytes() == run(tmp_path / "calm").path.read_bytes()


def test_a_script_without_a_guard_is_told_so(tmp_path):
    """Its workers would start the script again, and die of it; no trial is to blame."""
    call = f"run_study(study_trials.study(), trials=2, seed=1, folder={str(tmp_path)!r}, workers=2)"
    file = tmp_path / "bare.py"
    head = f"import sys; sys.path.insert(0, {HERE!r})\nimport study_trials\n"
    file.write_text(f"{head}from data_tools.studies import run_study\n{call}\n", encoding="utf-8")
    done = subprocess.run([sys.executable, file], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "no worker process can be started" in done.stderr
    assert len((tmp_path / "small.journal").read_bytes().splitlines()) == 1


def test_no_worker_outlives_a_killed_run(tmp_path):
    call = (
        f"run_study(study_trials.study(study_trials.note_pid, log={str(tmp_path / 'pids')!r}),"
        f" trials=1000, seed=1, folder={str(tmp_path)!r}, workers=2)"
    )
    process, pids = script(tmp_path, call), tmp_path / "pids"
    until = time.monotonic() + 20
    while time.monotonic() < until:
        if pids.exists() and len(set(pids.read_text().split())) > 1:
            break
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    workers = {int(pid) for pid in pids.read_text().split()}
    assert len(workers) == 2
    while any(Path(f"/proc/{pid}").exists() for pid in workers) and time.monotonic() < until:
        time.sleep(0.02)
    assert not any(Path(f"/proc/{pid}").exists() for pid in workers)

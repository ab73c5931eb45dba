"""Kills, Ctrl-C, full disks, forbidden folders, files that vanish, and two processes at once."""

import os
import random
import signal
import subprocess
import sys
import time

import naive_formats
import numpy as np
import pytest

from data_tools.logs.series_files import read_headings, read_velocities
from data_tools.recordings import open_recording
from data_tools.recordings.convert import convert
from data_tools.runs.demo import write_demo
from data_tools.runs.export import read_calibration
from data_tools.runs.folder import MARKER, RunFolder
from data_tools.simulation.recorded_drive import record_drive
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.events import Events

STAGES = ("headings", "alignment", "refinement", "report")
COMPLETE = {"headings.csv", "velocities.csv", "report.html", "calibration.yaml"}

SIGNALLED = """
import os, signal, sys, threading
from data_tools.runs.folder import RunFolder
stage, name, delay = sys.argv[1], getattr(signal, sys.argv[2]), float(sys.argv[3])
plain = RunFolder.stage
def watched(self, reached):
    plain(self, reached)
    if reached == stage:
        timer = threading.Timer(delay, os.kill, (os.getpid(), name))
        timer.daemon = True
        timer.start()
RunFolder.stage = watched
sys.argv = ["evcalib", *sys.argv[4:]]
from data_tools.cli import main
main()
"""


def whole(recording):
    return Events.concatenate(list(recording))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drive")
    camera = Camera(96, 72, 80.0, 80.0, 47.5, 35.5)
    write_demo(folder, record_drive(2, motion="sweep", duration=4.0, camera=camera))
    return folder


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A recording of 400,000 events, whose conversion takes a while."""
    rng, count = np.random.default_rng(5), 400_000
    path = tmp_path_factory.mktemp("source") / "source.npz"
    np.savez(
        path,
        x=rng.integers(0, 640, count).astype(np.uint16),
        y=rng.integers(0, 480, count).astype(np.uint16),
        t=np.sort(rng.integers(0, 10**7, count)),
        p=rng.integers(0, 2, count).astype(np.uint8),
        width=640,
        height=480,
    )
    return path


def calibrating(files, out, stage, name, delay):
    """Return what a calibration said that got a signal so long after a stage began."""
    words = [sys.executable, "-c", SIGNALLED, stage, name, f"{delay:.3f}", "calibrate"]
    words += [files / "events.h5", "--camera", files / "calib.txt", "-o", out, "--overwrite"]
    words += ["--wheels", files / "wheels.csv", "--vehicle", files / "vehicle.yaml"]
    return subprocess.run(
        list(map(str, words)), capture_output=True, text=True, timeout=120, check=False
    )


def assert_nothing_pretends(folder):
    """Check that what has a final name is whole, and that a calibration means all is there."""
    names = {path.name for path in folder.iterdir()} if folder.exists() else set()
    for name, read in (("headings.csv", read_headings), ("velocities.csv", read_velocities)):
        if name in names:
            read(folder / name)
    if "report.html" in names:
        assert (folder / "report.html").read_text(encoding="utf-8").endswith("</html>\n")
    if "calibration.yaml" in names:
        read_calibration(folder / "calibration.yaml")
        assert names >= COMPLETE
    assert MARKER in names or names == COMPLETE or not names


def test_a_calibration_killed_in_any_stage_pretends_nothing_and_can_be_run_again(files, tmp_path):
    """All kills hit the same folder, so each run also meets what the one before left."""
    out, chance, killed = tmp_path / "out", random.Random(11), 0
    for stage in STAGES:
        done = calibrating(files, out, stage, "SIGKILL", chance.uniform(0, 0.2))
        killed += done.returncode == -signal.SIGKILL
        assert_nothing_pretends(out)
    assert killed >= 3
    done = calibrating(files, out, "never", "SIGKILL", 0)
    assert done.returncode in (0, 3), done.stderr
    assert {path.name for path in out.iterdir()} == COMPLETE
    assert_nothing_pretends(out)


@pytest.mark.parametrize("stage", STAGES)
def test_ctrl_c_in_any_stage_ends_in_one_line(files, tmp_path, stage):
    out = tmp_path / "out"
    done = calibrating(files, out, stage, "SIGINT", 0.0)
    assert done.returncode == 130, done.stderr
    assert done.stderr == "evcalib: interrupted\n"
    assert "stopped: interrupted" in (out / MARKER).read_text()
    assert_nothing_pretends(out)
    assert "calibration.yaml" not in os.listdir(out)


CONVERT = """
import sys
from data_tools.recordings.convert import convert
from data_tools.recordings import open_recording
print("ready", flush=True)
convert(open_recording(sys.argv[1]), sys.argv[2])
"""


def converting(source, target):
    words = [sys.executable, "-c", CONVERT, str(source), str(target)]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout.readline() == b"ready\n"
    return process


@pytest.mark.parametrize("suffix", [".h5", ".npz", ".csv"])
def test_a_conversion_killed_at_any_moment_leaves_the_old_file_or_the_new(source, tmp_path, suffix):
    target, chance, kills = tmp_path / f"copy{suffix}", random.Random(suffix), 0
    target.write_text("the old one")
    for longest in (0.05, 0.2, 0.8):
        process = converting(source, target)
        time.sleep(chance.uniform(0, longest))
        kills += process.poll() is None
        process.kill()
        process.communicate()
        left = target.read_bytes()
        if left != b"the old one":
            assert len(whole(open_recording(target, size=(640, 480)))) == 400_000
    assert kills
    convert(open_recording(source), target)
    assert len(whole(open_recording(target, size=(640, 480)))) == 400_000
    assert os.listdir(tmp_path) == [target.name]


def test_two_conversions_to_one_name_leave_one_whole_file(source, tmp_path):
    target = tmp_path / "copy.h5"
    both = [converting(source, target) for _ in range(2)]
    for process in both:
        _, err = process.communicate(timeout=60)
        assert process.returncode == 0, err
    wanted, found = whole(open_recording(source)), whole(open_recording(target))
    for column in "xytp":
        np.testing.assert_array_equal(getattr(found, column), getattr(wanted, column))
    assert os.listdir(tmp_path) == [target.name]


def test_two_runs_cannot_share_a_folder(tmp_path):
    with RunFolder(tmp_path) as folder:
        folder.write("headings.csv", lambda path: path.write_text("first"))
        with pytest.raises(InputError, match="in use: another run is writing to it"):
            RunFolder(tmp_path, overwrite=True).__enter__()
        folder.write("calibration.yaml", lambda path: path.write_text("first"))
    assert (tmp_path / "calibration.yaml").read_text() == "first"
    assert not (tmp_path / MARKER).exists()
    with RunFolder(tmp_path, overwrite=True):
        pass


COMPILE = """
import numpy as np
from evcalib import Events
from evcalib.surfaces import tos
rng = np.random.default_rng(1)
events = Events.from_arrays(
    rng.integers(0, 20, 500), rng.integers(0, 10, 500), range(500), [1] * 500, 20, 10
)
print(tos(events).tobytes().hex())
"""


def test_two_processes_fill_one_empty_cache_of_kernels(tmp_path):
    """Both compile at the same time; a third one finds a cache that is sound."""
    env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    words = [sys.executable, "-c", COMPILE]
    both = [
        subprocess.Popen(words, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        for _ in range(2)
    ]
    outputs = [process.communicate(timeout=120) for process in both]
    assert [process.returncode for process in both] == [0, 0], outputs
    third = subprocess.run(words, env=env, capture_output=True, check=True)
    assert {out for out, _ in outputs} == {third.stdout}
    assert list(tmp_path.rglob("*.nbc"))


@pytest.mark.parametrize("cut", [8000, 8003], ids=["whole records", "part of one"])
def test_a_recording_that_shrinks_while_it_is_read_is_told(tmp_path, cut):
    """Also where the cut is between two records and nothing in the file tells."""
    path, count = tmp_path / "events.dat", 600_000
    records = np.zeros((count, 2), dtype="<u4")
    records[:, 0] = np.arange(count)
    path.write_bytes(naive_formats.HEADER_DAT + b"\x0c\x08" + records.tobytes())
    recording = open_recording(path)
    pieces = iter(recording)
    assert len(next(pieces)) < count
    with open(path, "rb+") as file:
        file.truncate(path.stat().st_size - cut)
    with pytest.raises(InputError, match=r"events\.dat changed while it was read"):
        list(pieces)


def test_a_recording_that_vanishes_before_it_is_read_is_told(source, tmp_path):
    path = tmp_path / "events.npz"
    path.write_bytes(source.read_bytes())
    recording = open_recording(path)
    path.unlink()
    with pytest.raises(InputError, match=r"events\.npz"):
        list(recording)

"""From the files of a drive to its calibration, as a user types it; and what bad files get."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from naive_formats import evt2_words

from data_tools.logs.series_files import read_velocities
from data_tools.recordings import open_recording
from data_tools.runs import demo
from data_tools.runs.demo import write_demo
from data_tools.runs.folder import MARKER
from data_tools.simulation.recorded_drive import RecordedDrive, record_drive
from evcalib import calibrate
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.geometry import rotation_angle
from evcalib.series import VelocitySeries

EVCALIB = [sys.executable, "-c", "from data_tools.cli import main; main()"]

SMALL = Camera(96, 72, 80.0, 80.0, 47.5, 35.5)


@dataclass(frozen=True)
class Files:
    """A recorded drive and its files."""

    drive: RecordedDrive
    folder: Path

    def words(self, *more, **other):
        """Return a command line; `other` names files in place of the drive's, None for none."""
        names = {
            "recording": "events.h5",
            "camera": "calib.txt",
            "wheels": "wheels.csv",
            "vehicle": "vehicle.yaml",
            **other,
        }
        recording = self.folder / names.pop("recording")
        options = [
            word
            for role, name in names.items()
            if name is not None
            for word in (f"--{role}", self.folder / name)
        ]
        return ["calibrate", recording, *options, "--max-offset", "0.6", *more]

    def with_wheels(self, name, change):
        """Write the wheel log with its table changed; return the file's name."""
        lines = (self.folder / "wheels.csv").read_text().splitlines()
        table = np.array([line.split(",") for line in lines[1:]], dtype=float)
        rows = [",".join(f"{value:.9g}" for value in row) for row in change(table)]
        (self.folder / name).write_text("\n".join([lines[0], *rows]) + "\n")
        return name


def recorded(factory, motion, seed, duration):
    drive = record_drive(seed, motion=motion, duration=duration, camera=SMALL)
    folder = factory.mktemp(motion)
    write_demo(folder, drive)
    return Files(drive, folder)


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    return recorded(tmp_path_factory, "sweep", 2, 6.0)


def content(folder):
    return {path.name for path in Path(folder).iterdir()}


COMPLETE = {"calibration.yaml", "headings.csv", "velocities.csv", "report.html"}


@pytest.fixture(scope="module")
def calibrated(sweep, tmp_path_factory):
    """The folder of one run on wheels, with what it printed as JSON."""
    folder = tmp_path_factory.mktemp("results") / "run"
    words = sweep.words("-o", folder, "--json")
    done = subprocess.run([*EVCALIB, *map(str, words)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return folder, json.loads(done.stdout)


def test_a_recording_and_wheels_give_the_truth(sweep, calibrated):
    folder, printed = calibrated
    assert content(folder) == COMPLETE
    stored = yaml.safe_load((folder / "calibration.yaml").read_text())
    assert stored.items() >= printed.items()
    assert stored.keys() - printed.keys() == {"shared", "recording", "rig"}
    assert stored["noise"] is None  # so small a sensor is not filtered
    error = rotation_angle(stored["R_body_cam"], sweep.drive.R_body_cam)
    assert np.degrees(error) < min(2.0, 1.5 * stored["rotation_radius_deg"])
    miss = abs(stored["offset_s"] - sweep.drive.offset)
    assert miss < min(0.03, 3 * stored["offset_sd_s"])
    assert stored["offset_observable"] is True
    assert stored["rotation_observable"] is True


def test_the_report_says_what_was_found(calibrated):
    folder, printed = calibrated
    page = (folder / "report.html").read_text()
    assert f"{printed['offset_s']:.4f}" in page
    assert printed["verdict"].split(".")[0] in page
    for word in ("events.h5", "wheels.csv", "vehicle.yaml", "calib.txt", "evcalib calibrate"):
        assert word in page
    assert not re.search(r"(src|href)=\"https?:", page)


def test_velocities_stand_in_for_the_wheels(run, sweep, calibrated, tmp_path):
    folder, printed = calibrated
    wheels = sweep.folder / "wheels.csv"
    vehicle = ("--vehicle", sweep.folder / "vehicle.yaml")
    assert run("velocities", wheels, *vehicle, "-o", sweep.folder / "v.csv")[0] == 0
    text = (sweep.folder / "v.csv").read_text()
    (sweep.folder / "v.csv").write_text(text.replace(",", ";"))
    words = sweep.words(wheels=None, vehicle=None, velocities="v.csv")
    code, out, _ = run(*words, "-o", tmp_path / "o", "--json")
    assert "columns are separated by semicolons" in (tmp_path / "o" / "report.html").read_text()
    found = json.loads(out)
    assert code == 0
    assert found["offset_s"] == pytest.approx(printed["offset_s"], abs=1e-6)
    assert rotation_angle(found["R_body_cam"], printed["R_body_cam"]) < 1e-6


def test_the_stages_one_by_one_give_the_papers_chain(run, sweep, calibrated, tmp_path):
    """``headings``, ``velocities`` and ``align`` against ``calibrate --refinement none``."""
    folder, _ = calibrated
    code, out, _ = run(*sweep.words("-o", tmp_path / "o", "--refinement", "none", "--json"))
    whole = json.loads(out)
    assert code == 0
    camera = ("--camera", sweep.folder / "calib.txt")
    run("headings", sweep.folder / "events.h5", *camera, "-o", tmp_path / "h.csv")
    vehicle = ("--vehicle", sweep.folder / "vehicle.yaml")
    run("velocities", sweep.folder / "wheels.csv", *vehicle, "-o", tmp_path / "v.csv")
    _, out, _ = run(
        "align", tmp_path / "h.csv", tmp_path / "v.csv", "--max-offset", "0.6", "--json"
    )
    parts = json.loads(out)
    assert parts["offset_s"] == pytest.approx(whole["offset_s"], abs=1e-6)
    assert rotation_angle(parts["R_body_cam"], whole["R_body_cam"]) < 1e-6
    assert (tmp_path / "h.csv").read_text() == (folder / "headings.csv").read_text()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"events": Path("events.h5")}, r"events must be Events, not \w+Path; .*open_recording"),
        ({"events": "events.h5"}, r"events must be Events, not str; "),
        ({"events": np.zeros((9, 4))}, r"events must be Events, not ndarray; "),
        ({"camera": np.eye(3)}, r"camera must be Camera, not ndarray; .*read_camera"),
        (
            {"velocities": np.zeros((9, 3))},
            r"velocities must be VelocitySeries or BodyVelocities, not ndarray; .*read_velocities",
        ),
    ],
)
def test_a_wrong_type_is_told_with_what_makes_the_right_one(wrong, message):
    still = VelocitySeries([0.0, 1.0], np.ones((2, 3)))
    right = {"events": [], "camera": SMALL, "velocities": still}
    with pytest.raises(InputError, match=message):
        calibrate(**{**right, **wrong})


@pytest.mark.parametrize("motion", ["straight", "arc"])
def test_a_drive_that_cannot_answer_exits_with_3_and_says_why(
    run, tmp_path_factory, tmp_path, motion
):
    files = recorded(tmp_path_factory, motion, 3, 5.0)
    code, out, _ = run(*files.words("-o", tmp_path / "o"))
    assert code == 3
    assert "offset is not observable" in out
    assert "What would tell" in out
    assert content(tmp_path / "o") == COMPLETE
    assert "not observable" in (tmp_path / "o" / "report.html").read_text()


def test_calibrate_takes_pieces_and_tells_its_stages(sweep):
    """The function behind the command, given arrays."""
    recording = open_recording(sweep.folder / "events.h5")
    stages = []
    body = sweep.drive.drive
    t = np.arange(0, 6, 0.02)
    velocities = replace(read_velocities_of(sweep), v=body.velocity(t), t=t, yaw_rate=None)
    run = calibrate(
        (part for part in recording), SMALL, velocities, max_offset=0.6,
        camera_position=(0.1, 0.0, 0.4), on_stage=stages.append,
    )  # fmt: skip
    found = run.calibration
    assert stages == ["headings", "alignment", "refinement"] == list(run.timings)
    assert rotation_angle(found.R_body_cam, sweep.drive.R_body_cam) < np.radians(3.0)
    assert run.settings["camera_position"] == (0.1, 0.0, 0.4)
    assert run.gating is None


def read_velocities_of(files):
    (files.folder / "two.csv").write_text("t,vx,vy\n0,1,0\n1,1,0\n")
    return read_velocities(files.folder / "two.csv")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"refinement": "magic"}, "tracks, none"),
        ({"camera_position": (0, 0)}, "camera_position"),
        ({"camera_position": (0, 0, np.nan)}, "camera_position"),
        ({"velocities": None}, "BodyVelocities, not NoneType"),
        ({"events": None}, "events must be Events, not NoneType"),
        ({"events": []}, "holds no events"),
        ({"surface": "sits"}, "surface"),
        ({"rate": 0}, "rate"),
    ],
)
def test_wrong_arguments_are_refused_before_any_work(sweep, options, message):
    given = {"events": [], "velocities": read_velocities_of(sweep), **options}
    events, velocities = given.pop("events"), given.pop("velocities")
    with pytest.raises(InputError, match=message):
        calibrate(events, SMALL, velocities, **given)


def one_line(err):
    assert err.startswith("evcalib: ")
    assert err.count("\n") == 1
    return err


def scaled(columns, factor):
    def change(table):
        table[:, columns] *= factor
        return table

    return change


def shifted(rows, seconds):
    def change(table):
        table[rows, 0] += seconds
        return table

    return change


BAD_WHEELS = {
    "milliseconds": (scaled(slice(0, 1), 1e3), "are the times in seconds"),
    "millimetres": (scaled(slice(1, None, 2), 1e3), "metres per second"),
    "degrees": (scaled(slice(2, None, 2), 57.3), "radians, not degrees"),
    "clock set back": (shifted(slice(150, None), -1.0), "line 152: .* s before that of the row"),
    "clock set ahead": (shifted(slice(150, None), 1e4), "line 152: .* the clock was set"),
    "another day": (shifted(slice(None), 86400.0), "do not overlap"),
    "standing": (scaled(slice(1, None, 2), 0.0), "does not move"),
}


@pytest.mark.parametrize("name", BAD_WHEELS)
def test_bad_wheel_logs_are_refused_and_nothing_is_left(run, sweep, tmp_path, name):
    change, message = BAD_WHEELS[name]
    words = sweep.words(wheels=sweep.with_wheels("bad.csv", change))
    code, out, err = run(*words, "-o", tmp_path / "o")
    assert code == 2
    assert out == ""
    assert re.search(message, one_line(err))
    assert not (tmp_path / "o").exists()


def test_a_clock_that_jumps_a_little_gives_no_wrong_answer(run, sweep, tmp_path):
    """By 0.3 s in the middle: either half can be right, both cannot."""
    words = sweep.words(wheels=sweep.with_wheels("jump.csv", shifted(slice(150, None), 0.3)))
    code, out, _ = run(*words, "-o", tmp_path / "o", "--json")
    found = json.loads(out)
    assert code in (0, 3)
    if code == 0 and found["offset_observable"]:
        low, high = found["offset_interval_s"]
        truth = np.array([0.0, 0.3]) + sweep.drive.offset
        assert ((low < truth) & (truth < high)).any()


KALIBR = """cam0:
  camera_model: {model}
  distortion_model: {distortion}
  intrinsics: [80, 80, 47.5, 35.5]
  distortion_coeffs: [0, 0, 0, 0]
  resolution: [{width}, 72]
"""

BAD_CAMERAS = {
    "another model": ("c.yaml", {"model": "omni"}, "'omni' is not supported"),
    "another distortion": ("c.yaml", {"distortion": "fov"}, "model 'fov'; radial-tangential"),
    "another size": (
        "c.yaml",
        {"width": 346},
        "for 346x72 pixels, the events have 96x72",
    ),
    "no model": ("c.txt", "200 200 172 129 0 0 0 0 0\n", "calibration of another resolution"),
    "words": ("c.txt", "fx fy", "holds no camera in a form that is known"),
}


@pytest.mark.parametrize("name", BAD_CAMERAS)
def test_wrong_cameras_are_refused(run, sweep, tmp_path, name):
    file, text, message = BAD_CAMERAS[name]
    if isinstance(text, dict):
        text = KALIBR.format(**{"model": "pinhole", "distortion": "radtan", "width": 96, **text})
    (sweep.folder / file).write_text(text)
    code, _, err = run(*sweep.words(camera=file), "-o", tmp_path / "o")
    assert code == 2
    assert re.search(message, one_line(err))
    assert not (tmp_path / "o").exists()


def test_a_recording_that_ends_in_the_middle_of_a_word_is_used_and_the_loss_reported(
    run, sweep, tmp_path
):
    whole = list(open_recording(sweep.folder / "events.h5"))
    events = [row for part in whole for row in zip(part.t, part.x, part.y, part.p, strict=True)]
    rows = [(int(t), int(x), int(y), int(p)) for t, x, y, p in events if t < 3_000_000]
    header = f"% evt 2.0\n% geometry {SMALL.width}x{SMALL.height}\n".encode()
    (sweep.folder / "cut.raw").write_bytes(header + evt2_words(rows)[:-2])
    words = sweep.words("-o", tmp_path / "o", "--refinement", "none", recording="cut.raw")
    code, _, err = run(*words)
    assert code in (0, 3), err
    assert "bytes of a cut-off last word" in (tmp_path / "o" / "report.html").read_text()


def test_a_text_recording_that_ends_in_the_middle_of_a_line_is_refused(run, sweep, tmp_path):
    lines = "".join(f"{0.001 * k:.6f} {k % 90} {k % 70} {k % 2}\n" for k in range(5000))
    (sweep.folder / "cut.txt").write_text(lines[:-6])
    words = sweep.words("-o", tmp_path / "o", "--size", "96x72", recording="cut.txt")
    code, _, err = run(*words)
    assert code == 2
    assert "line 5000" in one_line(err)
    assert not (tmp_path / "o").exists()


def test_a_finished_folder_is_replaced_only_if_asked(run, sweep, calibrated):
    folder, _ = calibrated
    before = (folder / "calibration.yaml").read_bytes()
    code, _, err = run(*sweep.words("-o", folder))
    assert code == 2
    assert "--overwrite" in one_line(err)
    assert (folder / "calibration.yaml").read_bytes() == before


def test_a_folder_of_something_else_or_in_a_file_is_refused(run, sweep, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    code, _, err = run(*sweep.words("-o", tmp_path))
    assert code == 2
    assert "notes.txt" in one_line(err)
    code, _, err = run(*sweep.words("-o", tmp_path / "notes.txt" / "o"))
    assert code == 2
    assert "cannot make the folder" in one_line(err)


@pytest.mark.parametrize(
    "missing",
    [
        {"recording": "none.h5"},
        {"camera": "none.txt"},
        {"wheels": "none.csv"},
        {"vehicle": "none.yaml"},
    ],
    ids=lambda d: next(iter(d)),
)
def test_missing_files_are_named(run, sweep, tmp_path, missing):
    code, _, err = run(*sweep.words("-o", tmp_path / "o", **missing))
    assert code == 2
    assert next(iter(missing.values())) in one_line(err)
    assert not (tmp_path / "o").exists()


def test_wheels_and_velocities_exclude_each_other(run, sweep, tmp_path):
    code, _, err = run(*sweep.words("-o", tmp_path / "o", velocities="v.csv"))
    assert code == 2
    assert "either wheels" in one_line(err)
    code, _, err = run(*sweep.words("-o", tmp_path / "o", wheels=None, vehicle=None))
    assert code == 2
    assert "either wheels" in one_line(err)


@pytest.fixture
def disk(tmp_path):
    """A disk of 40 kB."""
    place = tmp_path / "disk"
    place.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", "size=40k", "tmpfs", str(place)]
    if os.getuid() != 0 or subprocess.run(words, capture_output=True, check=False).returncode:
        pytest.skip("cannot mount a small disk here")
    yield place
    subprocess.run(["umount", str(place)], check=False)


def test_a_full_disk_is_told_and_nothing_is_half_written(run, sweep, disk):
    code, _, err = run(*sweep.words("-o", disk / "o", "--refinement", "none"))
    assert code == 2
    assert "No space left" in one_line(err)
    assert MARKER in content(disk / "o")
    assert not content(disk / "o") & {"calibration.yaml", "report.html"}
    assert not [name for name in content(disk / "o") if name.endswith(".part")]


def test_ctrl_c_ends_with_130_and_a_marked_folder(sweep, tmp_path):
    folder = tmp_path / "o"
    words = [*EVCALIB, *map(str, sweep.words("-o", folder))]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as process:
        try:
            for _ in range(600):
                if (folder / MARKER).exists() and "headings" in (folder / MARKER).read_text():
                    break
                time.sleep(0.05)
            process.send_signal(signal.SIGINT)
            _, err = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 130
    assert one_line(err) == "evcalib: interrupted\n"
    assert content(folder) == {MARKER}
    assert "stopped: interrupted" in (folder / MARKER).read_text()


def test_the_demo_calibrates_the_recording_that_every_installation_has(run, tmp_path):
    code, out, _ = run("demo", "-o", tmp_path / "o")
    assert code == 0
    assert "+0.4550 s: error" in out
    assert content(tmp_path / "o") == COMPLETE
    code, _, err = run("demo", "-o", tmp_path / "o", "--recording", tmp_path / "files")
    assert code == 2
    assert "add --simulate" in err


def test_a_simulated_demo_finds_the_truth_and_keeps_its_files_if_asked(
    run, sweep, tmp_path, monkeypatch
):
    """On a small drive; the real one is longer."""
    monkeypatch.setattr(demo, "demo_drive", lambda seed: sweep.drive)
    words = ("demo", "--simulate", "-o", tmp_path / "o", "--recording", tmp_path / "files")
    code, out, _ = run(*words)
    assert code == 0
    assert f"{sweep.drive.offset:+.4f} s: error" in out
    assert content(tmp_path / "o") == COMPLETE
    assert content(tmp_path / "files") == {"events.h5", "calib.txt", "wheels.csv", "vehicle.yaml"}
    assert (tmp_path / "files" / "wheels.csv").read_text() == (
        sweep.folder / "wheels.csv"
    ).read_text()


def test_warmup_says_what_it_did(run):
    code, out, _ = run("warmup")
    assert code == 0
    assert "Compiled and kept" in out


def test_info_and_convert_agree_on_what_a_recording_holds(run, sweep, tmp_path):
    told = []
    assert run("convert", sweep.folder / "events.h5", tmp_path / "e.npz")[0] == 0
    for path in (sweep.folder / "events.h5", tmp_path / "e.npz"):
        code, out, _ = run("info", path, "--json")
        assert code == 0
        told.append(json.loads(out))
    same = ("count", "width", "height", "duration", "on_share", "first_us")
    assert [told[0][key] for key in same] == [told[1][key] for key in same]
    assert told[0]["width"] == SMALL.width
    code, out, _ = run("info", tmp_path / "e.npz")
    assert f"{SMALL.width}x{SMALL.height} px" in out


def test_a_batch_calibrates_what_it_can_and_names_the_rest(run, sweep, calibrated, tmp_path):
    _, printed = calibrated
    text = "defaults: {camera: calib.txt, vehicle: vehicle.yaml, wheels: wheels.csv}\n"
    text += "recordings:\n  - {recording: events.h5, max_offset: 0.6}\n"
    text += "  - {recording: none.h5}\n"
    (sweep.folder / "list.yaml").write_text(text)
    code, out, _ = run("batch", sweep.folder / "list.yaml", "-o", tmp_path / "all")
    assert code == 2
    assert "1 of 2 failed" in out
    assert "none.h5" in out
    stored = yaml.safe_load((tmp_path / "all" / "events" / "calibration.yaml").read_text())
    assert stored["offset_s"] == pytest.approx(printed["offset_s"], abs=1e-9)
    rows = (tmp_path / "all" / "summary.csv").read_text().splitlines()
    assert len(rows) == 3


def test_events_after_the_velocities_are_refused_before_they_are_read():
    t = np.arange(0.0, 5.0, 0.02)
    body = VelocitySeries(t, np.column_stack([np.ones_like(t), np.sin(t), 0 * t]))

    def pieces():
        yield Events.from_arrays([1], [1], [9_000_000], [1], 32, 24)
        raise AssertionError("the second piece is never asked for")

    camera = Camera(32, 24, 30.0, 30.0, 15.5, 11.5)
    with pytest.raises(InputError, match=r"begin at 9\.000 s"):
        calibrate(pieces(), camera, body)

"""The command line as a user types it: output, files, exit codes, one clear line per error."""

import gzip
import hashlib
import io
import json
import os
import re
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import yaml

from data_tools import cli
from data_tools.files import datasets
from data_tools.files.text import read_yaml
from data_tools.logs.series_files import read_paired_streams, write_headings, write_velocities
from data_tools.logs.velocity_sources import read_body_velocities
from data_tools.recordings import open_recording
from data_tools.simulation.drives import arc, s_curve, straight
from data_tools.simulation.streams import Noise, simulate
from evcalib.errors import InputError
from evcalib.geometry import rotation_angle

PAPER_TRUTH = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])

VEHICLE = """type: swerve
wheels:
  fl: {x: 0.30, y: 0.25}
  fr: {x: 0.30, y: -0.25}
"""


def write_drive(folder, drive, **options):
    options = {"heading_noise": Noise(0.05), "velocity_noise": Noise(0.01), **options}
    streams = simulate(drive, np.random.default_rng(3), offset=0.2, **options)
    write_headings(folder / "h.csv", streams.headings)
    write_velocities(folder / "v.csv", streams.velocities)
    return streams


def one_line(err):
    assert err.startswith("evcalib: ")
    assert err.count("\n") == 1
    return err


def test_align_writes_what_it_prints(run, tmp_path):
    streams = write_drive(tmp_path, s_curve(10))
    code, out, _ = run("align", tmp_path / "h.csv", tmp_path / "v.csv", "-o", tmp_path / "o")
    assert code == 0
    assert "determines the rotation and the offset" in out
    stored = yaml.safe_load((tmp_path / "o" / "calibration.yaml").read_text())
    assert stored["offset_s"] == pytest.approx(0.2, abs=4 * stored["offset_sd_s"])
    turn = np.degrees(rotation_angle(stored["R_body_cam"], streams.R_body_cam))
    assert turn < 4 * stored["rotation_sd_deg"]
    assert stored["offset_observable"] is True
    assert stored["rotation_observable"] is True
    assert "R_body_cam" in stored["convention"]
    names = {path.name for path in (tmp_path / "o").iterdir()}
    pictures = {f"{name}.png" for name in ("correlation", "directions", "residuals", "sphere")}
    assert names == pictures | {"calibration.yaml"}


def test_json_is_alone_on_stdout_and_equals_the_file(run, tmp_path):
    write_drive(tmp_path, s_curve(10))
    words = ("align", tmp_path / "h.csv", tmp_path / "v.csv", "-o", tmp_path / "o", "--json")
    _, out, err = run(*words)
    assert err == ""
    assert json.loads(out) == yaml.safe_load((tmp_path / "o" / "calibration.yaml").read_text())


@pytest.mark.parametrize("drive", [arc(12), straight(12)], ids=lambda d: d.kind)
def test_a_motion_that_cannot_answer_exits_with_3_and_says_what_is_unknown(run, tmp_path, drive):
    write_drive(tmp_path, drive)
    code, out, _ = run("align", tmp_path / "h.csv", tmp_path / "v.csv")
    assert code == 3
    assert "not observable" in out
    assert "What would tell" in out


def test_an_arc_with_the_offset_given_is_determined(run, tmp_path):
    write_drive(tmp_path, arc(12))
    code, out, _ = run("align", tmp_path / "h.csv", tmp_path / "v.csv", "--offset", "0.2")
    assert code == 0
    assert "0.2 s that was given" in out


def test_offset_method_none_takes_the_offset_as_it_is(run, tmp_path):
    write_drive(tmp_path, s_curve(10))
    words = ("--offset", "0.2", "--offset-method", "none", "--json")
    code, out, _ = run("align", tmp_path / "h.csv", tmp_path / "v.csv", *words)
    assert code == 0
    assert json.loads(out)["offset_s"] == 0.2


@pytest.mark.parametrize("fingers", [3, 5])
def test_the_papers_real_data_determine_the_rotation_only(run, data, fingers):
    path = data / "evcalib" / f"calib_data_time_{fingers}traj.npz"
    code, out, _ = run("align", path, "--json")
    result = json.loads(out)
    error = np.degrees(rotation_angle(result["R_body_cam"], PAPER_TRUTH))
    assert code == 0
    assert result["offset_observable"] is False
    assert error <= 3.0
    assert result["rotation_sd_deg"] >= error


def test_velocities_of_a_wheel_log_feed_align(run, tmp_path):
    (tmp_path / "car.yaml").write_text(VEHICLE)
    (tmp_path / "w.csv").write_text(
        "t,speed_fl,steer_fl,speed_fr,steer_fr\n0,1,0.5,1,0.5\n0.1,1,0.5,1,0.5\n0.2,2,0,2,0\n"
    )
    words = ("--vehicle", tmp_path / "car.yaml", "-o", tmp_path / "v.csv")
    code, out, _ = run("velocities", tmp_path / "w.csv", *words)
    assert code == 0
    assert "3 of 3 rows" in out
    table = np.genfromtxt(tmp_path / "v.csv", delimiter=",", names=True)
    assert table["vx"] == pytest.approx([np.cos(0.5), np.cos(0.5), 2.0])
    assert table["vy"] == pytest.approx([np.sin(0.5), np.sin(0.5), 0.0])


def test_a_missing_wheel_is_named(run, tmp_path):
    (tmp_path / "car.yaml").write_text(VEHICLE)
    (tmp_path / "w.csv").write_text("t,speed_fl,steer_fl\n0,1,0\n1,1,0\n")
    words = ("--vehicle", tmp_path / "car.yaml", "-o", tmp_path / "v.csv")
    code, _, err = run("velocities", tmp_path / "w.csv", *words)
    assert code == 2
    assert "fr" in one_line(err)


GOOD_V = "t,vx,vy\n" + "".join(f"{0.1 * i:.1f},1,{np.sin(i):.3f}\n" for i in range(60))
GOOD_H = "t,vx,vy,vz\n" + "".join(
    f"{0.1 * i:.1f},{np.sin(i / 9):.9f},0,{np.cos(i / 9):.9f}\n" for i in range(60)
)

BAD = {
    "empty": ("", GOOD_V, "is empty"),
    "no rows": ("t,vx,vy,vz\n", GOOD_V, "no row below its header"),
    "one row": ("t,vx,vy,vz\n0,1,0,0\n", GOOD_V, "one row below its header"),
    "wrong columns": ("when,vx,vy,vz\n0,1,0,0\n1,1,0,0\n", GOOD_V, "lacks the column.* t"),
    "NaN": (GOOD_H.replace("\n0.1,", "\n0.1,nan").replace("nan0", "nan,0", 1), GOOD_V, "line 3"),
    "text": (GOOD_H + "x,1,0,0\n", GOOD_V, "not a finite number"),
    "clock set": (GOOD_H + "1.0,1,0,0\n1.1,1,0,0\n", GOOD_V, "the clock was set"),
    "duplicate": ("t,vx,vy,vz\n" + 9 * "5.9,1,0,0\n", GOOD_V, "8 of 9 rows repeat"),
    "not unit": (GOOD_H + "6.0,2,0,0\n", GOOD_V, "length 2, not 1"),
    "zero heading": (GOOD_H + "6.0,0,0,0\n", GOOD_V, "length 0, not 1"),
    "mixed units": (GOOD_H, GOOD_V + "6.0,400,0\n", "400 m/s"),
    "standing": (GOOD_H, "t,vx,vy\n0,0,0\n1,0,0\n2,0,0\n", "does not move"),
    "milliseconds": (GOOD_H, "t,vx,vy\n0,1,0\n20,1,0.1\n40,1,0\n", "in seconds"),
    "no overlap": (GOOD_H, re.sub(r"\n(?=\d)", "\n9", GOOD_V), "do not overlap"),
    "binary": ("\x00\xff\x00", GOOD_V, "not a CSV text file|lacks the column"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_clear_line_and_exit_code_2(run, tmp_path, name):
    h, v, message = BAD[name]
    (tmp_path / "h.csv").write_text(h, encoding="latin-1")
    (tmp_path / "v.csv").write_text(v)
    code, out, err = run("align", tmp_path / "h.csv", tmp_path / "v.csv")
    assert code == 2
    assert out == ""

    assert re.search(message, one_line(err))


def test_all_parallel_directions_name_the_unknown_axis(run, tmp_path):
    (tmp_path / "h.csv").write_text(
        "t,vx,vy,vz\n" + "".join(f"{i / 10},0,0,1\n" for i in range(60))
    )
    (tmp_path / "v.csv").write_text("t,vx,vy\n" + "".join(f"{i / 10},1,0\n" for i in range(60)))
    code, out, _ = run("align", tmp_path / "h.csv", tmp_path / "v.csv")
    assert code == 3
    assert "rotation about the body's forward axis is unknown" in out


@pytest.mark.parametrize(
    "words",
    [
        ("align",),
        ("align", "h.csv"),
        ("align", "a.csv", "b.csv", "--max-offset", "many"),
        ("align", "missing.csv", "missing.csv"),
        ("align", "missing.npz"),
        ("export", "missing.yaml", "--to", "urdf"),
        ("nosuch",),
        ("calibrate", "missing.h5", "--camera", "missing.txt"),
        ("calibrate", "missing.h5", "--camera", "missing.txt", "-o", "missing", "--wheels", "w"),
        ("info", "missing.h5"),
        ("convert", "missing.h5", "missing.npz"),
        ("study", "nosuch", "-o", "missing"),
        ("batch", "missing.yaml", "-o", "missing"),
        ("baselines", "missing.csv", "missing.csv"),
    ],
    ids=" ".join,
)
def test_wrong_usage_is_one_line_and_exit_code_2(run, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(*words)
    assert code == 2
    assert out == ""
    one_line(err)
    assert not list(tmp_path.iterdir())


def test_unknown_methods_are_refused_with_the_choices(run, tmp_path):
    write_drive(tmp_path, s_curve(10))
    words = ("align", tmp_path / "h.csv", tmp_path / "v.csv", "--offset-method", "magic")
    code, _, err = run(*words)
    assert code == 2
    assert "profile, trace, canonical, scalar, none" in one_line(err)


def test_an_output_folder_that_cannot_be_made_is_refused(run, tmp_path):
    write_drive(tmp_path, s_curve(10))
    (tmp_path / "file").write_text("")
    words = ("align", tmp_path / "h.csv", tmp_path / "v.csv", "-o", tmp_path / "file" / "o")
    code, _, err = run(*words)
    assert code == 2
    assert "cannot make the folder" in one_line(err)


@pytest.mark.parametrize("form", ["kalibr", "ros-tf", "urdf"])
def test_export_goes_from_file_to_file(run, tmp_path, form):
    write_drive(tmp_path, s_curve(10))
    run("align", tmp_path / "h.csv", tmp_path / "v.csv", "-o", tmp_path / "o")
    source = tmp_path / "o" / "calibration.yaml"
    code, out, _ = run("export", source, "--to", form)
    assert code == 0
    assert run("export", source, "--to", form, "-o", tmp_path / "x")[0] == 0
    assert (tmp_path / "x").read_text() == out


def test_align_replaces_a_finished_folder_only_if_asked(run, tmp_path):
    write_drive(tmp_path, s_curve(10))
    words = ("align", tmp_path / "h.csv", tmp_path / "v.csv", "-o", tmp_path / "o")
    assert run(*words)[0] == 0
    before = (tmp_path / "o" / "calibration.yaml").stat().st_mtime_ns
    code, _, err = run(*words)
    assert code == 2
    assert "--overwrite" in one_line(err)
    assert (tmp_path / "o" / "calibration.yaml").stat().st_mtime_ns == before
    assert run(*words, "--overwrite")[0] == 0
    assert (tmp_path / "o" / "calibration.yaml").stat().st_mtime_ns != before


def test_baselines_stand_side_by_side(run, tmp_path):
    write_drive(tmp_path, s_curve(10))
    code, out, _ = run("baselines", tmp_path / "h.csv", tmp_path / "v.csv")
    assert code == 0
    ours = next(line.split() for line in out.splitlines() if line.startswith("ours "))
    assert float(ours[1]) == pytest.approx(200, abs=4 * float(ours[2]))
    for name in ("vc", "vc_wota", "cross_correlation", "cca", "hand_eye", "cgoc"):
        assert f"\n{name} " in out


def test_fetch_serves_from_a_folder_that_holds_the_files(run, tmp_path, monkeypatch):
    (tmp_path / "a.bin").write_bytes(b"whole")
    hashes = {"a.bin": hashlib.sha256(b"whole").hexdigest()}
    nowhere = datasets.DataSet("http://127.0.0.1:9/", hashes)
    monkeypatch.setitem(datasets.DATA_SETS, "tiny", nowhere)
    code, out, _ = run("fetch", "tiny", "--folder", tmp_path)
    assert code == 0
    assert out.strip() == str(tmp_path)
    (tmp_path / "a.bin").write_bytes(b"half")
    code, _, err = run("fetch", "tiny", "--folder", tmp_path)
    assert code == 2
    assert "a.bin" in one_line(err)
    code, _, err = run("fetch", "other-data", "--folder", tmp_path)
    assert code == 2
    assert "paper-data" in one_line(err)


def test_a_study_goes_on_and_leaves_its_table(run, tmp_path):
    words = ("study", "coverage", "-o", tmp_path / "s", "--trials", "1")
    code, out, _ = run(*words)
    assert code == 0
    assert (tmp_path / "s" / "coverage.h5").exists()
    again = run(*words)
    assert again[0] == 0
    assert again[1] == out
    code, _, err = run("study", "coverage", "-o", tmp_path / "s", "--trials", "1", "--seed", "9")
    assert code == 2
    one_line(err)


def test_headings_of_a_real_recording_point_to_the_truth(run, data, tmp_path):
    folder = data / "slider_depth"
    words = ("--camera", folder / "calib.txt", "--size", "240x180", "-o", tmp_path / "h.csv")
    code, out, _ = run("headings", folder / "events.txt.gz", *words)
    assert code == 0
    assert "532434 events" in out
    table = np.genfromtxt(tmp_path / "h.csv", delimiter=",", names=True)
    assert np.median(table["vx"][table["t"] > 0.2]) > np.cos(np.radians(2))


def test_noise_is_left_out_and_told_unless_all_events_are_asked_for(run, tmp_path):
    rng = np.random.default_rng(4)
    n, size = 160_000, {"width": 128, "height": 96}
    t, p = np.sort(rng.integers(0, 1_300_000, n)), rng.random(n) < 0.5
    source, camera = tmp_path / "noisy.npz", tmp_path / "calib.txt"
    np.savez(source, x=rng.integers(0, 128, n), y=rng.integers(0, 96, n), t=t, p=p, **size)
    camera.write_text("100 100 63.5 47.5 0 0 0 0 0\n")
    words = ("headings", source, "--camera", camera, "-o", tmp_path / "h.csv")
    for option, told in (("--denoise", True), ("--no-denoise", False)):
        code, out, _ = run(*words, option)
        assert (code, "160000 events" in out) == (cli.NO_ANSWER, True)
        assert ("left out as noise: " in out) == told


def test_importing_evcalib_pulls_in_neither_plots_nor_notebooks():
    heavy = "('matplotlib', 'IPython', 'ipywidgets', 'jupyterlab')"
    code = f"import sys, evcalib, data_tools.cli; sys.exit(any(m in sys.modules for m in {heavy}))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_library_runs_without_matplotlib():
    code = "import sys, evcalib; evcalib.align; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("name", ["shapes_rotation", "boxes_rotation"])
def test_a_turning_camera_has_no_heading_and_the_reason_is_said(run, data, tmp_path, name):
    folder = data / "rotation" / name
    words = ("--camera", folder / "calib.txt", "--size", "240x180", "--rate", "100")
    code, out, err = run("headings", folder / "events.txt.gz", *words, "-o", tmp_path / "h.csv")
    if code == cli.BAD_INPUT:
        assert "shorter than one baseline" in one_line(err)
    else:
        assert code == cli.NO_ANSWER
        assert " 0 headings of " in out
        assert "no heading: " in out


def piped(content, path, wait=0.0):
    """Write into a named pipe, once, from another thread."""
    os.mkfifo(path)

    def write():
        time.sleep(wait)
        path.write_bytes(content)

    threading.Thread(target=write, daemon=True).start()
    return path


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_files_may_come_out_of_pipes_and_messages_name_the_pipe(run, tmp_path):
    write_drive(tmp_path, s_curve(10))
    code, straightforward, _ = run("align", tmp_path / "h.csv", tmp_path / "v.csv")
    heads = piped((tmp_path / "h.csv").read_bytes(), tmp_path / "h", wait=0.3)
    bodies = piped((tmp_path / "v.csv").read_bytes(), tmp_path / "v")
    assert run("align", heads, bodies) == (code, straightforward, "")
    text = "".join(f"{k / 1e4 + 3e-6:.6f} {k % 8} {k % 5} {k % 2}\n" for k in range(9_000)).encode()
    code, out, _ = run("info", piped(gzip.compress(text), tmp_path / "e"), "--size", "8x5")
    assert code == 0
    assert "9000" in out
    code, _, err = run("info", piped(b"1 2 3\n4 5 6\n", tmp_path / "broken"), "--size", "8x5")
    assert code == 2
    assert f"{tmp_path / 'broken'}, line 1" in one_line(err)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_pipe_that_nobody_writes_into_and_a_device_are_refused(run, tmp_path, monkeypatch):
    monkeypatch.setattr("data_tools.files.pipes.WRITER", 0.1)
    os.mkfifo(tmp_path / "empty")
    code, _, err = run("info", tmp_path / "empty")
    assert code == 2
    assert "nothing comes out of the pipe" in one_line(err)
    code, _, err = run("info", os.devnull)
    assert code == 2
    assert "is a device, not a file" in one_line(err)
    for read in (open_recording, read_body_velocities, read_yaml, read_paired_streams):
        with pytest.raises(InputError, match="is a pipe, and a file is read more than once"):
            read(tmp_path / "empty")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_notes_of_what_came_out_of_a_pipe_name_the_pipe(run, tmp_path):
    write_drive(tmp_path, s_curve(10))
    text = (tmp_path / "v.csv").read_text().replace(",", ";").encode()
    code, out, _ = run("velocities", piped(text, tmp_path / "v"), "-o", tmp_path / "o.csv")
    assert code == 0
    assert "separated by semicolons" in out
    code, out, _ = run("align", tmp_path / "h.csv", piped(text, tmp_path / "w"))
    assert code == 0
    assert f"{tmp_path / 'w'}: columns are separated by semicolons" in out.splitlines()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_list_of_relative_paths_is_no_pipe_and_the_authors_file_may_be_one(run, tmp_path):
    os.mkfifo(tmp_path / "list")
    code, _, err = run("batch", tmp_path / "list", "-o", tmp_path / "out")
    assert code == 2
    assert "is a pipe" in one_line(err)
    buffer = io.BytesIO()
    np.savez(buffer, wrong=np.zeros(3))
    code, _, err = run("align", piped(buffer.getvalue(), tmp_path / "both"))
    assert code == 2
    assert f"{tmp_path / 'both'}" in one_line(err)
    assert "velocities file is needed" not in err


def test_nothing_is_written_over_what_is_read_or_written(run, tmp_path):
    write_drive(tmp_path, s_curve(10))
    log = tmp_path / "v.csv"
    before = log.read_bytes()
    (tmp_path / "link.csv").symlink_to(log)
    for output in (log, tmp_path / "link.csv"):
        code, _, err = run("velocities", log, "-o", output)
        assert code == 2
        assert f"{output} is also read as wheels: give another name" in one_line(err)
    one = tmp_path / "one"
    code, _, err = run("velocities", log, "-o", one, "--plot", one)
    assert code == 2
    assert f"{one} is also written by plot" in one_line(err)
    assert log.read_bytes() == before
    assert not one.exists()


@pytest.mark.skipif(not os.path.exists("/dev/stdout"), reason="no such device here")
def test_a_plot_on_standard_output_is_alone_there(tmp_path):
    write_drive(tmp_path, s_curve(10))
    words = [sys.executable, "-m", "evcalib", "velocities", tmp_path / "v.csv"]
    words += ["-o", tmp_path / "o.csv", "--plot", "/dev/stdout"]
    done = subprocess.run(words, capture_output=True, check=True)
    assert done.stdout.startswith(b"\x89PNG")
    assert done.stdout.endswith(b"IEND\xaeB`\x82")
    assert b"rows written" in done.stderr


def test_what_the_code_page_lacks_is_written_otherwise_and_is_no_failure(tmp_path):
    folder = tmp_path / "日本"
    folder.mkdir()
    write_drive(folder, s_curve(10))
    words = ("align", folder / "h.csv", folder / "v.csv", "-o", folder / "out")
    done = subprocess.run(
        [sys.executable, "-m", "evcalib", *map(str, words)],
        env={**os.environ, "PYTHONIOENCODING": "cp1252"},
        capture_output=True,
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert rb"\u65e5\u672c" in done.stdout
    assert (folder / "out" / "calibration.yaml").is_file()
    done = subprocess.run(
        [sys.executable, "-m", "evcalib", "info", str(folder / "none")],
        env={**os.environ, "PYTHONIOENCODING": "cp1252"},
        capture_output=True,
    )
    assert done.returncode == 2
    assert done.stderr.startswith(rb"evcalib: cannot read ")

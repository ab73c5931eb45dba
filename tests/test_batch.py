"""Batches: a strict list, one calibration per entry, and failures that harm nobody."""

import csv
import inspect
import io
import tracemalloc

import batch_jobs
import numpy as np
import pytest
import yaml

from data_tools.cli._calibrate import calibrate as calibrate_command
from data_tools.studies.batch import run_batch
from data_tools.studies.batch_list import KEYS, read_list
from evcalib.errors import InputError

GOOD = """
defaults:
  camera: calib.txt
  vehicle: cars/vehicle.yaml
  wheels: shared.csv
recordings:
  - recording: a/one.txt.gz
    wheels: a/wheels.csv
    max_offset: 2
  - recording: b/two.aedat4
    velocities: b/v.csv
    size: 346x260
    camera: other.yaml
  - {recording: c/one.txt, name: third}
"""


def written(tmp_path, text):
    path = tmp_path / "list.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_list_is_read_with_its_defaults_and_paths_relative_to_it(tmp_path):
    entries = read_list(written(tmp_path, GOOD))

    def at(name):
        return str(tmp_path / name)

    assert entries == (
        {
            "name": "one",
            "recording": at("a/one.txt.gz"),
            "camera": at("calib.txt"),
            "wheels": at("a/wheels.csv"),
            "vehicle": at("cars/vehicle.yaml"),
            "max_offset": 2.0,
        },
        {
            "name": "two",
            "recording": at("b/two.aedat4"),
            "camera": at("other.yaml"),
            "velocities": at("b/v.csv"),
            "size": [346, 260],
        },
        {
            "name": "third",
            "recording": at("c/one.txt"),
            "camera": at("calib.txt"),
            "wheels": at("shared.csv"),
            "vehicle": at("cars/vehicle.yaml"),
        },
    )


ONE = "recordings:\n  - {recording: r, camera: c, velocities: v}\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "needs the key recordings"),
        ("recordings: []", "is empty"),
        ("recordings: 3\n", "needs the key recordings"),
        ("recordings: [3]", "must be `key: value` lines, not 3"),
        (ONE + "extra: 1\n", r"unknown key\(s\) extra"),
        (ONE.replace("camera: c", "camra: c"), r"line 2: unknown key\(s\) camra; there are name"),
        (ONE.replace("recording: r, ", ""), "line 2: there is no recording"),
        (ONE.replace(", velocities: v", ""), r"no velocities \(or wheels and vehicle\)"),
        (ONE.replace("velocities: v", "wheels: w"), "there is no vehicle"),
        (ONE.replace("velocities: v", "velocities: v, wheels: w"), "either velocities, or wheels"),
        (ONE.replace("velocities: v", "velocities: 7"), "velocities must be a path, not 7"),
        (ONE.replace("v}", "v, size: 300}"), "size must be WIDTHxHEIGHT"),
        (ONE.replace("v}", "v, size: 0x5}"), "size must be WIDTHxHEIGHT"),
        (ONE.replace("v}", "v, max_offset: -1}"), "max_offset must be a positive number"),
        (ONE.replace("v}", "v, max_offset: .inf}"), "max_offset must be a positive number"),
        (ONE.replace("v}", "v, max_offset: yes}"), "max_offset must be a positive number"),
        (ONE.replace("v}", "v, name: ../up}"), "name must be letters"),
        (ONE.replace("v}", "v, name: ..}"), "name must be letters"),
        (ONE.replace("recording: r", "recording: .r"), "give a `name`"),
        (ONE.replace("v}", "v, camera: d}"), r"camera is given twice \(line 2\)"),
        (ONE + "  - {recording: R, camera: c, velocities: v}\n", "line 3: the name R is taken by"),
        ("defaults: {name: x}\n" + ONE, "defaults cannot hold name"),
        ("recordings: [", "is not YAML"),
        ("recordings: !!python/object/apply:os.getcwd []", "is not YAML"),
    ],
)
def test_slips_in_a_list_are_errors(tmp_path, text, words):
    with pytest.raises(InputError, match=words):
        read_list(written(tmp_path, text))


def test_lists_that_cannot_be_read_are_errors(tmp_path):
    with pytest.raises(InputError, match="cannot read"):
        read_list(tmp_path / "none.yaml")
    (tmp_path / "list.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not a text file"):
        read_list(tmp_path / "list.yaml")


def listed(tmp_path, *names):
    text = "defaults: {camera: c.txt, velocities: v.csv}\nrecordings:\n"
    return written(tmp_path, text + "".join(f"  - recording: {name}.raw\n" for name in names))


def calls(folder):
    return {path.parent.name: len(path.read_text()) for path in folder.glob("*/calls")}


def test_failures_are_listed_and_the_others_unharmed(tmp_path):
    folder, names = tmp_path / "out", ("first", "broken", "vague", "last")
    done = run_batch(listed(tmp_path, *names), folder=folder, calibrate=batch_jobs.calibrate)
    assert done.failures == [("broken", "broken.raw is damaged")]
    rows = list(csv.DictReader(io.StringIO((folder / "summary.csv").read_text())))
    assert [row["name"] for row in rows] == list(names)
    assert [r["status"] for r in rows] == ["determined", "failed", "no answer", "determined"]
    np.testing.assert_allclose(float(rows[0]["yaw_deg"]), np.degrees(0.3))
    assert float(rows[0]["offset_s"]) == 0.25
    assert rows[1]["offset_s"] == ""
    assert "1 of 4 failed" in done.text()
    assert "broken: broken.raw is damaged" in done.text()


def test_run_again_only_what_failed_is_tried_again(tmp_path):
    folder, path = tmp_path / "out", listed(tmp_path, "first", "broken", "last")
    run_batch(path, folder=folder, calibrate=batch_jobs.calibrate)
    again = run_batch(path, folder=folder, calibrate=batch_jobs.calibrate)
    assert again.failures
    assert calls(folder) == {"first": 1, "broken": 2, "last": 1}
    (tmp_path / "mended").touch()
    mended = run_batch(path, folder=folder, calibrate=batch_jobs.calibrate)
    assert not mended.failures
    assert mended.result.table["offset_observable"].dtype == bool
    run_batch(path, folder=folder, calibrate=batch_jobs.calibrate)
    assert calls(folder) == {"first": 1, "broken": 3, "last": 1}
    assert not (folder / "batch.journal").exists()


def test_a_list_that_changes_has_only_its_changed_entries_run_again(tmp_path):
    folder = tmp_path / "out"

    def run(*names, defaults=""):
        path = listed(tmp_path, *names)
        path.write_text(path.read_text().replace("v.csv}", f"v.csv{defaults}}}"))
        return run_batch(path, folder=folder, calibrate=batch_jobs.calibrate)

    first = run("first", "second")
    longer = run("new", "second", "first", "broken")
    assert calls(folder) == {"first": 1, "second": 1, "new": 1, "broken": 1}
    assert [row["status"] for row in longer.rows()] == ["determined"] * 3 + ["failed"]
    kept = {row["name"]: row for row in longer.rows()}
    assert all(kept[row["name"]] == row for row in first.rows())
    run("second", "broken", "new")
    assert calls(folder) == {"first": 1, "second": 1, "new": 1, "broken": 2}
    run("second", "new")
    assert not (folder / "batch.journal").exists()
    run("second", "new", defaults=", max_offset: 3")
    assert calls(folder) == {"first": 1, "second": 2, "new": 2, "broken": 2}


def test_a_list_that_changes_after_a_stop(tmp_path, monkeypatch):
    """Stopped in its midst, only the journal holds what was done."""
    folder, done = tmp_path / "out", []

    def stop(*args, **more):
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(more["recording"])
        return batch_jobs.calibrate(*args, **more)

    with pytest.raises(KeyboardInterrupt):
        run_batch(listed(tmp_path, "a", "b", "c"), folder=folder, calibrate=stop)
    assert not (folder / "batch.h5").exists()
    # Killed while results are taken along, the next call does it.
    path = listed(tmp_path, "d", "b", "a")
    with monkeypatch.context() as patch:
        patch.setattr("data_tools.studies.batch_again.Journal.append", stop)
        with pytest.raises(KeyboardInterrupt):
            run_batch(path, folder=folder, calibrate=batch_jobs.calibrate)
    run_batch(path, folder=folder, calibrate=batch_jobs.calibrate)
    assert calls(folder) == {"a": 1, "b": 1, "d": 1}


def test_another_version_in_the_same_folder_is_refused(tmp_path, monkeypatch):
    folder = tmp_path / "out"
    run_batch(listed(tmp_path, "first"), folder=folder, calibrate=batch_jobs.calibrate)
    monkeypatch.setattr("evcalib.__version__", "9.9")
    with pytest.raises(InputError, match="version of evcalib"):
        run_batch(listed(tmp_path, "second"), folder=folder, calibrate=batch_jobs.calibrate)
    assert calls(folder) == {"first": 1}


def test_every_option_of_calibrate_may_stand_in_a_list(tmp_path):
    """But those that are the batch's own; each reaches the calibration."""
    options = set(inspect.signature(calibrate_command).parameters)
    assert options - {"output", "overwrite", "as_json"} == set(KEYS) - {"name"}
    entry = {
        **{"recording": "r", "camera": "c", "velocities": "v", "offset": -0.5},
        **{
            "camera_position": "0.3,0,0.8",
            "camera_height": 0.8,
            "refinement": "none",
            "max_slip": 0.1,
        },
        **{
            "max_yaw_rate": 1,
            "columns": {"t": {"column": "ms", "unit": "ms"}},
            "topic": "/odom",
        },
        **{"clock_shift": -3600, "twist_frame": "ground", "motion_time_unit": "ms"},
        **{"wheel_radius": 0.1, "time_unit": "us", "format": "text", "disorder": "sort"},
        **{"stream": "1", "surface": "ts", "rate": 30, "seed": 7, "size": "8x5"},
        "denoise": False,
        **{"imu": "auto", "imu_rotation": "-x,y,-z", "imu_unit": "deg/s", "imu_stream": "/imu"},
        **{"imu_time_unit": "us", "imu_columns": {"wx": "gx"}},
    }
    seen = []

    def calibrate(**given):
        seen.append(given)
        return batch_jobs.calibrate(**given)

    path = written(tmp_path, yaml.safe_dump({"recordings": [entry]}))
    assert not run_batch(path, folder=tmp_path / "out", calibrate=calibrate).failures
    (given,) = seen
    assert given["reading"] == {k: entry[k] for k in ("time_unit", "format", "disorder", "stream")}
    motion = ("columns", "topic", "wheel_radius", "clock_shift", "twist_frame")
    assert given["motion"] == {**{k: entry[k] for k in motion}, "time_unit": "ms"}
    imu = ("rotation", "unit", "stream", "time_unit", "columns")
    assert given["imu"] == {"source": "auto", **{key: entry[f"imu_{key}"] for key in imu}}
    assert (given["camera_position"], given["size"]) == ((0.3, 0, 0.8), (8, 5))
    same = (
        "offset",
        "camera_height",
        "refinement",
        "max_slip",
        "max_yaw_rate",
        "surface",
        "rate",
        "seed",
        "denoise",
    )
    assert {key: given[key] for key in same} == {key: entry[key] for key in same}
    assert set(given) - {"recording", "camera", "velocities", "output"} == {
        *same, "reading", "motion", "imu", "camera_position", "size",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("disorder: keep", "disorder must be one of refuse, sort, drop, not 'keep'"),
        ("time_unit: h", "time_unit must be one of s, ms, us, ns"),
        ("camera_position: [1, 2]", "camera_position must be X,Y,Z in metres"),
        ("seed: 1.5", "seed must be a whole number"),
        ("wheel_radius: 0", "wheel_radius must be a positive number of metres"),
        ("topic: 3", "topic must be a word"),
        ("denoise: 1", "denoise must be true or false"),
        ("columns: 3", "columns must be a path"),
        ("imu_rotation: '-x,y,z'", "imu_rotation -x,y,z is no rotation"),
        ("imu_unit: deg/s", "there is no imu, which imu_unit is of"),
        ("offset: .nan", "offset must be a number of seconds"),
    ],
)
def test_slips_in_options_are_errors(tmp_path, value, words):
    with pytest.raises(InputError, match=words):
        read_list(written(tmp_path, ONE.replace("v}", f"v, {value}}}")))


def test_a_recording_that_kills_its_process_fails_alone(tmp_path):
    folder, path = tmp_path / "out", listed(tmp_path, "first", "killer", "last")
    done = run_batch(path, folder=folder, calibrate=batch_jobs.calibrate, workers=2)
    assert [name for name, _ in done.failures] == ["killer"]
    assert len(done.rows()) == 3


def test_memory_holds_little_more_than_the_list_and_the_table(tmp_path):
    """A calibration of 1 MB is let go: what a longer list adds is far less per recording."""

    def peak(count):
        path = listed(tmp_path, *(f"r{k}" for k in range(count)))
        tracemalloc.start()
        done = run_batch(path, folder=tmp_path / f"out{count}", calibrate=batch_jobs.large)
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert len(done.rows()) == count
        return found

    peak(2)
    assert peak(1000) - peak(100) < 900 * 20_000

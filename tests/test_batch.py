"""Batches: a strict list, one calibration per entry, and failures that harm nobody."""

import csv
import io
import tracemalloc

import batch_jobs
import numpy as np
import pytest

from data_tools.studies.batch import run_batch
from data_tools.studies.batch_list import read_list
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


def test_another_list_in_the_same_folder_is_refused(tmp_path):
    folder = tmp_path / "out"
    run_batch(listed(tmp_path, "first"), folder=folder, calibrate=batch_jobs.calibrate)
    with pytest.raises(InputError, match="other parameters"):
        run_batch(listed(tmp_path, "second"), folder=folder, calibrate=batch_jobs.calibrate)


def test_a_recording_that_kills_its_process_fails_alone(tmp_path):
    folder, path = tmp_path / "out", listed(tmp_path, "first", "killer", "last")
    done = run_batch(path, folder=folder, calibrate=batch_jobs.calibrate, workers=2)
    assert [name for name, _ in done.failures] == ["killer"]
    assert len(done.rows()) == 3


def test_memory_holds_little_more_than_the_list_and_the_table(tmp_path):
    """Beyond that a calibration of 1 MB is let go: of a thousand of them, few are ever held."""
    path = listed(tmp_path, *(f"r{k}" for k in range(1000)))
    tracemalloc.start()
    done = run_batch(path, folder=tmp_path / "out", calibrate=batch_jobs.large)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(done.rows()) == 1000
    assert peak < 10e6

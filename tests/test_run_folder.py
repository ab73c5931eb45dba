"""The output folder: whole or marked as incomplete, whatever ends the run."""

import os
import signal
import stat
import subprocess
import sys
import threading

import numpy as np
import pytest
from made_runs import made_run

from data_tools.files.atomic import is_output, write_file
from data_tools.logs.series_files import read_headings, read_velocities
from data_tools.runs import folder as run_folder
from data_tools.runs._inputs import input_file
from data_tools.runs.export import read_calibration
from data_tools.runs.folder import CALIBRATION, MARKER, RunFolder
from evcalib.errors import InputError

FILES = {"headings.csv", "velocities.csv", "report.html", CALIBRATION}


def names(folder):
    return {path.name for path in folder.iterdir()}


def text(content):
    return lambda path: path.write_text(content)


def earlier(folder):
    """Leave the files of a complete run."""
    with RunFolder(folder) as run:
        for name in ("headings.csv", "report.html", CALIBRATION):
            run.write(name, text("old"))


def cut_short(path, error, *files, stage=""):
    """Run until an error."""
    with RunFolder(path) as folder:
        if stage:
            folder.stage(stage)
        for name in files:
            folder.write(name, text("whole"))
        raise error


def test_a_run_leaves_its_four_files_and_they_read_back(tmp_path):
    run, path = made_run(), tmp_path / "new" / "folder"
    with RunFolder(path) as folder:
        folder.write_run(run)
    assert names(path) == FILES
    np.testing.assert_array_equal(read_headings(path / "headings.csv").t, run.estimate.headings.t)
    np.testing.assert_array_equal(read_velocities(path / "velocities.csv").v, run.velocities.v)
    assert read_calibration(path / CALIBRATION).offset == run.calibration.offset
    assert (path / "report.html").read_text(encoding="utf-8").endswith("</html>\n")


def test_report_and_calibration_get_their_names_last(tmp_path):
    with RunFolder(tmp_path) as folder:
        assert names(tmp_path) == {MARKER}
        folder.write(CALIBRATION, text("c"))
        folder.write("report.html", text("r"))
        folder.write("headings.csv", text("h"))
        parts = {f"{CALIBRATION}.part", "report.html.part"}
        assert names(tmp_path) == {MARKER, "headings.csv"} | parts
    assert names(tmp_path) == {"headings.csv", "report.html", CALIBRATION}


def test_at_every_step_of_the_end_the_folder_is_complete_or_marked(tmp_path, monkeypatch):
    """Killed between any two changes of the folder, nothing pretends."""
    seen = []
    for name in ("replace", "unlink"):
        real = getattr(run_folder.Path, name)

        def watched(self, *args, _real=real, **more):
            out = _real(self, *args, **more)
            seen.append(names(tmp_path))
            return out

        monkeypatch.setattr(run_folder.Path, name, watched)
    with RunFolder(tmp_path) as folder:
        folder.write_run(made_run())
    assert seen[-1] == FILES
    for found in seen[:-1]:
        assert MARKER in found
        if CALIBRATION in found:
            assert found >= FILES
        if "report.html" in found:
            assert found >= FILES - {CALIBRATION}


def test_the_marker_tells_what_was_going_on(tmp_path):
    with RunFolder(tmp_path, command="evcalib calibrate x\udcff") as folder:
        folder.stage("headings")
        marker = (tmp_path / MARKER).read_text()
    assert "evcalib calibrate x\\udcff" in marker
    assert "stage: headings" in marker
    assert "cut short" in marker


@pytest.mark.parametrize(
    ("error", "why"),
    [
        (KeyboardInterrupt(), "interrupted"),
        (MemoryError("no memory"), "no memory"),
        (InputError("a bad row"), "a bad row"),
        (ZeroDivisionError(), "ZeroDivisionError"),
    ],
)
def test_an_error_after_the_first_file_leaves_it_and_a_marker(tmp_path, error, why):
    path = tmp_path / "out"
    with pytest.raises(type(error)):
        cut_short(path, error, "headings.csv", "report.html", stage="align")
    assert names(path) == {MARKER, "headings.csv"}
    marker = (path / MARKER).read_text()
    assert "stage: align" in marker
    assert f"stopped: {why}" in marker


def test_bad_input_before_the_first_file_leaves_nothing(tmp_path):
    with pytest.raises(InputError), RunFolder(tmp_path / "a" / "b"):
        raise InputError("no such recording")
    assert names(tmp_path) == set()
    (tmp_path / "mine").mkdir()
    with pytest.raises(InputError), RunFolder(tmp_path / "mine"):
        raise InputError("no such recording")
    assert names(tmp_path / "mine") == set()


def test_ctrl_c_before_the_first_file_is_told(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        cut_short(tmp_path / "a", KeyboardInterrupt(), stage="headings")
    assert names(tmp_path / "a") == {MARKER}


def test_a_complete_run_is_not_overwritten_unasked(tmp_path):
    earlier(tmp_path)
    with (
        pytest.raises(InputError, match=r"finished calibration.*--overwrite"),
        RunFolder(tmp_path),
    ):
        pass
    assert (tmp_path / CALIBRATION).read_text() == "old"
    assert MARKER not in names(tmp_path)
    with RunFolder(tmp_path, overwrite=True) as folder:
        folder.write("velocities.csv", text("new"))
        assert names(tmp_path) == {MARKER, "velocities.csv"}
        folder.write(CALIBRATION, text("new"))
    assert names(tmp_path) == {"velocities.csv", CALIBRATION}
    assert (tmp_path / CALIBRATION).read_text() == "new"


@pytest.mark.parametrize("error", [InputError("bad"), KeyboardInterrupt()])
def test_an_earlier_run_survives_what_ends_before_the_first_file(tmp_path, error):
    earlier(tmp_path)
    with pytest.raises(type(error)), RunFolder(tmp_path, overwrite=True):
        raise error
    assert names(tmp_path) == {"headings.csv", "report.html", CALIBRATION}
    assert (tmp_path / "report.html").read_text() == "old"


def test_an_incomplete_run_gives_way_and_leaves_nothing_behind(tmp_path):
    for name in (MARKER, f"{MARKER}.part", "headings.csv", "report.html.part"):
        (tmp_path / name).write_text("cut")
    with RunFolder(tmp_path) as folder:
        folder.write(CALIBRATION, text("c"))
    assert names(tmp_path) == {CALIBRATION}


def test_an_incomplete_run_stays_marked_by_bad_input(tmp_path):
    (tmp_path / MARKER).write_text("cut")
    (tmp_path / "headings.csv").write_text("cut")
    with pytest.raises(InputError), RunFolder(tmp_path):
        raise InputError("bad")
    assert names(tmp_path) == {MARKER, "headings.csv"}


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("name", ["thesis.tex", "sub", "calibration.yaml.bak", "events.csv"])
def test_a_folder_with_something_else_is_refused_and_untouched(tmp_path, name, overwrite):
    if name == "sub":
        (tmp_path / name).mkdir()
    else:
        (tmp_path / name).write_text("precious")
    with pytest.raises(InputError, match=name), RunFolder(tmp_path, overwrite=overwrite):
        pass
    assert names(tmp_path) == {name}


def test_hidden_files_are_no_hindrance(tmp_path):
    (tmp_path / ".DS_Store").write_text("x")
    with RunFolder(tmp_path) as folder:
        folder.write(CALIBRATION, text("c"))
    assert names(tmp_path) == {".DS_Store", CALIBRATION}


def test_a_file_in_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "out").write_text("x")
    with pytest.raises(InputError, match="it is a file"), RunFolder(tmp_path / "out"):
        pass
    with pytest.raises(InputError, match="cannot"), RunFolder(tmp_path / "out" / "below"):
        pass


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs /proc")
def test_where_no_folder_can_be_made_the_message_says_so():
    with pytest.raises(InputError, match="cannot make the folder /proc/evcalib"):
        RunFolder("/proc/evcalib/out").__enter__()


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere"
)
@pytest.mark.parametrize("mode", [0o500, 0o000])
def test_a_folder_without_permission_is_refused(tmp_path, mode):
    tmp_path.chmod(mode)
    try:
        for path in (tmp_path, tmp_path / "below"):
            with pytest.raises(InputError, match=r"cannot (read|write|make)"), RunFolder(path):
                pass
    finally:
        tmp_path.chmod(0o700)


@pytest.fixture
def disk(tmp_path):
    """Return a function that mounts a small disk and gives its folder."""
    place = tmp_path / "disk"
    place.mkdir()

    def mount(*options):
        words = ["mount", "-t", "tmpfs", "-o", ",".join(options), "tmpfs", str(place)]
        if subprocess.run(words, capture_output=True, check=False).returncode:
            pytest.skip("cannot mount a small disk here")
        return place

    yield mount
    subprocess.run(["umount", str(place)], capture_output=True, check=False)


def test_a_full_disk_is_told_and_leaves_no_half_file(disk):
    place = disk("size=64k")

    def fill():
        with RunFolder(place) as folder:
            folder.write("headings.csv", text("short"))
            folder.write("report.html", text("x" * 200_000))

    with pytest.raises(InputError, match=r"report\.html: No space left"):
        fill()
    assert names(place) == {MARKER, "headings.csv"}
    assert "No space left" in (place / MARKER).read_text()


def test_a_disk_that_is_full_from_the_start_is_told(disk):
    place = disk("size=8k", "nr_inodes=10")
    (place / ".fill").write_bytes(b"x" * 8192)
    with pytest.raises(InputError, match="No space left"), RunFolder(place / "out"):
        pass
    assert names(place) == {".fill"}


def test_a_read_only_disk_is_told(disk):
    place = disk("ro")
    with pytest.raises(InputError, match="Read-only"), RunFolder(place):
        pass
    with pytest.raises(InputError, match="cannot make the folder"), RunFolder(place / "out"):
        pass


VICTIM = """
import sys, time
from data_tools.runs.folder import RunFolder
def slow(path):
    with open(path, "w") as file:
        file.write("half")
        file.flush()
        print("writing", flush=True)
        time.sleep(60)
with RunFolder(sys.argv[1], command="victim") as folder:
    folder.write("headings.csv", lambda p: p.write_text("whole"))
    folder.write("report.html", lambda p: p.write_text("whole"))
    folder.stage("velocities")
    folder.write("velocities.csv", slow)
"""


@pytest.mark.parametrize("how", ["SIGKILL", "SIGTERM", "SIGINT"])
def test_a_process_that_is_ended_while_writing_leaves_a_marked_folder(tmp_path, how):
    path = tmp_path / "out"
    words = [sys.executable, "-c", VICTIM, str(path)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        try:
            assert process.stdout.readline() == b"writing\n"
            process.send_signal(getattr(signal, how))
            process.wait(timeout=20)
        finally:
            process.kill()
    left = names(path)
    assert {MARKER, "headings.csv"} <= left
    assert not {"velocities.csv", "report.html", CALIBRATION} & left
    marker = (path / MARKER).read_text()
    assert "stage: velocities" in marker
    if how == "SIGINT":
        assert left == {MARKER, "headings.csv"}
        assert "interrupted" in marker
    with RunFolder(path) as folder:
        folder.write(CALIBRATION, text("c"))
    assert names(path) == {CALIBRATION}


def test_a_file_that_fails_half_way_keeps_the_old_one(tmp_path):
    path = tmp_path / "file"
    write_file(path, text("old"))

    def fail(part):
        part.write_text("half")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_file(path, fail)
    assert names(tmp_path) == {"file"}
    assert path.read_text() == "old"
    with pytest.raises(InputError, match="it is a folder"):
        write_file(tmp_path, text("x"))


def test_only_files_of_a_run_are_written(tmp_path):
    with pytest.raises(ValueError, match="not a file of a run"), RunFolder(tmp_path / "a") as run:
        run.write("../escape.txt", text("x"))
    assert names(tmp_path) == {"a"}


def test_input_files_are_described_by_name_size_and_digest(tmp_path):
    path = tmp_path / "a.txt"
    path.write_bytes(b"abc")
    known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert str(input_file(path, digest=True)) == f"a.txt, 3 bytes, sha256 {known}"
    assert input_file(path).sha256 == ""
    (tmp_path / "b").write_bytes(b"12345")
    assert input_file(tmp_path).size == 8
    with pytest.raises(InputError, match="cannot read"):
        input_file(tmp_path / "none")


def test_a_link_stays_and_its_target_is_replaced(tmp_path):
    (tmp_path / "far").mkdir()
    (tmp_path / "far" / "real.csv").write_text("old")
    (tmp_path / "link.csv").symlink_to("far/real.csv")
    (tmp_path / "second.csv").symlink_to(tmp_path / "link.csv")
    write_file(tmp_path / "second.csv", text("new"))
    assert (tmp_path / "link.csv").is_symlink()
    assert (tmp_path / "second.csv").is_symlink()
    assert (tmp_path / "far" / "real.csv").read_text() == "new"
    assert names(tmp_path / "far") == {"real.csv"}
    with pytest.raises(RuntimeError):
        write_file(tmp_path / "second.csv", failing)
    assert (tmp_path / "far" / "real.csv").read_text() == "new"
    assert names(tmp_path / "far") == {"real.csv"}


def failing(path):
    path.write_text("half")
    raise RuntimeError


def test_a_link_to_nothing_makes_its_target_and_a_ring_of_links_is_told(tmp_path):
    (tmp_path / "link").symlink_to("fresh.csv")
    write_file(tmp_path / "link", text("new"))
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "fresh.csv").read_text() == "new"
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(InputError, match=r"cannot write .*a: "):
        write_file(tmp_path / "a", text("new"))
    assert (tmp_path / "a").is_symlink()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_pipe_gets_the_whole_content_or_is_refused_where_nobody_reads(tmp_path, monkeypatch):
    pipe, got = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reader.start()
    write_file(pipe, lambda path: path.write_bytes(b"row\n" * 50_000))
    reader.join()
    assert got == [b"row\n" * 50_000]
    monkeypatch.setattr("data_tools.files.atomic.READER", 0.1)
    with pytest.raises(InputError, match="nobody reads this pipe"):
        write_file(pipe, text("new"))
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_device_is_written_into(tmp_path):
    """A null device and a full one of the test's own, never the machine's."""
    for name, minor in (("null", 3), ("full", 7)):
        try:
            os.mknod(tmp_path / name, 0o666 | stat.S_IFCHR, os.makedev(1, minor))
            open(tmp_path / name, "wb").close()
        except (AttributeError, PermissionError):
            pytest.skip("devices can only be made, and opened, by root")
    write_file(tmp_path / "null", text("new"))
    with pytest.raises(InputError, match="No space left"):
        write_file(tmp_path / "full", text("new"))
    assert all(stat.S_ISCHR((tmp_path / name).stat().st_mode) for name in ("null", "full"))
    assert names(tmp_path) == {"null", "full"}


WRITER = """
import sys
from pathlib import Path
from data_tools.files.atomic import is_output, write_file
path = Path(sys.argv[1])
assert is_output(path)
print("before")
write_file(path, lambda part: part.write_text("content\\n"))
print("after")
"""


@pytest.mark.skipif(not os.path.exists("/dev/stdout"), reason="no /dev/stdout here")
@pytest.mark.parametrize("name", ["/dev/stdout", "here"])
def test_what_goes_to_this_programs_own_output_is_printed_there(tmp_path, name):
    """Only regular files: whoever breaks this writes into the test's own folder."""
    log = tmp_path / "log.csv"
    log.write_text("kept\n")
    with open(log, "a") as out:
        given = log if name == "here" else name
        subprocess.run([sys.executable, "-c", WRITER, given], stdout=out, check=True)
    assert log.read_text() == "kept\nbefore\ncontent\nafter\n"
    assert not is_output(tmp_path / "none")


def test_a_link_among_the_files_of_a_run_is_never_replaced(tmp_path):
    earlier(tmp_path / "run")
    (tmp_path / "run" / CALIBRATION).rename(tmp_path / "kept.yaml")
    (tmp_path / "run" / CALIBRATION).symlink_to(tmp_path / "kept.yaml")
    with pytest.raises(InputError, match="a link or no regular file"):
        RunFolder(tmp_path / "run", overwrite=True).__enter__()
    assert (tmp_path / "kept.yaml").read_text() == "old"

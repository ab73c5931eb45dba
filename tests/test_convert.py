"""Recordings written anew: the same events, bounded memory, nothing half-written."""

import gzip
import subprocess
import sys
import textwrap
import tracemalloc

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.recordings import open_recording
from data_tools.recordings.convert import convert
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.filters import denoise

TARGETS = ("a.h5", "a.hdf5", "a.npz", "a.csv", "a.csv.gz", "a.txt", "a.txt.gz")


def write_source(path, n=1000, seed=0, origin=0, spread=10**6):
    random = np.random.default_rng(seed)
    np.savez(
        path,
        x=random.integers(0, 640, n).astype(np.uint16),
        y=random.integers(0, 480, n).astype(np.uint16),
        t=np.sort(random.integers(0, spread, n)) + origin,
        p=random.integers(0, 2, n).astype(np.uint8),
        width=640,
        height=480,
    )
    return path


def events(path, **options):
    return Events.concatenate(list(open_recording(path, **options)))


def same(one, other):
    return one.shape == other.shape and all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in "xytp"
    )


@settings(deadline=None, max_examples=8)
@given(
    st.integers(1, 40),
    st.integers(0, 9),
    st.sampled_from([0, 5_000_000, 1_675_956_550_123_456]),
    st.sampled_from([3, 10**6, 10**13]),
)
def test_every_target_holds_the_same_events(tmp_path_factory, n, seed, origin, spread):
    folder = tmp_path_factory.mktemp("convert")
    recording = open_recording(write_source(folder / "source.npz", n, seed, origin, spread))
    wanted = events(recording.path)
    for name in TARGETS:
        assert convert(recording, folder / name) == n
        size = (640, 480) if "txt" in name else None
        again = open_recording(folder / name, size=size)
        assert same(Events.concatenate(list(again)), wanted)
        assert again.origin_us == recording.origin_us
        assert not list(folder.glob("*.part"))


def test_the_layout_is_as_documented(tmp_path):
    source = write_source(tmp_path / "source.npz", n=70_000, origin=1_675_956_550_000_000)
    recording = open_recording(source)
    convert(recording, tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        group = file["events"]
        types = {name: group[name].dtype.name for name in group}
        assert types == {"x": "uint16", "y": "uint16", "t": "int64", "p": "uint8"}
        assert all(group[name].chunks == (65536,) for name in group)
        assert all((group[k].compression, group[k].shuffle) == ("gzip", True) for k in group)
        assert dict(group.attrs) == {
            "format": "evcalib-events",
            "version": 1,
            "width": 640,
            "height": 480,
            "time_unit": "us",
            "origin_us": recording.origin_us,
            "count": 70_000,
            "source": "source.npz",
        }
        assert group["t"][0] + recording.origin_us == np.load(source)["t"][0]


def test_a_file_of_a_later_version_or_with_another_count_is_refused(tmp_path):
    convert(open_recording(write_source(tmp_path / "source.npz")), tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["events"].attrs["count"] = 1001
    with pytest.raises(InputError, match="holds 1000 events, but says 1001"):
        open_recording(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["events"].attrs["version"] = 2
    with pytest.raises(InputError, match="layout is of version 2, this evcalib reads up to 1"):
        open_recording(tmp_path / "a.h5")


def test_real_events_come_back(data, tmp_path):
    path = data / "slider_depth" / "events.txt.gz"
    recording = open_recording(path, size=(240, 180))
    convert(recording, tmp_path / "slider.h5")
    assert same(events(tmp_path / "slider.h5"), events(path, size=(240, 180)))


@pytest.mark.parametrize("name", ["a.bag", "a", "a.h5.gz", "a.gz", ".h5x"])
def test_unknown_targets_are_refused(tmp_path, name):
    recording = open_recording(write_source(tmp_path / "source.npz"))
    with pytest.raises(InputError, match="cannot tell the format from the name"):
        convert(recording, tmp_path / name)


def test_targets_that_cannot_be_written_are_refused(tmp_path):
    recording = open_recording(write_source(tmp_path / "source.npz"))
    (tmp_path / "folder.h5").mkdir()
    with pytest.raises(InputError, match="it is a folder"):
        convert(recording, tmp_path / "folder.h5")
    with pytest.raises(InputError, match="is the recording itself"):
        convert(recording, tmp_path / "source.npz")
    for name in TARGETS:
        with pytest.raises(InputError, match="cannot write"):
            convert(recording, tmp_path / "nowhere" / name)


@pytest.mark.parametrize("name", ["a.h5", "a.npz", "a.csv", "a.txt.gz"])
@pytest.mark.parametrize("stop", [KeyboardInterrupt, InputError("damaged")])
def test_a_conversion_that_is_stopped_leaves_the_old_file_and_no_other(tmp_path, name, stop):
    recording = open_recording(write_source(tmp_path / "source.npz"))
    (tmp_path / name).write_text("old")

    class Stopped(type(recording)):
        def __iter__(self):
            yield from super().__iter__()
            raise stop

    recording.__class__ = Stopped
    with pytest.raises(type(stop) if isinstance(stop, Exception) else stop):
        convert(recording, tmp_path / name)
    assert (tmp_path / name).read_text() == "old"
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([name, "source.npz"])


@pytest.mark.parametrize("name", ["a.h5", "a.npz", "a.csv"])
def test_a_full_disk_is_reported_and_leaves_nothing(tmp_path, name):
    write_source(tmp_path / "source.npz", n=300_000)
    program = f"""
        import resource, signal
        from data_tools.recordings.convert import convert
        from data_tools.recordings import open_recording
        from evcalib.errors import InputError
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
        try:
            convert(open_recording({str(tmp_path / "source.npz")!r}), {str(tmp_path / name)!r})
        except InputError as error:
            print("InputError:", error, flush=True)  # HDF5 may crash at exit after that
    """
    run = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True
    )
    assert f"InputError: cannot write {tmp_path / name}" in run.stdout, run.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["source.npz"]


def test_memory_stays_bounded(tmp_path):
    n = 3_000_000
    recording = open_recording(write_source(tmp_path / "source.npz", n=n))
    for name in ("a.h5", "a.npz"):
        tracemalloc.start()
        assert convert(recording, tmp_path / name) == n
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        tracemalloc.start()
        assert sum(len(piece) for piece in open_recording(tmp_path / name)) == n
        assert tracemalloc.get_traced_memory()[1] < 13 * n
        tracemalloc.stop()
        assert peak < 13 * n  # what the events alone take


def test_text_tells_the_sensor_in_a_comment(tmp_path):
    recording = open_recording(write_source(tmp_path / "source.npz", n=2))
    convert(recording, tmp_path / "a.txt.gz")
    first = gzip.decompress((tmp_path / "a.txt.gz").read_bytes()).decode().splitlines()[0]
    assert first == "# evcalib-events version=1 width=640 height=480 time_unit=s"


def test_denoise_writes_what_the_filter_leaves(tmp_path, run):
    """Pure noise of 10 Hz per pixel: a tenth of it stays once the noise has been measured."""
    rng = np.random.default_rng(4)
    n, size = 40_000, {"width": 64, "height": 48}
    t = np.sort(rng.integers(0, 1_300_000, n))
    source = tmp_path / "noisy.npz"
    x, y = rng.integers(0, 64, n), rng.integers(0, 48, n)
    np.savez(source, x=x, y=y, t=t, p=rng.random(n) < 0.5, **size)
    wanted = denoise(events(source))
    code, out, _ = run("convert", source, tmp_path / "clean.h5", "--denoise")
    assert (code, f"{len(wanted)} events written" in out) == (0, True)
    assert "left out: " in out
    assert "without enough neighbours (10." in out
    assert same(events(tmp_path / "clean.h5"), wanted)
    assert len(wanted) < 0.4 * n
    assert run("convert", source, tmp_path / "same.h5")[0] == 0
    assert same(events(tmp_path / "same.h5"), events(source))

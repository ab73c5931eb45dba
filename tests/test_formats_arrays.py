"""Arrays of other programs: .npy, .mat of both kinds, HDF5 tables; columns in whatever order."""

import io
import itertools
import zlib

import numpy as np
import pytest
from fuzz import seeds
from fuzz.targets import SIZE, read_events

from data_tools.files import unpack
from data_tools.recordings import open_recording
from data_tools.recordings.formats import _mat5, mat
from data_tools.recordings.formats._tables import column_order
from evcalib.errors import InputError

FILES = {
    f"npy-{kind}": (lambda kind=kind: seeds.npy(kind), ".npy")
    for kind in ("structured", "rows", "columns", "transposed")
}


def npz(kind, **more):
    content = io.BytesIO()
    np.savez_compressed(content, events=np.load(io.BytesIO(seeds.npy(kind))), **more)
    return content.getvalue()


FILES |= {f"npz-{kind}": (lambda kind=kind: npz(kind), ".npz") for kind in ("structured", "rows")}
FILES |= {
    f"mat-{kind}-{packed}": (lambda kind=kind, packed=packed: seeds.mat(kind, packed), ".mat")
    for kind in ("fields", "variables", "table")
    for packed in (True, False)
}
FILES |= {
    f"hdf5-{kind}": (lambda kind=kind: seeds.hdf5(kind), ".h5")
    for kind in ("table", "matlab", "matlab-table", "e2vid")
}


@pytest.fixture
def write(tmp_path):
    def write(content, suffix):
        path = tmp_path / f"input{suffix}"
        path.write_bytes(content)
        return path

    return write


@pytest.mark.parametrize("name", FILES)
def test_the_events_that_were_written_are_read(write, name):
    make, suffix = FILES[name]
    path = write(make(), suffix)
    (x, y, t, p), losses = read_events(path, size=SIZE)
    for found, expected in zip((x, y, t, p), seeds.columns(), strict=True):
        np.testing.assert_array_equal(found, expected)
    assert losses == {}
    notes = open_recording(path, size=SIZE).notes
    table = any(word in name for word in ("table", "rows", "columns", "transposed"))
    assert any("have no names" in note for note in notes) == table
    assert any("count pixels from 1" in note for note in notes) == ("mat" in name)
    with pytest.raises(InputError, match="does not tell the sensor size"):
        open_recording(path)


def test_archives_of_several_arrays_of_events_are_asked_about(write):
    other = np.load(io.BytesIO(seeds.npy("rows")))[:10]
    path = write(npz("structured", other=other, width=SIZE[0], height=SIZE[1]), ".npz")
    with pytest.raises(InputError, match=r"has events in events, other: say which, stream"):
        open_recording(path)
    (x, *_), _ = read_events(path, stream="events")
    np.testing.assert_array_equal(x, seeds.columns()[0])
    content = io.BytesIO()
    np.savez(content, events=np.asfortranarray(np.zeros((9, 4))), one=np.array({}, dtype=object))
    with pytest.raises(InputError, match="in no format that is known"):
        open_recording(write(content.getvalue(), ".npz"), size=SIZE)


@pytest.mark.parametrize("order", list(itertools.permutations("xytp")))
def test_columns_are_told_apart_by_what_they_hold(order):
    """Only x and y look alike: of these x is taken to stand first."""
    named = dict(zip("xytp", seeds.columns(), strict=True))
    found, note = column_order(np.column_stack([named[key] for key in order]))
    first, second = sorted((order.index("x"), order.index("y")))
    assert found == {"x": first, "y": second, "t": order.index("t"), "p": order.index("p")}
    assert " ".join(sorted(found, key=found.get)) in note


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([[1, 2, 3, 1], [2, 1, 4, 0], [3, 5, 5, 1]], "several orders fit"),
        ([[2, 2, 9, 1], [1, 1, 4, 0]], "no order"),
        ([[1, 2, 3, 1], [1, 1, 4, 1]], "no order"),
        ([[1.5, 2, 3, 1], [1, 1, 4, 0]], "no order"),
        (np.zeros((0, 4)), "n x 4 numbers are needed"),
        (np.full((2, 4), "a"), "n x 4 numbers are needed"),
    ],
)
def test_columns_that_cannot_be_told_apart_are_refused(rows, message):
    with pytest.raises(InputError, match=message):
        column_order(np.asarray(rows))


def test_a_few_late_events_do_not_hide_the_times():
    x, y, t, p = seeds.columns()
    t = t.copy()
    t[[50, 120]] -= 100_000
    assert column_order(np.column_stack([t, x, y, p]))[0]["t"] == 0


def test_fractional_times_are_asked_for(write):
    x, y, t, p = seeds.columns()
    path = write(seeds.array(np.column_stack([t / 1e6, x, y, p])), ".npy")
    with pytest.raises(InputError, match="say their unit: time_unit"):
        open_recording(path, size=SIZE)
    found = read_events(path, size=SIZE, time_unit="s")[0]
    np.testing.assert_array_equal(found[2], t)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (seeds.array(np.zeros(3)), r"not an array of shape \(3,\)"),
        (seeds.array(np.zeros((3, 5))), "not an array of shape"),
        (seeds.array(np.zeros(3, [("x", "u2"), ("y", "u2")])), "needs the fields x, y, t, p"),
        (seeds.npy("rows")[:-1], r"declares .* it is damaged or cut off"),
        (seeds.npy("rows") + b"1", "it is damaged or cut off"),
        (seeds.npy("rows")[:60], "no usable header"),
        (seeds.npy("rows").replace(b"'<i8'", b"'|O' "), "Python objects"),
        (seeds.npy("rows").replace(b"(300, 4)", b"(-30, 4)"), "damaged or cut off"),
    ],
)
def test_arrays_that_are_none_of_events_are_refused(write, content, message):
    path = write(content, ".npy")
    with pytest.raises(InputError, match=message) as refusal:
        open_recording(path, size=SIZE)
    assert str(path) in str(refusal.value)


def test_mat_files_that_hold_other_things_are_refused(write):
    content = seeds.mat("fields", False)
    with pytest.raises(InputError, match="no such events: none"):
        open_recording(write(content.replace(b"ts\0", b"tz\0"), ".mat"), size=SIZE)
    with pytest.raises(InputError, match="no such events: only TD"):
        open_recording(write(content, ".mat"), size=SIZE, stream="left")
    assert open_recording(write(content, ".mat"), size=SIZE, stream="TD").format == "mat"


def test_mat_files_that_unpack_without_end_are_refused(write, monkeypatch):
    monkeypatch.setattr(unpack, "HARMLESS", 1 << 20)
    bomb = zlib.compress(bytes(1 << 24))
    content = seeds.mat()[:128] + b"\x0f\0\0\0" + len(bomb).to_bytes(4, "little") + bomb
    with pytest.raises(InputError, match="unpack to"):
        open_recording(write(content, ".mat"), size=SIZE)
    for module in (mat, _mat5):
        monkeypatch.setattr(module, "LARGEST", 1000)
    with pytest.raises(InputError, match="save it as version 7"):
        open_recording(write(seeds.mat(), ".mat"), size=SIZE)


def test_four_events_of_matlab_are_four(tmp_path):
    import h5py

    path = tmp_path / "input.h5"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name in "xytp":
            file[f"TD/{name}"] = np.arange(4)[None] % (2 if name == "p" else 9)
    assert read_events(path, size=SIZE)[0][0].tolist() == [0, 1, 2, 3]


def test_a_table_beside_named_columns_is_none_of_events(tmp_path):
    import h5py

    path = tmp_path / "input.h5"
    path.write_bytes(seeds.hdf5("dsec"))
    with h5py.File(path, "a") as file:
        file["poses"] = np.zeros((10, 4))
    assert open_recording(path, size=SIZE).format == "dsec"

"""Events in HDF5: each layout written here with h5py, read back exactly; damage refused."""

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.recordings import open_recording
from evcalib.errors import InputError
from evcalib.events import Events

X, Y = [0, 639, 5, 5], [479, 0, 7, 8]
T, P = [10, 10, 2_000, 3_000_000], [True, False, True, True]
GZIP = {"chunks": (2,), "compression": "gzip", "shuffle": True}


def read(path, **options):
    recording = open_recording(path, **options)
    all_events = Events.concatenate(list(recording))
    return recording, [getattr(all_events, name).tolist() for name in "xytp"]


def write_dsec(path, group="events", t_offset=None, **columns):
    values = {
        "x": np.array(X, np.uint16),
        "y": np.array(Y, np.uint16),
        "t": np.array(T, np.uint32),
        "p": np.array(P, np.uint8),
    } | columns
    with h5py.File(path, "a") as file:
        for name, column in values.items():
            if column is not None:
                file.create_dataset(f"{group}/{name}", data=column, **GZIP)
        file["ms_to_idx"] = np.array([0, 2], np.uint64) if group == "events" else 0
        if t_offset is not None:
            file["t_offset"] = t_offset
    return path


@pytest.fixture
def path(tmp_path):
    return tmp_path / "events.h5"


def test_dsec_times_start_at_its_offset(path):
    recording, columns = read(write_dsec(path, t_offset=np.int64(49_599_000_000)), size=(640, 480))
    assert columns == [X, Y, [49_599_000_000 + t for t in T], P]
    assert recording.format == "dsec"
    with pytest.raises(InputError, match="does not tell the s"):
        open_recording(path)


def test_of_several_groups_one_must_be_named(path):
    write_dsec(path, "prophesee/left")
    with h5py.File(path, "a") as file:
        file.copy("prophesee/left", "prophesee/right")
        del file["prophesee/right/t"]
        file["prophesee/right/t"] = np.array(T, np.int64) + 1
    with pytest.raises(InputError, match="has events of prophesee/left, prophesee/right; say"):
        open_recording(path, size=(640, 480))
    _, columns = read(path, size=(640, 480), stream="/prophesee/right")
    assert columns == [X, Y, [t + 1 for t in T], P]
    with pytest.raises(InputError, match="no such events: only prophesee/left, prophesee/right"):
        open_recording(path, size=(640, 480), stream="up")


def test_prophesee_rows_and_geometry_are_read(path):
    rows = np.zeros(4, dtype=[("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
    for name, values in zip("xytp", (X, Y, T, P), strict=True):
        rows[name] = values
    with h5py.File(path, "w") as file:
        file.attrs["geometry"] = "640x480"
        file.create_dataset("CD/events", data=rows, **GZIP)
    recording, columns = read(path)
    assert columns == [X, Y, T, P]
    assert (recording.format, recording.shape) == ("prophesee-hdf5", (480, 640))


def test_mvsec_unix_seconds_and_signs_are_read(path):
    start = 1_504_645_177.421
    times = [start + t / 1e6 for t in T]
    rows = np.array([X, Y, times, [1 if p else -1 for p in P]], dtype=np.float64).T
    with h5py.File(path, "w") as file:
        for side in ("left", "right"):
            file.create_dataset(f"davis/{side}/events", data=rows if side == "left" else rows[:1])
    recording, columns = read(path, size=(640, 480))
    expected = [1_504_645_177_421_000 + t - recording.origin_us for t in T]
    assert columns == [X, Y, expected, P]
    assert recording.origin_us == 1_504_645_177_000_000
    assert recording.notes == ["the events of the left camera were read: davis/left/events"]
    assert len(read(path, size=(640, 480), stream="davis/right")[1][0]) == 1


def test_a_table_that_is_only_called_events_is_not_of_mvsec(path):
    rows = np.array([X, Y, T, P]).T
    with h5py.File(path, "w") as file:
        file["events"] = rows
    recording, columns = read(path, size=(640, 480))
    assert (recording.format, columns) == ("hdf5-table", [X, Y, T, P])
    with h5py.File(path, "w") as file:
        file["events"] = rows / [1, 1, 1e6, 1]
    with pytest.raises(InputError, match=r"say their unit: time_unit='us' \(--time-unit us\)"):
        open_recording(path, size=(640, 480))


def test_seconds_in_columns_need_their_unit(path):
    write_dsec(path, t=np.array(T) / 1e6)
    with pytest.raises(InputError, match="times are fractions; say their unit"):
        open_recording(path, size=(640, 480))
    assert read(path, size=(640, 480), time_unit="s")[1] == [X, Y, T, P]


@settings(deadline=None, max_examples=30)
@given(st.data())
def test_columns_in_any_chunks_are_read_exactly(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("h5") / "events.h5"
    n = data.draw(st.integers(1, 60))
    random = np.random.default_rng(data.draw(st.integers(0, 9)))
    values = {
        "x": random.integers(0, 640, n).astype(data.draw(st.sampled_from(["u2", "i4", "f4"]))),
        "y": random.integers(0, 480, n).astype("<i8"),
        "t": np.sort(random.integers(0, 10**9, n)),
        "p": random.integers(0, 2, n).astype(data.draw(st.sampled_from(["?", "i1", "u8"]))),
    }
    with h5py.File(path, "w") as file:
        for name, column in values.items():
            chunk = data.draw(st.none() | st.integers(1, n))
            file.create_dataset(f"events/{name}", data=column, chunks=chunk and (chunk,))
    assert read(path, size=(640, 480))[1] == [values[k].tolist() for k in "xyt"] + [
        values["p"].astype(bool).tolist()
    ]


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"t": None}, r"has no such events: none \(columns x, y, t, p are needed\)"),
        ({"x": np.array(X[:3], np.uint16)}, "differ in length: /events/x "),
        ({"x": np.array([0, 1, 2.5, 3])}, "event 2 has x = 2.5, not a whole number"),
        ({"y": np.array([0, -1, 2, 3])}, "event 1 has y = -1, no pixel"),
        ({"p": np.array([0, 1, 2, 1])}, "event 2 has polarity 2; it must be 0 or 1"),
        ({"p": np.array([0, 1, -1, 1])}, "polarities mix codings, -1 and 0"),
        ({"x": np.array([b"a", b"b", b"c", b"d"])}, "x must hold numbers"),
        ({"t": np.array([1, 2, 3, 1 << 63], np.uint64)}, "event 3 has t = 9223372036854775808 us"),
        ({"t": np.array([1, 5, 4, 6])}, "times are out of order: event 2"),
        ({"x": np.array([0, 1, 2, 640])}, None),
    ],
)
def test_columns_that_are_no_events_are_refused(path, columns, message):
    write_dsec(path, **columns)
    if message is None:  # one event outside the sensor is left out and counted
        recording, values = read(path, size=(640, 480))
        assert (len(values[0]), recording.losses) == (3, {"events outside the sensor": 1})
        return
    with pytest.raises(InputError, match=message) as refusal:
        read(path, size=(640, 480))
    assert str(path) in str(refusal.value)


def test_a_file_that_declares_more_than_it_holds_is_refused_before_reading(path):
    with h5py.File(path, "w") as file:
        for name in "xytp":
            file.create_dataset(f"events/{name}", (1 << 40,), "u2", chunks=(1 << 16,))
    with pytest.raises(InputError, match=r"declares \d+ bytes of events, but the whole file has"):
        open_recording(path, size=(640, 480))


def test_chunks_too_large_to_unpack_are_refused(path):
    with h5py.File(path, "w") as file:
        for name in "xytp":
            file.create_dataset(f"events/{name}", (3 << 27,), "i8", chunks=(3 << 27,))
    with pytest.raises(InputError, match=r"in chunks of 3221225472 bytes.*h5repack"):
        open_recording(path, size=(640, 480))


def test_cut_and_damaged_files_are_refused(path):
    random = np.random.default_rng(0)
    many = {
        "x": random.integers(0, 640, 5000).astype("u2"),
        "y": random.integers(0, 480, 5000).astype("u2"),
        "t": np.arange(5000, dtype="i8"),
        "p": random.integers(0, 2, 5000).astype("u1"),
    }
    with h5py.File(path, "w") as file:
        for name, column in many.items():
            file.create_dataset(f"events/{name}", data=column, chunks=(500,), compression="gzip")
    data = path.read_bytes()
    for size in (0, 40, 3000, len(data) - 10):
        path.write_bytes(data[:size])
        with pytest.raises(InputError, match=r"is damaged or cut off|is empty|no format"):
            open_recording(path, size=(640, 480))
    refused = 0
    for place in range(1000, len(data) - 40, 1500):
        broken = bytearray(data)
        broken[place : place + 40] = random.bytes(40)
        path.write_bytes(broken)
        try:
            assert len(read(path, size=(640, 480), disorder="drop")[1][0]) <= 5000
        except InputError:
            refused += 1
    assert refused > 3


def test_blosc_and_zstd_are_unpacked_by_the_extra(path, monkeypatch):
    hdf5plugin = pytest.importorskip("hdf5plugin", reason="needs the extra formats")
    with h5py.File(path, "w") as file:
        for name, values in zip("xytp", (X, Y, T, P), strict=True):
            filter = hdf5plugin.Blosc(cname="zstd") if name in "xy" else hdf5plugin.Zstd()
            file.create_dataset(f"events/{name}", data=values, chunks=(4,), **filter)
    assert read(path, size=(640, 480))[1] == [X, Y, T, P]
    monkeypatch.setattr(h5py.h5z, "filter_avail", lambda code: False)
    with pytest.raises(InputError, match=r"compressed with blosc.* \(HDF5 filter 32001\).*formats"):
        open_recording(path, size=(640, 480))

"""Events in NumPy archives and in CSV: exact, in pieces, and refused with reasons."""

import contextlib
import gzip
import io
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.recordings import open_recording
from evcalib.errors import InputError
from evcalib.events import Events

X, Y, T, P = [0, 639, 5], [479, 0, 7], [10, 10, 3_000_000], [True, False, True]


def read(path, **options):
    recording = open_recording(path, **options)
    all_events = Events.concatenate(list(recording))
    return recording, [getattr(all_events, name).tolist() for name in "xytp"]


@pytest.fixture
def npz(tmp_path):
    return tmp_path / "events.npz"


@pytest.fixture
def csv(tmp_path):
    return tmp_path / "events.csv"


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_archives_of_columns_are_read(npz, save):
    signs = np.where(P, 1, -1).astype(np.int8)
    save(npz, x=np.array(X, np.int16), y=Y, timestamps=np.array(T), polarity=signs)
    recording, columns = read(npz, size=(640, 480))
    assert (recording.format, columns) == ("npz", [X, Y, T, P])
    with pytest.raises(InputError, match="does not tell the s"):
        open_recording(npz)


def test_archives_may_tell_sensor_and_unit(npz):
    t = np.array(T) / 1e6
    np.savez(npz, x=X, y=Y, t=t, p=P, width=640, height=np.array([480]), time_unit="s")
    recording, columns = read(npz)
    assert (recording.shape, columns) == ((480, 640), [X, Y, T, P])
    np.savez(npz, x=X, y=Y, t=t, p=P, width=640, height=480, time_unit="min")
    with pytest.raises(InputError, match="its time_unit is 'min'"):
        open_recording(npz)
    np.savez(npz, x=X, y=Y, t=t, p=P, width=640.5, height=480)
    with pytest.raises(InputError, match=r"must be whole numbers, not 640\.5, 480"):
        open_recording(npz)


def test_archives_that_are_no_events_are_refused(npz):
    np.savez(npz, x=X, y=Y, t=np.array(T, dtype=object), p=P)
    with pytest.raises(InputError, match="t holds Python objects, which could run code"):
        open_recording(npz, size=(640, 480))
    np.savez(npz, x=X[:2], y=Y, t=T, p=P)
    with pytest.raises(InputError, match="the columns must be of one length"):
        open_recording(npz, size=(640, 480))
    np.savez(npz, x=np.array([X]), y=Y, t=T, p=P)
    with pytest.raises(InputError, match="the columns must be of one length"):
        open_recording(npz, size=(640, 480))
    np.savez(npz, x=X, y=Y, t=T)
    with pytest.raises(InputError, match="no format that is known"):
        open_recording(npz, size=(640, 480))
    with pytest.raises(InputError, match="needs the arrays x, y, t, p, and has x, y, t"):
        open_recording(npz, size=(640, 480), format="npz")


def test_arrays_that_declare_more_than_they_hold_are_refused(npz):
    head = {"descr": "<i8", "fortran_order": False, "shape": (1 << 50,)}
    with zipfile.ZipFile(npz, "w") as archive:
        for name in "xytp":
            stream = io.BytesIO()
            np.lib.format.write_array_header_1_0(stream, head)
            archive.writestr(f"{name}.npy", stream.getvalue() + bytes(24))
    with pytest.raises(InputError, match=r"declares \(1125899906842624,\) values, but has 24"):
        open_recording(npz, size=(640, 480))


def test_damaged_archives_are_refused_or_read(npz):
    n = 4000
    random = np.random.default_rng(2)
    x, y = random.integers(0, 640, n), random.integers(0, 480, n)
    np.savez_compressed(npz, x=x, y=y, t=np.arange(n), p=random.integers(0, 2, n))
    data = npz.read_bytes()
    npz.write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=r"no format that is known"):
        open_recording(npz, size=(640, 480))
    refused = 0
    for place in range(60, len(data) - 30, len(data) // 15):
        broken = bytearray(data)
        broken[place : place + 30] = random.bytes(30)
        npz.write_bytes(broken)
        with pytest.raises(InputError):
            read(npz, size=(640, 480))
        refused += 1
    assert refused > 10


@pytest.mark.parametrize(
    ("text", "options"),
    [
        ("x,y,t,p\n0,479,10,1\n639,0,10,0\n5,7,3000000,1\n", {"time_unit": "us"}),
        ("p;t;y;x\n1;0.000010;479;0\n-1;0.000010;0;639\n1;3.0;7;5\n", {}),
        ("# a comment\n\nid\tts\tx\ty\tpol\na\t.01\t0\t479\t1\nb\t0.01\t639\t0\t0\n"
         "c\t3e3\t5\t7\t1\n", {"time_unit": "ms"}),
        ('"X","Y","Timestamp","On"\n0,479,10000,1\n# no event\n639,0,10000,0\n5,7,3000000000,1\n',
         {"time_unit": "ns"}),
    ],
)  # fmt: skip
def test_tables_with_columns_in_any_order_are_read(csv, text, options):
    csv.write_text(text)
    recording, columns = read(csv, size=(640, 480), **options)
    assert (recording.format, columns) == ("csv", [X, Y, T, P])
    csv.write_bytes(gzip.compress(text.encode()))
    assert read(csv, size=(640, 480), **options)[1] == columns


@settings(deadline=None, max_examples=30)
@given(st.permutations("xytp"), st.integers(1, 50), st.integers(0, 9))
def test_any_order_of_columns_gives_the_same_events(tmp_path_factory, order, n, seed):
    path = tmp_path_factory.getbasetemp() / "any_order.csv"
    random = np.random.default_rng(seed)
    columns = {
        "x": random.integers(0, 640, n),
        "y": random.integers(0, 480, n),
        "t": np.sort(random.integers(0, 10**14, n)),
        "p": random.integers(0, 2, n),
    }
    rows = np.column_stack([columns[name] for name in order])
    np.savetxt(path, rows, "%d", ",", header=",".join(order), comments="")
    _, read_back = read(path, size=(640, 480), time_unit="us")
    assert read_back == [columns[name].tolist() for name in "xyt"] + [(columns["p"] > 0).tolist()]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y,t,p\n0,0,10,1\n", "times are whole numbers; say their unit"),
        ("x,y,t,p\n0,0,0.1,1\n0,0,0.2\n", "after line 1: .*3.* column"),
        ("x,y,t,p\n0,0,0.1,1\n0,a,0.2,1\n", "line 3, column 2: 'a' is no number"),
        ("x,y,t,p\n0,0,0.1,1\n0,0,nan,1\n", "not a usable time"),
        ("x,y,t,p\n0,0,0.1,7\n", "event 0 has polarity 7"),
        ("x,y,t,p\n", "holds no events"),
        ("x,y,t,ts,p\n0,0,1,1,1\n", "no format that is known"),
    ],
)
def test_tables_that_are_no_events_are_refused(csv, text, message):
    csv.write_text(text)
    with pytest.raises(InputError, match=message) as refusal:
        open_recording(csv, size=(640, 480))
    assert str(csv) in str(refusal.value)


def test_a_cut_gzip_is_refused(csv):
    rows = "".join(f"{k % 640},5,{k * 1e-3},1\n" for k in range(30_000))
    data = gzip.compress(f"x,y,t,p\n{rows}".encode())
    csv.write_bytes(data[: len(data) - 100])
    with pytest.raises(InputError, match="is damaged or cut off"):
        read(csv, size=(640, 480))


@settings(deadline=None, max_examples=120)
@given(
    st.one_of(
        st.binary(max_size=60), st.text(alphabet="0123.-e,;\n#xytp ", max_size=60).map(str.encode)
    )
)
def test_any_bytes_below_a_header_are_events_or_a_clear_refusal(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "any_bytes.csv"
    for head in (b"x,y,t,p\n", b"p,t,y,x\n1,0.5,2,3\n"):
        path.write_bytes(head + content)
        with contextlib.suppress(InputError):
            assert all(len(piece) for piece in open_recording(path, size=(640, 480)))

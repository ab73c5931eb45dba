"""Events in bags: read exactly as the `rosbags` library wrote them, whatever kind of bag."""

import contextlib
import sqlite3

import backports.zstd
import numpy as np
import pytest
from bag_writing import DVS, KINDS, PACKETS, PROPHESEE, Maker, get_types_from_msg
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.bags import _guard, open_bag
from data_tools.files.unpack import unpacked_size, zstd_size
from data_tools.recordings import open_recording
from data_tools.recordings.formats._event_arrays import read_array
from evcalib.errors import InputError

START = 1_675_956_550_123_456_789
FIVE = [
    (1, 2, START, True),
    (639, 479, START + 999, False),
    (0, 0, START + 1_000_500, True),
    (3, 1, START + 1_000_500, False),
    (7, 7, START + 3_000_000_001, True),
]


def micros(rows):
    """Return x, y, t [us], p of rows (x, y, t in ns, p)."""
    return [(x, y, (t + 500) // 1000, p) for x, y, t, p in rows]


def events(path, **options):
    recording = open_recording(path, **options)
    rows = []
    for piece in recording:
        rows += zip(
            piece.x.tolist(),
            piece.y.tolist(),
            (piece.t + recording.origin_us).tolist(),
            piece.p.tolist(),
            strict=True,
        )
    return rows, recording


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("type", [DVS, PROPHESEE])
def test_lists_of_events_are_read_with_their_ros_times(tmp_path, kind, type):
    make = Maker(kind)
    parts = [FIVE[:2], [], FIVE[2:3], FIVE[3:]]
    rows = [(START + k, make.array(type, part, 640, 480)) for k, part in enumerate(parts)]
    path = make.write(tmp_path, [("/dvs/events", rows)])
    read, recording = events(path)
    assert read == micros(FIVE)
    assert (recording.width, recording.height, recording.format) == (640, 480, "rosbag")
    assert recording.origin_us == START // 1_000_000_000 * 1_000_000
    assert recording.notes == ["topic /dvs/events"]


@settings(deadline=None, max_examples=40)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 65535),
            st.integers(0, 65535),
            st.integers(0, 2**31 * 10**9 - 1),
            st.booleans(),
        ),
        max_size=9,
    ),
    st.text(alphabet="abc/_", max_size=9),
    st.sampled_from(["ros1", "sqlite3"]),
)
def test_any_list_of_events_is_read_as_it_was_serialised(rows, frame, kind):
    make = Maker(kind)
    message = make.array(DVS, rows, 11, 13, frame)
    write = make.store.serialize_ros1 if kind == "ros1" else make.store.serialize_cdr
    raw = bytes(write(message, DVS))
    size, columns = read_array(raw, 1 if kind == "ros1" else 2, ("height", "width"))
    assert size == (11, 13)
    read = list(zip(*(column.tolist() for column in columns), strict=True))
    assert read == micros(rows)
    if rows:
        with pytest.raises(InputError, match="cut off"):
            read_array(raw[:-6], 1 if kind == "ros1" else 2, ("height", "width"))


def test_the_larger_byte_order_is_read_too():
    make = Maker("sqlite3")
    raw = make.store.serialize_cdr(make.array(DVS, FIVE, 640, 480), DVS, little_endian=False)
    size, columns = read_array(bytes(raw), 2, ("height", "width"))
    assert size == (640, 480)
    assert list(zip(*(column.tolist() for column in columns), strict=True)) == micros(FIVE)


@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
def test_a_single_file_of_a_ros_2_bag_will_do(tmp_path, kind):
    make = Maker(kind)
    folder = make.write(tmp_path, [("/e", [(START, make.array(DVS, FIVE, 640, 480))])])
    (file,) = (path for path in folder.iterdir() if path.suffix in (".db3", ".mcap"))
    assert events(file)[0] == micros(FIVE)
    odd = file.rename(tmp_path / "recording.data")
    with pytest.raises(InputError, match=r"whose name must end in \.(db3|mcap)"):
        open_recording(odd)


def test_of_several_topics_one_must_be_named(tmp_path):
    make = Maker("ros1")
    left, right = (make.array(DVS, FIVE[k : k + 1], 640, 480) for k in (0, 1))
    path = make.write(tmp_path, [("/left", [(START, left)]), ("/right", [(START, right)])])
    with pytest.raises(InputError, match="several topics of events: /left, /right; say which"):
        open_recording(path)
    with pytest.raises(InputError, match="no topic /up of events; it holds /left "):
        open_recording(path, stream="/up")
    assert events(path, stream="right")[0] == micros(FIVE[1:2])


def test_bags_without_events_or_of_two_sensors_are_refused(tmp_path):
    make = Maker("sqlite3")
    path = make.write(tmp_path, [("/odom", [(START, make.odometry(START, (1, 2, 3), 4.0))])])
    with pytest.raises(InputError, match="no topic of events; it holds /odom"):
        open_recording(path)
    rows = [(START, make.array(DVS, FIVE[:1], w, 480)) for w in (640, 320)]
    (tmp_path / "two").mkdir()
    with pytest.raises(InputError, match="message 1 is of a sensor of 320x480 px, the first"):
        list(open_recording(make.write(tmp_path / "two", [("/e", rows)])))
    with pytest.raises(InputError, match="not of 240x180"):
        open_recording(path.parent / "two" / "bag", size=(240, 180))


def long_bag(folder, kind, chunk=None):
    make = Maker(kind)
    rows = [
        (START + k * 10**6, make.array(DVS, [(k % 640, 5, START + k * 10**6, True)], 640, 480))
        for k in range(2000)
    ]
    return make.write(folder, [("/e", rows)], chunk)


@pytest.mark.parametrize("kind", ["ros1", "ros1-bz2", "ros1-lz4"])
def test_of_a_cut_ros_1_bag_the_first_part_is_read(tmp_path, kind):
    path = long_bag(tmp_path, kind, chunk=20_000)
    whole = events(path)[0]
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 6 // 10])
    read, recording = events(path)
    assert 200 < len(read) < 1900
    assert read == whole[: len(read)]
    assert recording.losses["bytes of a cut-off last record"] > 0
    path.write_bytes(data[:5000])
    with pytest.raises(InputError, match="is cut off before its first messages"):
        open_recording(path)


def test_a_bag_that_was_not_indexed_is_read(tmp_path):
    path = long_bag(tmp_path, "ros1", chunk=20_000)
    data = path.read_bytes()
    at = data.index(b"index_pos=") + len(b"index_pos=")
    index = int.from_bytes(data[at : at + 8], "little")
    whole = events(path)[0]
    path.write_bytes(data[:at] + bytes(8) + data[at + 8 : index])
    read, recording = events(path)
    assert read == whole
    assert not recording.losses["bytes of a cut-off last record"]


@pytest.mark.parametrize("type", [DVS, PACKETS])
def test_ros_2_bags_need_not_define_their_messages(tmp_path, type):
    make = Maker("sqlite3")
    if type == DVS:
        message = make.array(DVS, FIVE, 640, 480)
    else:
        word = np.array([1 << 63 | 2 << 48 | 1 << 32], "<u8")
        message = make.packet(START, 1, "mono", word)
    folder = make.write(tmp_path, [("/e", [(START, message)])])
    (file,) = folder.glob("*.db3")
    with contextlib.closing(sqlite3.connect(file)) as database, database:
        database.execute("DELETE FROM message_definitions")
    expected = micros(FIVE) if type == DVS else [(1, 2, (START + 500) // 1000, True)]
    assert events(folder)[0] == expected


def test_width_may_come_before_height_and_be_signed(tmp_path):
    make = Maker("ros1")
    text = "std_msgs/Header header\nint32 width\nint32 height\nEvent[] events"
    make.store.fielddefs.pop(PROPHESEE)
    make.store.register(get_types_from_msg(text, PROPHESEE))
    path = make.write(tmp_path, [("/e", [(START, make.array(PROPHESEE, FIVE, 640, 480))])])
    read, recording = events(path)
    assert (read, recording.shape) == (micros(FIVE), (480, 640))


def test_a_cut_sqlite_bag_is_refused_with_advice(tmp_path):
    folder = long_bag(tmp_path, "sqlite3")
    (file,) = folder.glob("*.db3")
    data = file.read_bytes()
    for share in (2, 6, 9):
        file.write_bytes(data[: len(data) * share // 10])
        with pytest.raises(InputError, match=r"is damaged or cut off.*recover"):
            list(open_recording(folder))


@pytest.mark.parametrize("kind", ["mcap", "mcap-zstd"])
def test_of_a_cut_mcap_file_the_first_part_is_read(tmp_path, kind):
    (file,) = long_bag(tmp_path, kind, chunk=20_000).glob("*.mcap")
    whole = events(file)[0]
    data = file.read_bytes()
    for share in (3, 8):
        file.write_bytes(data[: len(data) * share // 10])
        read, recording = events(file)
        assert 0.2 * share / 10 < len(read) / len(whole) < 1.3 * share / 10
        assert read == whole[: len(read)]
        assert recording.losses["bytes of a cut-off last record"] > 0
    file.write_bytes(data[:100])
    with pytest.raises(InputError, match="is cut off before its first messages"):
        open_recording(file)


@pytest.mark.parametrize("kind", ["ros1", "ros1-bz2", "sqlite3", "mcap"])
def test_a_damaged_bag_gives_events_or_a_clear_refusal(tmp_path, kind):
    path = long_bag(tmp_path, kind, chunk=20_000)
    file = path
    if path.is_dir():
        (file,) = (p for p in path.iterdir() if p.suffix in (".db3", ".mcap"))
    data = bytearray(file.read_bytes())
    random = np.random.default_rng(3)
    for _ in range(12):
        broken = data.copy()
        place = int(random.integers(0, len(data) - 40))
        broken[place : place + 40] = random.bytes(40)
        file.write_bytes(broken)
        with contextlib.suppress(InputError):
            list(open_recording(path, disorder="drop"))


def test_without_rosbags_the_extra_is_named(tmp_path, monkeypatch):
    path = long_bag(tmp_path, "ros1")
    monkeypatch.setitem(__import__("sys").modules, "rosbags.interfaces", None)
    with pytest.raises(InputError, match=r'pip install "evcalib\[formats\]"'):
        open_recording(path)


def test_other_definitions_under_a_known_name_are_refused(tmp_path):
    make = Maker("ros1")
    text = "std_msgs/Header header\nuint32 height\nuint32 width\nuint8[] events"
    make.store.fielddefs.pop(DVS)
    make.store.register(get_types_from_msg(text, DVS))
    message = make.make(
        DVS, header=make.header(START), height=1, width=1, events=np.zeros(3, np.uint8)
    )
    path = make.write(tmp_path, [("/e", [(START, message)])])
    with pytest.raises(InputError, match="/e is of another dvs_msgs/msg/EventArray than the known"):
        open_recording(path)


def test_real_packets_have_the_stated_count_and_duration(data):
    recording = open_recording(data / "formats" / "ros1_evt3_packets.bag")
    pieces = list(recording)
    assert sum(map(len, pieces)) == 343_474
    assert (pieces[-1].t[-1] - pieces[0].t[0]) / 1e6 == pytest.approx(2.08, abs=0.005)
    assert (recording.width, recording.height) == (640, 480)
    assert not sum(recording.losses.values())
    with open_bag(recording.path) as bag:
        stamps = [bag.decode(bag.topics[0], raw) for raw in bag.messages(bag.topics[0])]
    first, last = ((m.header.stamp.sec * 10**9 + m.header.stamp.nanosec) for m in stamps[::516])
    # Events happen before their packet arrives, and those of this camera by 0.1 s at the most.
    assert -100_000 < recording.origin_us + pieces[0].t[0] - first / 1000 < 0
    assert -100_000 < recording.origin_us + pieces[-1].t[-1] - last / 1000 < 0


def test_a_real_bag_that_is_cut_is_read_up_to_there(data, tmp_path):
    whole = (data / "formats" / "ros1_evt3_packets.bag").read_bytes()
    path = tmp_path / "cut.bag"
    path.write_bytes(whole[: len(whole) // 2])
    recording = open_recording(path)
    count = sum(map(len, recording))
    assert 50_000 < count < 250_000
    assert recording.losses["bytes of a cut-off last record"] > 0


def streamed(data):
    """Compress as writers of streams do, which do not know the size beforehand."""
    packer = backports.zstd.ZstdCompressor()
    return packer.compress(data) + packer.flush()


def test_zstd_chunks_that_do_not_tell_their_size_are_bounded(tmp_path, monkeypatch):
    for name in ("plain", "told"):
        (tmp_path / name).mkdir()
    monkeypatch.setattr(backports.zstd, "compress", streamed)
    (file,) = long_bag(tmp_path / "plain", "mcap-zstd", chunk=20_000).glob("*.mcap")
    monkeypatch.undo()
    assert zstd_size(streamed(bytes(100))[:18]) is None
    whole = events(file)[0]
    (told,) = long_bag(tmp_path / "told", "mcap-zstd", chunk=20_000).glob("*.mcap")
    assert whole == events(told)[0]
    monkeypatch.setattr(_guard, "MOST", 1000)
    with pytest.raises(InputError, match="unpacks to over 1000 bytes"):
        open_recording(file)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (streamed(bytes(5000))[:-4], "cut off"),
        (streamed(bytes(5001)), "more than the 5000 declared"),
        (b"x" + streamed(bytes(9)), "damaged"),
        (streamed(bytes(9)) * 2, "goes on after its end"),
    ],
)
def test_a_zstd_frame_is_measured_without_being_held(data, message):
    assert unpacked_size(streamed(bytes(5000)), 5000) == 5000
    with pytest.raises(InputError, match=message):
        unpacked_size(data, 5000)


def test_a_real_bag_whose_chunks_do_not_tell_their_size(data):
    with open_bag(data / "wheels" / "evo_nav2_turtlebot.mcap") as bag:
        (odometry,) = (topic for topic in bag.topics if topic.name == "/odom")
        assert sum(1 for _ in bag.messages(odometry)) == odometry.count == 2639

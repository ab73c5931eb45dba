"""EventPacket messages: every encoding from words made by hand, and sensor time to ROS time."""

import numpy as np
import pytest
from bag_writing import Maker

from data_tools.recordings import open_recording
from evcalib.errors import InputError
from evcalib.events import Events

START = 1_700_000_000_000_000  # [us], ROS time of sensor time 0
TURN = 1 << 24


def evt3(t_us, rows):
    """Return words of EVT3: the time, then for rows (x, y, p) the row and the event."""
    words = [0x8000 | (t_us >> 12 & 0xFFF), 0x6000 | (t_us & 0xFFF)]
    for x, y, p in rows:
        words += [y, 0x2000 | p << 11 | x]
    return np.array(words, dtype="<u2")


def mono(time_base_ns, rows):
    """Return words of mono: rows are (x, y, t in ns, p)."""
    return np.array(
        [p << 63 | y << 48 | x << 32 | (t - time_base_ns) for x, y, t, p in rows], "<u8"
    )


def record(tmp_path, packets, kind="mcap"):
    make = Maker(kind)
    rows = [
        (1000 * stamp, make.packet(1000 * stamp, seq, encoding, data, **fields))
        for stamp, seq, encoding, data, fields in packets
    ]
    return make.write(tmp_path, [("/event_camera/events", rows)])


def events(recording):
    rows = []
    for piece in recording:
        t = piece.t + recording.origin_us
        rows += zip(piece.x.tolist(), piece.y.tolist(), t.tolist(), piece.p.tolist(), strict=True)
    return rows


def test_evt3_keeps_its_state_from_packet_to_packet(tmp_path):
    first = evt3(100, [(5, 6, 1)])
    second = np.array([0x6000 | 150, 0x2000 | 7, 0x3000 | 0x800 | 20, 0x5000 | 0b101], "<u2")
    stamps = [START + 100 + 300, START + 150 + 300]
    path = record(tmp_path, [(stamps[0], 1, "evt3", first, {}), (stamps[1], 2, "evt3", second, {})])
    rows = events(open_recording(path))
    expected = [(5, 6, 100, 1), (7, 6, 150, 0), (20, 6, 150, 1), (22, 6, 150, 1)]
    assert rows == [(x, y, START + 300 + t, bool(p)) for x, y, t, p in expected]


@pytest.mark.parametrize("big", [False, True])
def test_evt3_turns_are_told_by_the_stamps_also_over_a_long_gap(tmp_path, big):
    times = [TURN - 10_000, TURN + 5_000, TURN + 900_000, 3 * TURN + 77, 3 * TURN + 500_000]
    packets = []
    for k, t in enumerate(times):
        data = evt3(t, [(k, k, 1)])
        packets.append(
            (START + t, k, "evt3", data.byteswap() if big else data, {"is_bigendian": big})
        )
    recording = open_recording(record(tmp_path, packets, "ros1"))
    assert [t for _, _, t, _ in events(recording)] == [START + t for t in times]


def test_mono_times_count_from_the_time_base(tmp_path):
    rows = [(1, 2, 5_000_000, 1), (639, 479, 5_000_700, 0), (3, 3, 9_000_000, 1)]
    packets = [
        (START + 5_000, 1, "mono", mono(5_000_000, rows[:2]), {"time_base": 5_000_000}),
        (START + 9_000, 2, "mono", mono(9_000_000, rows[2:]), {"time_base": 9_000_000}),
    ]
    read = events(open_recording(record(tmp_path, packets)))
    assert read == [(x, y, START + (t + 500) // 1000, bool(p)) for x, y, t, p in rows]
    swapped = [(*p[:3], p[3].byteswap(), p[4] | {"is_bigendian": True}) for p in packets]
    (tmp_path / "big").mkdir()
    assert events(open_recording(record(tmp_path / "big", swapped))) == read


def test_libcaer_times_are_ros_times_already(tmp_path):
    base = 1000 * START
    rows = [(1, 2, 2**31 - 5, 1), (345, 259, 2**31 - 1, 0), (3, 3, 4, 1)]
    data = np.array([(x << 17 | y << 2 | p << 1 | 1, t) for x, y, t, p in rows], "<u4")
    fields = {"time_base": base, "width": 346, "height": 260}
    recording = open_recording(record(tmp_path, [(START + 77, 1, "libcaer", data, fields)]))
    turns = (0, 0, 1)
    expected = [
        (x, y, START + t + (n << 31), bool(p)) for (x, y, t, p), n in zip(rows, turns, strict=True)
    ]
    assert events(recording) == expected
    assert any("ROS times as the driver set them" in note for note in recording.notes)


def test_compressed_libcaer_is_decoded_word_by_word(tmp_path):
    words = [
        0x0000 | 1,  # high part of the time: 4096
        0x1000 | 20,  # low part
        0x2000 | 300,  # column 300
        0x3000 | 0x800 | 7,  # row 7, ON
        0x4000 | 100,  # rows from 100, OFF
        0x5000 | 0b10000001,  # rows 100, 107
        0x5000 | 0b00000010,  # eight further: row 109
        0x1000 | 30,
        0x2000 | 5,
        0x3000 | 9,  # row 9, OFF
    ]
    fields = {"time_base": 1000 * START, "width": 346, "height": 260}
    packet = (START, 1, "libcaer_cmp", np.array(words, "<u2"), fields)
    t = START + 4096 + 20
    assert events(open_recording(record(tmp_path, [packet]))) == [
        (300, 7, t, True),
        (300, 100, t, False),
        (300, 107, t, False),
        (300, 109, t, False),
        (5, 9, t + 10, False),
    ]


def test_delays_and_drift_of_the_clock_are_taken_out(tmp_path):
    random = np.random.default_rng(1)
    times = np.arange(0, 100_000_000, 100_000) + 50_000
    delay = 700 + random.exponential(5_000, times.size).astype(int)
    true = times + 50e-6 * times
    packets = [
        (START + round(on_host) + int(late), k, "evt3", evt3(int(t), [(1, 1, 1)]), {})
        for k, (t, on_host, late) in enumerate(zip(times, true, delay, strict=True))
    ]
    recording = open_recording(record(tmp_path, packets))
    t = np.array([row[2] for row in events(recording)])
    assert t.size == times.size
    assert np.abs(t - START - 700 - true).max() < 150
    assert "drift +" in recording.notes[1]
    assert "ms (median) after the earliest" in recording.notes[1]


def test_lost_packets_are_counted(tmp_path):
    packets = [(START + 1000 * k, k, "evt3", evt3(1000 * k, [(1, 1, 1)]), {}) for k in (0, 1, 5, 6)]
    recording = open_recording(record(tmp_path, packets))
    assert len(events(recording)) == 4
    assert recording.losses == {"packets missing by their numbers": 3}


def test_what_cannot_be_read_is_refused(tmp_path):
    packet = (START, 1, "evt21", evt3(5, [(1, 1, 1)]), {})
    with pytest.raises(InputError, match="encoded as 'evt21'; evt3, mono, libcaer and"):
        open_recording(record(tmp_path, [packet]))
    (tmp_path / "mixed").mkdir()
    mixed = [(START, 1, "evt3", evt3(5, [(1, 1, 1)]), {}), (START, 2, "mono", mono(0, []), {})]
    with pytest.raises(InputError, match=r"packet 1 is encoded as 'mono', the first as"):
        open_recording(record(tmp_path / "mixed", mixed))
    (tmp_path / "later").mkdir()
    empty = {"time_base": 1000 * START}
    later = [(START, 1, "libcaer", mono(0, []), empty), (START, 2, "mono", mono(0, []), {})]
    with pytest.raises(InputError, match=r"packet 1 is encoded as 'mono', the first as 'libcaer'"):
        open_recording(record(tmp_path / "later", later))
    (tmp_path / "jump").mkdir()
    jump = [
        (START + 1000 * k + (k > 60) * 2_000_000, k, "evt3", evt3(1000 * k, [(1, 1, 1)]), {})
        for k in range(120)
    ]
    with pytest.raises(InputError, match=r"camera and host part by 2\.000 s about 0\.1 s after"):
        open_recording(record(tmp_path / "jump", jump))


def test_packets_without_a_time_of_their_own_follow_the_one_before(tmp_path):
    bare = np.array([0x2000 | 9], "<u2")
    packets = [
        (START + 100, 1, "evt3", evt3(100, [(5, 6, 1)]), {}),
        (START + 5000, 2, "evt3", bare, {}),
        (START + 9000, 3, "evt3", evt3(9000, [(5, 6, 1)]), {}),
    ]
    rows = events(open_recording(record(tmp_path, packets)))
    assert [(x, t - START) for x, _, t, _ in rows] == [(5, 100), (9, 100), (5, 9000)]


def test_a_real_stream_cut_into_packets_gives_the_same_events(data, tmp_path):
    """evt3.raw, cut anywhere, each part stamped 0.3 ms after its last time."""
    path = data / "formats" / "evt3.raw"
    raw = path.read_bytes()
    body = raw[raw.index(b"% system_ID 49\n") + len(b"% system_ID 49\n") :]
    direct = Events.concatenate(list(open_recording(path, disorder="sort")))
    words = np.frombuffer(body, "<u2")
    cuts = np.sort(np.random.default_rng(0).integers(1, words.size, 1500))
    # The first word of this file tells the high part of the time, the low one comes soon after.
    place = np.arange(words.size)
    latest = [np.maximum.accumulate(np.where(words >> 12 == code, place, 0)) for code in (8, 6)]
    high, low = (words[at].astype(np.int64) & 0xFFF for at in latest)
    ends = np.append(cuts, words.size) - 1
    sensor = high[ends] << 12 | low[ends]
    back = np.concatenate([[0], np.diff(sensor)]) < 0
    assert back.sum() == 1  # the clock turns once within this file
    sensor = sensor + TURN * np.cumsum(back)
    packets = [
        (START + int(t) + 300, k, "evt3", part, {"width": 1280, "height": 720})
        for k, (part, t) in enumerate(zip(np.split(words, cuts), sensor, strict=True))
    ]
    recording = open_recording(record(tmp_path, packets, "ros1"), disorder="sort")
    packed = Events.concatenate(list(recording))
    assert recording.losses == {}
    for name in "xyp":
        np.testing.assert_array_equal(getattr(packed, name), getattr(direct, name))
    shift = packed.t + recording.origin_us - direct.t
    assert shift.max() - shift.min() <= 1
    assert recording.origin_us + packed.t[0] - START - 300 <= sensor[0]

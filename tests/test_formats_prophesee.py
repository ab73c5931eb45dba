"""EVT2, EVT3 and DAT: hand-written words, round trips, real files, cuts and flipped bits."""

import re
import struct
from itertools import pairwise

import naive_formats as naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.recordings import open_recording
from data_tools.recordings.formats._evt import Evt2Decoder, Evt3Decoder
from evcalib.errors import InputError

WRITERS = {
    "evt2": lambda events: naive.HEADER_EVT2 + naive.evt2_words(events),
    "evt3": lambda events: naive.HEADER_EVT3 + naive.evt3_words(events),
    "dat": lambda events: naive.HEADER_DAT + naive.dat_records(events),
}
READERS = {  # slow reader, bytes of a word, events without the last byte of the file
    "evt2.raw": (naive.read_evt2, 4, 521_251),
    "evt3.raw": (naive.read_evt3, 2, 1_218_618),
    "gen4.dat": (naive.read_dat, 8, 1_218_617),
}
HEADERS = {"evt2.raw": 166, "evt3.raw": 225, "gen4.dat": 67}


def evt3(*words):
    return b"".join(struct.pack("<H", word) for word in words)


def listed(columns):
    return list(zip(*(getattr(columns, c).tolist() for c in "txyp"), strict=True))


def read(path, **options):
    recording = open_recording(path, **options)
    return recording, [event for piece in recording for event in listed(piece)]


@pytest.fixture
def write(tmp_path):
    def write(data, name="recording.raw"):
        path = tmp_path / name
        path.write_bytes(data)
        return path

    return write


def test_evt3_words_by_hand():
    columns = Evt3Decoder().decode(
        evt3(
            0x8001,  # high bits of the time: 1
            0x6002,  # low bits: 2
            0x0005,  # row 5
            0x2807,  # column 7, ON
            0x3064,  # base column 100, OFF
            0x4801,  # of the next 12 columns the first and the last
            0x5003,  # of the next 8 the first two
            0x6003,  # low bits: 3
            0x2007,  # column 7, OFF
            0x8002,  # high bits: 2; the low ones start anew
            0x2009,  # column 9, OFF
        )
    )
    t = 4098
    assert listed(columns) == [
        (t, 7, 5, True),
        (t, 100, 5, False),
        (t, 111, 5, False),
        (t, 112, 5, False),
        (t, 113, 5, False),
        (t + 1, 7, 5, False),
        (8192, 9, 5, False),
    ]


def test_evt2_words_by_hand():
    words = (0x80000001, 0x1 << 28 | 5 << 22 | 639 << 11 | 479, 0x80000002, 7 << 11 | 9)
    columns = Evt2Decoder().decode(struct.pack("<4I", *words))
    assert listed(columns) == [(69, 639, 479, True), (128, 7, 9, False)]


def test_events_before_time_or_place_are_counted():
    decoder = Evt3Decoder()
    assert not decoder.decode(evt3(0x0001, 0x2002, 0x3000, 0x4FFF, 0x50FF)).t.size
    assert decoder.losses == {"events before the first time words": 21}
    decoder = Evt3Decoder()
    assert not decoder.decode(evt3(0x8001, 0x6001, 0x2002, 0x4001, 0x0001, 0x5003)).t.size
    assert decoder.losses == {"events before the first row or base column": 4}
    decoder = Evt2Decoder()
    assert not decoder.decode(struct.pack("<I", 5)).t.size
    assert decoder.losses == {"events before the first time word": 1}


def test_words_of_other_kinds_are_passed_over_and_unknown_ones_counted():
    decoder = Evt3Decoder()
    others = [kind << 12 for kind in (0x7, 0xA, 0xE, 0xF)]
    unknown = [kind << 12 for kind in (0x1, 0x9, 0xB, 0xC, 0xD)]
    columns = decoder.decode(evt3(0x8000, 0x6000, 0x0000, *others, *unknown, 0x2001))
    assert listed(columns) == [(0, 1, 0, False)]
    assert decoder.losses == {"words of unknown type": 5}
    decoder = Evt2Decoder()
    kinds = [0x8, *range(2, 8), 0x9, 0xA, 0xB, 0xC, 0xD, 0xE, 0xF, 0x1]
    columns = decoder.decode(struct.pack(f"<{len(kinds)}I", *(kind << 28 for kind in kinds)))
    assert listed(columns) == [(0, 0, 0, True)]
    assert decoder.losses == {"words of unknown type": 10}


def test_loops_of_the_24_bit_clock_are_undone_and_small_steps_back_kept():
    highs = (4094, 4095, 0, 4095, 0, 1, 2049, 4095, 0)
    words = [w for high in highs for w in (0x8000 | high, 0x6000, 0x2000)]
    t = Evt3Decoder().decode(evt3(0x0000, *words)).t // 4096
    assert t.tolist() == [4094, 4095, 4096, 4095, 4096, 4097, 6145, 8191, 8192]


def test_loops_of_the_34_bit_clock_are_undone_and_small_steps_back_kept():
    last = (1 << 28) - 1
    words = [w for high in (last, 0, last, 0, 1 << 27) for w in (0x8 << 28 | high, 0)]
    t = Evt2Decoder().decode(struct.pack(f"<{len(words)}I", *words)).t // 64
    assert t.tolist() == [last, last + 1, last, last + 1, last + 1 + (1 << 27)]


EVENTS = st.lists(
    st.tuples(
        st.one_of(st.integers(0, 3), st.integers(0, 30_000), st.integers(0, 40_000_000)),
        st.integers(0, 639),
        st.one_of(st.just(7), st.integers(0, 479)),
        st.integers(0, 1),
    ),
    min_size=1,
    max_size=40,
)


def with_times(steps, start):
    """Return events whose first is at `start`: a clock's loops before it cannot be told."""
    t = start + np.cumsum([0, *(step[0] for step in steps[1:])])
    return [(int(at), *step[1:]) for at, step in zip(t, steps, strict=True)]


@pytest.mark.parametrize("name", WRITERS)
@given(steps=EVENTS, start=st.integers(0, 16_000_000))
@settings(deadline=None, max_examples=80)
def test_what_is_written_is_read(name, steps, start, tmp_path_factory):
    events = with_times(steps, start)
    path = tmp_path_factory.getbasetemp() / f"round_trip_{name}"
    path.write_bytes(WRITERS[name](events))
    recording, found = read(path)
    assert found == events
    assert (recording.format, recording.losses) == (name, {})


def test_rows_of_vectors_are_read_with_all_masks():
    rng = np.random.default_rng(1)
    events = []
    for k in range(300):
        x = np.flatnonzero(rng.random(1280) < rng.uniform(0.01, 0.9))
        events += [(5000 * k, int(column), k % 720, k % 2) for column in x]
    data = naive.evt3_words(events)
    assert len(data) < len(events)  # far fewer words than events
    assert listed(Evt3Decoder().decode(data)) == events
    assert listed(Evt3Decoder().decode(naive.evt3_words(events, vectors=False))) == events


def test_more_events_than_one_piece_holds():
    row = evt3(0x3000, *[0x4FFF] * 170)
    data = evt3(0x8000, 0x6000, 0x0000) + row * 200
    pieces = list(Evt3Decoder().pieces(data))
    assert len(pieces) > 1
    assert sum(piece.t.size for piece in pieces) == 200 * 170 * 12
    whole = Evt3Decoder().decode(data)
    np.testing.assert_array_equal(whole.x, np.tile(np.arange(170 * 12), 200))


def test_a_base_column_never_wraps():
    columns = Evt3Decoder().decode(evt3(0x8000, 0x6000, 0x0000, 0x3000, *[0x4001] * 6000))
    assert (np.diff(columns.x.astype(int)) >= 0).all()
    assert columns.x.max() < 40_000


@given(data=st.binary(max_size=400), cuts=st.lists(st.integers(0, 400), max_size=5))
@settings(deadline=None, max_examples=150)
def test_any_bytes_decode_as_the_slow_reader_does_however_they_are_cut(data, cuts):
    start = evt3(0x8000, 0x6000, 0x0000)
    expected = naive.read_evt3(start + data)
    decoder = Evt3Decoder()
    stream = start + data
    bounds = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    parts = [decoder.decode(stream[a:b]) for a, b in pairwise(bounds)]
    assert [event for part in parts for event in listed(part)] == expected
    decoder.finish()
    assert decoder.losses["bytes of a cut-off last word"] == len(stream) % 2


def test_dat_clock_loops_after_71_minutes(write):
    events = [(2**32 - 1, 1, 2, 1), (2**32, 3, 4, 0), (2**33 + 7, 5, 6, 1)]
    steps = [(t, 0, 0, 0) for t in range(2**32, 2**33, 2**30)]
    path = write(WRITERS["dat"]([*events[:2], *steps, events[2]]))
    assert read(path)[1] == [*events[:2], *steps, events[2]]
    path = write(WRITERS["dat"]([events[1], events[0], events[1]]))  # a step back over the loop
    with pytest.raises(InputError, match="is 1 us late"):
        read(path)
    back = write(WRITERS["dat"]([events[0], events[1], events[0], events[1]]))
    assert [event[0] - 2**32 for event in read(back, disorder="sort")[1]] == [-1, -1, 0, 0]


@pytest.mark.parametrize(
    ("name", "count", "seconds", "size"),
    [
        ("evt2.raw", 521_252, 0.0959, (640, 480)),
        ("evt3.raw", 1_218_618, 10.768, (1280, 720)),
        ("gen4.dat", 1_218_618, 10.768, (1280, 720)),
    ],
)
def test_real_files(data, name, count, seconds, size):
    recording = open_recording(data / "formats" / name)
    pieces = list(recording)
    assert (recording.width, recording.height) == size
    assert sum(map(len, pieces)) == count
    assert (pieces[-1].t[-1] - pieces[0].t[0]) / 1e6 == pytest.approx(seconds, abs=6e-4)
    assert not recording.losses


def test_evt3_and_dat_agree_event_by_event(data):
    found = {}
    for name in ("evt3.raw", "gen4.dat"):
        pieces = list(open_recording(data / "formats" / name))
        found[name] = {c: np.concatenate([getattr(e, c) for e in pieces]) for c in "xytp"}
    for column in "xyp":
        np.testing.assert_array_equal(found["evt3.raw"][column], found["gen4.dat"][column])
    assert set((found["evt3.raw"]["t"] - found["gen4.dat"]["t"]).tolist()) == {11_194_368}


def test_real_evt2_agrees_with_a_library(data):
    library = pytest.importorskip("expelliarmus")
    events = library.Wizard(encoding="evt2", fpath=str(data / "formats" / "evt2.raw")).read()
    pieces = list(open_recording(data / "formats" / "evt2.raw"))
    for column in "xytp":
        ours = np.concatenate([getattr(piece, column) for piece in pieces])
        np.testing.assert_array_equal(ours, events[column])


@pytest.mark.parametrize("name", HEADERS)
def test_a_cut_file_gives_the_first_events_or_says_why_not(data, name, tmp_path):
    start = HEADERS[name]
    whole = (data / "formats" / name).read_bytes()
    slow, word, count = READERS[name]
    rng = np.random.default_rng(5)
    path = tmp_path / name
    for cut in [*range(start + 60), *rng.integers(start + 60, 4000, 60), *range(3960, 3976)]:
        path.write_bytes(whole[:cut])
        expected = slow(whole[start:cut])
        if not expected:
            with pytest.raises(InputError, match=re.escape(str(path))):
                open_recording(path)
            continue
        recording, found = read(path)
        assert found == expected
        assert sum(recording.losses.values()) == (cut - start) % word
    path.write_bytes(whole[:-1])
    recording = open_recording(path)
    assert sum(map(len, recording)) == count
    assert sum(recording.losses.values()) == word - 1


@pytest.mark.parametrize("name", HEADERS)
def test_a_flipped_bit_in_the_header_is_harmless_or_said(data, name, tmp_path):
    whole = (data / "formats" / name).read_bytes()[: HEADERS[name] + 8000]
    path = tmp_path / name
    path.write_bytes(whole)
    _, expected = read(path)
    rng = np.random.default_rng(6)
    outcomes = set()
    for _ in range(250):
        at, bit = int(rng.integers(HEADERS[name])), int(rng.integers(8))
        damaged = bytearray(whole)
        damaged[at] ^= 1 << bit
        path.write_bytes(damaged)
        try:
            recording, found = read(path)
        except InputError:
            outcomes.add("refused")
            continue
        outcomes.add("read")
        assert found == expected or sum(recording.losses.values()) == len(expected) - len(found)
    assert outcomes == {"read", "refused"}


def test_sizes_from_headers(write):
    words = naive.evt3_words([(5, 3, 4, 1)])
    for header in (
        b"% evt 3.0\n% geometry 64x48\n",
        b"% evt 3.0\n% Width 64\n% Height 48\n",
        b"% format EVT3;height=48;width=64\n% end\n",
        b"% evt 3.0\r\n% geometry 64x48\r\n% end\r\n",
    ):
        recording, found = read(write(header + words))
        assert (recording.width, recording.height, found) == (64, 48, [(5, 3, 4, 1)])
    recording, _ = read(write(b"% evt 3.0\n% plugin_name hal_plugin_gen31_fx3\n" + words))
    assert (recording.width, recording.height) == (640, 480)
    assert recording.notes == ["the sensor's size, 640x480 px, is that of gen3"]
    with pytest.raises(InputError, match="does not tell the sensor size"):
        open_recording(write(b"% evt 3.0\n% a b\n" + words))
    recording, _ = read(write(b"% evt 3.0\n% a b\n" + words), size=(9, 9))
    assert (recording.width, recording.height) == (9, 9)


def test_words_without_a_header_are_read_when_named(write):
    path = write(naive.evt3_words([(5, 3, 4, 1)]))
    with pytest.raises(InputError, match="no format that is known"):
        open_recording(path)
    assert read(path, format="evt3", size=(10, 10))[1] == [(5, 3, 4, 1)]


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (b"% evt 2.1\n% geometry 64x48\n", "only EVT2 and EVT3 are read"),
        (b"% evt 2.0\n% format EVT3;height=48;width=64\n", "EVT3 or EVT2"),
        (b"% evt 3.0\n% geometry 64000x48000\n", "size as '64000x48000'"),
        (b"% evt 3.0\n% geometry 0x48\n", "size as '0x48'"),
        (b"% evt 3.0\n% geometry 64x48\n% endianness big\n", "big-endian"),
        (b"% evt 3.0\n% geometry 64x48\n% serial\xff_number 1\n", "damaged header: b'% serial"),
        (b"% evt 3.0\n% geometry 64x48\n$ serial_number 1\n", "damaged header: b'. serial"),
        (b"% Data file containing CD events\n% Version 1\n", "version 1"),
        (b"% Version 2\n% Width 64\n% Height 48\n\x0e\x08", "external triggers"),
        (b"% Version 2\n% Width 64\n% Height 48\n\x0c\x09", "type 0x0c and 9 bytes"),
        (b"% Version 2\n% Width 64\n% Height 48\n\x0c\x08", "holds no events"),
        (b"% Version 2\n% Width 64\n% Height 99999\n\x0c\x08", "size as '64x99999'"),
    ],
)
def test_headers_that_are_refused(write, header, message):
    with pytest.raises(InputError, match=message):
        open_recording(write(header + b"\x01\x80"))
    with pytest.raises(InputError, match="ends within its header"):
        open_recording(write(b"% Version 2\n% Width 64\n% Height 48\n\x0c"))


def test_a_wrong_format_is_refused(write, data):
    with pytest.raises(InputError, match="not evt2"):
        open_recording(data / "formats" / "evt3.raw", format="evt2")
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, 60_000, dtype=np.uint8).tobytes()
    with pytest.raises(InputError, match="of unknown type"):
        open_recording(write(noise), format="evt3", size=(1280, 720))

"""AEDAT 4: a real file, against the library alone, cut off and damaged."""

import re
import struct
import sys

import numpy as np
import pytest
from fuzz import seeds

from data_tools.recordings import open_recording
from data_tools.recordings.formats._aedat4_layout import _header
from evcalib.errors import InputError

HEADER = 18 + 3108
EVENTS = 78_830


@pytest.fixture
def whole(data):
    pytest.importorskip("lz4")
    return (data / "formats" / "davis346.aedat4").read_bytes()


@pytest.fixture
def write(tmp_path):
    def write(content):
        path = tmp_path / "recording.aedat4"
        path.write_bytes(content)
        return path

    return write


def columns(recording):
    pieces = list(recording)
    return {c: np.concatenate([getattr(piece, c) for piece in pieces]) for c in "xytp"}


def test_a_real_file(whole, write, data):
    aedat = pytest.importorskip("aedat")
    path = write(whole)
    recording = open_recording(path)
    found = columns(recording)
    assert (recording.format, recording.width, recording.height) == ("aedat4", 346, 260)
    assert (found["t"].size, recording.losses) == (EVENTS, {})
    assert (found["t"][-1] - found["t"][0]) / 1e6 == pytest.approx(2.36, abs=0.005)
    assert recording.origin_us == 1_589_163_147_000_000
    packets = [packet["events"] for packet in aedat.Decoder(path) if "events" in packet]
    events = np.concatenate(packets)
    np.testing.assert_array_equal(found["t"] + recording.origin_us, events["t"])
    for column in ("x", "y"):
        np.testing.assert_array_equal(found[column], events[column])
    np.testing.assert_array_equal(found["p"], events["on"])


def test_a_cut_file_gives_the_first_events_and_says_how_much_is_lost(whole, write):
    full = columns(open_recording(write(whole)))
    rng = np.random.default_rng(0)
    table = _header(whole[18:HEADER])[1]
    for cut in [*rng.integers(100_000, table, 25), table - 1, table, table + 1, len(whole) - 1]:
        path = write(whole[:cut])
        recording = open_recording(path)
        found = columns(recording)
        for column, values in found.items():
            np.testing.assert_array_equal(values, full[column][: values.size])
        lost = sum(recording.losses.values())
        # What is lost is the part of one packet; what is found, all packets before it.
        again = columns(open_recording(write(whole[: cut - lost])))
        assert again["t"].size == found["t"].size
        assert (lost == 0) == (cut >= table)
        assert (found["t"].size == EVENTS) == (cut >= table - 1)


def test_a_file_cut_before_its_first_events_is_refused(whole, write):
    for cut in [*range(14, 60), 1000, HEADER - 1, HEADER, HEADER + 4, HEADER + 8, HEADER + 3000]:
        path = write(whole[:cut])
        with pytest.raises(InputError, match=re.escape(str(path))):
            open_recording(path)


def test_damage_is_refused(whole, write):
    damaged = {
        17: "header",  # length of the header
        20: "its header",  # an offset in the header: the library panics
        HEADER: "packet 0",  # number of the stream
        HEADER + 20: "packet 0",  # compressed data
    }
    for at, message in damaged.items():
        content = bytearray(whole)
        content[at] ^= 0x80
        with pytest.raises(InputError, match=message):
            open_recording(write(content))


def test_a_packet_of_a_huge_size_is_not_allocated(whole, write):
    content = bytearray(whole[: _header(whole[18:HEADER])[1]])
    struct.pack_into("<I", content, HEADER + 4, 0x70000000)
    with pytest.raises(InputError, match=r"no events .*bytes of a cut-off last packet"):
        open_recording(write(content))


def test_streams_are_chosen_by_number(whole, write):
    path = write(whole)
    assert open_recording(path, stream="0").width == 346
    with pytest.raises(InputError, match="no stream of events 1, only 0"):
        open_recording(path, stream="1")
    with pytest.raises(InputError, match="346x260 px, not of 640x480"):
        open_recording(path, size=(640, 480))


def test_without_the_library_the_extra_is_named(data, monkeypatch):
    monkeypatch.setitem(sys.modules, "lz4.frame", None)
    with pytest.raises(InputError, match=re.escape('pip install "evcalib[formats]"')):
        open_recording(data / "formats" / "davis346.aedat4")


def test_a_table_without_counts_is_told(write):
    """DV of 2020 wrote 0 for the number of events, and for the first and the last time."""
    pytest.importorskip("lz4")
    content = bytearray(seeds.aedat4_made(bytes, 0))
    table = content.index(b"FTAB")
    for first in range(0, seeds.COUNT, 50):
        part = seeds.rows()[first : first + 50]
        told = struct.pack("<qqq", len(part), part[0][0], part[-1][0])
        at = content.index(told, table)
        content[at : at + 24] = bytes(24)
        if first == 0:
            with pytest.raises(InputError, match="holds 50 events, not 0 as the table says"):
                open_recording(write(bytes(content)))
    recording = open_recording(write(bytes(content)))
    assert columns(recording)["t"].size == seeds.COUNT
    assert "has no counts and times" in recording.notes[0]


def test_real_files_of_dv(data):
    """Of 2020, whose table counts nothing, and of 2022; two of no events."""
    pytest.importorskip("lz4")
    for name, count in (("dv_2020", 6_676), ("dv_sample", 9_193)):
        assert columns(open_recording(data / "formats" / f"{name}.aedat4"))["t"].size == count
    with pytest.raises(InputError, match="has no stream of events"):
        open_recording(data / "formats" / "dv_frames_only.aedat4")
    with pytest.raises(InputError, match="several streams of events: say which"):
        open_recording(data / "formats" / "dv_empty_stereo.aedat4")
    with pytest.raises(InputError, match="holds no events"):
        open_recording(data / "formats" / "dv_empty_stereo.aedat4", stream="1")

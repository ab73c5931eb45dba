"""AEDAT 2.0, AEDAT 3.1 and Event Stream: files written by hand, and the real ones."""

import gzip
import struct

import numpy as np
import pytest
from fuzz import seeds
from fuzz.targets import read_events

from data_tools.recordings import open_recording
from data_tools.recordings.formats import aedat2, es
from data_tools.recordings.formats.aedat2 import Clock
from evcalib.errors import InputError

FILES = {
    "aedat2-davis": seeds.aedat2,
    "aedat2-dvs128": lambda: seeds.aedat2("ch.unizh.ini.jaer.chip.retina.DVS128", (128, 128)),
    "aedat3": seeds.aedat3,
    "aedat3-frames-between": lambda: seeds.aedat3(kinds=(1, 2)),
    "es-dvs": seeds.es,
    "es-atis": lambda: seeds.es(2),
}


@pytest.fixture
def write(tmp_path):
    def write(content, name="recording"):
        path = tmp_path / name
        path.write_bytes(content)
        return path

    return write


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("block", [None, 997])
def test_the_events_that_were_written_are_read(write, monkeypatch, name, block):
    """Whatever the blocks: an event may stand across two of them."""
    if block is not None:
        monkeypatch.setattr(aedat2, "BLOCK_BYTES", block // 8 * 8)
        monkeypatch.setattr(es, "BLOCK_BYTES", block)
    (x, y, t, p), losses = read_events(write(FILES[name]()))
    expected = seeds.columns()
    shift = 4_999_800 if name.startswith("es") else 0
    np.testing.assert_array_equal(x, expected[0])
    np.testing.assert_array_equal(y, expected[1])
    np.testing.assert_array_equal(p, expected[3])
    np.testing.assert_array_equal(t - t[0], expected[2] - expected[2][0])
    assert shift or t[0] == expected[2][0]
    assert losses == {}


def test_where_the_pixels_of_jaer_stand(write):
    """JAER's address 0 is the lower right pixel; ON is a 0 for the DVS128, a 1 for the DAVIS."""
    for chip, address, size, on in (
        ("DVS128", 0, (128, 128), True),
        ("DAVIS346B", 0, (346, 260), False),
    ):
        content = f"#!AER-DAT2.0\r\n# AEChip: a.b.{chip}\r\n".encode() + struct.pack(
            ">II", address, 7
        )
        (x, y, t, p), _ = read_events(write(content))
        assert (x[0], y[0], t[0], p[0]) == (size[0] - 1, size[1] - 1, 7, on)


def test_without_a_chip_the_size_tells_it(write):
    path = write(seeds.aedat2(None, (240, 180)))
    with pytest.raises(InputError, match="does not tell the sensor size"):
        open_recording(path)
    recording = open_recording(path, size=(240, 180))
    assert recording.notes == ["the file names no chip: a DAVIS was taken"]
    dvs = open_recording(write(seeds.aedat2(None, (128, 128))), size=(128, 128))
    assert dvs.notes == ["the file names no chip: DVS128 was taken"]
    assert next(iter(dvs)).x[0] == seeds.columns()[0][0]


def test_a_clock_of_32_bits_goes_on():
    clock = Clock(32)
    assert clock(np.array([4294967290, 4294967295, 3])).tolist() == [
        4294967290,
        4294967295,
        4294967299,
    ]
    assert clock(np.array([], np.int64)).tolist() == []
    assert clock(np.array([4294967294, 5])).tolist() == [4294967294, 4294967301]


def test_the_overflow_of_a_packet_is_counted(write):
    content = bytearray(seeds.aedat3(step=150))
    second = content.index(b"END-HEADER\r\n") + 12 + 28 + 8 * 150
    struct.pack_into("<i", content, second + 12, 1)
    (_, _, t, _), _ = read_events(write(bytes(content)))
    expected = seeds.columns()[2]
    np.testing.assert_array_equal(t, expected + (np.arange(300) >= 150) * (1 << 31))


def test_events_of_aedat3_that_are_marked_invalid_are_counted(write):
    content = bytearray(seeds.aedat3())
    content[content.index(b"END-HEADER\r\n") + 12 + 28] &= 0xFE
    found, losses = read_events(write(bytes(content)))
    assert found[0].size == seeds.COUNT - 1
    assert losses == {"events marked invalid": 1}


def test_of_two_sources_one_is_said(write):
    path = write(seeds.aedat3(sources=("DVS128", "DAVIS240C"), kinds=(1, 1)))
    with pytest.raises(InputError, match=r"several sources.* one of 0 \(DVS128\), 1 \(DAVIS240C\)"):
        open_recording(path)
    assert open_recording(path, stream="1").width == 240
    assert read_events(path, stream="0")[0][0].size == seeds.COUNT
    with pytest.raises(InputError, match="has no source 2, only 0"):
        open_recording(path, stream="2")


def test_measurements_of_exposure_of_an_atis_are_passed_over_and_counted(write):
    content = seeds.es(2) + bytes([0b01, 1, 0, 1, 0, 0b11, 1, 0, 1, 0])
    found, losses = read_events(write(content))
    assert found[0].size == seeds.COUNT
    assert losses == {"measurements of exposure": 2}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (seeds.aedat2().replace(b"DAT2.0", b"DAT1.0"), "version 1.0 of AEDAT; 2.0, 3.1 and 4.0"),
        (seeds.aedat2("net.sf.Tmpdiff64"), "chip net.sf.Tmpdiff64, whose addresses are not known"),
        (seeds.aedat2()[:60], "ends within its header"),
        (seeds.aedat3().replace(b"DAT3.1", b"DAT3.0"), "version 3.0 of AEDAT"),
        (seeds.aedat3().replace(b"RAW", b"Serial-TS"), "format Serial-TS; only RAW"),
        (seeds.aedat3(kinds=(2,)), "holds no events"),
        (
            seeds.aedat3().replace(struct.pack("<i", 50), struct.pack("<i", -5)),
            "no header of a pac",
        ),
        (seeds.es(4), "holds colour events"),
        (seeds.es(0), "holds generic events"),
        (seeds.es(9), "holds type 9"),
        (seeds.es(version=1), "version 1.0.0 of Event Stream; only 2"),
        (seeds.es()[:19], "ends within its header"),
        (seeds.es()[:20], "holds no events"),
    ],
)
def test_what_cannot_be_read_is_named(write, content, message):
    path = write(content)
    with pytest.raises(InputError, match=message) as refusal:
        open_recording(path)
    assert str(path) in str(refusal.value)


def test_the_size_of_the_caller_is_compared(write):
    for make in (seeds.aedat2, seeds.aedat3, seeds.es):
        with pytest.raises(InputError, match="not of 640x480"):
            open_recording(write(make()), size=(640, 480))


def test_real_files(data):
    """The disk's text was made of the AEDAT 2.0 by others, who turned it round."""
    path = data / "formats" / "davis240_imu.aedat"
    (x, y, t, p), losses = read_events(path)
    assert (x.size, losses) == (374_296, {})
    with gzip.open(data / "rotation" / "disk" / "events.txt.gz") as file:
        text = np.loadtxt(file, max_rows=20_000)
    at = np.searchsorted(t, t[0])
    columns = np.column_stack([x, y, p])[at : at + len(text)]
    np.testing.assert_array_equal(columns, text[:, 1:].astype(int))
    np.testing.assert_allclose((t[: len(text)] - t[0]) / 1e6, text[:, 0], rtol=0, atol=1e-9)
    (x, y, t, p), losses = read_events(data / "formats" / "dvs.es")
    assert (x.size, t[-1], losses) == (473_225, 999_000, {})
    assert (x.max(), y.max()) == (319, 239)

"""The reader of `t x y p` text against exact decimals, NumPy, and damaged files."""

import gzip
import tracemalloc
import zipfile
from decimal import ROUND_HALF_UP, Decimal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.recordings.formats.events_text import load_events_text, read_events_text
from evcalib.errors import InputError

TEXT = "0.003811000 96 133 0\n0.003820001 127 171 0\n0.003836000 4 160 1\n"


@pytest.fixture
def write(tmp_path):
    def write(text, name="events.txt"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def test_three_lines(write):
    events = load_events_text(write(TEXT), 240, 180)
    assert events.t.tolist() == [3811, 3820, 3836]
    assert (events.x.tolist(), events.y.tolist()) == ([96, 127, 4], [133, 171, 160])
    assert events.p.tolist() == [False, False, True]


def test_the_real_slider_agrees_with_numpy(data):
    path = data / "slider_depth" / "events.txt.gz"
    events = load_events_text(path, 240, 180)
    assert len(events) == 532_434
    with gzip.open(path) as stream:
        table = np.loadtxt(stream)
    np.testing.assert_array_equal(events.t, np.rint(table[:, 0] * 1e6))
    np.testing.assert_array_equal(events.x, table[:, 1])
    np.testing.assert_array_equal(events.y, table[:, 2])
    np.testing.assert_array_equal(events.p, table[:, 3] > 0)


def test_blocks_do_not_change_the_events(data):
    path = data / "rotation" / "shapes_rotation" / "events.txt.gz"
    whole = load_events_text(path, 240, 180)
    pieces = list(read_events_text(path, 240, 180, block_bytes=5000))
    assert len(pieces) > 50
    assert max(map(len, pieces)) <= 5000 // 8 + 1
    for name in "xytp":
        joined = np.concatenate([getattr(piece, name) for piece in pieces])
        np.testing.assert_array_equal(joined, getattr(whole, name))


def test_memory_stays_bounded(write):
    line = b"0.500000 100 100 1\n"
    path = write(gzip.compress(line * 500_000), "long.gz")
    next(read_events_text(path, 240, 180))  # compiled, so that only the reading is measured
    tracemalloc.start()
    n = sum(len(piece) for piece in read_events_text(path, 240, 180, block_bytes=1 << 16))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert n == 500_000
    assert peak < 1_500_000  # the text has 9.5 million bytes


@given(st.integers(64, 200), st.integers(1, 60))
@settings(deadline=None, max_examples=30)
def test_any_block_size_gives_all_lines(tmp_path_factory, block, n):
    path = tmp_path_factory.mktemp("text") / "events.txt"
    path.write_text("".join(f"{k}.{k:06d} {k} {k % 7} {k % 2}\n" for k in range(n)))
    t = [e for piece in read_events_text(path, 99, 7, block_bytes=block) for e in piece.t.tolist()]
    assert t == [k * 1_000_001 for k in range(n)]


def test_all_containers_hold_the_same(write, tmp_path):
    paths = [write(TEXT), write(gzip.compress(TEXT.encode()), "any_name.bin")]
    with zipfile.ZipFile(tmp_path / "slider.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("slider/calib.txt", "1 2 3")
        archive.writestr("slider/events.txt", TEXT)
    paths.append(tmp_path / "slider.zip")
    for path in paths:
        assert load_events_text(path, 240, 180).t.tolist() == [3811, 3820, 3836]


def test_a_zip_tells_its_members(tmp_path):
    path = tmp_path / "two.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a/events.txt", TEXT)
        archive.writestr("b/events.txt", TEXT)
    with pytest.raises(InputError, match=r"2 files named events.txt.*a/events.txt, b/events.txt"):
        load_events_text(path, 240, 180)
    with pytest.raises(InputError, match="no member c"):
        next(read_events_text(path, 240, 180, member="c"))
    assert len(next(read_events_text(path, 240, 180, member="b/events.txt"))) == 3


@pytest.mark.parametrize(
    "line",
    [
        "0.5 1 2 1",
        "0.5\t1\t2\t1\r",
        " 0.500000 , 1, 2,1 ",
        "5e-1 1 2 1",
        "4.999996E-01 1 2 1",
        "0.4999995 1 2 1",
        "000000000000000000000000.5000000000000000000000000001 1 2 1",
    ],
)
def test_forms_of_the_same_line(write, line):
    events = load_events_text(write(f"# t x y p\n\n{line}\n"), 3, 3, time_unit="s")
    assert events.x.tolist() == [1]
    assert events.y.tolist() == [2]
    assert events.t.tolist() == [500_000]


@given(
    st.integers(0, 10**13),
    st.integers(0, 12),
    st.sampled_from(["s", "ms", "us", "ns"]),
    st.booleans(),
)
@settings(deadline=None, max_examples=300)
def test_times_are_rounded_as_exact_decimals(tmp_path_factory, digits, places, unit, scientific):
    value = Decimal(digits).scaleb(-places)
    micro = value.scaleb({"s": 6, "ms": 3, "us": 0, "ns": -3}[unit])
    expected = int(micro.quantize(Decimal(1), rounding=ROUND_HALF_UP))
    path = tmp_path_factory.mktemp("text") / "events.txt"
    path.write_text(f"{value:{'.20e' if scientific else 'f'}} 0 0 1\n")
    if expected > 10**14:
        with pytest.raises(InputError, match="over three years"):
            load_events_text(path, 1, 1, time_unit=unit)
    else:
        assert load_events_text(path, 1, 1, time_unit=unit).t.tolist() == [expected]


def test_the_last_line_may_lack_its_newline(write):
    assert len(load_events_text(write(TEXT[:-1]), 240, 180)) == 3


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("0.004 1 2", "four numbers"),
        ("0.004 1", "four numbers"),
        ("0.004 1 2 1 7", "four numbers"),
        ("0.004 1 2 x", "four numbers"),
        ("0.004 1.5 2 1", "four numbers"),
        ("0.004 -1 2 1", "four numbers"),
        ("0.0.4 1 2 1", "four numbers"),
        ("nan 1 2 1", "four numbers"),
        ("0.004e 1 2 1", "four numbers"),
        ("0.004 1 2 - 1", "four numbers"),
        (". 1 2 1", "four numbers"),
        ("\x00\x01\x02", "four numbers"),
        ("0.004 240 2 1", r"x is outside the sensor \(width 240\)"),
        ("0.004 99999999999999999999999999 2 1", "four numbers"),
        ("0.004 1 180 1", r"y is outside the sensor \(height 180\)"),
        ("-0.004 1 2 1", "time is negative"),
        ("0.003 1 2 1", r"before that of the last event \(3836 us\)"),
        ("1468941032.2 1 2 1", "over three years"),
        ("9e99 1 2 1", "over three years"),
        ("0.004 1 2 3", "polarity must be"),
        ("0.004 1 2 -1", "mix codings .-1 in line 4, 0 in line 1"),
    ],
)
def test_a_bad_line_is_named(write, line, message):
    with pytest.raises(InputError, match=f"line 4: .*{message}"):
        load_events_text(write(TEXT + line + "\n0.005 1 2 1\n"), 240, 180)


def test_line_numbers_count_across_blocks_and_comments(write):
    lines = ["# comment", *(f"0.{k:06d} 1 1 1" for k in range(500)), "garbled"]
    with pytest.raises(InputError, match=r"line 502: .*'garbled'"):
        list(read_events_text(write("\n".join(lines)), 240, 180, block_bytes=64))


def test_order_is_checked_across_blocks(write):
    lines = [f"0.{k:06d} 1 1 1" for k in range(500)] + ["0.000001 1 1 1"]
    with pytest.raises(InputError, match=r"line 501: .*before that of the last event"):
        list(read_events_text(write("\n".join(lines)), 240, 180, block_bytes=64))


def test_an_origin_brings_unix_time_down(write):
    text = "1468941032.229164 1 2 1\n1468941032.229165 1 2 0\n"
    events = load_events_text(write(text), 240, 180, origin_us=1_468_941_032_000_000)
    assert events.t.tolist() == [229_164, 229_165]


def test_whole_numbers_need_their_unit(write):
    path = write("3811 96 133 0\n3820 96 133 1\n")
    with pytest.raises(InputError, match="no decimal point; say time_unit"):
        load_events_text(path, 240, 180)
    assert load_events_text(path, 240, 180, time_unit="us").t.tolist() == [3811, 3820]


@pytest.mark.parametrize("text", ["", "\n\n", "# nothing\n"])
def test_a_file_without_events_is_refused(write, text):
    with pytest.raises(InputError, match="holds no events"):
        load_events_text(write(text), 240, 180)


def test_damaged_files_are_refused(write, tmp_path):
    packed = gzip.compress("".join(f"0.{k:06d} 1 1 1\n" for k in range(5000)).encode())
    with pytest.raises(InputError, match="damaged or cut off"):
        load_events_text(write(packed[: len(packed) // 2], "cut.gz"), 240, 180)
    broken = bytearray(packed)
    broken[len(broken) // 2] ^= 255
    with pytest.raises(InputError):
        load_events_text(write(bytes(broken), "broken.gz"), 240, 180)
    with pytest.raises(InputError, match="damaged or cut off"):
        load_events_text(write(b"PK\x03\x04 no zip", "no.zip"), 240, 180)
    with pytest.raises(InputError, match="cannot read"):
        load_events_text(tmp_path / "missing.txt", 240, 180)
    with pytest.raises(InputError, match="not a text of events"):
        list(read_events_text(write(b"a" * 1000), 240, 180, block_bytes=64))


def test_bad_options_are_refused(write):
    path = write(TEXT)
    with pytest.raises(InputError, match="time_unit must be one of"):
        next(read_events_text(path, 240, 180, time_unit="h"))
    with pytest.raises(InputError, match="width"):
        next(read_events_text(path, 0, 180))
    with pytest.raises(InputError, match="block_bytes"):
        next(read_events_text(path, 240, 180, block_bytes=1))


@given(st.binary(max_size=200))
@settings(deadline=None, max_examples=300)
def test_random_bytes_never_crash(tmp_path_factory, noise):
    path = tmp_path_factory.mktemp("noise") / "events.txt"
    path.write_bytes(TEXT.encode() + noise)
    try:
        events = load_events_text(path, 240, 180)
    except InputError:
        return
    assert len(events) >= 3

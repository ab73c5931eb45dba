"""Clocks of recordings that lie: glitches, turns of 32 bits, units that nobody declared."""

from itertools import pairwise

import h5py
import naive_formats as naive
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from data_tools.recordings import _clock, describe, open_recording
from data_tools.recordings.formats import Columns
from evcalib.errors import InputError

SIZE = (640, 480)
REASON = _clock.GLITCHES


def ascending(count, seed=0):
    """About 300 events per second, whose columns tell their numbers."""
    return np.cumsum(np.random.default_rng(seed).integers(1, 6000, count)) + 10_000


def saved(path, t, **more):
    number = np.arange(t.size)
    np.savez(path, x=number % 640, y=number // 640 % 480, t=t, p=number % 2, **more)
    return path


def found(recording):
    """Return numbers and times of the events."""
    pieces = list(recording)
    x, y, t = (np.concatenate([getattr(p, c) for p in pieces]) for c in "xyt")
    return x.astype(int) + 640 * y.astype(int), t


@pytest.mark.parametrize("disorder", ["refuse", "sort", "drop"])
@pytest.mark.parametrize("shift", [10**8, 4 * 10**9, 200_000, 1 << 40, 1 << 62, -9_000_000])
@pytest.mark.parametrize("rows", [[0], [300], [0, 300, 301], [1, 598], [599]])
def test_glitches_are_left_out_and_nothing_else(tmp_path, rows, shift, disorder):
    t = ascending(600)
    wrong = t.copy()
    wrong[rows] += shift
    recording = open_recording(saved(tmp_path / "e.npz", wrong, width=640, height=480))
    if (rows == [599] and shift == 200_000) or (0 in rows and shift < 0):
        pytest.skip("an end that is not far away may be right")
    assert describe(recording).losses == {REASON: len(rows)}
    recording = open_recording(tmp_path / "e.npz", disorder=disorder)
    number, times = found(recording)
    kept = np.delete(np.arange(600), rows)
    np.testing.assert_array_equal(number, kept)
    np.testing.assert_array_equal(times, t[kept])
    assert recording.losses == {REASON: len(rows)}


@given(
    cuts=st.lists(st.integers(0, 6000), max_size=12),
    starts=st.lists(st.integers(0, 5990), min_size=1, max_size=4, unique=True),
    length=st.integers(1, 9),
    shift=st.sampled_from([60_000_000, 10**12]),
)
@example(cuts=[30], starts=[1], length=3, shift=60_000_000)
@settings(deadline=None, max_examples=60)
def test_pieces_do_not_matter(cuts, starts, length, shift):
    """Of glitches with more sound events than bad ones between them; else none can say which is."""
    assume(np.diff(sorted(starts)).min(initial=6000) > 2 * length + 1)
    t = np.arange(6000) * 1000
    wrong, bad = t.copy(), np.zeros(6000, bool)
    for start in starts:
        wrong[start : start + length] = t[start : start + length] + shift
        bad[start : start + length] = True
    number = np.arange(6000, dtype=np.uint16)
    whole = Columns(number, number, wrong, number > 0)
    bounds = np.unique([0, *cuts, 6000])
    pieces = [whole.rows(slice(*ab)) for ab in pairwise(bounds)]
    losses = _clock.Counter()
    kept = Columns.joined(list(_clock.without_glitches(pieces, losses)))
    np.testing.assert_array_equal(kept.x, number[~bad])
    assert losses == {REASON: np.count_nonzero(bad)}


def test_the_borders_of_large_pieces(tmp_path):
    t = np.arange(400_000) * 5
    rows = [131_070, 131_071, 131_072, 262_143, 262_144, 399_990]
    wrong = t.copy()
    wrong[rows] += 90_000_000
    number, _ = found(open_recording(saved(tmp_path / "e.npz", wrong), size=SIZE))
    assert number.size == 400_000 - len(rows)


def test_a_clock_that_starts_anew_is_refused_and_no_advice_loses_data(tmp_path):
    t = ascending(600)
    path = saved(tmp_path / "e.npz", np.concatenate([t[:300], t[:300]]))
    for disorder in ("refuse", "sort"):
        recording = open_recording(path, size=SIZE, disorder=disorder)
        with pytest.raises(InputError, match="Then cut the file there") as error:
            list(recording)
        assert "drop" not in str(error.value)
        assert "event 300" in str(error.value)
        assert recording.losses == {}


def test_two_recordings_in_one_are_refused(tmp_path):
    t = np.stack([ascending(3000), ascending(3000) + 10**9], axis=1).ravel()
    with pytest.raises(InputError, match="jumps to and fro"):
        list(open_recording(saved(tmp_path / "e.npz", t), size=SIZE))


def test_late_events_are_no_glitches(tmp_path):
    t = ascending(600)
    t[[200, 201]] = t[[201, 200]]
    recording = open_recording(saved(tmp_path / "e.npz", t), size=SIZE)
    with pytest.raises(InputError, match="--disorder sort"):
        list(recording)
    assert describe(recording).late == 1


WRITERS = {
    "npz": lambda path, t: saved(path, t),
    "csv": lambda path, t: path.write_text(
        "t,x,y,p\n" + "".join(f"{s},{k % 640},{k // 640},{k % 2}\n" for k, s in enumerate(t))
    ),
    "text": lambda path, t: path.write_text(
        "".join(f"{s} {k % 640} {k // 640} {k % 2}\n" for k, s in enumerate(t))
    ),
    "hdf5": lambda path, t: write_hdf5(path, t),
}


def write_hdf5(path, t):
    number = np.arange(t.size)
    with h5py.File(path, "w") as file:
        for name, column in zip("xytp", (number % 640, number // 640, t, number % 2), strict=True):
            file[f"events/{name}"] = column


@pytest.mark.parametrize("turn", [32, 31])
@pytest.mark.parametrize("form", WRITERS)
def test_a_clock_of_32_bits_goes_on_and_that_is_told(tmp_path, form, turn):
    start = (1 << turn) - 600_000
    t = start + ascending(600)
    WRITERS[form](tmp_path / f"e.{form}", t % (1 << turn))
    recording = open_recording(tmp_path / f"e.{form}", size=SIZE, time_unit="us")
    number, times = found(recording)
    np.testing.assert_array_equal(times, t)
    assert number.size == 600
    assert any("started again (1 x)" in note for note in recording.notes)
    assert any("started again (1 x)" in note for note in describe(recording).notes)


def test_a_signed_clock_and_late_events_around_the_turn(tmp_path):
    t = (1 << 31) - 600_000 + ascending(600)
    row = int(np.argmax(t >= 1 << 31))
    t[[row - 1, row]] = t[[row, row - 1]]
    signed = (t + (1 << 31)) % (1 << 32) - (1 << 31)
    recording = open_recording(saved(tmp_path / "e.npz", signed), size=SIZE, disorder="sort")
    np.testing.assert_array_equal(found(recording)[1], np.sort(t))


def test_dat_tells_of_its_turn(tmp_path):
    t = (1 << 32) - 600_000 + ascending(600)
    events = [(int(s) % (1 << 32), k, 0, 1) for k, s in enumerate(t)]
    (tmp_path / "e").write_bytes(naive.HEADER_DAT + naive.dat_records(events))
    recording = open_recording(tmp_path / "e")
    np.testing.assert_array_equal(found(recording)[1], t)
    assert any("started again (1 x)" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("scale", "digits", "count", "why"),
    [
        (1, 1, 600, "events per second"),
        (1e-3, 3, 600, "events per second"),
        (1e3, 1, 20_000, "events per second"),
        (1, 1, 20_000, "nothing but zeros"),
        (1e-3, 3, 20_000, "whole milliseconds"),
    ],
)
@pytest.mark.parametrize("separator", [" ", ",", ";"])
def test_decimal_times_of_another_unit_are_asked_for(
    tmp_path, separator, scale, digits, count, why
):
    """Microseconds times `scale`; the many are crowded so that they are more than one a second."""
    t = ascending(count) if count < 1000 else np.arange(count) // 7 + 5
    t = 91 * t if scale < 1 and count > 1000 else t
    header = separator.join("txyp") + "\n" if separator != " " else ""
    rest = separator.join(("", "3", "4", "1\n"))
    text = header + "".join(f"{s * scale:.{digits}f}{rest}" for s in t)
    (tmp_path / "e").write_text(text)
    with pytest.raises(InputError, match=f"(?s){why}.*--time-unit us"):
        open_recording(tmp_path / "e", size=SIZE)
    unit = {1: "us", 1e-3: "ms", 1e3: "ns"}[scale]
    times = found(open_recording(tmp_path / "e", size=SIZE, time_unit=unit))[1]
    np.testing.assert_array_equal(times, t)


def test_seconds_stay_seconds(tmp_path):
    t = ascending(600)
    for digits in (6, 4):
        text = "".join(f"{s / 1e6:.{digits}f} 3 4 1\n" for s in t)
        (tmp_path / "e").write_text(text)
        times = found(open_recording(tmp_path / "e", size=SIZE))[1]
        np.testing.assert_allclose(times, t, atol=51)
    # Cut to milliseconds, several events share one.
    (tmp_path / "e").write_text("".join(f"{k // 5 / 1e3:.3f} 3 4 1\n" for k in range(5000)))
    assert open_recording(tmp_path / "e", size=SIZE).format == "text"
    # Slow on purpose, and said to be.
    (tmp_path / "e").write_text("".join(f"{9 * k}.5 3 4 1\n" for k in range(50)))
    assert len(found(open_recording(tmp_path / "e", size=SIZE, time_unit="s"))[1]) == 50


def test_whole_numbers_that_can_hardly_be_microseconds_are_asked_about(tmp_path):
    t = ascending(600) * 1000
    path = saved(tmp_path / "e.npz", t)
    recording = open_recording(path, size=SIZE)
    assert "us was assumed, but that would be 0.32 events per second" in recording.notes[0]
    assert describe(recording).notes == tuple(recording.notes)
    recording = open_recording(path, size=SIZE, time_unit="ns")
    np.testing.assert_array_equal(found(recording)[1], t // 1000)
    assert recording.notes == []


def test_a_unit_that_the_file_declares_or_its_format_fixes_is_not_overridden(tmp_path):
    t = ascending(600)
    npz = saved(tmp_path / "e.npz", t, time_unit="us", width=640, height=480)
    write_hdf5(tmp_path / "e.h5", t)
    with h5py.File(tmp_path / "e.h5", "r+") as file:
        file["events"].attrs.update({"time_unit": "us", "width": 640, "height": 480})
    mark = "# evcalib-events version=1 width=640 height=480 time_unit=us\n"
    (tmp_path / "e.csv").write_text(mark + "t,x,y,p\n" + "".join(f"{s},3,4,1\n" for s in t))
    (tmp_path / "e.txt").write_text(mark + "".join(f"{s} 3 4 1\n" for s in t))
    (tmp_path / "e.dat").write_bytes(naive.HEADER_DAT + naive.dat_records([(5, 3, 4, 1)]))
    (tmp_path / "e.raw").write_bytes(naive.HEADER_EVT2 + naive.evt2_words([(5, 3, 4, 1)]))
    for path in (npz, *(tmp_path / f"e.{end}" for end in ("h5", "csv", "txt", "dat", "raw"))):
        with pytest.raises(InputError, match=r"in us.*not in ms: leave time_unit"):
            open_recording(path, time_unit="ms")
        assert len(open_recording(path, time_unit="us").notes) <= 1


def test_times_of_unix_size_come_down_in_every_reader(tmp_path):
    t = ascending(600) + 1_700_000_000_000_000
    for form, write in WRITERS.items():
        write(tmp_path / f"e.{form}", t)
        recording = open_recording(tmp_path / f"e.{form}", size=SIZE, time_unit="us")
        np.testing.assert_array_equal(found(recording)[1] + recording.origin_us, t)
        assert recording.origin_us == t[0] // 10**6 * 10**6


@pytest.mark.parametrize("first", [0, 9 * 10**15])
def test_a_first_event_far_from_all_others_is_left_out(tmp_path, first):
    t = ascending(600) + 1_700_000_000_000_000
    t[0] = first
    recording = open_recording(saved(tmp_path / "e.npz", t), size=SIZE)
    assert found(recording)[1].size == 599
    assert recording.origin_us == t[1] // 10**6 * 10**6

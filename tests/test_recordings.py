"""The common front of recordings: format, size, origin, order, pieces, description."""

import gzip
import json
import tracemalloc
import zipfile
from itertools import pairwise

import naive_formats as naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.recordings import _stages as stages
from data_tools.recordings import describe, open_recording
from data_tools.recordings.formats import Columns, known
from data_tools.runs.headings import headings_from_files, open_with_camera
from evcalib.errors import InputError

TEXT = "0.003811 96 133 0\n0.003820 127 171 0\n0.003836 4 160 1\n"
CAMCHAIN = """cam0:
  camera_model: pinhole
  intrinsics: [200.0, 200.0, 119.5, 89.5]
  distortion_model: none
  distortion_coeffs: []
  resolution: [240, 180]
"""


def dat(events):
    return naive.HEADER_DAT + naive.dat_records(events)


def at_times(*times):
    return [(t, k % 640, k % 480, k % 2) for k, t in enumerate(times)]


def listed(recording):
    return [
        event
        for piece in recording
        for event in zip(*(getattr(piece, c).tolist() for c in "txyp"), strict=True)
    ]


@pytest.fixture
def write(tmp_path):
    def write(data, name="recording"):
        path = tmp_path / name
        path.write_bytes(data if isinstance(data, bytes) else data.encode())
        return path

    return write


def test_formats_are_found_by_content_whatever_the_name(write, tmp_path):
    event = [(5, 3, 4, 1)]
    contents = {
        "evt2": naive.HEADER_EVT2 + naive.evt2_words(event),
        "evt3": naive.HEADER_EVT3 + naive.evt3_words(event),
        "dat": dat(event),
        "text": b"# t x y p\n\n0.000005 3 4 1\n",
    }
    for name, content in contents.items():
        recording = open_recording(write(content), size=None if name != "text" else (9, 9))
        assert (recording.format, listed(recording)) == (name, event)
    path = write(gzip.compress(contents["text"]))
    assert listed(open_recording(path, size=(9, 9))) == event
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a/events.txt", contents["text"])
        archive.writestr("b/events.txt", contents["text"] * 2)
    recording = open_recording(path, size=(9, 9), stream="b/events.txt")
    assert listed(recording) == event * 2


@pytest.mark.parametrize(
    "content", ["A picture, perhaps\n", b"\x89PNG\r\n\x1a\n" + bytes(99), b"%"]
)
def test_unknown_content_is_refused_with_the_formats_that_are_known(write, content):
    with pytest.raises(
        InputError, match=r"in no format that is known; known are .*evt2, evt3, dat"
    ):
        open_recording(write(content))


def test_files_that_are_not_there(tmp_path, write):
    with pytest.raises(InputError, match=r"cannot read .*nothing: No such file"):
        open_recording(tmp_path / "nothing")
    with pytest.raises(InputError, match="is empty"):
        open_recording(write(b""))
    with pytest.raises(InputError, match=r"format must be one of .*evt3.*, not 'evt9'"):
        open_recording(write(TEXT), format="evt9")
    assert {"text", "evt2", "evt3", "dat", "aedat4"} <= set(known())


def test_a_format_can_be_said(write):
    with pytest.raises(InputError, match="line 1: four numbers"):
        open_recording(write("hello\n"), format="text", size=(9, 9))


def test_sizes_are_needed_and_must_agree(write):
    with pytest.raises(InputError, match="does not tell the sensor size"):
        open_recording(write(TEXT))
    with pytest.raises(InputError, match="640x480 px, not of 240x180"):
        open_recording(write(dat(at_times(1))), size=(240, 180))
    with pytest.raises(InputError, match="width must be a whole number"):
        open_recording(write(TEXT), size=(0, 9))
    recording = open_recording(write(dat(at_times(1))), size=(640, 480))
    assert recording.shape == (480, 640)


def test_a_few_events_outside_the_sensor_are_counted_and_many_refused(write):
    events = at_times(*range(1000))
    events[3] = (3, 640, 5, 1)
    events[8] = (8, 5, 480, 1)
    recording = open_recording(write(dat(events)))
    assert listed(recording) == events[:3] + events[4:8] + events[9:]
    assert recording.losses == {"events outside the sensor": 2}
    path = write(dat(events).replace(b"Width 640", b"Width 320"))
    with pytest.raises(InputError, match=r"outside the sensor of 320x480.*is the size right"):
        open_recording(path)


def test_times_of_unix_size_count_from_a_whole_second(write):
    unix = 1_700_000_000
    lines = f"{unix}.250000 1 2 1\n{unix}.750000 1 2 1\n"
    recording = open_recording(write(lines), size=(9, 9))
    assert recording.origin_us == unix * 10**6
    assert [event[0] for event in listed(recording)] == [250_000, 750_000]
    recording = open_recording(write(lines), size=(9, 9), origin_us=unix * 10**6 - 10)
    assert [event[0] for event in listed(recording)] == [250_010, 750_010]
    assert open_recording(write(TEXT), size=(240, 180)).origin_us == 0


def test_impossible_origins_are_refused(write):
    path = write(dat(at_times(5, 6)))
    with pytest.raises(InputError, match="event at 5 us, before origin_us = 6"):
        list(open_recording(path, origin_us=6))
    with pytest.raises(InputError, match="over three years after"):
        list(open_recording(path, origin_us=-(10**15)))
    with pytest.raises(InputError, match="whole microseconds"):
        open_recording(path, origin_us=0.5)


def test_iterations_start_anew_and_losses_are_of_the_last(write):
    recording = open_recording(write(dat(at_times(1, 2, 3)) + b"cut"))
    for _ in range(3):
        assert len(listed(recording)) == 3
        assert recording.losses == {"bytes of a cut-off last event": 3}


LATE = at_times(0, 100, 90, 100, 40_000, 30_000, 95, 80_000, 80_000)


def test_late_events_are_refused_with_their_place(write):
    recording = open_recording(write(dat(LATE)))
    message = r"recording: times are out of order: event 2 \(t = 90 us in the file\) is 10 us late"
    with pytest.raises(InputError, match=message):
        list(recording)
    lines = "".join(f"{t} {x} {y} {p}\n" for t, x, y, p in LATE)
    with pytest.raises(InputError, match=message):
        list(open_recording(write(lines), size=(640, 480), time_unit="us"))


def test_late_events_are_put_in_order_on_demand(write):
    recording = open_recording(write(dat(LATE)), disorder="sort")
    assert listed(recording) == sorted(LATE, key=lambda event: event[0])
    assert recording.losses == {}
    assert recording.notes == ["3 late events were put in order, by up to 39905 us"]
    lines = "".join(f"{t} {x} {y} {p}\n" for t, x, y, p in LATE)
    text = open_recording(write(lines), size=(640, 480), time_unit="us", disorder="sort")
    assert listed(text) == sorted(LATE, key=lambda event: event[0])


def test_what_is_too_late_cannot_be_sorted(write):
    recording = open_recording(write(dat(at_times(0, 50_001, 0))), disorder="sort")
    with pytest.raises(InputError, match=r"event 2 .* is 50001 us late, more than 50 ms"):
        list(recording)
    assert len(listed(open_recording(write(dat(at_times(0, 50_000, 0))), disorder="sort"))) == 3


def test_late_events_are_left_out_on_demand(write):
    recording = open_recording(write(dat(LATE)), disorder="drop")
    assert [event[0] for event in listed(recording)] == [0, 100, 100, 40_000, 80_000, 80_000]
    assert recording.losses == {"late events": 3}
    with pytest.raises(InputError, match="disorder must be one of"):
        open_recording(write(dat(LATE)), disorder="ignore")


def test_events_are_held_back_as_long_as_an_earlier_one_may_come():
    number = np.zeros(1, np.uint16)
    times = [500, 50_000, 100, 50_101, 101, 99_000]
    pieces = [Columns(number, number, np.array([t]), number > 0) for t in times]
    found = [int(t) for piece in stages.in_order(pieces, stages.Disorder()) for t in piece.t]
    assert found == sorted(times)


@given(
    t=st.lists(st.integers(0, 120_000), min_size=1, max_size=60),
    cuts=st.lists(st.integers(0, 60), max_size=6),
)
@settings(deadline=None, max_examples=200)
def test_sorting_in_pieces_is_sorting_or_refusing(t, cuts):
    t = np.array(t)
    number = np.arange(t.size, dtype=np.uint16)
    whole = Columns(number, number, t, number % 2 > 0)
    bounds = np.unique([0, *np.minimum(cuts, t.size), t.size])
    pieces = [whole.rows(slice(a, b)) for a, b in pairwise(bounds)]
    lag = np.maximum.accumulate(t) - t
    late = stages.Disorder()
    if lag.max() > stages.SORT_WINDOW_US:
        with pytest.raises(InputError, match="too far out of order"):
            list(stages.in_order(pieces, late))
        return
    found = Columns.joined(list(stages.in_order(pieces, late)))
    order = np.argsort(t, kind="stable")
    np.testing.assert_array_equal(found.x, number[order])
    np.testing.assert_array_equal(found.t, t[order])
    assert (late.count, late.largest_us) == (np.count_nonzero(lag), lag.max())


@given(sizes=st.lists(st.integers(0, 50), max_size=40))
@settings(deadline=None, max_examples=50)
def test_gathering_changes_sizes_only(sizes):
    t = np.arange(sum(sizes))
    whole = Columns(t.astype(np.uint16), t.astype(np.uint16), t, t % 2 > 0)
    ends = np.cumsum(sizes)
    pieces = (whole.rows(slice(end - size, end)) for end, size in zip(ends, sizes, strict=True))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stages, "LEAST", 30)
        patch.setattr(stages, "MOST", 40)
        found = [piece.t for piece in stages.gathered(pieces)]
    assert np.concatenate([[], *found]).tolist() == t.tolist()
    assert all(0 < piece.size <= 40 for piece in found)


def test_memory_stays_bounded(write):
    events = np.zeros((3_000_000, 2), "<u4")
    events[:, 0] = np.arange(3_000_000)
    path = write(naive.HEADER_DAT + b"\x0c\x08" + events.tobytes())
    recording = open_recording(path, disorder="sort")
    next(iter(recording))
    tracemalloc.start()
    most = max(len(piece) for piece in recording)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most <= stages.MOST
    assert peak < 35e6  # the columns of all events take 39 million bytes


def test_a_description_by_hand(write):
    times = [1_000_000, 1_000_001, 1_000_002, 1_350_000, 1_349_000, 1_351_000]
    events = [(t, 1, 2, k < 4) for k, t in enumerate(times)]
    info = describe(open_recording(write(dat(events) + b"cut")), gap_limit=0.3)
    assert (info.format, info.width, info.height, info.count) == ("dat", 640, 480, 6)
    assert (info.first_us, info.last_us, info.duration) == (1_000_000, 1_351_000, 0.351)
    assert info.on_share == pytest.approx(4 / 6)
    assert info.rate_mean == pytest.approx(6 / 0.351)
    assert info.rate_peak == 300  # three events in 10 ms
    assert (info.gaps, info.longest_gap, info.longest_gap_start) == (1, 0.349998, 2e-6)
    assert (info.late, info.largest_step_back) == (1, 0.001)
    assert info.losses == {"bytes of a cut-off last event": 3}
    assert json.loads(json.dumps(info.to_dict()))["rate_peak"] == 300
    text = info.text()
    assert "6 (66.7 % ON)" in text
    assert "1 of over 0.3 s; the longest 0.349998 s" in text
    assert "1 events are late, by up to 1.000 ms" in text
    assert "3 bytes of a cut-off last event" in text
    with pytest.raises(InputError, match="gap_limit"):
        describe(open_recording(write(dat(events))), gap_limit=0.0)


def test_a_description_of_one_moment(write):
    info = describe(open_recording(write(dat(at_times(7, 7, 7)))))
    assert (info.duration, info.rate_mean, info.rate_peak) == (0.0, 0.0, 300)
    assert "times ascend" in info.text()


@given(
    steps=st.lists(st.integers(-20_000, 60_000), min_size=1, max_size=80),
    least=st.integers(1, 90),
)
@settings(deadline=None, max_examples=60)
def test_a_description_does_not_depend_on_pieces(steps, least, tmp_path_factory):
    t = np.maximum(np.cumsum(steps) + 500_000, 0)
    path = tmp_path_factory.getbasetemp() / "described.dat"
    path.write_bytes(dat(at_times(*map(int, t))))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stages, "LEAST", least)
        patch.setattr(stages, "MOST", least)
        info = describe(open_recording(path), gap_limit=0.05)
    latest = np.maximum.accumulate(t)
    assert (info.gaps, info.late) == (
        np.count_nonzero(np.diff(latest) > 50_000),
        np.count_nonzero(t < latest),
    )
    assert info.longest_gap * 1e6 == pytest.approx(np.diff(latest, prepend=latest[0]).max())
    most = np.unique(t // 10_000, return_counts=True)[1].max()
    assert info.rate_peak == pytest.approx(max(100 * most, info.rate_mean))


def test_a_real_text_is_described(data):
    path = data / "slider_depth" / "events.txt.gz"
    info = describe(open_recording(path, size=(240, 180)))
    assert (info.format, info.count, info.late) == ("text", 532_434, 0)
    assert info.duration == pytest.approx(1.7, abs=0.05)


def test_headings_say_what_was_not_used(write, data):
    rng = np.random.default_rng(0)
    events = [(int(t), *map(int, rng.integers(0, 180, 2)), 1) for t in range(0, 10**6, 250)]
    content = dat(events).replace(b"640", b"240").replace(b"480", b"180") + b"cut"
    camera = write(CAMCHAIN, "camchain.yaml")
    result = headings_from_files(write(content), camera)
    assert "4000 events in " in result.summary
    assert "not used of the recording: 3 x bytes of a cut-off last event" in result.summary


def test_a_camera_and_a_recording_of_unlike_sensors_are_refused(write):
    recording = write(dat(at_times(1)))
    with pytest.raises(InputError, match="calibrated for 240x180 pixels, the events have 640x480"):
        open_with_camera(recording, write(CAMCHAIN, "camchain.yaml"))


def test_a_recording_tells_the_size_that_a_calib_txt_lacks(write):
    calib = write("200 200 320 240\n", "calib.txt")
    _, camera = open_with_camera(write(dat(at_times(1))), calib)
    assert (camera.width, camera.height) == (640, 480)
    with pytest.raises(InputError, match="does not tell the sensor size"):
        open_with_camera(write(TEXT), calib)

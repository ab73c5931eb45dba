"""Corner detectors against their plain twins, the authors' flags, and cases drawn by hand."""

from itertools import pairwise

import cv2
import naive_corners as naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.recordings.formats.events_text import load_events_text
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.features.corners import ArcStar, TosHarris, arc_star
from evcalib.surfaces import tos


def random_events(seed, n, width, height, longest_us):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.integers(0, longest_us + 1, n))
    x, y = rng.integers(0, width, n), rng.integers(0, height, n)
    return Events.from_arrays(x, y, t, rng.random(n) < 0.5, width, height)


def twin(events):
    columns = (events.x, events.y, events.t, events.p)
    return np.array(naive.arc_star(*columns, events.width, events.height), dtype=bool)


def fronts(seed, width, height, tick_us):
    """L-shaped fronts that sweep over the sensor again and again, with noise."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[:height, :width]
    front = np.maximum(rows, columns)
    t = np.concatenate([(front + start) * tick_us for start in range(0, 400, 50)], axis=None)
    t = t + rng.integers(0, tick_us + 1, t.size)
    x, y = np.tile(columns.ravel(), 8), np.tile(rows.ravel(), 8)
    x[::9], y[::9] = rng.integers(0, width, x[::9].size), rng.integers(0, height, x[::9].size)
    p = (np.arange(t.size) // rows.size % 2 == 0) ^ (rng.random(t.size) < 0.05)
    order = np.argsort(t, kind="stable")
    return Events.from_arrays(x[order], y[order], t[order], p[order], width, height)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("width", "height", "longest_us"),
    [(30, 20, 2000), (30, 20, 20), (13, 11, 0), (9, 9, 60_000), (12, 30, 1), (8, 40, 500)],
    ids=["sparse", "dense", "all at t = 0", "one pixel inside", "many ties", "all border"],
)
def test_flags_of_noise_equal_the_twin(seed, width, height, longest_us):
    events = random_events(seed, 4000, width, height, longest_us)
    assert np.array_equal(arc_star(events), twin(events))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("tick_us", [2, 30, 3000])
def test_flags_of_sweeping_corners_equal_the_twin(seed, tick_us):
    events = fronts(seed, 25, 18, tick_us)
    flags = arc_star(events)
    assert np.array_equal(flags, twin(events))
    assert flags.sum() > 20


@settings(deadline=None, max_examples=50)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 10),
            st.integers(0, 11),
            st.sampled_from([0, 1, 49_999, 50_000, 50_001]),
            st.booleans(),
        ),
        max_size=300,
    ),
    st.integers(0, 300),
)
def test_chunks_equal_the_twin_at_exact_filter_times(rows, cut):
    x, y, dt, p = np.array(rows, dtype=np.int64).reshape(-1, 4).T
    events = Events.from_arrays(x, y, np.cumsum(dt), p, 11, 12)
    detector = ArcStar(11, 12)
    flags = np.concatenate([detector.update(events[:cut]), detector.update(events[cut:])])
    assert np.array_equal(flags, twin(events))


def test_every_flag_equals_the_authors_on_a_real_recording(data):
    packed = np.load(data / "golden" / "arc_star_slider_depth.npy")
    events = load_events_text(data / "slider_depth" / "events.txt.gz", 346, 260)
    golden = np.unpackbits(packed)[: len(events)].astype(bool)
    assert golden.sum() == 42_723
    assert np.array_equal(arc_star(events), golden)


def wedge(degrees):
    """Both circles around (4, 4) fire at t = 1, within the angle at t = 2, the centre at 3."""
    steps = np.array([*naive.SMALL, *naive.LARGE])
    within = np.degrees(np.arctan2(steps[:, 0], steps[:, 1])) % 360 < degrees
    order = np.argsort(within, kind="stable")
    x, y = np.vstack((steps[order] + 4, (4, 4))).T
    t = np.append(within[order] + 1, 3)
    return Events.from_arrays(x, y, t, np.ones(t.size, bool), 9, 9)


@pytest.mark.parametrize(
    ("degrees", "corner"), [(45, False), (90, True), (180, False), (270, True)]
)
def test_a_wedge_is_a_corner_and_a_straight_edge_is_not(degrees, corner):
    assert arc_star(wedge(degrees))[-1] == corner


def test_an_echo_is_no_corner():
    events = wedge(90)
    x, y = np.append(events.x, 4), np.append(events.y, 4)
    for wait, echo in [(50_000, True), (50_001, False)]:
        t = np.append(events.t, events.t[-1] + wait)
        later = Events(x, y, t, np.ones(len(t), bool), 9, 9)
        assert arc_star(later)[-2:].tolist() == [True, not echo]


def test_stale_or_foreign_events_are_refused():
    events = random_events(0, 50, 20, 20, 100)
    detector = ArcStar(20, 20)
    detector.update(events)
    with pytest.raises(InputError, match="before the"):
        detector.update(events)
    with pytest.raises(InputError, match="was made for"):
        ArcStar(30, 20).update(events)
    with pytest.raises(InputError, match="filter_us"):
        ArcStar(30, 20, filter_us=-1)
    assert arc_star(Events.empty(20, 20)).shape == (0,)


def plain_tos_harris(events, period_us):
    """Look each event up in the response of the surface at the start of its period."""
    flags = []
    for k in range(len(events)):
        t = int(events.t[k])
        first = int(np.searchsorted(events.t, t // period_us * period_us))
        if first == 0:
            surface = np.zeros(events.shape, np.float32)
        else:
            surface = tos(events[:first]).astype(np.float32)
        response = cv2.cornerHarris(surface, 7, 5, 0.04)
        flags.append(response[events.y[k], events.x[k]] > max(0.1 * response.max(), 0))
    return np.array(flags, dtype=bool)


@pytest.mark.parametrize("seed", range(3))
def test_harris_flags_equal_the_twin_in_pieces_of_any_size(seed):
    events = fronts(seed, 25, 18, 30)[:1500]
    expected = plain_tos_harris(events, 1000)
    assert expected.sum() > 20
    detector = TosHarris(25, 18, period_us=1000)
    cuts = [0, 7, 500, 500, 900, len(events)]
    flags = [detector.update(events[a:b]) for a, b in pairwise(cuts)]
    assert np.array_equal(np.concatenate(flags), expected)


def test_harris_finds_the_corners_of_a_square_and_not_its_sides():
    side = [(10 + k, 10) for k in range(31)]
    square = [
        *side,
        *((x, 40) for x, _ in side),
        *((y, x) for x, y in side),
        *((40, x) for x, _ in side),
    ]
    x, y = np.array(square).T
    before = Events.from_arrays(x, y, np.zeros(len(x), int), np.ones(len(x), bool), 51, 51)
    again = Events.from_arrays(x, y, np.full(len(x), 9000), np.ones(len(x), bool), 51, 51)
    detector = TosHarris(51, 51)
    assert not detector.update(before).any()
    flags = detector.update(again)
    corners = np.array([(10, 10), (10, 40), (40, 10), (40, 40)])
    near = np.abs(np.column_stack((x, y))[:, None] - corners).max(axis=2).min(axis=1)
    assert flags[near == 0].all()
    assert not flags[near > 6].any()


def test_unusable_options_of_harris_are_refused():
    for option in ({"period_us": 0}, {"period_us": 0.5}, {"share": 1}, {"block": 0}):
        with pytest.raises(InputError, match=next(iter(option))):
            TosHarris(20, 20, **option)
    with pytest.raises(InputError, match="do not fit"):
        TosHarris(30, 20).update(random_events(0, 50, 20, 20, 100))
    assert TosHarris(20, 20).update(Events.empty(20, 20)).shape == (0,)

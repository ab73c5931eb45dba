"""Surfaces against plain-Python twins, hand-written cases and their own identities."""

import math
import os
import subprocess
import sys
from itertools import pairwise

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from surface_streams import random_events, rows, size, streams

from evcalib._event_columns import MAX_TIME_US
from evcalib.events import Events
from evcalib.surfaces import SURFACES, TosTs, dist, silc, time_surface, tos, tos_ts


def split(twin, events):
    """Apply a twin to the events of either polarity."""
    return [twin([e for e in rows(events) if e[3] == on]) for on in (False, True)]


@given(streams(), st.integers(0, 100_000), st.sampled_from([0.03, 0.0007, 5.0]))
@settings(deadline=None, max_examples=60)
def test_time_surface_equals_its_twin(events, later, tau):
    t = int(events.t[-1]) + later
    expected = naive.time_surface(rows(events), t, *size(events), tau)
    np.testing.assert_allclose(time_surface(events, t, tau=tau), expected, 0, 1e-12)
    both = split(lambda part: naive.time_surface(part, t, *size(events), tau), events)
    np.testing.assert_allclose(time_surface(events, t, tau=tau, polarity="split"), both, 0, 1e-12)


@given(streams(), st.sampled_from([(3, None), (7, None), (7, 250), (7, 1)]))
@settings(deadline=None, max_examples=60)
def test_tos_equals_its_twin(events, options):
    k, threshold = options
    level = 255 - 2 * k if threshold is None else threshold
    twin = lambda part: naive.tos(part, *size(events), k, level)  # noqa: E731
    assert tos(events, k=k, threshold=threshold).tolist() == twin(rows(events))
    assert tos(events, k=k, threshold=threshold, polarity="split").tolist() == split(twin, events)


@given(streams())
@settings(deadline=None, max_examples=20)
def test_tos_that_tests_first_is_a_threshold_of_one_less(events):
    expected = naive.tos_test_first(rows(events), *size(events), 7, 241)
    assert tos(events, threshold=240).tolist() == expected


@given(streams(), st.sampled_from([1, 6, 8]))
@settings(deadline=None, max_examples=60)
def test_silc_equals_its_twin(events, r):
    twin = lambda part: naive.silc(part, *size(events), r)  # noqa: E731
    assert silc(events, r=r).tolist() == split(twin, events)
    assert silc(events, r=r, polarity="merged").tolist() == twin(rows(events))


@given(streams(), st.sampled_from([(3.0, 5, 0.99), (0.0, 3, 1.0), (1.7, 7, 0.5)]))
@settings(deadline=None, max_examples=60)
def test_dist_equals_its_twin(events, options):
    alpha, side, clip = options
    start = int(events.t[0])
    twin = lambda part: naive.dist(part, start, *size(events), alpha, side, clip)  # noqa: E731
    named = {"alpha": alpha, "patch": side, "clip": clip}
    assert dist(events, **named).tolist() == split(twin, events)
    assert dist(events, polarity="merged", **named).tolist() == twin(rows(events))


@given(streams(), st.integers(0, 100_000), st.sampled_from([0.1, 0.5, 0.9999]))
@settings(deadline=None, max_examples=60)
def test_tos_ts_equals_its_twin(events, later, level):
    t = int(events.t[-1]) + later
    expected = naive.tos_ts(rows(events), t, *size(events), 7, 241, 0.03, level)
    assert tos_ts(events, t, ts_threshold=level).tolist() == expected


@pytest.mark.parametrize("name", SURFACES)
@given(events=streams(), cuts=st.lists(st.integers(0, 120), max_size=4))
@settings(deadline=None, max_examples=20)
def test_streaming_equals_one_call(name, events, cuts):
    whole = SURFACES[name](*size(events))
    whole.update(events)
    pieces = SURFACES[name](*size(events))
    edges = [0, *sorted(min(c, len(events)) for c in cuts), len(events)]
    for a, b in pairwise(edges):
        pieces.update(events[a:b])
        pieces.render()
    np.testing.assert_array_equal(pieces.render(), whole.render())


def test_surfaces_equal_their_twins_on_a_real_recording(data):
    from data_tools.recordings.formats.events_text import read_events_text

    path = data / "slider_depth" / "events.txt.gz"
    events = next(read_events_text(path, 240, 180))[100_000:104_000]
    t = int(events.t[-1])
    listed = rows(events)
    decayed = naive.time_surface(listed, t, 240, 180, 0.03)
    np.testing.assert_allclose(time_surface(events), decayed, rtol=0, atol=1e-12)
    assert tos(events).tolist() == naive.tos(listed, 240, 180, 7, 241)
    assert tos_ts(events).tolist() == naive.tos_ts(listed, t, 240, 180, 7, 241, 0.03, 0.1)
    assert silc(events, polarity="merged").tolist() == naive.silc(listed, 240, 180, 6)
    expected = naive.dist(listed, listed[0][2], 240, 180, 3.0, 5, 0.99)
    assert dist(events, polarity="merged").tolist() == expected


def test_tos_of_three_events_by_hand():
    events = Events.from_arrays([1, 2, 1], [1, 1, 1], [0, 1, 2], [0, 1, 1], 4, 3)
    expected = [[0, 0, 0, 0], [0, 255, 254, 0], [0, 0, 0, 0]]
    assert tos(events, k=3).tolist() == expected


def test_silc_of_two_neighbours_by_hand():
    events = Events.from_arrays([1, 2, 1], [1, 1, 1], [0, 1, 2], [1, 1, 1], 4, 3)
    # The second event finds 9 >= 0 beside it; the third is at 8 and finds 9 >= 8.
    assert silc(events, r=1)[1].tolist() == [[0, 0, 0, 0], [0, 9, 8, 0], [0, 0, 0, 0]]
    assert not silc(events, r=1)[0].any()


def test_tos_is_255_minus_the_events_since_in_its_patch():
    events = random_events(30, 20, 3000, 5, 100)
    image = tos(events)
    for y in range(20):
        for x in range(30):
            own = np.flatnonzero((events.x == x) & (events.y == y))
            since = events[int(own[-1]) + 1 :] if own.size else events[:0]
            dx, dy = since.x.astype(int) - x, since.y.astype(int) - y
            later = int(((abs(dx) <= 3) & (abs(dy) <= 3)).sum())
            value = 255 - later if own.size else 0
            assert image[y, x] == (value if value >= 241 else 0)


def test_an_event_at_time_zero_counts_and_no_event_is_exactly_zero():
    events = Events.from_arrays([1], [0], [0], [True], 3, 2)
    assert time_surface(events, 0).tolist() == [[0, 1, 0], [0, 0, 0]]
    late = time_surface(events, 30_000)
    assert late[0, 1] == pytest.approx(math.exp(-1), abs=1e-15)
    assert np.count_nonzero(late) == 1
    assert tos_ts(events, 0)[0, 1] == 255


def test_time_surface_is_accurate_over_all_ages():
    ages = np.unique(np.geomspace(1, 65_000, 60_000).astype(np.int64))
    x = np.arange(ages.size)
    t = int(ages[-1])
    events = Events.from_arrays(x, 0 * x, np.sort(t - ages), x % 2, ages.size, 1)
    for tau in (0.0001, 0.03, 100.0):
        expected = np.exp((events.t - t) / (tau * 1e6))
        np.testing.assert_allclose(
            time_surface(events, t, tau=tau)[0], expected, rtol=0, atol=1e-14
        )


def test_time_surface_scales_with_tau_and_time():
    events = random_events(20, 20, 300, 1, 1000)
    slow = Events(events.x, events.y, 4 * events.t, events.p, 20, 20)
    a, b = time_surface(events, tau=0.01), time_surface(slow, tau=0.04)
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-14)


@pytest.mark.parametrize("function", [tos, silc, dist])
def test_speed_invariant_surfaces_do_not_see_the_speed(function):
    events = random_events(20, 20, 600, 2, 1000)
    slow = Events(events.x, events.y, 4 * events.t + 77, events.p, 20, 20)
    np.testing.assert_array_equal(function(events), function(slow))


def test_dist_clips_at_the_smallest_count_that_enough_pixels_do_not_exceed():
    x = [0, 1, 2, 2, 2, 3, 3, 3]
    events = Events.from_arrays(x, [0] * 8, np.arange(8) * 100, [1] * 8, 4, 1)
    # Counts 1, 1, 3, 3: half of the pixels do not exceed 1.
    expected = naive.dist(rows(events), 0, 4, 1, 1.0, 3, 0.5)
    assert dist(events, alpha=1.0, patch=3, clip=0.5)[1].tolist() == expected
    assert dist(events, alpha=1.0, patch=3, clip=0.51)[1].tolist() != expected


def test_tos_ts_lives_for_its_age_and_no_longer():
    events = Events.from_arrays([1], [0], [5], [True], 3, 2)
    # 30,000 us * ln 10 = 69,077.6 us
    assert tos_ts(events, 5 + 69_077).tolist() == [[0, 255, 0], [0, 0, 0]]
    assert not tos_ts(events, 5 + 69_078).any()
    for age in range(1, 3000, 37):
        level = math.exp(-age / 30_000)
        assert TosTs(3, 2, ts_threshold=level).max_age_us == age - 1
        assert TosTs(3, 2, ts_threshold=math.nextafter(level, 0)).max_age_us == age


def test_dist_ranks_lie_between_0_and_1_and_counts_of_single_pixels_vanish():
    lonely = Events.from_arrays([0, 9], [0, 9], [10, 20], [1, 1], 10, 10)
    assert not dist(lonely).any()
    crowded = dist(random_events(16, 16, 4000, 3, 10))
    assert crowded.min() >= 0
    assert crowded.max() < 1


def test_a_mirrored_stream_gives_mirrored_surfaces():
    events = random_events(31, 17, 800, 9, 700)
    mirrored = Events(30 - events.x, events.y, events.t, events.p, 31, 17)
    for function in (time_surface, tos, silc, dist, tos_ts):
        np.testing.assert_array_equal(function(mirrored), function(events)[..., ::-1])


def test_the_largest_times_do_not_overflow():
    events = Events.from_arrays([0, 1], [0, 0], [0, MAX_TIME_US], [1, 1], 2, 2)
    image = time_surface(events)
    assert 0 < image[0, 0] < 1e-300
    assert image.ravel()[1:].tolist() == [1, 0, 0]
    assert tos_ts(events).tolist() == [[0, 255], [0, 0]]
    assert tos_ts(events, tau=1e6, ts_threshold=1e-300)[0].tolist() == [254, 255]
    assert dist(events)[1, 0, 0] == 0


BASELINE = """
import numpy as np, hashlib
from evcalib.events import Events
from evcalib.surfaces import silc, time_surface, tos
rng = np.random.default_rng(0)
n = 20_000
events = Events.from_arrays(rng.integers(0, 61, n), rng.integers(0, 43, n),
                            np.arange(n) * 7, rng.integers(0, 2, n), 61, 43)
for image in (tos(events), silc(events), silc(events, r=8), time_surface(events)):
    print(hashlib.sha256(image.tobytes()).hexdigest())
"""


@pytest.mark.slow
def test_any_cpu_gives_the_same_bits():
    runs = []
    for cpu in ("generic", ""):
        env = {**os.environ, "NUMBA_CPU_NAME": cpu} if cpu else dict(os.environ)
        done = subprocess.run(
            [sys.executable, "-c", BASELINE], env=env, capture_output=True, text=True, check=True
        )
        runs.append(done.stdout)
    assert runs[0] == runs[1]
    assert len(runs[0].split()) == 4

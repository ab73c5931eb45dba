"""The pixels of the simulated sensor against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from data_tools.simulation.sensor import Sensor, events_from_video
from evcalib.errors import InputError

IDEAL = Sensor(threshold_on=0.25, threshold_off=0.25, mismatch=0.0, refractory=0.0, noise_rate=0.0)


def one_pixel(t, levels):
    return np.asarray(t), np.reshape(levels, (-1, 1, 1))


def test_a_ramp_reports_each_threshold_at_its_time():
    events = events_from_video(*one_pixel([0, 1_000_000], [0.0, 1.1]), IDEAL)
    expected = np.ceil(np.array([0.25, 0.5, 0.75, 1.0]) / 1.1 * 1e6)
    assert events.t.tolist() == expected.tolist()
    assert events.p.all()


def test_a_triangle_has_hysteresis():
    # up to 1.1: the reference ends at 1.0, so that the way down reports 0.75, 0.5 and 0.25
    events = events_from_video(*one_pixel([0, 1100, 2200], [0.0, 1.1, 0.0]), IDEAL)
    assert events.t.tolist() == [250, 500, 750, 1000, 1450, 1700, 1950, 2200]
    assert events.p.tolist() == [True] * 4 + [False] * 4


def test_thresholds_differ_by_polarity():
    sensor = Sensor(0.5, 0.125, mismatch=0.0, refractory=0.0, noise_rate=0.0)
    events = events_from_video(*one_pixel([0, 1024, 2048], [0.0, 1.0, 0.0]), sensor)
    assert events.t[events.p].tolist() == [512, 1024]
    assert events.t[~events.p].tolist() == [1024 + 128 * k for k in range(1, 9)]


def test_the_dead_time_adds_to_the_period():
    # the reference is memorised at the end of the dead time, so that the period is C / slope + dead
    sensor = Sensor(0.25, 0.25, mismatch=0.0, refractory=300e-6, noise_rate=0.0)
    t = np.arange(0, 20_001, 100)
    events = events_from_video(*one_pixel(t, t * 0.25e-3), sensor)
    assert events.t.tolist() == [1000 + 1300 * k for k in range(15)]


def test_one_step_or_many_give_the_same_events():
    levels = np.array([0.0, 3.0])
    fine = np.linspace(0, 4096, 257)
    events = events_from_video(*one_pixel([0, 4096], levels), IDEAL)
    same = events_from_video(*one_pixel(fine, np.interp(fine, [0, 4096], levels)), IDEAL)
    assert events.t.tolist() == same.t.tolist()


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.floats(-3, 3), min_size=2, max_size=20),
    st.floats(0.05, 0.6),
    st.floats(0.05, 0.6),
)
def test_the_intensity_at_an_event_is_the_sum_of_the_thresholds_so_far(levels, on, off):
    t = 1_000_000 * np.arange(len(levels))
    sensor = Sensor(on, off, mismatch=0.0, refractory=0.0, noise_rate=0.0)
    events = events_from_video(*one_pixel(t, levels), sensor)
    reference = levels[0] + np.cumsum(np.where(events.p, on, -off))
    # a time is at most 1 us late, in which the level moves by 6e-6 at most
    np.testing.assert_allclose(np.interp(events.t, t, levels), reference, rtol=0, atol=6.1e-6)
    last = reference[-1] if len(events) else levels[0]
    assert -off - 1e-9 < levels[-1] - last < on + 1e-9


def test_count_is_change_over_threshold():
    rng = np.random.default_rng(5)
    change = rng.uniform(-4, 4, (12, 17))
    video = np.stack([np.zeros_like(change), change])
    events = events_from_video([0, 10_000], video, IDEAL)
    count = np.zeros(change.shape, dtype=int)
    np.add.at(count, (events.y, events.x), 1)
    np.testing.assert_array_equal(count, np.floor(np.abs(change) / 0.25))
    np.testing.assert_array_equal(events.p, change[events.y, events.x] > 0)


def test_nothing_happens_without_change_and_noise():
    assert len(events_from_video([0, 5, 10**6], np.full((3, 4, 5), -0.7), IDEAL)) == 0


def test_noise_is_a_poisson_process_of_the_rate_asked_for():
    sensor = Sensor(mismatch=0.0, refractory=0.0, noise_rate=5.0)
    events = events_from_video([0, 4_000_000], np.zeros((2, 50, 60)), sensor, seed=2)
    expected = 5.0 * 4.0 * 3000
    assert abs(len(events) - expected) < 4 * np.sqrt(expected)
    assert abs(events.p.mean() - 0.5) < 4 * 0.5 / np.sqrt(expected)
    per_pixel = np.bincount(events.y.astype(int) * 60 + events.x, minlength=3000)
    assert per_pixel.var() / per_pixel.mean() == pytest.approx(1.0, abs=4 * np.sqrt(2 / 3000))
    assert stats.kstest(first_times(events)[first_times(events) < 4.0] * 5.0, "expon").pvalue > 1e-3


def first_times(events):
    """Time [s] of the first event of each pixel, infinite without."""
    first = np.full(events.shape, np.inf)
    np.minimum.at(first, (events.y, events.x), 1e-6 * events.t)
    return first


def test_a_noise_event_resets_the_pixel():
    # slope 1 per second, threshold 0.9: 0.9 s after any event comes the next, or noise before it
    sensor = Sensor(0.9, 0.9, mismatch=0.0, refractory=0.0, noise_rate=0.2)
    ramp = np.stack([np.zeros((20, 20)), np.full((20, 20), 10.0)])
    events = events_from_video([0, 10_000_000], ramp, sensor)
    pixel = events.y.astype(int) * 20 + events.x
    gaps = np.concatenate([np.diff(events.t[pixel == k], prepend=0) for k in range(400)])
    assert gaps.max() <= 900_001
    expected = 0.2 * 10 * 400
    assert abs((gaps < 899_999).sum() - expected) < 4 * np.sqrt(expected)


def test_dead_time_bounds_the_rate_of_noise_too():
    sensor = Sensor(mismatch=0.0, refractory=0.05, noise_rate=100.0)
    events = events_from_video([0, 2_000_000], np.zeros((2, 20, 30)), sensor)
    assert abs(len(events) - 2 * 600 / (0.01 + 0.05)) < 300
    pixel = events.y.astype(int) * 30 + events.x
    order = np.lexsort((events.t, pixel))
    same = np.diff(pixel[order]) == 0
    assert np.diff(events.t[order])[same].min() >= 49_999


def test_mismatch_is_per_pixel_and_polarity():
    sensor = Sensor(0.4, 0.2, mismatch=0.1, refractory=0.0, noise_rate=0.0)
    ramp = np.stack([np.zeros((80, 80)), np.full((80, 80), 1.0)])
    on = first_times(events_from_video([0, 1_000_000], ramp, sensor, seed=9))
    off = first_times(events_from_video([0, 1_000_000], -ramp, sensor, seed=9))
    assert on.mean() == pytest.approx(0.4, abs=4 * 0.04 / 80)
    assert on.std() == pytest.approx(0.04, rel=0.05)
    assert off.mean() == pytest.approx(0.2, abs=4 * 0.02 / 80)
    assert off.std() == pytest.approx(0.02, rel=0.05)
    assert abs(np.corrcoef(on.ravel(), off.ravel())[0, 1]) < 0.05


def test_ties_go_by_row_then_column():
    video = np.stack([np.zeros((5, 7)), np.ones((5, 7))])
    events = events_from_video([0, 1000], video, IDEAL)
    order = np.lexsort((events.x, events.y, events.t))
    np.testing.assert_array_equal(order, np.arange(len(events)))
    assert len(events) == 4 * 35


def test_the_seed_decides():
    video = np.random.default_rng(0).normal(size=(6, 9, 9))
    sensor = Sensor(noise_rate=1000.0, mismatch=0.1)
    first, again, other = (
        events_from_video(1000 * np.arange(6), video, sensor, seed=s) for s in (1, 1, 2)
    )
    for name in "xytp":
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert not np.array_equal(first.t, other.t)


@pytest.mark.parametrize(
    ("settings_", "message"),
    [
        ({"threshold_on": 0.0}, "threshold_on must be a positive number"),
        ({"mismatch": -0.1}, "mismatch must be a number of at least 0"),
        ({"noise_rate": np.inf}, "noise_rate must be a number of at least 0"),
    ],
)
def test_unusable_sensors(settings_, message):
    with pytest.raises(InputError, match=message):
        Sensor(**settings_)


@pytest.mark.parametrize(
    ("t", "shape", "message"),
    [
        ([0, 0], (2, 3, 3), "t_us must increase"),
        ([0, 0.5], (2, 3, 3), "whole microseconds"),
        ([0], (1, 3, 3), "two frames"),
        ([0, 1], (2, 3), "shape"),
    ],
)
def test_unusable_videos(t, shape, message):
    with pytest.raises(InputError, match=message):
        events_from_video(t, np.zeros(shape))


def test_a_negative_seed_is_refused():
    with pytest.raises(InputError, match="seed"):
        events_from_video([0, 1], np.zeros((2, 3, 3)), seed=-1)

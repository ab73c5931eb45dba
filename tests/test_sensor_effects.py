"""What slow, dim, leaking, hot and flickering pixels report, and how it is read: closed forms."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.simulation._readout_kernels import serve_rows
from data_tools.simulation.recorded_drive import Disturbances, record_drive
from data_tools.simulation.sensor import Sensor, events_from_video
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.events import Events

IDEAL = {"mismatch": 0.0, "refractory": 0.0, "noise_rate": 0.0}
PLAIN = Sensor(**IDEAL)


def one_pixel(t, levels):
    return np.asarray(t), np.reshape(levels, (-1, 1, 1))


@pytest.mark.parametrize("cutoff", [20.0, 200.0])
@pytest.mark.parametrize("light", [0.1, 1.0])
def test_a_step_comes_through_as_one_pole(cutoff, light):
    """y = D (1 - exp(-t / tau)), with the bandwidth of the light after the step."""
    sensor = Sensor(0.05, 0.05, cutoff=cutoff, light=light, **IDEAL)
    level = -0.5
    tau = 1e6 / (2 * np.pi * cutoff * light * np.exp(level))
    t = [0, 1, int(12 * tau)]
    events = events_from_video(*one_pixel(t, [level - 1.02, level, level]), sensor)
    expected = -tau * np.log(1.0 - 0.05 * np.arange(1, 21) / 1.02)
    assert events.p.all()
    np.testing.assert_allclose(events.t, expected, rtol=0.02, atol=0.02 * tau + 2)


def test_a_slow_wave_is_late_by_the_time_constant_and_a_fast_one_is_damped():
    """Amplitude 1 / sqrt(1 + (w tau)^2) and delay arctan(w tau) / w, for little contrast."""
    tau, size = 1.0 / (2 * np.pi * 50.0), 0.2
    t = np.arange(0, 4_000_001, 250)
    for hertz in (2.0, 80.0):
        w = 2 * np.pi * hertz
        video = one_pixel(t, size * np.sin(1e-6 * w * t))
        events = events_from_video(*video, Sensor(0.002, 0.002, cutoff=50.0, **IDEAL))
        signal = 0.002 * np.cumsum(np.where(events.p, 1, -1))
        when = 1e-6 * events.t
        late = when > 1.0
        parts = np.stack([np.sin(w * when[late]), np.cos(w * when[late]), np.ones(late.sum())], 1)
        a, b, _ = np.linalg.lstsq(parts, signal[late], rcond=None)[0]
        assert np.hypot(a, b) == pytest.approx(size / np.hypot(1, w * tau), rel=0.04)
        assert np.arctan2(-b, a) / w == pytest.approx(np.arctan(w * tau) / w, rel=0.05)


def naive_low_pass(t, levels, cutoff):
    """Return the low-pass on a grid of 10 us: Euler steps of dy = (x - y) 2 pi cutoff exp(x)."""
    fine = np.arange(t[0], t[-1] + 1, 10.0)
    x = np.interp(fine, t, levels)
    y = np.empty_like(x)
    y[0] = x[0]
    for k in range(1, x.size):
        rate = 2e-5 * np.pi * cutoff * np.exp(x[k])
        y[k] = y[k - 1] + (x[k] - y[k - 1]) * min(rate, 1.0)
    return fine, y


def test_the_low_pass_against_small_steps():
    """Light that wanders by a factor of ten; the signal at each event is known from the count."""
    rng = np.random.default_rng(3)
    t = np.arange(0, 400_001, 2000)
    levels = np.interp(t, np.arange(0, 400_001, 40_000), rng.uniform(-2.5, 0.0, 11))
    fine, y = naive_low_pass(t, levels, 60.0)
    events = events_from_video(*one_pixel(t, levels), Sensor(0.05, 0.05, cutoff=60.0, **IDEAL))
    told = levels[0] + 0.05 * np.cumsum(np.where(events.p, 1, -1))
    assert len(events) > 100
    assert np.abs(np.interp(events.t, fine, y) - told).max() < 0.02


def test_leak_makes_on_events_at_its_rate():
    sensor = Sensor(leak_rate=0.5, **IDEAL)
    events = events_from_video([0, 20_000_000], np.zeros((2, 40, 50)), sensor, seed=1)
    assert events.p.all()
    assert len(events) == pytest.approx(0.5 * 20 * 2000, abs=2000)
    first = np.sort(1e-6 * events.t[:1000])
    # Anywhere in the period of 2 s: 1000 of 2000 pixels within the first second.
    assert first[-1] == pytest.approx(1.0, abs=0.1)


def test_pixels_of_low_thresholds_leak_faster():
    sensor = Sensor(0.2, 0.2, **{**IDEAL, "mismatch": 0.2}, leak_rate=2.0)
    events = events_from_video([0, 50_000_000], np.zeros((2, 10, 10)), sensor, seed=1)
    rate = np.bincount(events.y.astype(int) * 10 + events.x, minlength=100) / 50.0
    expected = 2.0 * 0.2 / sensor.new_state(100, 1)[:, 5]
    np.testing.assert_allclose(rate, expected, atol=0.03)


def test_hot_pixels_are_few_and_fire_at_their_rate():
    sensor = Sensor(hot_pixels=0.02, hot_rate=200.0, **IDEAL)
    events = events_from_video([0, 2_000_000], np.zeros((2, 60, 80)), sensor, seed=4)
    count = np.bincount(events.y.astype(int) * 80 + events.x, minlength=4800)
    hot = count > 0
    assert abs(hot.sum() - 96) < 4 * np.sqrt(96)
    assert count[hot].mean() == pytest.approx(400, abs=4 * np.sqrt(400 / hot.sum()))


@pytest.mark.parametrize("light", [0.05, 0.5, 1.0])
def test_shot_noise_falls_with_the_light(light):
    """v2e's rate: all of it in the dark, a quarter in full light."""
    sensor = Sensor(shot_noise=6.0, light=light, **{**IDEAL, "noise_rate": 1.0})
    events = events_from_video([0, 4_000_000], np.zeros((2, 50, 60)), sensor, seed=2)
    expected = (1.0 + 6.0 * (1.0 - 0.75 * light)) * 4.0 * 3000
    assert abs(len(events) - expected) < 4 * np.sqrt(expected)
    assert abs(events.p.mean() - 0.5) < 4 * 0.5 / np.sqrt(expected)


@pytest.mark.parametrize("hertz", [100.0, 120.0])
def test_flicker_is_a_line_in_the_spectrum(hertz):
    """Each period tells the range of the logarithm up and down again, in thresholds."""
    sensor = Sensor(0.03, 0.03, flicker=0.2, flicker_rate=hertz, **IDEAL)
    events = events_from_video([0, 1_000_000], np.zeros((2, 4, 5)), sensor)
    swing = np.log(1.2 / 0.8)
    assert len(events) == pytest.approx(20 * hertz * 2 * np.floor(swing / 0.03), rel=0.08)
    rate = np.bincount(events.t[events.p] // 1000, minlength=1000)[:1000]
    power = np.abs(np.fft.rfft(rate - rate.mean())) ** 2
    assert power.argmax() == hertz


def test_dim_light_alone_changes_nothing_but_the_logarithm():
    """Where nothing depends on the light, contrast is contrast."""
    t = np.arange(0, 1_000_001, 10_000)
    video = one_pixel(t, np.sin(3e-6 * t))
    dim = events_from_video(*video, Sensor(light=0.1, **IDEAL))
    assert dim.t.tolist() == events_from_video(*video, PLAIN).t.tolist()


def naive_rows(t, y, row_time, event_time):
    """Serve rows one by one, from a list of what waits."""
    waiting, free, out = list(range(len(t))), 0.0, []
    while waiting:
        now = max(free, t[waiting[0]])
        row = y[waiting[0]]
        read = [k for k in waiting if t[k] <= now and y[k] == row]
        free = now + row_time
        out += [(int(np.ceil(free)), k) for k in read]
        free += event_time * len(read)
        waiting = [k for k in waiting if k not in read]
    return out, free


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(st.integers(0, 60), st.integers(0, 4)), min_size=1, max_size=40),
    st.integers(0, 12),
    st.sampled_from([0.0, 0.25, 2.0]),
)
def test_the_arbiter_against_a_list(events, row_time, event_time):
    t, y = np.array(sorted(events)).T
    out, order, free = serve_rows(t, y, 5, (float(row_time), event_time, 0.0))
    expected, last = naive_rows(t, y, row_time, event_time)
    assert list(zip(out.tolist(), order.tolist(), strict=True)) == expected
    assert free == pytest.approx(last)
    assert (np.diff(out) >= 0).all()


def busy(rate, duration, seed=0, **sensor):
    """Return events at random, before and after their readout."""
    rng = np.random.default_rng(seed)
    n = int(rate * duration)
    t = np.sort(rng.integers(0, int(1e6 * duration), n))
    x, y, p = rng.integers(0, 40, n), rng.integers(0, 30, n), rng.random(n) < 0.5
    before = Events.from_arrays(x, y, t, p, 40, 30)
    return before, Sensor(**sensor).readout(seed)


def test_a_readout_that_has_nothing_to_do_returns_what_it_gets():
    before, readout = busy(1e4, 0.1)
    assert readout.carry(before) is before


def test_a_readout_that_keeps_up_is_late_by_a_row_and_a_little():
    before, readout = busy(1e4, 1.0, row_time=2e-6)
    after = readout.carry(before)
    assert len(after) == len(before)
    # An M/D/1 queue of load 0.02 waits load / (2 (1 - load)) of a service on average.
    assert after.t.mean() - before.t.mean() == pytest.approx(2.0, abs=0.6)


def test_a_readout_that_is_overrun_falls_behind():
    before, readout = busy(1e6, 0.1, event_time=2e-6)
    after = readout.carry(before)
    assert after.t[-1] == pytest.approx(2e5, rel=0.01)


def test_a_readout_in_pieces_keeps_the_order():
    before, readout = busy(3e5, 0.2, row_time=3e-6, event_time=1e-6)
    cuts = np.searchsorted(before.t, [0, 70_000, 130_000, 200_001])
    pieces = [readout.carry(before[a:b]) for a, b in pairwise(cuts)]
    t = np.concatenate([piece.t for piece in pieces])
    assert t.size == len(before)
    assert (np.diff(t) >= 0).all()


def test_gaps_lose_their_share():
    """Gaps and what lies between them take turns: a share of g r / (1 + g r) is lost."""
    before, readout = busy(1e4, 60.0, gap_rate=2.0, gap=0.05)
    cuts = np.searchsorted(before.t, np.arange(0, 61_000_000, 200_000))
    kept = sum(len(readout.carry(before[a:b])) for a, b in pairwise(cuts))
    assert kept / len(before) == pytest.approx(1 / 1.1, abs=0.03)
    once = busy(1e4, 60.0, gap_rate=2.0, gap=0.05)[1].carry(before)
    assert len(once) == kept, "however the stream is cut"
    assert np.diff(once.t).max() >= 50_000


def test_stamps_are_multiples():
    before, readout = busy(1e4, 0.5, stamp=1e-3)
    after = readout.carry(before)
    assert not (after.t % 1000).any()
    assert (before.t - after.t).max() <= 999


def test_effects_do_not_depend_on_threads():
    sensor = Sensor(
        cutoff=80.0, light=0.3, shot_noise=2.0, leak_rate=0.3, hot_pixels=0.01, flicker=0.1,
        row_time=1e-6, event_time=1e-7, gap_rate=0.5,
    )  # fmt: skip

    lens = Camera(32, 24, 30.0, 30.0, 15.5, 11.5)
    made = record_drive(1, duration=0.9, camera=lens, disturbances=Disturbances(sensor))
    one, two = (Events.concatenate(list(made.simulator.stream(threads=k))) for k in (1, 2))
    assert len(one) > 1000
    for name in "txyp":
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


@pytest.mark.parametrize("wrong", [
    {"light": 0.0}, {"cutoff": -1.0}, {"flicker": 1.0}, {"hot_pixels": 2.0},
    {"leak_rate": np.nan}, {"row_time": -1e-6}, {"flicker_rate": 0.0},
])  # fmt: skip
def test_unusable_settings_are_refused(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        Sensor(**wrong)

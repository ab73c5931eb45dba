"""The filters of noise, hot pixels and flicker: their slow twin, closed forms, real recordings."""

from itertools import pairwise

import naive_filters
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import evcalib
from data_tools.recordings import open_recording
from data_tools.simulation.recorded_drive import CAMERA
from data_tools.simulation.sensor import Sensor
from data_tools.simulation.simulator import simulate_translation
from evcalib import Events, InputError
from evcalib.filters import Denoiser, denoise
from evcalib.filters import _denoiser as filters
from evcalib.filters import _noise_rate as rates
from evcalib.kernels.events import EventColumns
from evcalib.kernels.filters import support as kernels

WIDTH, HEIGHT = 64, 48


def poisson(rate, seconds, *, width=WIDTH, height=HEIGHT, seed=0):
    """Return pure noise of both polarities."""
    rng = np.random.default_rng(seed)
    n = rng.poisson(rate * width * height * seconds)
    t = np.sort(rng.integers(0, int(1e6 * seconds), n))
    x, y, p = rng.integers(0, width, n), rng.integers(0, height, n), rng.random(n) < 0.5
    return Events(x, y, t, p, width, height)


def bar(seconds, *, speed=60.0, width=WIDTH, height=HEIGHT, noise=None):
    """Return a vertical edge that crosses the image again and again, and which events it made."""
    rng = np.random.default_rng(1)
    y, x = np.meshgrid(np.arange(height), np.arange(int(speed * seconds)))
    t = 1e6 * (x + rng.uniform(-0.4, 0.4, x.shape)) / speed
    t = np.clip(t, 0, None).ravel().astype(np.int64)
    x, y, p = x.ravel() % width, y.ravel(), np.ones(t.size, dtype=bool)
    made = np.ones(t.size, dtype=bool)
    if noise is not None:
        more = (noise.t, noise.x, noise.y, noise.p)
        t, x, y, p = map(np.concatenate, zip((t, x, y, p), more, strict=True))
        made = np.concatenate([made, np.zeros(len(noise), dtype=bool)])
    order = np.argsort(t, kind="stable")
    return Events(x[order], y[order], t[order], p[order], width, height), made[order]


def fresh(width, height):
    return kernels.State(
        last=np.full((2, height + 2, width + 2), kernels.NEVER),
        hot=np.zeros((height, width), dtype=bool),
        fired=np.zeros((height, width), dtype=np.int32),
        band=np.zeros((height, width), dtype=np.uint8),
        level=np.zeros((height, width), dtype=np.uint8),
    )


@st.composite
def streams(draw):
    width, height = draw(st.integers(1, 20)), draw(st.integers(1, 20))
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    n = draw(st.integers(0, 400))
    t = np.sort(rng.integers(0, draw(st.sampled_from([50, 5_000, 900_000])) + 1, n))
    x, y = rng.integers(0, width, n), rng.integers(0, height, n)
    return Events(x, y, t, rng.random(n) < 0.5, width, height)


@settings(max_examples=60, deadline=None)
@given(
    streams(), st.integers(1, 60_000), st.integers(1, 8), st.integers(0, 3), st.integers(0, 2**31)
)
def test_the_kernel_does_what_its_slow_twin_does(events, within_us, support, band, seed):
    state = fresh(events.width, events.height)
    state.hot[:] = np.random.default_rng(seed).random(state.hot.shape) < 0.1
    hot = {(x, y) for y, x in np.argwhere(state.hot).tolist()}
    flags = np.zeros(len(events), dtype=bool)
    state.band[:] = band
    limits = kernels.Limits(within_us, rates.ALONE_US, support, band > 0)
    of_hot, flickered = kernels.neighbours(EventColumns.of(events), state, limits, flags, None)
    told = naive_filters.neighbours(
        events.x, events.y, events.t, events.p,
        within_us=within_us, support=support, hot=hot, band=band,
    )  # fmt: skip
    assert (flags.tolist(), flickered) == told
    assert state.fired.sum() == len(events)
    assert of_hot == sum((x, y) in hot for x, y in zip(events.x, events.y, strict=True))


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 12), st.integers(1, 12), st.integers(0, 2**31))
def test_hot_pixels_are_those_of_the_slow_twin(width, height, seed):
    heat = np.random.default_rng(seed).exponential(20.0, (height, width)) ** 2
    hot = np.zeros((height, width), dtype=bool)
    kernels.find_hot(heat, 5.0, 10.0, hot)
    assert {(x, y) for y, x in np.argwhere(hot).tolist()} == naive_filters.hot_pixels(
        heat, 5.0, 10.0
    )


@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(0, 30_000), max_size=8), st.sampled_from([0.0, 0.3]))
def test_a_stream_may_be_cut_anywhere(cuts, flicker):
    events, _ = bar(1.5, noise=poisson(6.0, 1.5))
    if flicker:
        events = lit(events, 100)
    whole = Denoiser(WIDTH, HEIGHT)
    flags = whole.update(events)
    pieces = Denoiser(WIDTH, HEIGHT)
    edges = [0, *sorted(min(cut, len(events)) for cut in cuts), len(events)]
    parts = [pieces.update(events[a:b]) for a, b in pairwise(edges)]
    assert np.array_equal(np.concatenate(parts), flags)
    assert pieces.noise == whole.noise


@pytest.mark.parametrize(("rate", "within"), [(1.0, 0.02), (5.0, 0.01), (10.0, 0.01)])
@pytest.mark.parametrize("support", [1, 2, 3])
def test_of_pure_noise_the_expected_share_stays(rate, within, support):
    noise = poisson(rate, 400_000 / (rate * 128 * 96), width=128, height=96)
    kept = Denoiser(128, 96, support=support, within=within).update(noise)
    inside = (noise.x > 0) & (noise.x < 127) & (noise.y > 0) & (noise.y < 95)
    inside &= noise.t > 1e6 * within
    share = rates.share_within(rate, within, support)
    if support == 1:
        assert share == pytest.approx(1.0 - np.exp(-8.0 * 0.5 * rate * within))
    n = inside.sum()
    # Neighbours share their neighbours, so that the scatter is a little wider than a binomial's.
    assert abs(kept[inside].mean() - share) < 6.0 * np.sqrt(share * (1 - share) / n) + 1e-4


@pytest.mark.parametrize("rate", [1.0, 3.0, 10.0, 30.0])
def test_the_noise_is_measured(rate):
    denoiser = Denoiser(240, 180)
    denoiser.update(poisson(rate, 1.2, width=240, height=180))
    assert denoiser.noise.rate == pytest.approx(rate, rel=0.15)
    share = rates.share_within(denoiser.noise.rate, denoiser.within, filters.SUPPORT)
    assert share < 1.02 * filters.SHARE


def test_noise_goes_and_edges_stay():
    noise = poisson(5.0, 3.0)
    events, made = bar(3.0, noise=noise)
    kept = Denoiser(WIDTH, HEIGHT).update(events)
    later = events.t > 1_000_000
    assert kept[later & made].mean() > 0.9
    assert kept[later & ~made].mean() < 0.25


def test_a_sensor_without_noise_keeps_all():
    events, _ = bar(2.0)
    denoiser = Denoiser(WIDTH, HEIGHT)
    assert denoiser.update(events).all()
    assert denoiser.noise.kept == denoiser.noise.events == len(events)
    assert denoiser.within == 0.0


def test_little_noise_stays():
    """As much of it as texture that moves may pass for."""
    denoiser = Denoiser(240, 180)
    assert denoiser.update(poisson(1.5, 1.2, width=240, height=180)).all()
    assert denoiser.noise.rate > 1.0


def test_an_interruption_does_not_end_the_filter():
    noise = poisson(5.0, 3.0)
    there = (noise.t < 1_500_000) | (noise.t > 1_750_000)
    events = noise[there]
    kept = Denoiser(WIDTH, HEIGHT).update(events)
    after = events.t > 1_750_000
    assert kept[after].mean() < 0.2


def test_pixels_far_hotter_than_their_neighbours_go():
    events, _ = bar(3.0)
    n = 3 * 400
    t = np.sort(np.random.default_rng(3).integers(0, 3_000_000, n))
    hot = Events(np.where(np.arange(n) % 2, 20, 21), np.full(n, 17), t, t % 2 == 0, WIDTH, HEIGHT)
    both = np.concatenate([events.t, hot.t])
    order = np.argsort(both, kind="stable")
    x, y, p = (np.concatenate([getattr(events, name), getattr(hot, name)])[order] for name in "xyp")
    stream = Events(x, y, both[order], p, WIDTH, HEIGHT)
    denoiser = Denoiser(WIDTH, HEIGHT)
    kept = denoiser.update(stream)
    from_hot = (stream.y == 17) & np.isin(stream.x, [20, 21]) & (stream.t > 400_000)
    assert not kept[from_hot].any()
    assert kept[~from_hot & (stream.t > 400_000)].all()
    assert denoiser.noise.hot_pixels == 2
    assert denoiser.noise.hot == from_hot.sum() + np.count_nonzero(~kept & ~from_hot)


def lit(events, rate, *, seed=5):
    """Return events under lamps: each pixel goes up and down by one event in each cycle."""
    rng = np.random.default_rng(seed)
    seconds = 1e-6 * events.t[-1]
    cycles = np.arange(int(seconds * rate))
    shape = (cycles.size, events.height, events.width)
    up, down = (
        ((cycles[:, None, None] + rng.uniform(a, a + 0.3, shape)) * 1e6 / rate).astype(np.int64)
        for a in (0.1, 0.6)
    )
    y, x = np.indices(shape[1:])
    flicker = [np.broadcast_to(side, shape).ravel() for side in (x, y)]
    t = np.concatenate([events.t, up.ravel(), down.ravel()])
    order = np.argsort(t, kind="stable")
    x, y = (
        np.concatenate([own, side, side])
        for own, side in zip((events.x, events.y), flicker, strict=True)
    )
    p = np.concatenate([events.p, np.ones(up.size, bool), np.zeros(down.size, bool)])
    return Events(x[order], y[order], t[order], p[order], events.width, events.height)


@pytest.mark.parametrize("rate", [100, 120])
def test_flicker_of_lamps_goes(rate):
    events, _ = bar(2.0)
    stream = lit(events, rate)
    denoiser = Denoiser(WIDTH, HEIGHT)
    kept = denoiser.update(stream)
    assert denoiser.noise.lamps == rate
    # What remains after the first period is as much as the edge made.
    late = stream.t > 400_000
    assert kept[late].sum() < 1.2 * np.count_nonzero(events.t > 400_000)
    assert kept[late].sum() > 0.5 * np.count_nonzero(events.t > 400_000)


def test_whole_milliseconds_are_no_flicker():
    """Stamps cut to 10 ms come at one phase, but both polarities at the same."""
    events, _ = bar(2.0, noise=poisson(20.0, 2.0))
    cut = Events(
        events.x, events.y, events.t // 10_000 * 10_000, events.p, events.width, events.height
    )
    denoiser = Denoiser(WIDTH, HEIGHT)
    denoiser.update(cut)
    assert denoiser.noise.lamps == 0


def test_headings_are_found_in_spite_of_noise():
    """Noise of 5 Hz per pixel, on events of a camera that moves to the right and ahead."""
    direction = np.array([0.8, 0.0, 0.6])
    sensor = Sensor(noise_rate=5.0)
    events = simulate_translation(direction, 0.5, 1.5, CAMERA, seed=8, sensor=sensor).events
    without = evcalib.estimate_headings(events, CAMERA, denoise=False)
    found = evcalib.estimate_headings(events, CAMERA)
    assert without.noise is None
    assert len(found.headings) > len(without.headings) + 5
    assert found.noise.events == found.counts.events == len(events)
    assert found.noise.kept < 0.9 * len(events)
    apart = np.degrees(np.arccos(np.clip(found.headings.v @ direction, -1, 1)))
    assert np.median(apart) < 1.0


REAL = {
    "slider_depth/events.txt.gz": (240, 180),
    "motion/garfield.txt.gz": (128, 128),
    "motion/stripes.txt.gz": (128, 128),
    "rotation/evbench/seq_0003.txt.gz": (240, 180),
    "still/atis_car.txt.gz": (304, 240),
    "still/emlb.aedat4": None,
    "formats/ros2_libcaer.mcap": None,
}


@pytest.mark.parametrize("name", REAL)
def test_real_recordings_by_day_are_left_as_they_are(name, data):
    """Hot pixels aside, which some have: 2 % of their events at most."""
    denoiser = None
    for piece in open_recording(data / name, size=REAL[name]):
        denoiser = denoiser or Denoiser(piece.width, piece.height)
        denoiser.update(piece)
    noise = denoiser.noise
    assert (noise.unsupported, noise.flicker, noise.lamps) == (0, 0, 0)
    assert noise.hot <= 0.02 * noise.events


def test_a_real_recording_under_lamps_is_told_so(data):
    """The spokes of a disk, in a country of 50 Hz; few pixels flicker all the time."""
    events = Events.concatenate(
        list(open_recording(data / "rotation/disk/events.txt.gz", size=(240, 180)))
    )
    denoiser = Denoiser(240, 180)
    kept = denoiser.update(events)
    assert denoiser.noise.lamps == 100
    assert kept.mean() > 0.9


def test_the_function_gives_the_events_that_stay():
    events, _ = bar(1.0, noise=poisson(5.0, 1.0))
    chosen = Denoiser(WIDTH, HEIGHT, support=1, within=0.004)
    flags = chosen.update(events)
    kept = evcalib.denoise(events, support=1, within=0.004)
    assert np.array_equal(kept.t, events.t[flags])
    assert len(denoise(Events.empty(3, 2))) == 0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"support": 0}, "support must be 1 to 8"),
        ({"support": 1.5}, "support must be 1 to 8"),
        ({"share": 1.0}, "share must be between 0 and 1"),
        ({"share": 0.0}, "share"),
        ({"within": -1.0}, "within"),
        ({"within": 1e9}, "within must be"),
    ],
)
def test_unusable_options_are_refused(options, said):
    with pytest.raises(InputError, match=said):
        Denoiser(4, 4, **options)


def test_what_is_no_stream_is_refused():
    denoiser = Denoiser(WIDTH, HEIGHT)
    with pytest.raises(InputError, match="events must be Events"):
        denoise([1, 2, 3])
    with pytest.raises(InputError, match="was made for"):
        denoiser.update(Events.empty(3, 2))
    events = poisson(1.0, 0.1)
    denoiser.update(events)
    with pytest.raises(InputError, match="before the"):
        denoiser.update(events)

"""Surfaces against scalar loops and pip-installable peers: 5 million events at 346x260.

Run with ``pytest tests/benchmarks/test_bench_surfaces.py --benchmark-only``; the column
``Mev/s`` of the JSON (``--benchmark-json``), printed at the end with ``-s``, is what matters.
Peers that are not installed are skipped.  Each competitor's image is checked first.
"""

import numba
import numpy as np
import pytest

from evcalib.events import Events
from evcalib.surfaces import Dist, Silc, TimeSurface, Tos, TosTs

WIDTH, HEIGHT, N, SECONDS = 346, 260, 5_000_000, 1.0
FRAME_US, TAU = 10_000, 0.03


@pytest.fixture(scope="module")
def events():
    """Forty slanted edges that cross the image at 200 to 600 px/s, with jitter."""
    rng = np.random.default_rng(0)
    edge = rng.integers(0, 40, N)
    speed, slope = rng.uniform(200, 600, 40)[edge], rng.uniform(-1, 1, 40)[edge]
    t = np.sort(rng.integers(0, int(SECONDS * 1e6), N))
    y = rng.integers(0, HEIGHT, N)
    x = rng.uniform(0, WIDTH, 40)[edge] + slope * y + speed * t * 1e-6 + rng.normal(0, 0.5, N)
    return Events.from_arrays(np.floor(x).astype(int) % WIDTH, y, t, edge % 2, WIDTH, HEIGHT)


@pytest.fixture
def race(benchmark):
    """Time a call on prepared state and note how many events it takes per second."""

    def run(group, setup, call, n=N, rounds=15):
        benchmark.group = f"{group} (5 million events)" if n == N else group
        benchmark.pedantic(call, setup=lambda: ((setup(),), {}), rounds=rounds, warmup_rounds=1)
        rate = n / benchmark.stats.stats.min / 1e6
        benchmark.extra_info["Mev/s"] = round(rate, 1)
        print(f"\n{benchmark.group}: {benchmark.name}: {rate:.1f} million events per second")

    return run


def scalar(function):
    return numba.njit(nogil=True, error_model="numpy")(function)


@scalar
def tos_loop(image, x, y, k, threshold):
    height, width = image.shape
    reach = k // 2
    for i in range(x.size):
        col, row = np.int64(x[i]), np.int64(y[i])
        for v in range(max(0, row - reach), min(height, row + reach + 1)):
            for u in range(max(0, col - reach), min(width, col + reach + 1)):
                value = image[v, u]
                image[v, u] = value - 1 if value > threshold else 0
        image[row, col] = 255


@scalar
def silc_loop(image, x, y, p, r):
    _, height, width = image.shape
    for i in range(x.size):
        col, row, plane = np.int64(x[i]), np.int64(y[i]), np.int64(p[i])
        centre = max(image[plane, row, col], 1)
        for v in range(max(0, row - r), min(height, row + r + 1)):
            for u in range(max(0, col - r), min(width, col + r + 1)):
                if image[plane, v, u] >= centre:
                    image[plane, v, u] -= 1
        image[plane, row, col] = (2 * r + 1) ** 2


@scalar
def sae_loop(image, x, y, t, p):
    for i in range(t.size):
        image[np.int64(p[i]), y[i], x[i]] = t[i]


@scalar
def decay_loop(sae, t, tau_us, out):
    for p in range(sae.shape[0]):
        for v in range(sae.shape[1]):
            for u in range(sae.shape[2]):
                last = sae[p, v, u]
                out[p, v, u] = np.exp((last - t) / tau_us) if last >= 0 else 0.0


def fed(surface, events):
    surface.update(events)
    return surface


def test_tos(race, events):
    race("TOS 7x7", lambda: Tos(WIDTH, HEIGHT), lambda surface: surface.update(events))


def test_tos_scalar_numba(race, events):
    def call(image):
        tos_loop(image, events.x, events.y, 7, 241)

    image = np.zeros((HEIGHT, WIDTH), np.uint8)
    call(image)
    np.testing.assert_array_equal(image, fed(Tos(WIDTH, HEIGHT), events).render())
    race("TOS 7x7", lambda: np.zeros_like(image), call)


def test_silc(race, events):
    race("SILC r = 6", lambda: Silc(WIDTH, HEIGHT), lambda surface: surface.update(events))


def test_silc_scalar_numba(race, events):
    def call(image):
        silc_loop(image, events.x, events.y, events.p, 6)

    image = np.zeros((2, HEIGHT, WIDTH), np.uint8)
    call(image)
    np.testing.assert_array_equal(image, fed(Silc(WIDTH, HEIGHT), events).render())
    race("SILC r = 6", lambda: np.zeros_like(image), call, rounds=3)


@pytest.fixture(scope="module")
def store(events):
    dv = pytest.importorskip("dv_processing")
    store = dv.EventStore()
    rows = (getattr(events, name).tolist() for name in "txyp")
    for row in zip(*rows, strict=True):
        store.push_back(*row)
    return store


def test_silc_dv_processing(race, store):
    """Its patch is 9x9 at most in Python, less than half of r = 6, and it merges polarities."""
    dv = pytest.importorskip("dv_processing")
    race(
        "SILC r = 6",
        lambda: dv.SpeedInvariantTimeSurface((WIDTH, HEIGHT)),
        lambda surface: surface.accept(store),
        rounds=3,
    )


def test_sae(race, events):
    race(
        "SAE",
        lambda: TimeSurface(WIDTH, HEIGHT, polarity="split"),
        lambda surface: surface.update(events),
    )


def test_sae_scalar_numba(race, events):
    race(
        "SAE",
        lambda: np.full((2, HEIGHT, WIDTH), -1),
        lambda image: sae_loop(image, events.x, events.y, events.t, events.p),
    )


def test_sae_dv_processing(race, store):
    dv = pytest.importorskip("dv_processing")
    race(
        "SAE",
        lambda: dv.TimeSurface((WIDTH, HEIGHT)),
        lambda surface: surface.accept(store),
        rounds=3,
    )


def test_sae_and_one_frame_eventcv(race, events):
    eventcv = pytest.importorskip("eventcv")
    table = np.column_stack([getattr(events, name).astype(np.int64) for name in "xytp"])
    stream = eventcv.from_numpy(table, sensor_size=(WIDTH, HEIGHT), time_unit="us")
    race("SAE", lambda: stream, lambda stream: stream.tsurf(tau_ms=1e3 * TAU).numpy(), rounds=3)


def frame_times(events):
    first = int(events.t[0])
    return range(first + FRAME_US, int(events.t[-1]), FRAME_US)


def test_time_surface_every_10_ms(race, events):
    def call(surface):
        before = 0
        for t in frame_times(events):
            surface.update(events.between(before, t))
            surface.render(t)
            before = t

    race(
        "TS frame every 10 ms", lambda: TimeSurface(WIDTH, HEIGHT, tau=TAU, polarity="split"), call
    )


def test_time_surface_every_10_ms_scalar_numba(race, events):
    def call(sae):
        before = 0
        for t in frame_times(events):
            part = events.between(before, t)
            sae_loop(sae, part.x, part.y, part.t, part.p)
            decay_loop(sae, t, 1e6 * TAU, np.empty(sae.shape))
            before = t

    race("TS frame every 10 ms", lambda: np.full((2, HEIGHT, WIDTH), -1), call)


def test_time_surface_every_10_ms_tonic(race, events):
    tonic = pytest.importorskip("tonic")
    array = np.zeros(N, dtype=tonic.io.events_struct)
    for name in "xytp":
        array[name] = getattr(events, name)

    def call(array):
        return tonic.functional.to_timesurface_numpy(
            array, sensor_size=(WIDTH, HEIGHT, 2), dt=FRAME_US, tau=1e6 * TAU
        )

    frames = call(array)
    t = next(iter(frame_times(events)))
    ours = fed(TimeSurface(WIDTH, HEIGHT, tau=TAU, polarity="split"), events.between(0, t))
    np.testing.assert_allclose(frames[0], ours.render(t), rtol=0, atol=1e-12)
    race("TS frame every 10 ms", lambda: array, call, rounds=3)


def test_tos_ts_every_50_ms(race, events):
    def call(surface):
        for t in range(50_000, int(SECONDS * 1e6), 50_000):
            surface.update(events.between(t - 50_000, t))
            surface.render(t)

    race("TOS AND TS, frame every 50 ms", lambda: TosTs(WIDTH, HEIGHT), call)


def dist_numpy(first, last, count, start, clip=0.99, alpha=3.0, reach=2):
    """The definition in whole-array NumPy; one polarity."""
    limit = max(1, int(np.quantile(count, clip, method="inverted_cdf")))
    seen, far = count > 0, 1 << 62

    def patches(image, outside):
        side = (2 * reach + 1, 2 * reach + 1)
        wide = np.pad(image, reach, constant_values=outside)
        return np.lib.stride_tricks.sliding_window_view(wide, side)

    late = patches(np.where(seen, last, -1), -1).max((2, 3))
    early = patches(np.where(seen, first, far), far).min((2, 3))
    near = patches(np.minimum(count, limit), 0).sum((2, 3))
    discount = alpha * (late - early) / np.maximum(near, 1)
    value = np.where(seen & (near > 1), np.maximum(last - start - discount, 0), 0)
    unique, rank = np.unique(value, return_inverse=True)
    return rank.reshape(value.shape) / unique.size


def test_dist(race, events):
    """45,000 events of one polarity, taken and rendered; the bar is 2 ms."""
    part = events[events.p][:45_000]

    def call(surface):
        surface.update(part)
        surface.render()

    race("DiST, 45,000 events", lambda: Dist(WIDTH, HEIGHT, polarity="merged"), call, 45_000, 50)


def test_dist_numpy(race, events):
    part = events[events.p][:45_000]
    at = part.y.astype(int) * WIDTH + part.x

    def call(_):
        first, last, count = np.zeros((3, HEIGHT * WIDTH), dtype=np.int64)
        last[at] = part.t
        first[at[::-1]] = part.t[::-1]
        np.add.at(count, at, 1)
        planes = (plane.reshape(HEIGHT, WIDTH) for plane in (first, last, count))
        return dist_numpy(*planes, int(part.t[0]))

    ours = fed(Dist(WIDTH, HEIGHT, polarity="merged"), part).render()
    np.testing.assert_array_equal(call(None), ours)
    race("DiST, 45,000 events", lambda: None, call, 45_000, 5)

"""The filter of noise against a straight scalar loop, and tonic where it is installed.

Run with ``pytest tests/benchmarks/test_bench_filters.py --benchmark-only -s``.  The loop tests one
neighbour after the other on a padded image, as the text describes the filter; its flags are checked
to be ours before anything is timed.  Ours also counts what tells noise, hot pixels and flicker.
tonic's `Denoise` has four neighbours, of either polarity.
"""

import numba
import numpy as np
import pytest

from evcalib.events import Events
from evcalib.filters import Denoiser

WIDTH, HEIGHT, N = 346, 260, 5_000_000
WITHIN, SUPPORT = 0.01, 3


@pytest.fixture(scope="module")
def events():
    """Edges that sweep the image, and half as much noise."""
    rng = np.random.default_rng(0)
    t = np.sort(rng.integers(0, 10**6, N))
    x = ((rng.integers(0, 40, N) * 17 + 2e-4 * t + rng.normal(0, 0.7, N)) % WIDTH).astype(np.int64)
    noise = rng.random(N) < 0.33
    x[noise] = rng.integers(0, WIDTH, noise.sum())
    y = rng.integers(0, HEIGHT, N)
    return Events.from_arrays(x, y, t, rng.random(N) < 0.5, WIDTH, HEIGHT)


@numba.njit(nogil=True)
def loop(x, y, t, p, width, height, within_us, support):
    last = np.full((2, height + 2, width + 2), -(2**62))
    flags = np.zeros(t.size, dtype=np.bool_)
    for i in range(t.size):
        plane = 1 if p[i] else 0
        found = 0
        for dy in range(3):
            for dx in range(3):
                if dx == 1 and dy == 1:
                    continue
                if t[i] - last[plane, y[i] + dy, x[i] + dx] <= within_us:
                    found += 1
        last[plane, y[i] + 1, x[i] + 1] = t[i]
        flags[i] = found >= support
    return flags


def ours(events):
    return Denoiser(WIDTH, HEIGHT, support=SUPPORT, within=WITHIN).update(events)


def theirs(events):
    columns = (events.x, events.y, events.t, events.p)
    return loop(*columns, WIDTH, HEIGHT, round(1e6 * WITHIN), SUPPORT)


@pytest.mark.benchmark(group="noise filter, 5 million events")
@pytest.mark.parametrize("run", [ours, theirs])
def test_filter(benchmark, events, run):
    assert np.array_equal(ours(events), theirs(events))
    benchmark.pedantic(run, (events,), rounds=5)
    rate = N / benchmark.stats.stats.min / 1e6
    print(f"\n{run.__name__}: {rate:.0f} million events per second")


@pytest.mark.benchmark(group="noise filter, 5 million events")
def test_tonic(benchmark, events):
    transforms = pytest.importorskip("tonic.transforms")
    dtype = np.dtype([("x", "<i8"), ("y", "<i8"), ("t", "<i8"), ("p", "<i8")])
    table = np.empty(100_000, dtype=dtype)
    for name in "xytp":
        table[name] = getattr(events, name)[: table.size]
    benchmark.pedantic(transforms.Denoise(filter_time=10_000), (table,), rounds=1)
    print(f"\ntonic: {table.size / benchmark.stats.stats.min / 1e6:.2f} million events per second")

"""Arc* against a straight scalar loop and dv-processing's C++: 5 million events at 346x260.

Run with ``pytest tests/benchmarks/test_bench_corners.py --benchmark-only -s``.  The loop follows
the authors' code line by line: both arcs are grown to the end, one element at a time.  Its flags
are checked to be ours before anything is timed.
"""

import numba
import numpy as np
import pytest

from evcalib.events import Events
from evcalib.features.corners import ArcStar, arc_star
from evcalib.kernels.features.corners import LARGE_CIRCLE, NEVER, SMALL_CIRCLE

WIDTH, HEIGHT, N = 346, 260, 5_000_000
SMALL, LARGE = (tuple(map(tuple, circle.tolist())) for circle in (SMALL_CIRCLE, LARGE_CIRCLE))


@pytest.fixture(scope="module")
def events():
    """Squares of 5 to 40 px that cross the image at 100 to 600 px/s, with jitter and noise."""
    rng = np.random.default_rng(0)
    thing = rng.integers(0, 60, N)
    speed = rng.uniform(-400, 400, (60, 2))[thing]
    half = rng.uniform(2.5, 20, 60)[thing]
    side, along = rng.integers(0, 4, N), rng.uniform(-1, 1, N)
    t = np.sort(rng.integers(0, 10**6, N))
    edge = np.where(side % 2 == 0, 1.0, -1.0)
    dx, dy = np.where(side < 2, along, edge) * half, np.where(side < 2, edge, along) * half
    start = rng.uniform(0, (WIDTH, HEIGHT), (60, 2))[thing]
    place = start + speed * (1e-6 * t)[:, None] + np.column_stack((dx, dy))
    place += rng.normal(0, 0.3, (N, 2))
    noise = rng.random(N) < 0.02
    place[noise] = rng.uniform(0, (WIDTH, HEIGHT), (noise.sum(), 2))
    x, y = (np.floor(place) % (WIDTH, HEIGHT)).astype(np.int64).T
    return Events.from_arrays(x, y, t, (dx * speed[:, 0] + dy * speed[:, 1]) > 0, WIDTH, HEIGHT)


@numba.njit(nogil=True, error_model="numpy")
def fits(sae, x, y, circle, k_min, k_max):
    n = len(circle)
    newest = 0
    for i in range(1, n):
        dx, dy = circle[i]
        old_dx, old_dy = circle[newest]
        if sae[y + dy, x + dx] > sae[y + old_dy, x + old_dx]:
            newest = i
    up, down = (newest + 1) % n, (newest - 1) % n
    up_head = sae[y + circle[up][1], x + circle[up][0]]
    down_head = sae[y + circle[down][1], x + circle[down][0]]
    oldest = sae[y + circle[newest][1], x + circle[newest][0]]
    up_oldest, down_oldest = up_head, down_head
    size = k_min
    for i in range(1, n):
        if up_head > down_head:
            if i < k_min or up_head >= oldest:
                size = max(size, i + 1)
                oldest = min(oldest, up_oldest)
            up = (up + 1) % n
            up_head = sae[y + circle[up][1], x + circle[up][0]]
            up_oldest = min(up_oldest, up_head)
        else:
            if i < k_min or down_head >= oldest:
                size = max(size, i + 1)
                oldest = min(oldest, down_oldest)
            down = (down - 1) % n
            down_head = sae[y + circle[down][1], x + circle[down][0]]
            down_oldest = min(down_oldest, down_head)
    return size <= k_max or n - k_max <= size <= n - k_min


@numba.njit(nogil=True, error_model="numpy")
def scalar_loop(x, y, t, p, last, sae, flags):
    _, height, width = sae.shape
    for i in range(t.size):
        col, row, now = np.int64(x[i]), np.int64(y[i]), t[i]
        q = 1 if p[i] else 0
        same, other = last[q, row, col], last[1 - q, row, col]
        last[q, row, col] = now
        flags[i] = False
        if now > same + 50_000 or other > same:
            sae[q, row, col] = now
            if (
                4 <= col < width - 4
                and 4 <= row < height - 4
                and fits(sae[q], col, row, SMALL, 3, 6)
            ):
                flags[i] = fits(sae[q], col, row, LARGE, 4, 8)


def scalar(events):
    last, sae = np.full((2, 2, HEIGHT, WIDTH), NEVER)
    flags = np.empty(len(events), bool)
    scalar_loop(events.x, events.y, events.t, events.p, last, sae, flags)
    return flags


@pytest.fixture
def race(benchmark):
    def run(call):
        benchmark.group = "Arc*, 5 million events"
        result = benchmark.pedantic(call, rounds=5, warmup_rounds=1)
        rate = N / benchmark.stats.stats.min / 1e6
        benchmark.extra_info["Mev/s"] = round(rate, 1)
        print(f"\n{benchmark.name}: {rate:.1f} million events per second")
        return result

    return run


def test_arc_star(race, events):
    flags = race(lambda: ArcStar(WIDTH, HEIGHT).update(events))
    assert 0.01 < flags.mean() < 0.3


def test_arc_star_scalar_numba(race, events):
    assert np.array_equal(scalar(events), arc_star(events))
    race(lambda: scalar(events))


def test_arc_star_dv_processing(race, events):
    """A variant: without the echo filter; keeps at most the given number of corners."""
    dv = pytest.importorskip("dv_processing")
    store = dv.EventStore()
    rows = (getattr(events, name).tolist() for name in "txyp")
    for row in zip(*rows, strict=True):
        store.push_back(*row)
    roi, mask = (0, 0, WIDTH, HEIGHT), np.ones((HEIGHT, WIDTH), np.uint8)

    def call():
        detector = dv.features.ArcCornerDetector((WIDTH, HEIGHT), 5000, False)
        return detector.detect(store, roi, mask)

    race(call)

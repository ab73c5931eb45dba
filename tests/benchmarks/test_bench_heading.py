"""The whole chain from events to headings at 20 Hz, and its matcher against OpenCV's.

Run with ``pytest tests/benchmarks/test_bench_heading.py --benchmark-only -s``.
"""

import time

import cv2
import numba
import numpy as np
import pytest

from data_tools.simulation.simulator import simulate_translation
from evcalib.camera import Camera
from evcalib.events import Events
from evcalib.features import Keypoints, match
from evcalib.heading import estimate_headings

CAMERA = Camera(346, 260, 250.0, 250.0, 172.5, 129.5)


def dense(seconds=1.0, n=5_000_000):
    """Squares near and far that move past at 230 to 430 px/s: 2.5 million events in a second."""
    rng = np.random.default_rng(0)
    square = rng.integers(0, 400, n)
    depth = rng.uniform(0.7, 1.3, 400)[square]
    half = rng.uniform(2.5, 9, 400)[square]
    t = np.sort(rng.integers(0, int(1e6 * seconds), n))
    along, side = rng.uniform(-1, 1, n), np.where(rng.random(n) < 0.5, 1.0, -1.0)
    upright = rng.random(n) < 0.5
    dx, dy = np.where(upright, side, along) * half, np.where(upright, along, side) * half
    x = rng.uniform(0, 700, 400)[square] - 300e-6 * t / depth + dx + rng.normal(0, 0.3, n)
    y = rng.uniform(0, 260, 400)[square] + dy + rng.normal(0, 0.3, n)
    x, y = np.floor(x % 700).astype(int), np.floor(y).astype(int)
    seen = (x < 346) & (y >= 0) & (y < 260)
    keep = np.flatnonzero(seen)
    return Events.from_arrays(x[keep], y[keep], t[keep], dx[keep] < 0, 346, 260)


def translation():
    return simulate_translation((1, 0, 0.3), 0.5, 1.0, CAMERA, seed=2).events


@pytest.mark.benchmark(group="events to headings at 20 Hz")
@pytest.mark.parametrize("make", [dense, translation])
def test_chain(benchmark, make):
    """CPU time of all threads, so that a busy machine or a hidden pool does not flatter it."""
    events = make()
    estimate_headings(events, CAMERA)
    start = time.process_time()
    estimate = benchmark.pedantic(estimate_headings, (events, CAMERA), rounds=3)
    rate = 3 * len(events) / (time.process_time() - start) / 1e6
    benchmark.extra_info["Mev per CPU second"] = round(rate, 2)
    print(
        f"\n{make.__name__}: {len(events)} events in {events.duration:.2f} s, {rate:.2f} million"
        f" events per CPU second, {estimate.found:.0%} of keyframes with a heading"
    )


@pytest.mark.benchmark(group="events to headings, by threads")
@pytest.mark.parametrize("threads", [1, 2])
def test_threads(benchmark, threads, monkeypatch):
    """Time by the clock: a machine with other work shows less than two cores give."""
    monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", threads)
    events = translation()
    estimate_headings(events, CAMERA)
    benchmark.pedantic(estimate_headings, (events, CAMERA), rounds=3)


def described(n, seed):
    rng = np.random.default_rng(seed)
    y, bits = np.sort(rng.uniform(0, 260, n)), rng.integers(0, 2**64, (n, 4), dtype=np.uint64)
    xy, none = np.column_stack((rng.uniform(0, 346, n), y)), np.zeros(n)
    return Keypoints(xy, none, none > 0, none.astype(np.int64), bits)


@pytest.mark.benchmark(group="mutual matches of 500 keypoints")
def test_match(benchmark):
    benchmark(match, described(500, 0), described(500, 1), farthest=256)


@pytest.mark.benchmark(group="mutual matches of 500 keypoints")
def test_match_within_reach(benchmark):
    benchmark(match, described(500, 0), described(500, 1), farthest=256, reach=60.0)


@pytest.mark.benchmark(group="mutual matches of 500 keypoints")
def test_match_opencv(benchmark):
    first, second = described(500, 0), described(500, 1)
    sides = [k.bits.view(np.uint8) for k in (first, second)]
    matcher = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True)
    found = benchmark(matcher.match, *sides)
    ours = match(first, second, farthest=256)
    assert sorted((m.queryIdx, m.trainIdx) for m in found) == [tuple(row) for row in ours.tolist()]

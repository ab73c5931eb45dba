"""Reading `t x y p` text against NumPy: half a million lines."""

import numpy as np
import pytest

from data_tools.recordings.formats.events_text import load_events_text

N = 500_000


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    rng = np.random.default_rng(0)
    t = np.sort(rng.integers(0, 2_000_000, N))
    columns = (t // 10**6, t % 10**6, *rng.integers(0, (240, 180, 2), (N, 3)).T)
    path = tmp_path_factory.mktemp("text") / "events.txt"
    lines = (f"{s}.{us:06d}000 {x} {y} {p}\n" for s, us, x, y, p in zip(*columns, strict=True))
    path.write_text("".join(lines))
    return path


@pytest.mark.benchmark(group="500,000 lines of t x y p")
def test_events_text(benchmark, path):
    events = benchmark(load_events_text, path, 240, 180)
    assert len(events) == N


@pytest.mark.benchmark(group="500,000 lines of t x y p")
def test_events_text_numpy_loadtxt(benchmark, path):
    table = benchmark.pedantic(np.loadtxt, (path,), rounds=3)
    ours = load_events_text(path, 240, 180)
    np.testing.assert_array_equal(np.rint(table[:, 0] * 1e6), ours.t)

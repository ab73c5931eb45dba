"""A message of 10,000 listed events as arrays, and as the objects that `rosbags` makes of it."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs the extra formats")

from bag_writing import DVS, Maker

from data_tools.recordings.formats._event_arrays import read_array

ROWS = 10_000


def message(kind):
    random = np.random.default_rng(0)
    x, y = random.integers(0, 480, (2, ROWS)).tolist()
    t = np.sort(random.integers(10**18, 10**18 + 10**9, ROWS)).tolist()
    make = Maker(kind)
    packed = make.array(DVS, list(zip(x, y, t, [True] * ROWS, strict=True)), 640, 480)
    write = make.store.serialize_ros1 if kind == "ros1" else make.store.serialize_cdr
    return make.store, bytes(write(packed, DVS))


@pytest.mark.parametrize("kind", ["ros1", "sqlite3"])
def test_arrays(benchmark, kind):
    benchmark.group = f"10,000 events of {kind}"
    _, raw = message(kind)
    _, columns = benchmark(read_array, raw, 1 if kind == "ros1" else 2, ("height", "width"))
    assert columns.t.size == ROWS


@pytest.mark.parametrize("kind", ["ros1", "sqlite3"])
def test_objects(benchmark, kind):
    benchmark.group = f"10,000 events of {kind}"
    store, raw = message(kind)
    read = store.deserialize_ros1 if kind == "ros1" else store.deserialize_cdr
    assert len(benchmark(read, raw, DVS).events) == ROWS

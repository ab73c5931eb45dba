"""Headings in threads: the same bytes for any number of these, and none left after an exception."""

import threading
from dataclasses import fields

import numba
import numpy as np
import pytest

from data_tools.simulation.simulator import simulate_translation
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.heading import _threads, estimate_headings
from evcalib.imu import ImuSeries, attitude_of

CAMERA = Camera(160, 120, 110.0, 110.0, 79.5, 59.5)


@pytest.fixture(scope="module")
def events():
    return simulate_translation((1, 0, 0.3), 0.5, 1.2, CAMERA, seed=3).events


def pieces(events):
    return (events[k : k + 5_000] for k in range(0, len(events), 5_000))


def running():
    return [t for t in threading.enumerate() if t.name.startswith("headings")]


def content(result):
    return [
        np.ascontiguousarray(getattr(part, f.name)).tobytes()
        for part in (result.headings, result.correspondences)
        for f in fields(part)
    ]


SHAKES = attitude_of(
    ImuSeries(np.linspace(0, 1.3, 1301), np.random.default_rng(5).normal(0, 0.05, (1301, 3)))
)


@pytest.mark.parametrize("attitude", [None, SHAKES], ids=["no gyro", "gyro"])
def test_the_same_bytes_for_any_number_of_threads(events, attitude, monkeypatch):
    found, used = [], []
    for threads in (1, 2, 3):
        monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", threads)

        def watched():
            for piece in pieces(events):
                used.append((threads, len(running())))  # noqa: B023
                yield piece

        found.append(
            estimate_headings(watched(), CAMERA, keep_correspondences=True, attitude=attitude)
        )
        assert not running()
    assert len(found[0].headings) > 5
    assert [max(n for k, n in used if k == threads) for threads in (1, 2, 3)] == [0, 2, 3]
    assert content(found[0]) == content(found[1]) == content(found[2])
    assert found[0].gaps == found[1].gaps == found[2].gaps


@pytest.mark.parametrize("error", [KeyboardInterrupt, InputError])
def test_what_stops_the_stream_stops_the_threads(error, events, monkeypatch):
    monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", 2)
    busy = 0

    def broken():
        nonlocal busy
        yield from pieces(events[: len(events) * 3 // 4])
        busy = len(running())
        raise error("stop")

    with pytest.raises(error, match="stop"):
        estimate_headings(broken(), CAMERA)
    assert busy > 0
    assert not running()


def test_what_goes_wrong_in_a_thread_is_told(events, monkeypatch):
    monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", 2)

    def broken(*_, **__):
        raise RuntimeError("broken pair")

    monkeypatch.setattr("evcalib.heading._estimator.match_keyframes", broken)
    with pytest.raises(RuntimeError, match="broken pair"):
        estimate_headings(events, CAMERA)
    assert not running()


def test_one_thread_is_no_thread(monkeypatch):
    monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", 1)
    assert _threads.Threads().submit is _threads.at_once

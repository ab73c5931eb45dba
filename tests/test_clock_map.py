"""The map between two clocks: against linear programming, and a clock known exactly."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from data_tools.bags.clock_map import MAX_DRIFT, fit_clock
from evcalib.errors import InputError


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(st.integers(0, 10**8), st.integers(0, 4 * 10**5)), min_size=1, max_size=30)
)
def test_no_line_below_all_packets_is_closer_to_them(packets):
    camera = np.array(sorted(t for t, _ in packets), dtype=np.int64)
    delay = np.array([late for _, late in packets], dtype=np.int64)
    fitted = fit_clock(camera, camera + 10**15 + delay)
    distance = camera + 10**15 + delay - fitted(camera)
    x = (camera - camera[0]) / 1e6
    best = linprog(
        -np.array([x.size, x.sum()]),
        A_ub=np.column_stack([np.ones_like(x), x]),
        b_ub=delay.astype(float),
        bounds=[(None, None), (-1e6 * MAX_DRIFT, 1e6 * MAX_DRIFT)],
    )
    assert best.success
    assert distance.min() >= -1
    assert distance.sum() <= (delay.sum() + best.fun) + 2 * x.size


def test_a_clock_with_delays_is_found():
    random = np.random.default_rng(5)
    camera = np.sort(random.integers(0, 600 * 10**6, 5000))
    host = 77 + camera + np.rint(3e-5 * camera).astype(np.int64)
    late = random.exponential(2_000, camera.size).astype(np.int64)
    fitted = fit_clock(camera, host + late)
    assert fitted.drift == pytest.approx(3e-5, abs=2e-7)
    assert np.abs(fitted(camera) - host).max() < 60
    assert fitted.scatter == pytest.approx(2000 * np.log(2), rel=0.1)


def test_times_keep_their_order():
    fitted = fit_clock(np.array([0, 10**7]), np.array([5, 5 + 10**7 - 2_000]))
    assert fitted.drift == -MAX_DRIFT
    t = fitted(np.arange(200_000))
    assert (np.diff(t) >= 0).all()


def test_clocks_that_jump_are_refused():
    camera = np.arange(400, dtype=np.int64) * 10_000
    host = camera + np.where(camera >= 3_000_000, 3_000_000, 0)
    with pytest.raises(InputError, match=r"part by 3\.000 s about 3\.0 s after the start"):
        fit_clock(camera, host)
    with pytest.raises(InputError, match="no packets"):
        fit_clock(camera[:0], host[:0])

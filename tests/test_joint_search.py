"""The width of offsets that fit alike, against closed forms; bins and borders of times."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evcalib.joint._offset_search import GATE, Search
from evcalib.series import bins

STEP = 0.01
OFFSETS = np.arange(-6, 7) * STEP


def parabolas(centre, spread, offsets=OFFSETS, stretches=200):
    """Tracks of which each has its best offset, `spread` [s] about `centre`.

    Against the centre, a track that has its own at c + e loses d^2 - 2 d e at a distance d.
    """
    rng = np.random.default_rng(1)
    e = rng.normal(size=stretches)
    e = spread * (e - e.mean()) / e.std()
    losses = (offsets - centre - e[:, None]) ** 2
    return Search(offsets, losses, np.ones(stretches), np.arange(stretches))


def ends(spread, stretches=200):
    """Where n d^2 = GATE sqrt(2 n) 2 d spread: the root of the gate's own definition."""
    return GATE * np.sqrt(2.0 / stretches) * 2 * spread


@pytest.mark.parametrize("spread", [0.1, 0.12, 0.125, 0.13])
def test_offsets_fit_as_well_up_to_where_the_gate_says(spread):
    search = parabolas(0.0, spread)
    assert search.reach(0.0) == pytest.approx(2 * (ends(spread) / STEP,), rel=1e-9)
    assert search.half_width(0.0) == pytest.approx(ends(spread) - STEP, rel=1e-9)


def test_the_width_moves_without_steps():
    widths = [parabolas(0.0, s).half_width(0.0) for s in np.linspace(0.08, 0.14, 601)]
    assert np.diff(widths).min() > 0
    assert np.diff(widths).max() < 1e-4


def test_a_sharp_optimum_has_no_width():
    assert parabolas(0.0, 0.01).half_width(0.0) == 0.0


def test_a_side_without_an_end_counts_as_the_other():
    search = parabolas(0.03, 0.1)
    later, earlier = search.reach(0.03)
    assert later == np.inf
    assert earlier == pytest.approx(ends(0.1) / STEP)
    assert search.half_width(0.03) == pytest.approx(ends(0.1) - STEP)


def test_where_no_end_shows_the_width_is_that_of_the_search():
    assert parabolas(0.0, 1.0).half_width(0.0) == pytest.approx(STEP * (OFFSETS.size - 1))


def test_a_side_that_the_odometry_does_not_cover_shows_no_end():
    search = parabolas(0.0, 0.1)
    search.losses[:, 8:] = np.nan
    assert search.reach(0.0)[0] == np.inf
    assert search.half_width(0.0) == pytest.approx(ends(0.1) - STEP)


def test_without_losses_at_the_best_offset_nothing_is_known():
    search = parabolas(0.0, 0.01)
    search.losses[:, 6] = np.nan
    assert search.half_width(0.0) == pytest.approx(STEP * (OFFSETS.size - 1))


@given(
    k=st.lists(st.integers(0, 10_000), min_size=1, max_size=50),
    start=st.floats(-1e6, 1e6),
    step=st.sampled_from([0.001, 0.01, 0.05, 0.12]),
    every=st.integers(1, 50),
)
def test_bins_count_steps_wherever_the_clock_begins(k, start, step, every):
    t = start + np.array(k) * step
    assert bins(t - start, every * step).tolist() == [number // every for number in k]

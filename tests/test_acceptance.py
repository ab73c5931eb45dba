"""Small versions of the Monte-Carlo figures; `tests/montecarlo.py` makes the full ones.

Seeds are fixed, so nothing here is flaky.  Each bound is what an estimator that just meets the
full figure would pass with 99.9 % probability at this number of trials.
"""

from functools import cache

import montecarlo
import numpy as np
import pytest
from scipy import stats

TRIALS, FEW = 16, 10

WHITE = [f"white {sigma:g}" for sigma in (0.02, 0.05, 0.1, 0.2)]
COVERED = [*WHITE, "ar1 0.8", "outliers 20%"]


@cache
def outcomes(name, trials=TRIALS):
    return montecarlo.run(name, trials, seed=1)


def pooled(names, field):
    return np.concatenate([getattr(outcomes(name), field) for name in names])


def test_the_offsets_error_is_near_the_cramer_rao_bound_from_little_to_much_noise():
    """RMSE <= 1.25 bounds; squared errors over the bound's square are chi-square, 64 of them."""
    ratio = pooled(WHITE, "offset_error") / pooled(WHITE, "bound")
    n = ratio.size
    limit = 1.25 * np.sqrt(stats.chi2.ppf(0.999, n) / n)
    assert np.sqrt(np.mean(ratio**2)) < limit


@pytest.mark.parametrize("name", WHITE)
def test_no_noise_level_is_far_from_the_bound(name):
    assert outcomes(name).efficiency < 1.25 * np.sqrt(stats.chi2.ppf(0.999, TRIALS) / TRIALS)


@pytest.mark.parametrize("field", ["offset_inside", "rotation_inside"])
def test_intervals_hold_the_truth_about_as_often_as_they_say(field):
    """Coverage of 90 to 98 % of 96 trials of white, coloured and contaminated noise."""
    inside = pooled(COVERED, field)
    low, high = stats.binom.ppf(0.001, inside.size, 0.90), stats.binom.ppf(0.999, inside.size, 0.98)
    assert low <= inside.sum() <= high


@pytest.mark.parametrize("field", ["offset_inside", "rotation_inside"])
@pytest.mark.parametrize("name", COVERED)
def test_no_kind_of_noise_breaks_the_intervals(name, field):
    """Of 16 trials at 90 %, 10 or more; plain least squares gives 2 to 9 under AR(1) noise."""
    assert getattr(outcomes(name), field).sum() >= stats.binom.ppf(0.001, TRIALS, 0.90)


@pytest.mark.parametrize("name", ["lively outliers 60%", "lively flips 40%"])
def test_most_headings_may_be_wrong(name):
    """Median <= 4 ms: of 16 errors at least 2 lie below (binomial); none beyond 50 ms."""
    errors = np.abs(outcomes(name).offset_error)
    assert np.sum(errors <= 4e-3) >= stats.binom.ppf(0.001, TRIALS, 0.5)
    assert errors.max() < 0.05
    assert np.median(np.degrees(outcomes(name).rotation_error)) < 1.4


@pytest.mark.parametrize("name", ["arc", "straight"])
def test_steady_drives_are_always_flagged(name):
    assert not outcomes(name, FEW).offset_observable.any()
    assert not outcomes(name, FEW).rotation_observable.any()
    assert outcomes(name, FEW).rotation_inside.all()


@pytest.mark.parametrize("name", ["s-curve 10 deg", "s-curve 20 deg"])
def test_s_curves_of_ten_degrees_and_more_are_never_flagged(name):
    assert outcomes(name, FEW).offset_observable.all()
    assert outcomes(name, FEW).rotation_observable.all()


def test_s_curves_of_five_degrees_are_hardly_ever_flagged():
    """57 of 60 are answered (README): of ten, fewer than 7 once in 1000."""
    answered = outcomes("s-curve 5 deg", FEW).offset_observable.sum()
    assert answered >= stats.binom.ppf(0.001, FEW, 0.95)


def test_given_its_offset_an_arc_determines_the_rotation():
    found = outcomes("arc, offset given", FEW)
    assert found.rotation_observable.all()
    assert found.rotation_inside.sum() >= stats.binom.ppf(0.001, FEW, 0.90)


def test_of_a_zigzag_that_repeats_within_the_search_no_repetition_is_claimed():
    """It is flagged, but for the few trials whose noise tells the true offset by luck."""
    found = outcomes("zigzag, period 1.6 s", FEW)
    assert found.offset_observable.mean() < 0.5
    assert np.abs(found.offset_error[found.offset_observable]).max(initial=0) < 0.05


def test_fingers_determine_the_rotation_without_the_offset():
    found = outcomes("fingers", FEW)
    assert found.rotation_observable.all()
    assert np.degrees(found.rotation_error).max() < 1
    assert found.rotation_inside.sum() >= stats.binom.ppf(0.001, FEW, 0.90)

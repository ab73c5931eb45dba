"""The kernel's median against numpy's, to the last bit."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from evcalib.kernels.median import median


@settings(deadline=None, max_examples=200)
@given(st.lists(st.floats(-1e9, 1e9) | st.sampled_from([0.0, 1.0]), min_size=1, max_size=60))
def test_medians_equal_numpys(values):
    values = np.array(values)
    assert median(values.copy()) == np.median(values)


def test_long_ordered_and_equal_values_take_no_longer_than_their_number():
    for values in (np.arange(100_001.0), np.arange(100_000.0)[::-1], np.ones(100_000)):
        assert median(values.copy()) == np.median(values)

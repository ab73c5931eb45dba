"""Events as arrays of other people's programs: named columns, or n x 4 numbers in some order."""

from __future__ import annotations

from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from data_tools.recordings.formats._columns import ALIASES
from evcalib.checks import MAX_SIDE
from evcalib.errors import InputError

SAMPLE = 1 << 16
"""Rows by which columns without names are told apart."""
ASCENDING = 0.95
"""Share of steps that do not go back in a column of times; of random pixels half of them do.

A choice: it leaves room for late events, and the refusal of two that fit guards it.
"""

FROM_ONE = "programs in MATLAB may count pixels from 1; x and y were taken as they stand, from 0"


def column_order(sample: NDArray) -> tuple[dict[str, int], str]:
    """Return which column of n x 4 numbers is x, y, t, p, found by what they hold.

    Polarities are 0 and 1, or -1 and 1; times ascend; x stands before y, as in every layout known.

    Parameters
    ----------
    sample : ndarray, shape (n, 4)
        The first rows.

    Returns
    -------
    (dict of str to int, str)
        The column of each, and a note that says so.

    Raises
    ------
    InputError
        If no order fits, or more than one.
    """
    if sample.dtype.kind not in "biuf" or sample.ndim != 2 or not sample.size:
        raise InputError(f"n x 4 numbers are needed, not {sample.dtype} of shape {sample.shape}")
    values = sample.astype(np.float64)
    whole = (values == np.rint(values)).all(axis=0) & (values >= 0).all(axis=0)
    pixel = whole & (values <= MAX_SIDE).all(axis=0)
    polarity = [set(np.unique(c).tolist()) in ({0.0, 1.0}, {-1.0, 1.0}) for c in values.T]
    steps = np.diff(values, axis=0) >= 0
    time = (steps.sum(axis=0) >= ASCENDING * len(steps)) & (values[-1] > values[0])
    fitting = [
        dict(zip("xytp", (x, y, t, p), strict=True))
        for x, y, t, p in permutations(range(4))
        if x < y and pixel[x] and pixel[y] and time[t] and polarity[p]
    ]
    if len(fitting) != 1:
        found = "no order of x, y, t, p fits" if not fitting else "several orders fit"
        raise InputError(
            f"{found} its four columns: times must ascend, polarities be 0 and 1 (or -1 and 1);"
            f" give the columns names: {', '.join(aliases[0] for aliases in ALIASES.values())}"
        )
    (order,) = fitting
    names = " ".join(sorted(order, key=order.__getitem__))
    return order, f"the four columns have no names: {names} was taken, by what they hold"

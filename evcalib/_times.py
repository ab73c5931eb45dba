"""Times round, whatever clock they come from: what hangs on a border must not hang on that."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BORDER = 1e-6
"""Times this close [s] to a border lie on it."""


def segments(t: NDArray[np.float64], gap: float) -> NDArray[np.int64]:
    """Return the number of the segment between gaps longer than `gap` [s] that each time is in."""
    return np.concatenate([[0], np.cumsum(np.diff(t) > gap + BORDER)])


def bins(since: NDArray[np.float64], width: float) -> NDArray[np.int64]:
    """Return the number of the bin of `width` [s] that each time since a start [s] lies in.

    Counted in whole microseconds, so that rounding moves no time across a border.
    """
    return np.rint(np.asarray(since) / BORDER).astype(np.int64) // max(round(width / BORDER), 1)

"""Running counts of encoders: counters that start anew, are reset, or have one wrong value."""

from __future__ import annotations

import numpy as np

from evcalib.arrays import Flags, Floats
from evcalib.errors import InputError

WRAPS = tuple(2.0**bits for bits in (8, 16, 24, 31, 32))
"""Where counters start anew."""
SPIKE = 5.0
"""Steps so many times those of a fast wheel (the 95th percentile) are no motion, if at most
`LONGEST` of them follow each other: a choice; a wheel that speeds up five times does so for
longer than two rows."""
LONGEST = 2
FEWEST = 20
"""Of fewer steps nobody can tell which are usual."""


def count_steps(
    name: str, count: Floats, t: Floats, wrap: float | None
) -> tuple[Floats, Flags, list[str]]:
    """Return how much a running count goes on from row to row, where that is to be believed.

    A step that fits a counter of 8 to 32 bits that starts anew is mended; steps to and from a
    single wrong value, and that of a reset, are left out.

    Parameters
    ----------
    name : str
        For messages.
    count : ndarray, shape (n,)
        The count.
    t : ndarray, shape (n,)
        Times [s].
    wrap : float, optional
        Where it starts anew, if that is known.

    Returns
    -------
    change : ndarray, shape (n - 1,)
        In counts.
    good : ndarray of bool, shape (n - 1,)
        False where the change is not known.
    notes : list of str
        What was mended or left out.

    Raises
    ------
    InputError
        If it jumps more often than a counter that is reset now and then.
    """
    change = np.diff(count)
    if wrap is not None:
        change = (change + wrap / 2) % wrap - wrap / 2
    good = np.ones(change.size, dtype=bool)
    spikes, usual = _spikes(change, np.diff(t))
    if not spikes.any():
        return change, good, []
    if wrap is None:
        for size in WRAPS:
            back = change - np.sign(change) * size
            if (np.abs(back[spikes]) <= 2 * usual[spikes]).all():
                change = np.where(spikes, back, change)
                word = "once" if spikes.sum() == 1 else f"{int(spikes.sum())} times"
                return (
                    change,
                    good,
                    [
                        f"the count of {name} starts anew after {size:.0f}, {word}: that was mended"
                        f" (wrap: {size:.0f} in the column map says so)"
                    ],
                )
    if spikes.sum() > max(2, change.size / 50):
        row = int(np.argmax(spikes))
        raise InputError(
            f"t = {t[row + 1]:.3f} s: the count of {name} jumps by {change[row]:.0f}, and"
            f" {int(spikes.sum())} times in all, by more than {SPIKE:.0f} times what it does"
            " otherwise; where does it start anew? say so in the column map (wrap: 65536), or is it"
            " counted since the row before (unit: ticks/row)?"
        )
    first = int(np.argmax(spikes))
    return (
        change,
        ~spikes,
        [
            f"{int(spikes.sum())} steps of the count of {name} are no motion (a reset, or a damaged"
            f" value; the first at t = {t[first + 1]:.3f} s) and were left out"
        ],
    )


def _spikes(change: Floats, step: Floats) -> tuple[Flags, Floats]:
    """Return which steps stand out alone, and what a fast wheel does in each step."""
    none = np.zeros(change.size, dtype=bool)
    rate = np.abs(change) / step
    moving = rate > 0
    if change.size < FEWEST or moving.sum() < FEWEST // 2:
        return none, none.astype(float)
    fast = float(np.percentile(rate[moving], 95))
    spikes = rate > SPIKE * fast
    edges = np.flatnonzero(np.diff(np.concatenate([[False], spikes, [False]])))
    for start, end in edges.reshape(-1, 2):
        if end - start > LONGEST:
            spikes[start:end] = False
    return spikes, fast * step

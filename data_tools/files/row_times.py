"""Times of rows or messages as loggers leave them: repeated, late, or of a clock that was set.

One rule for all motion: what repeats a time or is out of order by itself is left out, and told; a
clock that was set is refused, as nobody can tell which side of that is right.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable

import numpy as np

from evcalib.arrays import Flags, Floats, Integers
from evcalib.errors import InputError

MAX_JUMP = 60.0
"""A step above this [s] is taken for a clock that was set.  A choice: longer than drives pause."""
WRAPS = (2**32 * 1e-6, 2**32 * 1e-3)
"""Where counters of 32 bits start anew [s]: of microseconds, and of milliseconds."""
WRAP_STEPS = 20
"""Usual steps within which the next row follows when a counter starts anew: a choice, some lost
rows; a clock that was set hits this by chance in one of a thousand cases."""
MOST_LATE = 1 / 20
"""Share of rows out of order above which a log is refused.  A choice: one is shuffled then."""
MOST_REPEATED = 1 / 2
"""Share of repeated times above which they are coarser than the rows, and no time is right."""


def advancing(
    t: Floats | Integers,
    where: Callable[[int], str],
    *,
    per_second: float = 1.0,
    max_jump: float = MAX_JUMP,
    repeats: bool = False,
) -> tuple[Flags, list[str]]:
    """Return which rows are later than all before them, and what was left out.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times.
    where : callable
        Names a row in messages.
    per_second : float
        Units of `t` per second.
    max_jump : float
        Longest step [s].
    repeats : bool
        Keep rows that share a time.

    Raises
    ------
    InputError
        If rows that follow each other, or too many, are out of order, times jump, or most repeat.
    """
    keep = _in_order(t)
    late = np.flatnonzero(~keep)
    if late.size and (late.size > max(1, MOST_LATE * t.size) or (np.diff(late) == 1).any()):
        row = int(np.argmax(np.diff(t) < 0)) + 1
        raise InputError(
            f"{where(row)}: its time is {float(t[row - 1] - t[row]) / per_second:.3f} s"
            " before that of the row before: the clock was set, or rows are not in order; sort"
            " them, or use the part before or after that"
        )
    keep = _without_stray_ends(t, keep, max_jump * per_second)
    notes = []
    strays = np.flatnonzero(~keep)
    if strays.size:
        notes.append(
            f"{strays.size} rows whose time is not between those of their neighbours were left out"
            f" (the first: {where(int(strays[0]))})"
        )
    rows = np.flatnonzero(keep)
    steps = np.diff(t[rows])
    if steps.size and steps.max() > max_jump * per_second:
        k = int(np.argmax(steps))
        raise InputError(
            f"{where(int(rows[k + 1]))}: its time is {steps[k] / per_second:.3f} s after that"
            " of the row before: the clock was set, or two logs were joined; use the part before or"
            " after that"
        )
    again = rows[1:][steps == 0]
    if repeats or not again.size:
        return keep, notes
    if again.size > max(1, MOST_REPEATED * rows.size):
        raise InputError(
            f"{where(int(again[0]))}: {again.size} of {rows.size} rows repeat the time of the row"
            " before: times are coarser than the rows; log them with more digits"
        )
    keep[again] = False
    if keep.sum() < 2:
        raise InputError(
            f"{where(int(again[0]))}: of {keep.size} rows the times of 1 are usable, as the others"
            " repeat it; two at least are needed"
        )
    notes.append(
        f"{again.size} rows with the time of the row before were left out"
        f" (the first: {where(int(again[0]))})"
    )
    return keep, notes


def unwrapped(t: Floats) -> tuple[Floats, list[str]]:
    """Return times [s] that go on where a counter of 32 bits started anew, and what was mended.

    Its reading was made seconds before it came here, so that it falls by one of `WRAPS`.
    """
    steps = np.diff(t)
    usual = float(np.median(steps))
    if not usual > 0:
        return t, []
    for wrap in WRAPS:
        after = steps + wrap
        falls = np.flatnonzero((after > 0) & (after <= WRAP_STEPS * usual))
        if falls.size and (np.diff(falls) >= 10).all():
            laps = np.zeros(t.size)
            laps[falls + 1] = wrap
            times = "once" if falls.size == 1 else f"{falls.size} times"
            return t + np.cumsum(laps), [
                f"times fall by {wrap:.3f} s, {times}: a counter of 32 bits started anew, and that"
                " was mended"
            ]
    return t, []


def _in_order(t: Floats | Integers) -> Flags:
    """Return the longest choice of rows whose times never go back."""
    if not (np.diff(t) < 0).any():
        return np.ones(t.size, dtype=bool)
    values = t.tolist()
    tails: list[float] = []
    ends: list[int] = []
    before = [-1] * t.size
    for k, value in enumerate(values):
        place = bisect_right(tails, value)
        before[k] = ends[place - 1] if place else -1
        tails[place : place + 1] = [value]
        ends[place : place + 1] = [k]
    keep = np.zeros(t.size, dtype=bool)
    k = ends[-1]
    while k >= 0:
        keep[k] = True
        k = before[k]
    return keep


def _without_stray_ends(t: Floats | Integers, keep: Flags, jump: float) -> Flags:
    """Leave out one row at either end that lies further off than a clock jumps."""
    rows = np.flatnonzero(keep)
    if rows.size > 3:
        if t[rows[1]] - t[rows[0]] > jump:
            keep[rows[0]] = False
        if t[rows[-1]] - t[rows[-2]] > jump:
            keep[rows[-1]] = False
    return keep

"""Faults of a recording's clock that can be mended: one that starts again, and single glitches."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from data_tools.recordings.formats import Columns
from evcalib.arrays import Integers
from evcalib.errors import InputError

TURNS_US = (1 << 32, 1 << 31)
"""Where clocks of 32 bits, and those of 31 bits and a sign, start again [us]."""

TURN_SLACK_US = 1_000_000
"""How much later [us] than the turn the next event may be: a choice, far above the time between
events and far below any turn."""

JUMP_US = 50_000
"""A step back of more [us] is a fault of the clock, less is a late event, which sorting mends
(`data_tools.recordings._stages.SORT_WINDOW_US`)."""

RUN = 1000
"""Events in a row that one glitch spoils at most: a choice, a packet of most cameras."""

_PART = 1 << 17
"""Events that are looked at at a time; what is copied is never more."""

_SHARE = 20
"""A glitch spoils at most one of so many of the events around it."""

_FEWEST = 10
"""Of fewer events nobody can tell which are wrong."""

_ENDS, _ALONE_US, _ALONE_TIMES = 3, 10_000_000, 10
"""So few events at an end of a recording are out of place if they stand so far from the others
[us], and so many times as far as those last: a choice, for what is so far from all else is of no
use."""

GLITCHES = "events whose time is a glitch of the clock"
"""Reason under which they are counted."""


@dataclass
class Turns:
    """What a clock that started again adds to times."""

    count: int = 0
    _added: int = 0
    _last: int | None = None

    def mended(self, pieces: Iterable[Columns]) -> Iterator[Columns]:
        """Let times go on where a clock of 32 or 31 bits starts again."""
        for piece in pieces:
            t = piece.t
            steps = np.diff(t, prepend=t[0] if self._last is None else self._last)
            self._last = int(t[-1])
            added = np.zeros(0, dtype=np.int64)
            if (np.abs(steps) > min(TURNS_US) - TURN_SLACK_US).any():
                added = self._turns(t, steps)
            if added.any() or self._added:
                sums = self._added + np.cumsum(added if added.size else np.zeros_like(t))
                self._added = int(sums[-1])
                piece = piece._replace(t=t + sums)
            yield piece

    def _turns(self, t: Integers, steps: Integers) -> Integers:
        """Return what each step adds: a turn, or one back where a late event follows it.

        A clock starts again at 0, or at the lowest number with a sign; elsewhere a step of this
        size is a flipped bit.
        """
        added = np.zeros_like(steps)
        low = np.minimum(t, t - steps)
        starts = np.minimum(np.abs(low), np.abs(low + TURNS_US[1])) <= TURN_SLACK_US
        for turn in TURNS_US:
            forth = (steps + turn >= -JUMP_US) & (steps + turn <= TURN_SLACK_US) & starts
            back = (steps - turn <= JUMP_US) & (steps - turn >= -TURN_SLACK_US) & starts
            added[forth] = turn
            if self._added or forth.any():
                added[back] = -turn
            self.count += int(np.count_nonzero(forth)) - int(np.count_nonzero(added == -turn))
        return added


def without_glitches(pieces: Iterable[Columns], losses: Counter[str]) -> Iterator[Columns]:
    """Leave out the few events after which the clock is again where it was before them.

    That are events from the future or from the past in an ordered stream, also its first and last
    ones.  What the clock does for good, like starting anew, is left as it is.

    Raises
    ------
    InputError
        If there are so many that the stream is none of one clock.
    """
    held: Columns | None = None
    begun = False
    for piece in pieces:
        whole = piece if held is None else Columns.joined([held, piece])
        whole = _mended(whole, begun, False, losses)
        stop = max(whole.t.size - 2 * RUN, 0)
        held = whole.rows(slice(stop, None))
        if stop:
            begun = True
            yield whole.rows(slice(stop))
    if held is not None:
        held = _mended(held, begun, True, losses)
        if held.t.size:
            yield held


def parts(pieces: Iterable[Columns]) -> Iterator[Columns]:
    """Cut large pieces, so that what is copied of them on the way is small."""
    for piece in pieces:
        yield from (piece.rows(slice(k, k + _PART)) for k in range(0, piece.t.size, _PART))
        del piece


def _mended(piece: Columns, begun: bool, ended: bool, losses: Counter[str]) -> Columns:
    """Return the piece without the glitches that can be judged; the last `RUN` wait for more."""
    before = piece.t.size
    most = max(100, before // 1000)
    at = 0
    count = 0
    while True:
        back = np.flatnonzero(piece.t[at + 1 :] < piece.t[at:-1] - JUMP_US)
        if not back.size:
            break
        at += int(back[0]) + 1
        if not ended and at > piece.t.size - RUN - 1:
            break
        found = _glitch(piece.t, at, begun, ended)
        if found is None:
            continue
        count += 1
        if count > most:
            raise InputError(
                f"the clock jumps to and fro, over {most} times within {before} events, as if two"
                " recordings were mixed: write each to a file of its own"
            )
        piece = piece.rows(np.r_[: found[0], found[1] : piece.t.size])
        at = max(found[0] - 1, 0)
    # While little has come, a glitch right after the first events may still wait to be judged.
    if ended or piece.t.size > 2 * RUN:
        piece = _without_ends(piece, begun, ended)
    if piece.t.size < before:
        losses[GLITCHES] += before - piece.t.size
    return piece


def _glitch(t: Integers, at: int, begun: bool, ended: bool) -> tuple[int, int] | None:
    """Return which events to leave out where the clock goes back before event `at`, if any."""
    if t.size < _FEWEST:
        return None
    most = max(1, min(RUN, t.size // _SHARE))
    earlier = t[max(at - most - 1, 0) : at][::-1] <= t[at] + JUMP_US
    later = t[at : at + most + 1] >= t[at - 1] - JUMP_US
    high = int(np.argmax(earlier)) if earlier.any() else at if at <= most else most + 1
    low = int(np.argmax(later)) if later.any() else t.size - at if ended else most + 1
    if high > most or (begun and high == at):
        return None if low > most else (at, at + low)
    # Those with neighbours on one side only are as likely to be wrong as any.
    followed = at + low < t.size
    if high < at and (high <= low or not followed):
        return at - high, at
    return (at - high, at) if high < low else (at, at + low)


def _without_ends(piece: Columns, begun: bool, ended: bool) -> Columns:
    """Leave out the first or last events if they are far from all others."""
    if (begun and not ended) or piece.t.size < _FEWEST * _ENDS:
        return piece
    # As floats: a damaged time may be so far away that the difference of integers overflows.
    t = piece.t.astype(np.float64)
    far = np.abs(np.diff(t)) > _ALONE_US
    start, stop = 0, t.size
    if not begun and far[:_ENDS].any():
        start = int(np.flatnonzero(far[:_ENDS])[-1]) + 1
        if t[start] - t[start - 1] <= _ALONE_TIMES * (t[start:-_ENDS].max() - t[start]):
            start = 0
    if ended and far[-_ENDS:].any():
        stop = t.size - _ENDS + int(np.flatnonzero(far[-_ENDS:])[0])
        if t[stop] - t[stop - 1] <= _ALONE_TIMES * (t[stop - 1] - t[start]):
            stop = t.size
    return piece.rows(slice(start, stop)) if stop - start < t.size else piece


LEAST_RATE = 1.0
"""Events per second below which the unit of times is doubted: event cameras give thousands even in
the dark, and a unit that is wrong by 1000 makes single ones of them."""

_COARSE_US, _COARSE_RATE, _MANY = 1000, 1000.0, 100
"""Times in seconds that are all whole multiples of this [us], while fewer events than this [1/s]
came, of so many events at least, are rather milliseconds or microseconds with decimals: who cuts
times to milliseconds finds several events in each."""


def doubt(unit: str, t: Integers) -> str | None:
    """Return why the first events can hardly be in the unit that was taken for granted, if so.

    Parameters
    ----------
    unit : str
        What was taken for granted.
    t : ndarray of int64, shape (n,)
        Times of the first events [us], by that unit.
    """
    middle = np.sort(t)[t.size // 20 : t.size - t.size // 20]
    seconds = float(middle[-1] - middle[0]) / 1e6
    if t.size < _FEWEST or not seconds:
        return None
    rate = (middle.size - 1) / seconds
    if rate < LEAST_RATE:
        why = f"that would be {rate:.2g} events per second"
    elif unit == "s" and not (t % 1_000_000).any():
        why = "nothing but zeros stands behind their decimal point"
    elif unit == "s" and t.size >= _MANY and rate < _COARSE_RATE and not (t % _COARSE_US).any():
        why = f"that would be times of whole milliseconds, and only {rate:.0f} events per second"
    else:
        return None
    others = [other for other in ("us", "ms", "ns") if other != unit]
    return (
        f"the unit of the times is not told; {unit} was assumed, but {why}. Are they in"
        f" {' or '.join(others)}? Say so: --time-unit {others[0]} (time_unit='{others[0]}'), or"
        f" --time-unit {unit} if it is {unit} all the same"
    )

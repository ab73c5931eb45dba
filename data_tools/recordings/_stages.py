"""What happens to the columns of every recording on their way to `Events`, whatever the format."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from data_tools.recordings.formats import Columns
from evcalib.arrays import Integers
from evcalib.errors import InputError

MOST = 1 << 20
"""Events in a piece at most."""

LEAST = 1 << 17
"""Small pieces are joined until they have as many events."""

SORT_WINDOW_US = 50_000
"""How far back in time [us] an event may be and still be put in order."""

_CLOCK_WAS_SET = "was the clock set, or were two recordings joined? Then cut the file there"
_HELD = 1 << 23
_WRONG_SIZE = 0.1
_ENOUGH = 100


@dataclass
class Disorder:
    """Late events: those before the latest of the events that precede them in the file."""

    count: int = 0
    largest_us: int = 0
    _latest: int = field(default=-(1 << 62), repr=False)
    _position: int = field(default=0, repr=False)

    def lag(self, t: Integers) -> Integers | None:
        """Return how late [us] each of the next events is, None if none is, and count."""
        self._position += t.size
        if not t.size:
            return None
        if t[0] >= self._latest and not (t[1:] < t[:-1]).any():
            self._latest = int(t[-1])
            return None
        latest = np.maximum.accumulate(np.maximum(t, self._latest))
        lag = latest - t
        self.count += int(np.count_nonzero(lag))
        self.largest_us = max(self.largest_us, int(lag.max()))
        self._latest = int(latest[-1])
        return lag

    def place(self, lag: Integers, row: int, t: Integers) -> str:
        """Return where the event of a row of the piece just counted stands."""
        number = self._position - t.size + row
        return f"event {number} (t = {t[row]} us in the file) is {lag[row]} us late"


def inside(
    pieces: Iterable[Columns], width: int, height: int, losses: Counter[str]
) -> Iterator[Columns]:
    """Leave out events outside the sensor; refuse where they are too many for damage.

    Empty pieces stay out.
    """
    for piece in pieces:
        fits = (piece.x < width) & (piece.y < height)
        outside = int(fits.size - np.count_nonzero(fits))
        if not outside:
            yield piece
            continue
        if fits.size >= _ENOUGH and outside > _WRONG_SIZE * fits.size:
            raise InputError(
                f"{outside} of {fits.size} events are outside the sensor of {width}x{height} px,"
                f" up to x = {piece.x.max()}, y = {piece.y.max()}; is the size right?"
            )
        losses["events outside the sensor"] += outside
        if outside < fits.size:
            yield piece.rows(fits)


def gathered(pieces: Iterable[Columns]) -> Iterator[Columns]:
    """Join small pieces and cut large ones; no piece is empty."""
    held: list[Columns] = []
    count = 0
    for piece in pieces:
        held.append(piece)
        count += piece.t.size
        if count >= LEAST:
            yield from _cut(_joined(held))
            held, count = [], 0
    if count:
        yield from _cut(_joined(held))


def dropped(pieces: Iterable[Columns], late: Disorder, losses: Counter[str]) -> Iterator[Columns]:
    """Leave out late events."""
    for piece in pieces:
        lag = late.lag(piece.t)
        if lag is not None:
            keep = lag == 0
            losses["late events"] += int(keep.size - np.count_nonzero(keep))
            piece = piece.rows(keep)
        yield piece


def refused(pieces: Iterable[Columns], late: Disorder) -> Iterator[Columns]:
    """Stop at the first late event."""
    for piece in pieces:
        lag = late.lag(piece.t)
        if lag is not None:
            row = int(np.argmax(lag > 0))
            advice = (
                f"disorder='sort' (--disorder sort) puts in order what is up to"
                f" {SORT_WINDOW_US // 1000} ms late"
            )
            if lag[row] > SORT_WINDOW_US:
                advice = _CLOCK_WAS_SET
            where = late.place(lag, row, piece.t)
            raise InputError(f"times are out of order: {where}; {advice}")
        yield piece


def in_order(pieces: Iterable[Columns], late: Disorder) -> Iterator[Columns]:
    """Put late events where they belong, holding back the last `SORT_WINDOW_US` of events.

    Events of one time keep their order.
    """
    held: Columns | None = None
    for piece in pieces:
        lag = late.lag(piece.t)
        if lag is not None and lag.max() > SORT_WINDOW_US:
            where = late.place(lag, int(np.argmax(lag > SORT_WINDOW_US)), piece.t)
            raise InputError(
                f"times are too far out of order to be sorted: {where}, more than"
                f" {SORT_WINDOW_US // 1000} ms; {_CLOCK_WAS_SET}"
            )
        merged = piece if held is None else _joined([held, piece])
        if (merged.t[1:] < merged.t[:-1]).any():
            order = np.argsort(merged.t, kind="stable")
            merged = merged.rows(order)
        if merged.t.size > _HELD:
            raise InputError(
                f"over {_HELD} events are within {SORT_WINDOW_US // 1000} ms: too many to sort"
            )
        # An event of the limit itself may go: one that comes later goes after it.
        stop = int(np.searchsorted(merged.t, merged.t[-1] - SORT_WINDOW_US, "right"))
        held = merged.rows(slice(stop, None))
        if stop:
            yield merged.rows(slice(stop))
    if held is not None and held.t.size:
        yield held


def _joined(pieces: list[Columns]) -> Columns:
    return pieces[0] if len(pieces) == 1 else Columns.joined(pieces)


def _cut(piece: Columns) -> Iterator[Columns]:
    for start in range(0, piece.t.size, MOST):
        yield piece.rows(slice(start, start + MOST))

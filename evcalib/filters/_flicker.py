"""Lamps on the mains: whether they flicker, and how far a pixel goes up and down with them."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from evcalib.arrays import Integers
from evcalib.events import Events

LAMPS = (100, 120)
"""Lamps go bright and dark twice in each cycle of the mains, of 50 or 60 Hz [Hz]."""

EVERY, BINS = 32, 16
"""One event of so many is looked at, and put into one of so many phases.  A choice of speed."""

FEWEST = 250
"""Events of each polarity, of those looked at, without which no flicker is told: chance opposes
them to 1 / FEWEST."""

OPPOSED = 0.04
"""How far both polarities come in opposite phases, 0 to 0.4, from which on there is flicker.  A
choice: lamps that make a third of all events.  A real recording under lamps has 0.06 to 0.11, eight
others 0.02 at most (`tests/test_filters.py`)."""

MOST_BAND = 8
"""Most events of a band.  A choice: lamps that go out in each cycle have no fewer, and what is left
of a scene then comes late."""


REMEMBERED = 5
"""Periods that are looked at together: a second, over which lamps keep their phase to a fifth of a
cycle where the mains are 0.1 % off.  A choice."""


class FlickerMeter:
    """Measures flicker over periods.

    The sums are of whole numbers, so that they do not depend on how the stream is cut.

    Attributes
    ----------
    lamps : int
        Frequency of the flicker [Hz] of late; 0 without.
    """

    def __init__(self) -> None:
        self.lamps = 0
        self._seen = 0
        self._phases: deque[Integers] = deque([_nothing()], maxlen=REMEMBERED)

    def update(self, events: Events) -> None:
        """Take in the next events of a period."""
        rows = slice(-self._seen % EVERY, None, EVERY)
        t, p = events.t[rows], events.p[rows]
        self._seen += len(events)
        for phases, rate in zip(self._phases[-1], LAMPS, strict=True):
            bins = (t % 1_000_000) * (rate * BINS) // 1_000_000 % BINS
            phases += np.bincount(bins + BINS * p, minlength=2 * BINS).reshape(2, BINS)

    def measure(self, fired: Integers, seconds: float, band: NDArray[np.uint8]) -> None:
        """End a period in which each pixel fired so often, and set its band in events.

        A pixel flickers if it fires more than once in each cycle of the lamps; then as often up
        as down.
        """
        opposed = [_opposed(phases) for phases in np.sum(self._phases, axis=0)]
        self._phases.append(_nothing())
        strongest = int(np.argmax(opposed))
        self.lamps = LAMPS[strongest] if opposed[strongest] > OPPOSED else 0
        if self.lamps:
            swings = fired / (2 * self.lamps * seconds)
            wide = np.clip(np.ceil(swings - 0.25), 1, MOST_BAND)
            band[:] = np.where(swings > 0.5, wide, 0)


def _nothing() -> Integers:
    return np.zeros((len(LAMPS), 2, BINS), dtype=np.int64)


def _opposed(phases: Integers) -> float:
    """Return how far the polarities come in opposite phases; 0 with too few events."""
    count = phases.sum(axis=1)
    if count.min() < FEWEST:
        return 0.0
    wave = phases @ np.exp(2j * np.pi * np.arange(BINS) / BINS) / count
    return -float((wave[0] * wave[1].conjugate()).real)

"""How events get from the pixels to the computer: rows that wait for each other, and losses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_tools.simulation._readout_kernels import serve_rows
from evcalib.arrays import Integers
from evcalib.events import Events


@dataclass
class Readout:
    """The readout of one recording, given its events piece by piece, in order.

    Attributes
    ----------
    row_time, event_time, stamp, gap : float
        See `data_tools.simulation.sensor.Sensor`, in microseconds.
    gap_rate : float
        Gaps per microsecond.
    rng : Generator
        Of the gaps.
    free : float
        When the readout is free again [us].
    gap_end : float
        End of the last gap that was drawn [us].
    gap_start : float
        Its start.
    """

    row_time: float
    event_time: float
    stamp: float
    gap: float
    gap_rate: float
    rng: np.random.Generator
    free: float = 0.0
    gap_start: float = -np.inf
    gap_end: float = -np.inf

    def carry(self, events: Events) -> Events:
        """Return what arrives of a piece of events."""
        if not len(events):
            return events
        t = events.t
        order = np.arange(t.size)
        if self.row_time or self.event_time:
            busy = (self.row_time, self.event_time, self.free)
            t, order, self.free = serve_rows(t, events.y, events.height, busy)
        if self.gap_rate:
            kept = self._arrives(t)
            t, order = t[kept], order[kept]
        if self.stamp:
            t = (np.floor(t / self.stamp) * self.stamp).astype(np.int64)
        if t is events.t:
            return events
        x, y, p = events.x[order], events.y[order], events.p[order]
        return Events.from_arrays(x, y, t, p, events.width, events.height)

    def _arrives(self, t: Integers) -> np.ndarray:
        """Say which of some times lie in no gap."""
        if self.gap_end == -np.inf:
            self._next_gap(float(t[0]))
        kept = np.ones(t.size, dtype=bool)
        while self.gap_start <= t[-1]:
            kept &= (t < self.gap_start) | (t >= self.gap_end)
            if self.gap_end > t[-1]:
                break
            self._next_gap(self.gap_end)
        return kept

    def _next_gap(self, after: float) -> None:
        self.gap_start = after + float(self.rng.exponential(1.0 / self.gap_rate))
        self.gap_end = self.gap_start + self.gap

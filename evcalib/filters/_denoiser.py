"""Events without the sensor's own and the lamps': noise, hot pixels, flicker."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from evcalib import checks
from evcalib.arrays import Flags
from evcalib.display import Shown
from evcalib.errors import InputError
from evcalib.events import Events, require_next
from evcalib.filters import _noise_rate as rates
from evcalib.filters._flicker import FlickerMeter
from evcalib.kernels.events import EventColumns
from evcalib.kernels.filters import support as kernels

PERIOD_US = 200_000
"""Noise is measured anew at every multiple of this [us]."""

COUNTED_US = PERIOD_US // 2
"""From the start of each period, events are counted for so long [us].  A choice of speed."""

REMEMBERED = 5
"""The noise is the median of so many periods, a second: neither an interruption nor a jerk of the
camera changes it.  Hot pixels are counted over as long."""

SUPPORT = 3
"""Neighbours that keep an event.  Measured on simulated drives at 0.1 to 0.8 m/s with 1 to 10 Hz of
noise: where a fifth of the noise is let through, one neighbour keeps 16 to 41 % of the signal, two
21 to 53 %, three 26 to 56 %; of both polarities, one keeps 13 to 25 %."""

SHARE = 0.1
"""Share of the noise that may pass far from anything that moves.  A choice; see `SUPPORT`."""

LONGEST = 0.1
"""Longest time [s] within which neighbours count.  A choice: an edge that has not come to the next
pixel by then moves at less than 10 px/s."""

LEAST = 3.3
"""Noise [Hz per pixel] below which all events stay.  Moving texture passes for 3.0 at most
(`rates.QUIET`); drives with 5 Hz of noise are told 3.6 and more, and of those with 3 Hz corners are
found without a filter (tests/README.md)."""

HOT, HOT_LEAST = 5.0, 10.0
"""A pixel is hot if it fires `HOT` times as often as all its neighbours but one, and `HOT_LEAST`
times a second more.  A choice: two hot pixels may touch; edges sweep neighbours alike."""


@dataclass(frozen=True)
class Noise(Shown):
    """What was left out of a stream, and how noisy it was.

    Attributes
    ----------
    events, kept : int
        Taken in; left.
    hot, flicker, unsupported : int
        Left out: events of hot pixels; of flicker; those without enough neighbours.
    rate : float
        Background activity [events per second and pixel], the median over time.
    hot_pixels : int
        Most pixels that were hot at a time.
    lamps : int
        Frequency of the flicker [Hz]; 0 without.
    """

    events: int = 0
    kept: int = 0
    hot: int = 0
    flicker: int = 0
    unsupported: int = 0
    rate: float = 0.0
    hot_pixels: int = 0
    lamps: int = 0

    def text(self) -> str:
        """Return what was left out, and why, in a line."""
        reasons = [
            f"{self.unsupported:,} without enough neighbours ({self.rate:.1f} Hz of noise per"
            " pixel at most)",
            f"{self.hot:,} of {self.hot_pixels:,} hot pixels",
            f"{self.flicker:,} of lamps that flicker at {self.lamps} Hz",
        ]
        counts = (self.unsupported, self.hot, self.flicker)
        told = [reason for reason, count in zip(reasons, counts, strict=True) if count]
        share = 1.0 - self.kept / self.events if self.events else 0.0
        return f"{100 * share:.1f} % of the events" + (": " + ", ".join(told) if told else "")


class Denoiser:
    """Tells noise from signal in a stream that comes in pieces.

    An event stays if `support` of its eight neighbours had one of its polarity within a time, its
    own pixel not counted.  The time follows the noise, which is measured in the quiet tenth of the
    image: it is such that a given share of pure noise passes.  So little noise leaves slow edges
    whole, and a sensor without noise keeps all its events.  Pixels that fire far more often than
    their neighbours are left out, and support no one.  Where lamps flicker, 100 or 120 times a
    second, the events of a pixel count from where it leaves the band in which it goes up and down.

    The noise of a period of 0.2 s decides on the next one, so the first is taken as it is.

    Parameters
    ----------
    width, height : int
        Sensor size [px].
    support : int
        Neighbours that keep an event, 1 to 8.
    share : float
        Share of pure noise that passes.
    within : float, optional
        Time within which neighbours count [s]; by default it follows the noise.

    References
    ----------
    Delbruck, "Frame-free dynamic digital vision", 2008, has one neighbour and a fixed time.
    """

    def __init__(
        self,
        width: int,
        height: int,
        *,
        support: int = SUPPORT,
        share: float = SHARE,
        within: float | None = None,
    ) -> None:
        width, height = checks.side(width, "width"), checks.side(height, "height")
        if isinstance(support, bool) or support not in range(1, 9):
            raise InputError(f"support must be 1 to 8 neighbours, not {support!r}")
        if not 0 < checks.positive(share, "share") < 1:
            raise InputError(f"share must be between 0 and 1, not {share!r}")
        if within is not None and not 1e-6 <= checks.positive(within, "within", "seconds") <= 1e6:
            raise InputError(f"within must be 1e-6 to 1e6 seconds, not {within!r}")
        self.shape = (height, width)
        self.noise = Noise()
        self._support, self._fixed = int(support), within
        self._rate_time = rates.rate_time(share, self._support)
        self._areas = rates.block_areas(width, height)
        self._state = kernels.State(
            last=np.full((2, height + 2, width + 2), kernels.NEVER),
            hot=np.zeros(self.shape, dtype=np.bool_),
            fired=np.zeros(self.shape, dtype=np.int32),
            band=np.zeros(self.shape, dtype=np.uint8),
            level=np.zeros(self.shape, dtype=np.uint8),
        )
        self._alone = np.zeros(self._areas.shape, dtype=np.int32)
        self._flicker = FlickerMeter()
        self._heat = np.zeros(self.shape)
        self._recent: deque[float] = deque(maxlen=REMEMBERED)
        self._rates: list[float] = []
        self._period = -1
        self._now = 0

    @property
    def within(self) -> float:
        """Time within which neighbours count now [s]; 0 where all events stay."""
        if self._fixed is not None:
            return self._fixed
        rate = float(np.median(self._recent)) if self._recent else 0.0
        return 0.0 if rate < LEAST else min(self._rate_time / rate, LONGEST)

    def update(self, events: Events) -> Flags:
        """Take in the next events of the stream and tell which of them stay.

        Parameters
        ----------
        events : Events
            Of the same sensor, not before the last events taken in.

        Returns
        -------
        ndarray of bool, shape (n,)
            True where the event stays.

        Raises
        ------
        InputError
            If the sensor size differs or time goes back.
        """
        require_next(events, self.shape, self._now, "filter")
        stay = np.ones(len(events), dtype=np.bool_)
        if not len(events):
            return stay
        done = 0
        while done < len(events):
            period, since = divmod(int(events.t[done]), PERIOD_US)
            if period != self._period:
                self._measure()
                self._period = period
            counting = since < COUNTED_US
            until = period * PERIOD_US + (COUNTED_US if counting else PERIOD_US)
            end = int(np.searchsorted(events.t, until))
            self._judge(events[done:end], stay[done:end], counting)
            done = end
        self._now = int(events.t[-1])
        return stay

    def kept(self, events: Events) -> Events:
        """Take in the next events of the stream and return those that stay; see `update`."""
        stay = self.update(events)
        return events if stay.all() else events[stay]

    def _judge(self, events: Events, stay: Flags, counting: bool) -> None:
        """Mark the events of one period that stay."""
        within = self.within
        self._flicker.update(events)
        limits = kernels.Limits(
            since_us=round(1e6 * within),
            alone_us=rates.ALONE_US,
            support=self._support if within else 0,
            flicker=self._flicker.lamps > 0,
        )
        columns = EventColumns.of(events)
        alone = self._alone if counting else None
        of_hot, flickered = kernels.neighbours(columns, self._state, limits, stay, alone)
        kept = int(np.count_nonzero(stay))
        noise = self.noise
        self.noise = replace(
            noise,
            events=noise.events + len(events),
            kept=noise.kept + kept,
            hot=noise.hot + of_hot,
            flicker=noise.flicker + flickered,
            unsupported=noise.unsupported + len(events) - kept - of_hot - flickered,
        )

    def _measure(self) -> None:
        """Learn from the period that has ended."""
        if self._period < 0:
            return
        state = self._state
        rate = rates.noise_rate(self._alone, self._areas, 1e-6 * COUNTED_US)
        self._recent.append(rate)
        self._rates.append(rate)
        self._flicker.measure(state.fired, 1e-6 * PERIOD_US, state.band)
        # A mean over REMEMBERED periods, in events per second.
        kernels.warm(self._heat, state.fired, 1e6 / PERIOD_US, 1.0 / REMEMBERED)
        kernels.find_hot(self._heat, HOT, HOT_LEAST, state.hot)
        self._alone[:] = 0
        self.noise = replace(
            self.noise,
            rate=float(np.median(self._rates)),
            hot_pixels=max(self.noise.hot_pixels, int(np.count_nonzero(state.hot))),
            lamps=self._flicker.lamps or self.noise.lamps,
        )


def denoise(
    events: Events,
    *,
    support: int = SUPPORT,
    share: float = SHARE,
    within: float | None = None,
) -> Events:
    """Leave out noise: background activity, hot pixels, and flicker of lamps.

    A stream with little noise stays whole, and so does the first fifth of a second of any.

    Parameters
    ----------
    events : Events
        The whole stream.  For one that comes in pieces, and for counts of what was left out, see
        `evcalib.filters.Denoiser`.
    support, share, within
        As in `evcalib.filters.Denoiser`.

    Returns
    -------
    Events
        Those that stay.

    Raises
    ------
    InputError
        If an option is unusable.

    Examples
    --------
    Three pixels side by side fire at once; the fourth event is alone.

    >>> events = Events(x=[3, 4, 5, 9], y=[2, 2, 2, 2], t=[0, 10, 20, 30], p=[1] * 4,
    ...                 width=12, height=5)
    >>> denoise(events, support=1, within=0.005).x.tolist()
    [4, 5]
    """
    checks.instance(events, "events", Events)
    chosen = Denoiser(events.width, events.height, support=support, share=share, within=within)
    return chosen.kept(events)

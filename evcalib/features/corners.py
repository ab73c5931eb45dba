"""Corner events: Arc*, on the times of the neighbours, and Harris, on the surface around."""

from __future__ import annotations

import cv2
import numpy as np

from evcalib import checks
from evcalib.arrays import Flags
from evcalib.errors import InputError
from evcalib.events import Events, require_next
from evcalib.kernels.events import EventColumns
from evcalib.kernels.features import corners as kernels
from evcalib.surfaces import Tos

FILTER_US = 50_000
"""An event of the same polarity within this time [us] of the last is an echo of it.  The
authors' choice (Alzugaray & Chli 2018)."""


class ArcStar:
    """Arc* corner detector for a stream that comes in pieces.

    An event is a corner if the newest events on the circles of radius 3 and 4 around it form an
    arc of 3 to 6 and 4 to 8 pixels, or leave out one of that length.  Echoes are filtered first:
    an event counts only if its polarity did not come for 50 ms, or the other one came since.
    Events within 4 px of the border are never corners.

    A pixel that never fired is older than any event, also than one at t = 0; the original starts
    from zero and so loses the corners of the first 50 ms of a stream that starts there.

    Parameters
    ----------
    width, height : int
        Sensor size [px].
    filter_us : int
        Time of the echo filter [us].

    References
    ----------
    Alzugaray & Chli, "Asynchronous corner detection and tracking for event cameras in real time",
    IEEE RA-L 3(4), 2018.
    """

    def __init__(self, width: int, height: int, *, filter_us: int = FILTER_US) -> None:
        if not 0 <= int(filter_us) <= 2**61:
            raise InputError(f"filter_us must be a time in microseconds, not {filter_us!r}")
        self.shape = (height, width)
        self._filter_us = int(filter_us)
        self._now = 0
        self._last = np.full((height, width, 2), kernels.NEVER)
        self._sae = np.full((2, height, width), kernels.NEVER)
        self._circles = kernels.Circles(
            kernels.circle_steps(kernels.SMALL_CIRCLE, width),
            kernels.circle_steps(kernels.LARGE_CIRCLE, width),
        )

    def update(self, events: Events) -> Flags:
        """Take in the next events of the stream and tell which of them are corners.

        Parameters
        ----------
        events : Events
            Of the same sensor, not before the last events taken in.

        Returns
        -------
        ndarray of bool, shape (n,)
            True where the event is a corner.

        Raises
        ------
        InputError
            If the sensor size differs or time goes back.
        """
        require_next(events, self.shape, self._now, "detector")
        flags = np.zeros(len(events), dtype=np.bool_)
        if not len(events):
            return flags
        columns = EventColumns.of(events)
        kernels.arc_star(columns, self._last, self._sae, self._filter_us, self._circles, flags)
        self._now = int(events.t[-1])
        return flags


class TosHarris:
    """Harris corners of the TOS, looked up per event, for a stream that comes in pieces.

    At every multiple of the period the Harris response of the threshold-ordinal surface is
    computed anew; until the next one an event is a corner if the response at its pixel exceeds a
    share of the largest.  luvHarris computes it as often as the processor allows; a fixed period
    gives the same corners on any machine.

    Parameters
    ----------
    width, height : int
        Sensor size [px].
    period_us : int
        Time between two responses [us].
    share : float
        Of the largest response that a corner exceeds.
    block : int
        Side of the patch that is looked at [px]; that of the TOS by default.

    References
    ----------
    Glover et al., "luvHarris: a practical corner detector for event-cameras", IEEE TPAMI 44(12),
    2021.
    """

    SOBEL, K = 5, 0.04

    def __init__(
        self,
        width: int,
        height: int,
        *,
        period_us: int = 5_000,
        share: float = 0.1,
        block: int = 7,
    ) -> None:
        if int(period_us) != period_us or period_us < 1:
            raise InputError(f"period_us must be whole microseconds, not {period_us!r}")
        if not 0 < share < 1:
            raise InputError(f"share must be between 0 and 1, not {share!r}")
        self._block = int(checks.positive(block, "block", "pixels"))
        self._tos = Tos(width, height)
        self._period_us, self._share = int(period_us), share
        self._corner = np.zeros((height, width), dtype=np.bool_)
        self._next = 0

    def update(self, events: Events) -> Flags:
        """Take in the next events of the stream and tell which of them are corners.

        The parameters, the result and the errors are those of `ArcStar.update`.
        """
        flags = []
        while len(events):
            before = events.between(0, self._next)
            self._tos.update(before)
            flags.append(self._corner[before.y, before.x])
            events = events[len(before) :]
            if len(events):
                self._look()
                self._next = (int(events.t[0]) // self._period_us + 1) * self._period_us
        return np.concatenate(flags) if flags else np.zeros(0, dtype=np.bool_)

    def _look(self) -> None:
        """Find the corners of the surface as it is."""
        surface = self._tos.render().astype(np.float32)
        response = cv2.cornerHarris(surface, self._block, self.SOBEL, self.K)
        self._corner = response > max(self._share * float(response.max()), 0.0)


DETECTORS: dict[str, type[ArcStar] | type[TosHarris]] = {"arc_star": ArcStar, "harris": TosHarris}
"""The detectors by their short names."""


def arc_star(events: Events, *, filter_us: int = FILTER_US) -> Flags:
    """Tell which events are Arc* corners; see `ArcStar`.

    Parameters
    ----------
    events : Events
        The whole stream.
    filter_us : int
        Time of the echo filter [us].

    Returns
    -------
    ndarray of bool, shape (n,)
        True where the event is a corner.
    """
    return ArcStar(events.width, events.height, filter_us=filter_us).update(events)

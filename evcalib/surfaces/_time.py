"""The time surface."""

from __future__ import annotations

import numpy as np

from evcalib import checks
from evcalib.arrays import Floats, Integers
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.kernels.events import EventColumns
from evcalib.kernels.surfaces.time_surface import NEVER, decay, sae_update
from evcalib.surfaces._base import Surface, render_once


class TimeSurface(Surface):
    """Exponentially decayed time of the last event (Lagorce et al. 2017, eq. 2).

    Float64 in [0, 1]: exp(-(t - t_last) / tau) to 1e-14, and exactly 0 where no event ever came.

    Parameters
    ----------
    width, height : int
        Sensor size [px].
    tau : float
        Decay time [s].
    polarity : {"merged", "split"}
        Whether a pixel's last event is the last of either polarity, or each has its own image.
    """

    def __init__(
        self, width: int, height: int, *, tau: float = 0.03, polarity: str = "merged"
    ) -> None:
        self.tau = checks.positive(tau, "tau", "seconds")
        if not 1e-6 <= self.tau <= 1e6:
            raise InputError(f"tau must be 1e-6 to 1e6 seconds, not {tau!r}")
        super().__init__(width, height, polarity)

    def _clear(self) -> None:
        self._sae = np.full(self._planes * self.height * self.width, NEVER, dtype=np.int64)

    def _take(self, events: Events) -> None:
        plane = self._plane(self.height * self.width)
        sae_update(self._sae, plane, EventColumns.of(events), self.width)

    def _image(self, t: int) -> Floats:
        out = np.empty(self._sae.size)
        decay(self._sae, t, 1e-6 / self.tau, out)
        return out

    def last_times(self) -> Integers:
        """Return a copy of the last event's time of each pixel [us], -1 where none came."""
        shape = (self.height, self.width)
        return self._sae.reshape(shape if self.polarity == "merged" else (2, *shape)).copy()


def time_surface(
    events: Events, t_us: int | None = None, *, tau: float = 0.03, polarity: str = "merged"
) -> Floats:
    """Return the time surface of the events up to `t_us`.

    Parameters
    ----------
    events : Events
        What happened.
    t_us : int, optional
        Time of the image [us]; by default that of the last event.
    tau, polarity
        As in `TimeSurface`.

    Returns
    -------
    (height, width) or (2, height, width) float64
        1 for an event at this time, falling to 0 with the age.

    Examples
    --------
    >>> from evcalib import Events
    >>> events = Events(x=[0, 1], y=[0, 0], t=[0, 30_000], p=[1, 1], width=2, height=1)
    >>> time_surface(events, tau=0.03).round(3)
    array([[0.368, 1.   ]])
    """
    return render_once(TimeSurface, events, t_us, tau=tau, polarity=polarity)

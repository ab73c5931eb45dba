"""The paper's surface: TOS AND TS."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from evcalib._event_columns import MAX_TIME_US
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.kernels.surfaces.time_surface import keep_young
from evcalib.surfaces._base import Surface, render_once
from evcalib.surfaces._time import TimeSurface
from evcalib.surfaces._tos import Tos


class TosTs(Surface):
    """TOS where the time surface exceeds a threshold, else 0 (Li et al. 2024, sec. III-A).

    uint8.  The paper gives no threshold.  Its meaning is an age: a value lives on for
    tau ln(1 / ts_threshold) after its pixel's last event, 69 ms by default.

    Parameters
    ----------
    width, height : int
        Sensor size [px].
    k, threshold : int
        Patch and threshold of the `Tos`.
    tau : float
        Decay time [s] of the `TimeSurface`.
    ts_threshold : float
        The time surface must exceed it, in (0, 1).
    polarity : {"merged", "split"}
        As in `Tos`.
    """

    def __init__(
        self,
        width: int,
        height: int,
        *,
        k: int = 7,
        threshold: int | None = None,
        tau: float = 0.03,
        ts_threshold: float = 0.1,
        polarity: str = "merged",
    ) -> None:
        self.tos = Tos(width, height, k=k, threshold=threshold, polarity=polarity)
        self.time_surface = TimeSurface(width, height, tau=tau, polarity=polarity)
        if not 0 < ts_threshold < 1:
            raise InputError(f"ts_threshold must be between 0 and 1, not {ts_threshold!r}")
        self.ts_threshold = float(ts_threshold)
        self.max_age_us = _oldest(self.time_surface.tau * 1e6, self.ts_threshold)
        super().__init__(width, height, polarity)

    def _clear(self) -> None:
        self.tos.reset()
        self.time_surface.reset()

    def _take(self, events: Events) -> None:
        self.tos.update(events)
        self.time_surface.update(events)

    def _image(self, t: int) -> NDArray[np.uint8]:
        image = self.tos.render(t).ravel()
        keep_young(image, self.time_surface.last_times().ravel(), t - self.max_age_us, image)
        return image


def tos_ts(
    events: Events,
    t_us: int | None = None,
    *,
    k: int = 7,
    threshold: int | None = None,
    tau: float = 0.03,
    ts_threshold: float = 0.1,
    polarity: str = "merged",
) -> NDArray[np.uint8]:
    """Return TOS AND TS of the events up to `t_us`.

    Parameters
    ----------
    events : Events
        What happened.
    t_us : int, optional
        Time of the image [us]; by default that of the last event.
    k, threshold, tau, ts_threshold, polarity
        As in `TosTs`.

    Returns
    -------
    (height, width) or (2, height, width) uint8
        The TOS where the time surface is above its threshold, else 0.
    """
    return render_once(
        TosTs,
        events,
        t_us,
        k=k,
        threshold=threshold,
        tau=tau,
        ts_threshold=ts_threshold,
        polarity=polarity,
    )


def _oldest(tau_us: float, threshold: float) -> int:
    """Return the largest whole age [us] at which exp(-age / tau) exceeds the threshold."""
    age = math.floor(-tau_us * math.log(threshold)) + 1
    while age > 0 and not math.exp(-age / tau_us) > threshold:
        age -= 1
    return min(age, MAX_TIME_US + 1)

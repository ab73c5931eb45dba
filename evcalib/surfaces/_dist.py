"""The discounted, sorted timestamp surface."""

from __future__ import annotations

import math

import numpy as np

from evcalib import checks
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.kernels.events import EventColumns
from evcalib.kernels.surfaces.dist import NONE, dist_render, dist_update
from evcalib.kernels.surfaces.time_surface import NEVER
from evcalib.surfaces._base import Surface, odd_side, render_once


class Dist(Surface):
    """Discounted, sorted timestamps (Kim et al. 2021, sec. 4).

    The last time of each pixel, less alpha times the time span of the events in its patch over
    their number, replaced by its rank among the unique values over their number: float64 in
    [0, 1).  Pixels that are alone in their patch become 0.  All events since the start or the
    last `reset` count.

    The paper's normalisation of time to [0, 1] does not change ranks and is left out.  The limit
    of the counts, their quantile over all pixels, is at least 1: where nearly all pixels are
    empty, the authors' code divides by zero.

    Parameters
    ----------
    width, height : int
        Sensor size [px].
    alpha : float
        Weight of the discount, not negative.
    patch : int
        Side of the patch [px], odd, 3 to 31.
    clip : float
        Quantile at which counts are clipped, in (0, 1].
    polarity : {"split", "merged"}
        The paper splits.
    """

    def __init__(
        self,
        width: int,
        height: int,
        *,
        alpha: float = 3.0,
        patch: int = 5,
        clip: float = 0.99,
        polarity: str = "split",
    ) -> None:
        self.alpha = float(alpha)
        if not (math.isfinite(self.alpha) and self.alpha >= 0):
            raise InputError(f"alpha must be a number of at least 0, not {alpha!r}")
        self.patch = odd_side(patch, "patch")
        self.clip = checks.positive(clip, "clip")
        if self.clip > 1:
            raise InputError(f"clip must be a share of at most 1, not {clip!r}")
        super().__init__(width, height, polarity)

    def _clear(self) -> None:
        rows, stride = self.height + self.patch - 1, self.width + self.patch - 1
        self._state = np.empty((3, self._planes, rows, stride), dtype=np.int64)
        self._state[:2], self._state[2] = NONE, 0
        self._start = NEVER

    def _take(self, events: Events) -> None:
        if self._start == NEVER:
            self._start = int(events.t[0])
        rows, stride = self._state.shape[2:]
        corner = self.patch // 2 * (stride + 1)
        state, plane = self._state.reshape(3, -1), self._plane(rows * stride)
        dist_update(state, plane, corner, stride, EventColumns.of(events))

    def _image(self, t: int) -> Floats:
        options = (self._start, self.alpha, self.patch // 2, self.clip)
        planes = np.ascontiguousarray(self._state.swapaxes(0, 1))
        return np.stack([dist_render(plane, *options) for plane in planes])


def dist(
    events: Events,
    t_us: int | None = None,
    *,
    alpha: float = 3.0,
    patch: int = 5,
    clip: float = 0.99,
    polarity: str = "split",
) -> Floats:
    """Return the discounted, sorted timestamps of the events up to `t_us`.

    Parameters
    ----------
    events : Events
        What happened.
    t_us : int, optional
        Time of the image [us]; by default that of the last event.
    alpha, patch, clip, polarity
        As in `Dist`.

    Returns
    -------
    (height, width) or (2, height, width) float64
        Ranks in [0, 1); the latest is highest.
    """
    options = {"alpha": alpha, "patch": patch, "clip": clip}
    return render_once(Dist, events, t_us, **options, polarity=polarity)

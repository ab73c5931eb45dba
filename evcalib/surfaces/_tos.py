"""The threshold-ordinal surface TOS (Glover et al. 2021)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evcalib.events import Events
from evcalib.kernels.events import EventColumns
from evcalib.kernels.surfaces.tos import tos_update
from evcalib.kernels.surfaces.vector import lanes
from evcalib.surfaces._base import Surface, odd_side, render_once, whole


class _Bordered(Surface):
    """A surface with a border of half a patch, so that no patch needs clipping."""

    _side: int
    _dtype: type
    _flat: NDArray

    def _clear(self) -> None:
        reach = self._side // 2
        self._stride = self.width + 2 * reach
        self._cells = (self.height + 2 * reach) * self._stride
        # A vector load may reach past the last patch by less than its length.
        spare = lanes(self._side)
        self._flat = np.zeros(self._planes * self._cells + spare, dtype=self._dtype)

    def _image(self, t: int) -> NDArray:
        reach = self._side // 2
        full = self._flat[: self._planes * self._cells].reshape(self._planes, -1, self._stride)
        return full[:, reach : reach + self.height, reach : reach + self.width].copy()


class Tos(_Bordered):
    """Threshold-ordinal surface (Glover et al. 2021, Alg. 1).

    For each event, subtract 1 from the k x k patch; what falls below the threshold becomes 0; the
    centre becomes 255.  uint8, without time.

    Parameters
    ----------
    width, height : int
        Sensor size [px].
    k : int
        Side of the patch [px], odd, 3 to 31.
    threshold : int, optional
        By default 255 - 2 k, as in the paper.  An implementation that tests before it subtracts
        keeps one value more: it is this one with threshold 254 - 2 k.
    polarity : {"merged", "split"}
        The paper merges.
    """

    _dtype = np.uint8

    def __init__(
        self,
        width: int,
        height: int,
        *,
        k: int = 7,
        threshold: int | None = None,
        polarity: str = "merged",
    ) -> None:
        self.k = self._side = odd_side(k, "k")
        self.threshold = whole(255 - 2 * k if threshold is None else threshold, "threshold", 1, 254)
        super().__init__(width, height, polarity)

    def _take(self, events: Events) -> None:
        plane, columns = self._plane(self._cells), EventColumns.of(events)
        tos_update(self.k)(self._flat, plane, columns, self._stride, self.threshold)


def tos(
    events: Events,
    t_us: int | None = None,
    *,
    k: int = 7,
    threshold: int | None = None,
    polarity: str = "merged",
) -> NDArray[np.uint8]:
    """Return the threshold-ordinal surface of the events up to `t_us`.

    Parameters
    ----------
    events : Events
        What happened.
    t_us : int, optional
        Time of the image [us]; by default that of the last event.
    k, threshold, polarity
        As in `Tos`.

    Returns
    -------
    (height, width) or (2, height, width) uint8
        255 where the last event happened; 0 where nothing is remembered.

    Examples
    --------
    >>> from evcalib import Events
    >>> events = Events(x=[1, 2], y=[1, 1], t=[0, 1000], p=[1, 1], width=4, height=3)
    >>> tos(events, k=3)[1]
    array([  0, 254, 255,   0], dtype=uint8)
    """
    return render_once(Tos, events, t_us, k=k, threshold=threshold, polarity=polarity)

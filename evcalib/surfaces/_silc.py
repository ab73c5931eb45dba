"""The speed-invariant surface SILC (Manderscheid et al. 2019)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evcalib.events import Events
from evcalib.kernels.events import EventColumns
from evcalib.kernels.surfaces.silc import silc_update
from evcalib.surfaces._base import LARGEST_PATCH, render_once, whole
from evcalib.surfaces._tos import _Bordered


class Silc(_Bordered):
    """Speed-invariant time surface (Manderscheid et al. 2019, Alg. 1).

    For each event, subtract 1 in the (2 r + 1)^2 patch wherever the value is not below the
    centre's, as it was before; the centre becomes (2 r + 1)^2.  Values do not fall below 0, which
    the paper leaves open.  uint8 up to r = 7, else uint16.

    Parameters
    ----------
    width, height : int
        Sensor size [px].
    r : int
        Reach of the patch [px], 1 to 15.
    polarity : {"split", "merged"}
        The paper splits.
    """

    def __init__(self, width: int, height: int, *, r: int = 6, polarity: str = "split") -> None:
        self.r = whole(r, "r", 1, LARGEST_PATCH // 2)
        self._side = 2 * self.r + 1
        self._dtype = np.uint8 if self._side**2 <= 255 else np.uint16
        super().__init__(width, height, polarity)

    def _take(self, events: Events) -> None:
        plane, columns = self._plane(self._cells), EventColumns.of(events)
        silc_update(self._side)(self._flat, plane, columns, self._stride)


def silc(
    events: Events, t_us: int | None = None, *, r: int = 6, polarity: str = "split"
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Return the speed-invariant surface of the events up to `t_us`.

    Parameters
    ----------
    events : Events
        What happened.
    t_us : int, optional
        Time of the image [us]; by default that of the last event.
    r, polarity
        As in `Silc`.

    Returns
    -------
    (height, width) or (2, height, width) uint8 or uint16
        (2 r + 1)^2 where the last event happened; 0 where nothing is remembered.
    """
    return render_once(Silc, events, t_us, r=r, polarity=polarity)

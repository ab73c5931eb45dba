"""The clock of a camera against the clock of its host, from the arrival times of packets.

A packet cannot arrive before its last event has happened, so in the plane of camera time and host
time all packets lie above the line that maps one clock to the other; those that were not delayed
lie on it.  The line is therefore sought below all points and as close to them as can be, which is
a problem of the lower convex hull (Zhang, Liu and Xia, "Clock synchronization algorithms for
network measurements", INFOCOM 2002).  Delays that vary, even by much, do not matter then, only
the least delay remains in the result: an unknown constant, which a calibration of the time offset
between camera and vehicle finds together with all others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evcalib.arrays import Floats, Integers
from evcalib.errors import InputError

MAX_DRIFT = 2e-4
"""Clocks of crystals differ by less, even by much less."""
MAX_JUMP_US = 500_000
"""Where the least delays of two stretches of packets differ by more, a clock has jumped."""

_STRETCHES = 40
_PACKETS = 20


@dataclass(frozen=True, eq=False)
class ClockMap:
    """Host time = origin_host + (1 + drift) (camera time - origin_camera), in microseconds.

    Attributes
    ----------
    origin_camera, origin_host : int
        One instant on both clocks [us].
    drift : float
        By how much the host's clock runs faster.
    scatter : float
        Median delay of the packets beyond the least one [us].
    """

    origin_camera: int
    origin_host: int
    drift: float
    scatter: float

    def __call__(self, t: Integers) -> Integers:
        """Return host times [us] of camera times [us], rounded."""
        elapsed = t - self.origin_camera
        return self.origin_host + elapsed + np.rint(self.drift * elapsed).astype(np.int64)


def fit_clock(camera_us: Integers, host_us: Integers, max_drift: float = MAX_DRIFT) -> ClockMap:
    """Fit the line below all packets with the least sum of distances to them.

    Parameters
    ----------
    camera_us : ndarray of int64, shape (n,)
        Time of the last event of each packet on the camera's clock [us].
    host_us : ndarray of int64, shape (n,)
        Arrival on the host's clock [us].
    max_drift : float
        The drift is kept within plus and minus this.

    Returns
    -------
    ClockMap
        The mapping.

    Raises
    ------
    InputError
        If there are no packets, or the clocks do not run together: one of them jumped.
    """
    if not camera_us.size:
        raise InputError("there are no packets to compare the clocks by")
    origin_camera, origin_host = int(camera_us[0]), int(host_us[0])
    x = (camera_us - origin_camera).astype(np.float64)
    delay = (host_us - origin_host) - x
    _refuse_jumps(x, delay)
    drift = float(np.clip(_hull_slope(x, delay), -max_drift, max_drift))
    above = delay - drift * x
    least = float(above.min())
    return ClockMap(
        origin_camera, origin_host + round(least), drift, float(np.median(above - least))
    )


def _refuse_jumps(x: Floats, delay: Floats) -> None:
    count = int(np.clip(x.size // _PACKETS, 1, _STRETCHES))
    stretches = np.array_split(np.arange(x.size), count)
    least = np.array([delay[rows].min() for rows in stretches])
    steps = np.abs(np.diff(least))
    if steps.size and steps.max() > MAX_JUMP_US:
        at = int(np.argmax(steps)) + 1
        raise InputError(
            f"the clocks of camera and host part by {steps.max() / 1e6:.3f} s about"
            f" {x[stretches[at][0]] / 1e6:.1f} s after the start: one of them jumped; use a part"
            " of the recording before or after that"
        )


def _hull_slope(x: Floats, y: Floats) -> float:
    """Return the slope of the lower convex hull at the mean of x.

    The sum of distances to a line below all points is least for the edge of the hull that lies
    under their centre.
    """
    order = np.lexsort((y, x))
    hull: list[tuple[float, float]] = []
    for point in zip(x[order].tolist(), y[order].tolist(), strict=True):
        if hull and point[0] == hull[-1][0]:
            continue
        while len(hull) > 1 and _turns_down(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    if len(hull) < 2:
        return 0.0
    right = int(np.searchsorted([px for px, _ in hull], x.mean()).clip(1, len(hull) - 1))
    (x0, y0), (x1, y1) = hull[right - 1], hull[right]
    return (y1 - y0) / (x1 - x0)


def _turns_down(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """Tell whether b lies on or above the line from a to c."""
    return (b[0] - a[0]) * (c[1] - a[1]) <= (b[1] - a[1]) * (c[0] - a[0])

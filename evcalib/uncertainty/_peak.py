"""Where a sampled curve peaks between its samples, and how sharply."""

from __future__ import annotations

import numpy as np

from evcalib.arrays import Floats


def peak_of_parabola(x: Floats, y: Floats, limit: float) -> tuple[float, float]:
    """Return the vertex of the least-squares parabola through points, and its second derivative.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        At least three points, their x counted from where the peak is expected.
    limit : float
        Vertices farther away than this are moved to it, on their side.

    Returns
    -------
    float
        The vertex; 0 where the parabola opens upwards and has no peak.
    float
        The second derivative: negative at a peak.
    """
    a, b, _ = np.polyfit(x, y, 2)
    return float(np.clip(-b / (2 * a), -limit, limit)) if a < 0 else 0.0, float(2 * a)

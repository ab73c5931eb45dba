"""How noisy a sensor is, measured where the scene is quiet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import lambertw
from scipy.stats import binom

from evcalib.arrays import Floats
from evcalib.kernels.filters.support import BLOCK

QUIET = 0.1
"""Part of the image that is taken to see nothing but noise.  A choice.  What moves is seen there,
too: eight simulated drives without noise, at 0.2 to 1 m/s, pass for up to 1.1 Hz per pixel, and of
seven real recordings by day the worst, stripes that fill the image, for 1.6 Hz.  A simulated sensor
of 96 x 72 px, which has texture everywhere, passes for 3 Hz."""

_QUIET_SD = 1.2816
"""A tenth of a normal distribution lies further below its mean [sd]."""

ALONE_US = 5_000
"""An event that no neighbour of its polarity precedes by so much [us] may be noise.  A choice:
longer leaves out more of what moves, and confounds noise of over 1 / (4 ALONE_US) = 50 Hz with
less."""


MOST_ALONE = (1.0 - 1e-6) * np.exp(-1.0)
"""Most that noise leaves alone, in events per 4 ALONE_US: a hair less, where the inverse ends."""


def block_areas(width: int, height: int) -> Floats:
    """Return the pixels of each block, shape (rows, columns)."""
    side = 1 << BLOCK
    rows, columns = (
        np.minimum(side, length - np.arange(0, length, side)) for length in (height, width)
    )
    return np.outer(rows, columns).astype(np.float64)


def noise_rate(alone: NDArray[np.int32], areas: Floats, seconds: float) -> float:
    """Return events of noise per second and pixel, from the events of blocks without neighbours.

    The quiet part's count is the lower tail of a Poisson distribution, whose root has a standard
    deviation of a half.  Of noise at the rate r, a share exp(-8 (r/2) ALONE) has no neighbour of
    its polarity.
    """
    count = float(np.quantile(alone / areas, QUIET)) * float(np.median(areas))
    mean = (np.sqrt(count) + 0.5 * _QUIET_SD) ** 2 if count else 0.0
    seen = mean / (float(np.median(areas)) * seconds)
    exponent = 4e-6 * ALONE_US
    # More than the most that noise can leave alone, at 50 Hz, is taken for that.
    return float(-lambertw(-min(exponent * seen, MOST_ALONE)).real / exponent)


def share_within(noise_rate: float, within: float, support: int) -> float:
    """Return the share of pure noise that has `support` neighbours of its polarity within a time.

    Each of eight neighbours fires in it with probability 1 - exp(-r within / 2).
    """
    fires = -np.expm1(-0.5 * noise_rate * within)
    return float(binom.sf(support - 1, 8, fires))


def rate_time(share: float, support: int) -> float:
    """Return the product of noise rate and time at which `share_within` is `share`."""
    return float(brentq(lambda time: share_within(1.0, time, support) - share, 0.0, 100.0))

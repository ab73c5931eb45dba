"""Surface of active events (SAE), its exponential decay, and the mask by age."""

from __future__ import annotations

import numpy as np

from evcalib.kernels.jit import jit
from evcalib.kernels.surfaces.vector import as_bits, as_float

NEVER = -1
"""The time of a pixel that has seen no event."""

_ROUND = 6755399441055744.0  # 1.5 * 2**52: adding it leaves the nearest integer in the low bits
_ROUND_BITS = 0x4338000000000000
_LOG2_E = 1.4426950408889634
_LN2_8 = 0.6931471805599453 / 8
_SMALLEST = -1000.0  # below, 2^z would leave the normal numbers


@jit
def sae_update(sae, plane, events, width):
    """sae[p, y, x] = t.  `sae` is flat; `plane` is its size per polarity, 0 to merge them."""
    x, y, t, p = events.x, events.y, events.t, events.p
    for i in range(t.size):
        sae[(plane if p[i] else 0) + np.int64(y[i]) * width + x[i]] = t[i]


@jit
def decay(sae, t, rate, out):
    """exp(-(t - sae) * rate), 0 where sae is NEVER; rate [1/us], ages up to 2**51 us.

    2^z as 2^k (e^r)^8 with k the nearest integer and r = (z - k) ln(2) / 8, |r| <= 0.0433; e^r by
    a Taylor polynomial of degree 7, whose remainder is 2.5e-15 of the result.  Additions and
    multiplications alone: the loop becomes vector code on any CPU.
    """
    binary_rate = rate * _LOG2_E
    for i in range(sae.size):
        age = as_float((t - sae[i]) + _ROUND_BITS) - _ROUND
        z = max(-age * binary_rate, _SMALLEST)
        rounded = z + _ROUND
        r = (z - (rounded - _ROUND)) * _LN2_8
        e = 1 / 6 + r * (1 / 24 + r * (1 / 120 + r * (1 / 720 + r * (1 / 5040))))
        e = 1 + r * (1 + r * (1 / 2 + r * e))
        e *= e
        e *= e
        e *= e
        power = as_float((as_bits(rounded) - _ROUND_BITS + 1023) << 52)
        out[i] = e * power if sae[i] >= 0 else 0.0


@jit
def keep_young(image, sae, oldest, out):
    """Keep the image where sae >= oldest and not NEVER; 0 elsewhere."""
    for i in range(sae.size):
        out[i] = image[i] if sae[i] >= oldest and sae[i] >= 0 else 0

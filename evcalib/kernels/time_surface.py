"""Surface of active events (SAE), its exponential decay, and the mask by age."""

from __future__ import annotations

import numpy as np

from evcalib.kernels._jit import jit
from evcalib.kernels._vector import as_bits, as_float

NEVER = -1
"""The time of a pixel that has seen no event."""

_ROUND = 6755399441055744.0  # 1.5 * 2**52: adding it leaves the nearest integer in the low bits
_ROUND_BITS = 0x4338000000000000
_LOG2_E = 1.4426950408889634
_LN2_HIGH = 0.6931471803691238  # ln 2 without its last bits, so that multiples of it are exact
_LN2_LOW = 1.9082149292705877e-10
_SMALLEST = -700.0  # below, exp would leave the normal numbers; it is under 1e-304 there


@jit
def sae_update(sae, plane, x, y, t, p, width):
    """sae[p, y, x] = t.  `sae` is flat; `plane` is its size per polarity, 0 to merge them."""
    for i in range(t.size):
        sae[(plane if p[i] else 0) + np.int64(y[i]) * width + x[i]] = t[i]


@jit
def decay(sae, t, rate, out):
    """exp(-(t - sae) * rate), 0 where sae is NEVER; rate [1/us], ages up to 2**51 us.

    exp as 2^k e^r with |r| <= ln(2) / 2 and a Taylor polynomial of degree 11 (remainder 7e-15 of
    the value), in additions and multiplications alone: the loop becomes vector code on any CPU.
    """
    for i in range(sae.size):
        age = as_float((t - sae[i]) + _ROUND_BITS) - _ROUND
        z = max(-age * rate, _SMALLEST)
        shifted = z * _LOG2_E + _ROUND
        k = shifted - _ROUND
        r = (z - k * _LN2_HIGH) - k * _LN2_LOW
        e = 1 / 362880 + r * (1 / 3628800 + r * (1 / 39916800))
        e = 1 / 720 + r * (1 / 5040 + r * (1 / 40320 + r * e))
        e = 1 + r * (1 + r * (1 / 2 + r * (1 / 6 + r * (1 / 24 + r * (1 / 120 + r * e)))))
        power = as_float((as_bits(shifted) - _ROUND_BITS + 1023) << 52)
        out[i] = e * power if sae[i] >= 0 else 0.0


@jit
def keep_young(image, sae, oldest, out):
    """Keep the image where sae >= oldest and not NEVER; 0 elsewhere."""
    for i in range(sae.size):
        out[i] = image[i] if sae[i] >= oldest and sae[i] >= 0 else 0

"""Random numbers that depend on a seed and a place alone (splitmix64)."""

import numpy as np

from evcalib.kernels.jit import jit

_MIX = np.uint64(0x9E3779B97F4A7C15)
_MIX_A = np.uint64(0xBF58476D1CE4E5B9)
_MIX_B = np.uint64(0x94D049BB133111EB)


@jit
def draw(state, n):
    """Advance a splitmix64 state; return it and a number below n (Steele et al. 2014)."""
    state = state + _MIX
    z = (state ^ (state >> np.uint64(30))) * _MIX_A
    z = (z ^ (z >> np.uint64(27))) * _MIX_B
    z = z ^ (z >> np.uint64(31))
    return state, np.int64((z >> np.uint64(33)) % np.uint64(n))

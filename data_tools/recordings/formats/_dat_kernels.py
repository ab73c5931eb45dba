"""Decoder of the records of Prophesee's DAT files: records in, event columns out, one pass."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evcalib.kernels.jit import jit

# Fields of the state: the time last read (-1 = none yet), and what loops have added [us].
LAST, LOOPS = range(2)

_HALF = 1 << 31
_LOOP = 1 << 32


@jit
def decode(
    records: NDArray[np.uint32],
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    t: NDArray[np.int64],
    p: NDArray[np.bool_],
    state: NDArray[np.int64],
) -> None:
    """Decode pairs of words: the time, and 14 bits of x, 14 of y, then the polarity.

    A step by more than half the range, 36 minutes, is a loop of the 32-bit clock.
    """
    last, loops = state[LAST], state[LOOPS]
    for k in range(records.shape[0]):
        time, place = np.int64(records[k, 0]), np.int64(records[k, 1])
        if last - time > _HALF:
            loops += _LOOP
        elif last >= 0 and time - last > _HALF:
            loops -= _LOOP
        last = time
        x[k], y[k] = place & 0x3FFF, (place >> 14) & 0x3FFF
        t[k], p[k] = loops + time, (place >> 28) & 1
    state[LAST], state[LOOPS] = last, loops

"""Decoder of EVT 2.0 words (Prophesee, "EVT 2.0 Format"): words in, event columns out, one pass.

The four highest bits of a 32-bit word are its type.  An event holds the six lowest bits of its
time, 11 of x and 11 of y; the 28 higher bits of the time stand in words of their own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evcalib.kernels.jit import jit

OFF, ON, TIME_HIGH, EXT_TRIGGER, OTHERS, CONTINUED = 0x0, 0x1, 0x8, 0xA, 0xE, 0xF

MOST_PER_WORD = 1
"""Events that one word can hold."""

# Fields of the state: high bits last read (-1 = none yet), what loops of them have added [us],
# and counts of what could not be used.
HIGH, LOOPS, EARLY, UNKNOWN, STATE_SIZE = range(5)

_HALF = 1 << 27
_LOOP = 1 << 34


def new_state() -> NDArray[np.int64]:
    """Return the state before the first word."""
    state = np.zeros(STATE_SIZE, dtype=np.int64)
    state[HIGH] = -1
    return state


@jit
def decode(
    words: NDArray[np.uint32],
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    t: NDArray[np.int64],
    p: NDArray[np.bool_],
    state: NDArray[np.int64],
) -> tuple[int, int]:
    """Decode until words or room end; return how many words were read and events written.

    A step of the high bits by more than half their range is a loop of the 34-bit clock.
    """
    high, loops = state[HIGH], state[LOOPS]
    n = k = 0
    while k < words.size and n < t.size:
        word = np.int64(words[k])
        k += 1
        kind = word >> 28
        if kind in (OFF, ON):
            if high < 0:
                state[EARLY] += 1
                continue
            x[n], y[n] = (word >> 11) & 0x7FF, word & 0x7FF
            t[n] = loops + (high << 6) + ((word >> 22) & 0x3F)
            p[n] = kind == ON
            n += 1
        elif kind == TIME_HIGH:
            last, high = high, word & 0xFFFFFFF
            if last - high > _HALF:
                loops += _LOOP
            elif last >= 0 and high - last > _HALF:
                loops -= _LOOP
        elif kind not in (EXT_TRIGGER, OTHERS, CONTINUED):
            state[UNKNOWN] += 1
    state[HIGH], state[LOOPS] = high, loops
    return k, n

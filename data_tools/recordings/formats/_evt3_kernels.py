"""Decoder of EVT 3.0 words (Prophesee, "EVT 3.0 Format"): words in, event columns out, one pass.

The four highest bits of a 16-bit word are its type, and a word holds only what has changed: the
row, the high or the low 12 bits of the time, one event's column, or a base column and then masks
of the 12 or 8 pixels that follow it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evcalib.kernels.jit import jit

Shorts = NDArray[np.uint16]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

ADDR_Y, ADDR_X, BASE_X, VECT_12, VECT_8, TIME_LOW = 0x0, 0x2, 0x3, 0x4, 0x5, 0x6
CONTINUED_4, TIME_HIGH, EXT_TRIGGER, OTHERS, CONTINUED_12 = 0x7, 0x8, 0xA, 0xE, 0xF

MOST_PER_WORD = 12
"""Events that one word can hold."""

# Fields of the state: row, base column of vectors, their polarity, the two parts of the time (-1 =
# not told yet), what loops of the clock have added [us], and counts of what could not be used.
ROW, BASE, SIGN, HIGH, LOW, LOOPS, NO_TIME, NO_PLACE, UNKNOWN, STATE_SIZE = range(10)

_HALF = 1 << 11
_LOOP = 1 << 24


def new_state() -> Ints:
    """Return the state before the first word."""
    state = np.zeros(STATE_SIZE, dtype=np.int64)
    state[[ROW, BASE, HIGH, LOW]] = -1
    return state


@jit
def decode(words: Shorts, x: Shorts, y: Shorts, t: Ints, p: Bools, state: Ints) -> tuple[int, int]:
    """Decode until words or room end; return how many words were read and events written.

    The state lives in local variables here, which is twice as fast.
    """
    row, base, sign = state[ROW], state[BASE], state[SIGN]
    high, low, loops = state[HIGH], state[LOW], state[LOOPS]
    n = k = 0
    while k < words.size and n <= t.size - MOST_PER_WORD:
        kind, value = words[k] >> 12, np.int64(words[k] & 0xFFF)
        k += 1
        if kind == ADDR_X:
            column, mask, on = value & 0x7FF, np.int64(1), value >> 11
        elif kind in (VECT_12, VECT_8):
            pixels = 12 if kind == VECT_12 else 8
            column, mask, on = base, value & ((1 << pixels) - 1), sign
            # A base that no word has told stays unknown, and one that runs away does not wrap.
            base = min(base + pixels, 0x7FFF) if base >= 0 else base
        else:
            if kind == TIME_LOW:
                low = value
            elif kind == ADDR_Y:
                row = value & 0x7FF
            elif kind == BASE_X:
                base, sign = value & 0x7FF, value >> 11
            elif kind == TIME_HIGH:
                # The low bits start anew with each step of the high ones, until their own word.
                low = 0 if 0 <= high != value and low >= 0 else low
                loops += _looped(high, value)
                high = value
            elif kind not in (EXT_TRIGGER, OTHERS, CONTINUED_4, CONTINUED_12):
                state[UNKNOWN] += 1
            continue
        if high < 0 or low < 0:
            state[NO_TIME] += _ones(mask)
        elif row < 0 or column < 0:
            state[NO_PLACE] += _ones(mask)
        else:
            now = loops + (high << 12) + low
            while mask:
                if mask & 1:
                    x[n], y[n], t[n], p[n] = column, row, now, on
                    n += 1
                mask >>= 1
                column += 1
    state[ROW], state[BASE], state[SIGN] = row, base, sign
    state[HIGH], state[LOW], state[LOOPS] = high, low, loops
    return k, n


@jit
def _looped(last: int, high: int) -> int:
    """Return what a step of the high bits adds as loops of the clock [us].

    A step by more than half the range, 8.4 s, is a loop of the 24-bit clock; a smaller one back is
    a step back in time.
    """
    if last - high > _HALF:
        return _LOOP
    if last >= 0 and high - last > _HALF:
        return -_LOOP
    return 0


@jit
def _ones(mask: int) -> int:
    count = 0
    while mask:
        count += mask & 1
        mask >>= 1
    return count

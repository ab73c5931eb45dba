"""Decoder of EVT 3.0 words (Prophesee, "EVT 3.0 Format"): words in, event columns out, one pass.

The four highest bits of a 16-bit word are its type, and a word holds only what has changed: the
row, the high or the low 12 bits of the time, one event's column, or a base column and then masks
of the 12 or 8 pixels that follow it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evcalib.kernels._jit import jit

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
    """Decode until words or room end; return how many words were read and events written."""
    n = 0
    for k in range(words.size):
        if n > t.size - MOST_PER_WORD:
            return k, n
        kind, value = words[k] >> 12, np.int64(words[k] & 0xFFF)
        if kind == ADDR_X:
            if _usable(state, 0, 1):
                x[n], y[n], t[n], p[n] = value & 0x7FF, state[ROW], _time(state), value >> 11
                n += 1
        elif kind == TIME_LOW:
            state[LOW] = value
        elif kind == ADDR_Y:
            state[ROW] = value & 0x7FF
        elif kind == VECT_12:
            n = _vector(value, 12, x, y, t, p, n, state)
        elif kind == VECT_8:
            n = _vector(value & 0xFF, 8, x, y, t, p, n, state)
        elif kind == BASE_X:
            state[BASE], state[SIGN] = value & 0x7FF, value >> 11
        elif kind == TIME_HIGH:
            _set_high(value, state)
        elif kind not in (EXT_TRIGGER, OTHERS, CONTINUED_4, CONTINUED_12):
            state[UNKNOWN] += 1
    return words.size, n


@jit
def _vector(
    mask: int, pixels: int, x: Shorts, y: Shorts, t: Ints, p: Bools, n: int, state: Ints
) -> int:
    """Write the events of a mask and move the base behind it."""
    count = 0
    for k in range(pixels):
        count += (mask >> k) & 1
    if _usable(state, state[BASE], count):
        now = _time(state)
        for k in range(pixels):
            if (mask >> k) & 1:
                x[n], y[n], t[n], p[n] = state[BASE] + k, state[ROW], now, state[SIGN]
                n += 1
    if state[BASE] >= 0:
        # Behind the last column that can be told the base stays: uint16 shall not wrap.
        state[BASE] = min(state[BASE] + pixels, 0x7FFF)
    return n


@jit
def _usable(state: Ints, base: int, count: int) -> bool:
    """Count events whose time or place has not been told yet; return whether both have."""
    if state[HIGH] < 0 or state[LOW] < 0:
        state[NO_TIME] += count
        return False
    if state[ROW] < 0 or base < 0:
        state[NO_PLACE] += count
        return False
    return True


@jit
def _time(state: Ints) -> int:
    return int(state[LOOPS] + (state[HIGH] << 12) + state[LOW])


@jit
def _set_high(high: int, state: Ints) -> None:
    """Set the high bits; the low ones start anew with them, until their own word comes.

    A step by more than half the range, 8.4 s, is a loop of the 24-bit clock; a smaller one back is
    a step back in time.
    """
    last = state[HIGH]
    if last == high:
        return
    if last - high > _HALF:
        state[LOOPS] += _LOOP
    elif last >= 0 and high - last > _HALF:
        state[LOOPS] -= _LOOP
    if last >= 0 and state[LOW] >= 0:
        state[LOW] = 0
    state[HIGH] = high

"""Decoder of the bytes of Event Stream files: bytes in, event columns out, one pass."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evcalib.kernels.jit import jit

# Fields of the state: the time [us], events found, and measurements of exposure passed over.
TIME, COUNT, MEASURED = range(3)


@jit
def decode(
    data: NDArray[np.uint8],
    atis: bool,
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    t: NDArray[np.int64],
    p: NDArray[np.bool_],
    state: NDArray[np.int64],
) -> int:
    """Decode events as far as they are whole; return how many bytes that are.

    An event is a byte of time and polarity, then two bytes of x and two of y.  Before it, bytes
    add to the time, or are passed over (the format's reset).
    """
    at = count = measured = 0
    now = state[TIME]
    size = data.shape[0]
    while at < size:
        first = np.int64(data[at])
        if atis:
            if first >= 0xFC:
                now += 63 * (first & 3)
                at += 1
                continue
        elif first >= 0xFE:
            now += 127 * (first & 1)
            at += 1
            continue
        if at + 5 > size:
            break
        now += first >> 2 if atis else first >> 1
        if atis and first & 1:
            measured += 1
        else:
            x[count] = np.uint16(data[at + 1]) | (np.uint16(data[at + 2]) << 8)
            y[count] = np.uint16(data[at + 3]) | (np.uint16(data[at + 4]) << 8)
            t[count] = now
            p[count] = (first & (2 if atis else 1)) != 0
            count += 1
        at += 5
    state[TIME], state[COUNT] = now, count
    state[MEASURED] += measured
    return at

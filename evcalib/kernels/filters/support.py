"""Loop of the noise filter: which events have neighbours that fired of late."""

from typing import NamedTuple

import numpy as np

from evcalib.kernels.jit import jit

NEVER = -(2**62)
"""Time [us] of an event that never came: older than any event, and safe to subtract from."""

BLOCK = 3
"""Events are counted in blocks of 2**BLOCK pixels a side."""


class State(NamedTuple):
    """What the filter remembers of the stream."""

    last: np.ndarray  # (2, height + 2, width + 2) int64, last event of each polarity [us]
    hot: np.ndarray  # (height, width) bool, pixels that are left out
    fired: np.ndarray  # (height, width) int32, events of this period
    band: np.ndarray  # (height, width) uint8, events by which each pixel flickers up and down
    level: np.ndarray  # (height, width) uint8, where it is in this band


class Limits(NamedTuple):
    """What makes a neighbour support an event."""

    since_us: int  # it fired within this time
    alone_us: int  # and an event that no neighbour precedes by this is counted as alone
    support: int  # so many neighbours keep an event
    flicker: bool  # whether there is any


@jit
def neighbours(events, state, limits, supported, alone):
    """Mark the events that enough of their eight neighbours precede; `state` is updated.

    Parameters
    ----------
    events : EventColumns
        The events of one period.
    state : State
        Updated in place.
    limits : Limits
        What makes an event supported.
    supported : ndarray of bool, shape (n,)
        Output; events of hot pixels and of flicker are neither supported nor remembered.
    alone : ndarray of int32, shape (rows, columns), or None
        Adds up the events of each block that no neighbour precedes.

    Returns
    -------
    int, int
        Events of hot pixels; those of flicker, which go up and down within the band.
    """
    _, rows, stride = state.last.shape
    last, size = state.last.reshape(-1), rows * stride
    hot, fired = state.hot.reshape(-1), state.fired.reshape(-1)
    level, band = state.level.reshape(-1), state.band.reshape(-1)
    of_hot = flickered = 0
    for i in range(events.t.size):
        x, y, t = np.int64(events.x[i]), np.int64(events.y[i]), events.t[i]
        pixel = y * (stride - 2) + x
        fired[pixel] += 1
        if hot[pixel]:
            of_hot += 1
            supported[i] = False
            continue
        if limits.flicker and band[pixel]:
            up, now = events.p[i], level[pixel]
            if now < band[pixel] if up else now > 0:
                level[pixel] = now + 1 if up else now - 1
                flickered += 1
                supported[i] = False
                continue
        # Of the padded image: the neighbour above to the left.
        at = np.uint64(np.int64(events.p[i]) * size + y * stride + x)
        above, mid, below = at, at + np.uint64(stride), at + np.uint64(2 * stride)
        one, two = np.uint64(1), np.uint64(2)
        since = t - limits.since_us
        a, b, c = last[above], last[above + one], last[above + two]
        d, e = last[mid], last[mid + two]
        f, g, h = last[below], last[below + one], last[below + two]
        found = (
            np.int64(a >= since) + np.int64(b >= since) + np.int64(c >= since)
            + np.int64(d >= since) + np.int64(e >= since)
            + np.int64(f >= since) + np.int64(g >= since) + np.int64(h >= since)
        )  # fmt: skip
        if alone is not None:
            youngest = max(max(max(a, b), max(c, d)), max(max(e, f), max(g, h)))
            alone[y >> BLOCK, x >> BLOCK] += np.int32(youngest < t - limits.alone_us)
        last[mid + one] = t
        supported[i] = found >= limits.support
    return of_hot, flickered


@jit
def warm(heat, fired, rate, share):
    """Move `heat` towards ``rate * fired`` by a share of the way, and set `fired` to zero."""
    flat, counts = heat.reshape(-1), fired.reshape(-1)
    for i in range(flat.size):
        flat[i] += share * (rate * counts[i] - flat[i])
        counts[i] = 0


@jit
def find_hot(heat, factor, least, hot):
    """Mark the pixels that are far hotter than their neighbours, all but one of these.

    Parameters
    ----------
    heat : ndarray of float64, shape (height, width)
        Events per second.
    factor, least : float
        A pixel is hot above ``least`` and ``factor`` times the second hottest neighbour.
    hot : ndarray of bool, shape (height, width)
        Output.
    """
    height, width = heat.shape
    for y in range(height):
        for x in range(width):
            hot[y, x] = False
            if heat[y, x] <= least:
                continue
            first = second = 0.0
            for v in range(max(y - 1, 0), min(y + 2, height)):
                for u in range(max(x - 1, 0), min(x + 2, width)):
                    if v == y and u == x:
                        continue
                    first, second = max(first, heat[v, u]), max(second, min(first, heat[v, u]))
            hot[y, x] = heat[y, x] > least + factor * second

"""Loops of the discounted, sorted timestamp surface (DiST).

The state of a polarity is an array (3, rows, stride) with a border of half a patch: the last time
[us], minus the first time, and the number of events of each pixel.  Times start as NONE.
"""

from __future__ import annotations

import numpy as np

from evcalib.kernels.jit import jit
from evcalib.kernels.surfaces.vector import as_bits

LAST, MINUS_FIRST, COUNT = range(3)
NONE = -(1 << 62)  # before every time

_BITS = 12
_BINS = 1 << _BITS
_DIGITS = 6


@jit
def dist_update(state, plane, corner, stride, events):
    """Take events; `state` has shape (3, cells), pixel (0, 0) is cell `corner`."""
    x, y, t, p = events.x, events.y, events.t, events.p
    for i in range(t.size):
        at = corner + (plane if p[i] else 0) + np.int64(y[i]) * stride + x[i]
        if state[COUNT, at] == 0:
            state[MINUS_FIRST, at] = -t[i]
        state[LAST, at] = t[i]
        state[COUNT, at] += 1


@jit
def dist_render(state, start, alpha, reach, share):
    """Return the rank of the discounted times of one polarity, shape (height, width).

    value = last - start - alpha (max last - min first) / (sum of counts), over squares of
    2 reach + 1 pixels and with clipped counts, at least 0; 0 where the sum is 1, that is without
    a neighbour.
    """
    rows, stride = state.shape[1:]
    height, width = rows - 2 * reach, stride - 2 * reach
    last, count = state[LAST].ravel(), state[COUNT].ravel()
    seen = _nonzero(count)
    late, early, near = state[LAST].copy(), state[MINUS_FIRST].copy(), state[COUNT].copy()
    _clip(near, max(1, _quantile(count, seen, share, height * width)))
    _patch(late, width, True)
    _patch(early, width, True)
    _patch(near, width, False)
    late, early, near = late.ravel(), early.ravel(), near.ravel()
    keys, places = np.empty_like(seen), np.empty_like(seen)
    n = 0
    for at in seen:
        patch = at - reach * (stride + 1)
        time = float(last[at] - start) - alpha * (late[patch] + early[patch]) / near[patch]
        keys[n] = as_bits(time)
        places[n] = at
        n += near[patch] > 1 and time > 0  # without a branch: guessed wrong too often
    rank = np.zeros((rows, stride))
    _rank(keys[:n], places[:n], height * width, rank.ravel())
    return rank[reach : reach + height, reach : reach + width].copy()


@jit
def _nonzero(count):
    """Return the places of the pixels with events."""
    places = np.empty(count.size, dtype=np.int64)
    n = 0
    for i in range(count.size):
        places[n] = i
        n += count[i] > 0
    return places[:n]


@jit
def _quantile(count, seen, share, pixels):
    """Return the smallest count that at least `share` of the pixels do not exceed."""
    some = np.empty(seen.size, dtype=np.int64)
    low, high = 0, 0
    for i in range(seen.size):
        some[i] = count[seen[i]]
        high = max(high, some[i])
    while low < high:
        middle = (low + high) // 2
        within = pixels - seen.size
        for n in some:
            within += n <= middle
        if within >= share * pixels:
            high = middle
        else:
            low = middle + 1
    return low


@jit
def _clip(image, limit):
    for row in range(image.shape[0]):
        for col in range(image.shape[1]):
            image[row, col] = min(image[row, col], limit)


@jit
def _patch(image, width, largest):
    """Replace each cell by the maximum or the sum of the square patch that starts there."""
    border = image.shape[1] - width
    height = image.shape[0] - border
    for row in range(image.shape[0]):
        wide = image[row].copy()
        for shift in range(1, border + 1):
            _join(image[row, :width], wide[shift : shift + width], largest)
    for row in range(height):
        for shift in range(1, border + 1):
            _join(image[row, :width], image[row + shift, :width], largest)


@jit
def _join(into, other, largest):
    if largest:
        for i in range(into.size):
            into[i] = max(into[i], other[i])
    else:
        for i in range(into.size):
            into[i] += other[i]


@jit
def _rank(keys, places, pixels, out):
    """Write the rank of each key among the unique ones of all pixels, over their number.

    Keys are the bits of positive floats, which have the same order.  Pixels without one are 0.
    """
    keys, places = _sorted(keys, places)
    first = 0 if keys.size < pixels else -1
    unique, previous = first + 1, 0
    for key in keys:
        unique += key != previous
        previous = key
    rank, previous = first, 0
    for i in range(keys.size):
        rank += keys[i] != previous
        previous = keys[i]
        out[places[i]] = rank / unique


@jit
def _sorted(keys, places):
    """Sort positive keys with their places, digit by digit from the lowest."""
    low, high = 1 << 62, 0
    for key in keys:
        low, high = min(low, key), max(high, key)
    starts = np.zeros((_DIGITS, _BINS), dtype=np.int64)
    for key in keys:
        for digit in range(_DIGITS):
            starts[digit, ((key - low) >> (_BITS * digit)) & (_BINS - 1)] += 1
    other_keys, other_places = np.empty_like(keys), np.empty_like(places)
    for digit in range(_DIGITS):
        shift = _BITS * digit
        if (high - low) >> shift == 0:
            break
        _to_starts(starts[digit])
        for i in range(keys.size):
            value = ((keys[i] - low) >> shift) & (_BINS - 1)
            at = starts[digit, value]
            starts[digit, value] = at + 1
            other_keys[at] = keys[i]
            other_places[at] = places[i]
        keys, other_keys = other_keys, keys
        places, other_places = other_places, places
    return keys, places


@jit
def _to_starts(counts):
    """Replace counts by the sums of those before them."""
    total = 0
    for i in range(counts.size):
        count = counts[i]
        counts[i] = total
        total += count

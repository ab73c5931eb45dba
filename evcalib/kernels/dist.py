"""Loops of the discounted, sorted timestamp surface (DiST)."""

from __future__ import annotations

import numpy as np

from evcalib.kernels._jit import jit
from evcalib.kernels._vector import as_bits

_DIGIT = 11
_BINS = 1 << _DIGIT
_NONE = -(1 << 62)  # before every time, also with its sign changed


@jit
def dist_update(first, last, count, plane, x, y, t, p, width):
    """Keep the first and the last time [us] and the number of events of each pixel (flat)."""
    for i in range(t.size):
        at = (plane if p[i] else 0) + np.int64(y[i]) * width + x[i]
        if count[at] == 0:
            first[at] = t[i]
        last[at] = t[i]
        count[at] += 1


@jit
def dist_render(first, last, count, start, alpha, reach, share):
    """Rank of the discounted times of one polarity, shape (height, width).

    value = last - start - alpha (max last - min first) / (sum of counts), over squares of
    2 reach + 1 pixels and with clipped counts, at least 0; 0 where the sum is 1, that is without
    a neighbour.
    """
    height, width = count.shape
    limit = max(1, _quantile(count.ravel(), share))
    late = np.empty((height + 2 * reach, width + 2 * reach), dtype=np.int64)
    late[:] = _NONE
    early, near = late.copy(), np.zeros_like(late)
    for row in range(height):
        for col in range(width):
            if count[row, col] > 0:
                late[row + reach, col + reach] = last[row, col]
                early[row + reach, col + reach] = -first[row, col]
                near[row + reach, col + reach] = min(count[row, col], limit)
    late = _patch(late, width, True)
    early = _patch(early, width, True)
    near = _patch(near, width, False)
    value = np.zeros((height, width))
    for row in range(height):
        for col in range(width):
            if count[row, col] > 0 and near[row, col] > 1:
                spread = late[row, col] + early[row, col]
                time = float(last[row, col] - start) - alpha * spread / near[row, col]
                value[row, col] = max(time, 0.0)
    return _ranks(value.ravel()).reshape(height, width)


@jit
def _quantile(count, share):
    """Smallest count that at least `share` of the pixels do not exceed."""
    low, high = 0, 0
    for n in count:
        high = max(high, n)
    while low < high:
        middle = (low + high) // 2
        within = 0
        for n in count:
            within += n <= middle
        if within >= share * count.size:
            high = middle
        else:
            low = middle + 1
    return low


@jit
def _patch(image, width, largest):
    """Maximum or sum over each square patch of an image that has a border of half a patch."""
    border = image.shape[1] - width
    height = image.shape[0] - border
    for row in range(image.shape[0]):
        wide = image[row].copy()
        for shift in range(1, border + 1):
            _join(image[row, :width], wide[shift : shift + width], largest)
    for row in range(height):
        for shift in range(1, border + 1):
            _join(image[row, :width], image[row + shift, :width], largest)
    return image


@jit
def _join(into, other, largest):
    if largest:
        for i in range(into.size):
            into[i] = max(into[i], other[i])
    else:
        for i in range(into.size):
            into[i] += other[i]


@jit
def _ranks(values):
    """Rank of each value, >= 0, among the unique values, divided by their number."""
    keys = np.empty(values.size, dtype=np.int64)
    places = np.empty(values.size, dtype=np.int64)
    n = 0
    for i in range(values.size):
        keys[n] = as_bits(values[i])
        places[n] = i
        n += values[i] > 0  # without a branch: it would be guessed wrong half of the time
    keys, places = _sorted(keys[:n], places[:n])
    rank = 0 if n < values.size else -1
    unique = rank + 1
    for i in range(n):
        unique += i == 0 or keys[i] != keys[i - 1]
    out = np.zeros(values.size)
    for i in range(n):
        rank += i == 0 or keys[i] != keys[i - 1]
        out[places[i]] = rank / unique
    return out


@jit
def _sorted(keys, places):
    """Sort keys, the bits of positive floats, with their places, digit by digit."""
    other_keys, other_places = np.empty_like(keys), np.empty_like(places)
    for shift in range(0, 64, _DIGIT):
        starts = np.zeros(_BINS + 1, dtype=np.int64)
        for key in keys:
            starts[((key >> shift) & (_BINS - 1)) + 1] += 1
        for digit in range(_BINS):
            starts[digit + 1] += starts[digit]
        for i in range(keys.size):
            digit = (keys[i] >> shift) & (_BINS - 1)
            at = starts[digit]
            other_keys[at] = keys[i]
            other_places[at] = places[i]
            starts[digit] = at + 1
        keys, other_keys = other_keys, keys
        places, other_places = other_places, places
    return keys, places

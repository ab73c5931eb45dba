"""Loops of keypoints and their descriptors; a matcher per length of these, made on first use."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from evcalib.kernels.jit import jit

_M1 = np.uint64(0x5555555555555555)
_M2 = np.uint64(0x3333333333333333)
_M4 = np.uint64(0x0F0F0F0F0F0F0F0F)
_H01 = np.uint64(0x0101010101010101)
_ONE, _TWO, _FOUR, _TOP = np.uint64(1), np.uint64(2), np.uint64(4), np.uint64(56)


class Points(NamedTuple):
    """Keypoints as they are matched: sorted by class, then y."""

    xy: np.ndarray  # (n, 2) float64 [px]
    p: np.ndarray  # (n,) bool, the class


@jit
def gather_corners(events, owner, first, disc, sums):
    """Gather corner events into keypoints, newest first; return the number of keypoints.

    The newest event that no keypoint of its polarity owns founds one, which then owns the disc
    around it as far as it is free; every other event adds to its owner.

    Parameters
    ----------
    events : EventColumns
        The corner events.
    owner : ndarray of int64, shape (2, height, width)
        Number of each pixel's owner; those below `first` are of calls before and count as none.
    first : int
        Number of the first keypoint.
    disc : ndarray of int64, shape (m, 2)
        The pixels of a keypoint, as steps dx, dy.
    sums : ndarray of float64, shape (n, 5)
        Output, room for one keypoint per event: sums of x, y and t, number of events, polarity.
    """
    _, height, width = owner.shape
    found = 0
    for i in range(events.t.size - 1, -1, -1):
        x, y, p = np.int64(events.x[i]), np.int64(events.y[i]), np.int64(events.p[i])
        k = owner[p, y, x] - first
        if k < 0:
            k = found
            found += 1
            for step in range(len(disc)):
                col, row = x + disc[step, 0], y + disc[step, 1]
                inside = 0 <= col < width and 0 <= row < height
                if inside and owner[p, row, col] < first:
                    owner[p, row, col] = first + k
            sums[k] = 0.0
            sums[k, 4] = p
        sums[k, 0] += x
        sums[k, 1] += y
        sums[k, 2] += events.t[i]
        sums[k, 3] += 1.0
    return found


@jit
def brief(image, centres, pattern, bits):
    """Fill in BRIEF descriptors: bit b is set if the first pixel of test b is darker.

    Parameters
    ----------
    image : ndarray of float32, shape (height, width)
        The smoothed surface.
    centres : ndarray of int64, shape (n, 2)
        Columns x, y; the whole pattern around them lies in the image.
    pattern : ndarray of int64, shape (64 m, 4)
        Tests as dx, dy, dx, dy.
    bits : ndarray of uint64, shape (n, m)
        Output.
    """
    flat = image.reshape(-1)
    width = image.shape[1]
    first = pattern[:, 1] * width + pattern[:, 0]
    second = pattern[:, 3] * width + pattern[:, 2]
    for k in range(len(centres)):
        at = centres[k, 1] * width + centres[k, 0]
        for word in range(bits.shape[1]):
            value = np.uint64(0)
            for b in range(64):
                test = 64 * word + b
                darker = flat[at + first[test]] < flat[at + second[test]]
                value |= np.uint64(darker) << np.uint64(b)
            bits[k, word] = value


@jit
def _count_bits(v):
    """Return the number of set bits (LLVM knows this pattern as one instruction)."""
    v = v - ((v >> _ONE) & _M1)
    v = (v & _M2) + ((v >> _TWO) & _M2)
    v = (v + (v >> _FOUR)) & _M4
    return np.int64((v * _H01) >> _TOP)


@lru_cache
def matcher(words: int) -> Callable[..., Any]:
    """Return the matcher of descriptors of so many words."""

    @jit
    def near(own, bits, start, end, farthest, found):
        """Fill in which descriptors from start to end are near one, and how near; return how many.

        The number of words is a constant here, so that the loop over them is unrolled.
        """
        count = 0
        for j in range(np.uint64(start), np.uint64(end)):
            distance = 0
            for word in range(words):
                distance += _count_bits(own[word] ^ bits[j, word])
            if distance <= farthest:
                found[count, 0], found[count, 1] = j, distance
                count += 1
        return count

    @jit
    def match(bits1, bits2, points1, points2, reach, farthest):
        """Return the matches as an array of index pairs, shape (m, 2).

        Two keypoints match if each is the other's nearest by Hamming distance among those within
        the reach, and the distance is at most `farthest`.  Of equally near ones the first counts.

        Few are near by their descriptors, so these are compared first, by the CPU's instruction
        that counts bits.  Distance and index share one number: a minimum finds both.

        Parameters
        ----------
        bits1, bits2 : ndarray of uint64, shape (n1, words) and (n2, words)
            Descriptors.
        points1, points2 : Points
            Their places and classes; only equal classes match.
        reach : float
            Largest displacement [px].
        farthest : int
            Largest Hamming distance.
        """
        n1, n2 = len(bits1), len(bits2)
        xy1, class1, xy2, class2 = points1.xy, points1.p, points2.xy, points2.p
        nothing = np.int64((farthest + 1) << 32)
        best1, best2 = np.full(n1, nothing), np.full(n2, nothing)
        found = np.empty((n2, 2), dtype=np.int64)
        start, end = 0, 0
        for i in range(n1):
            x, y, group = xy1[i, 0], xy1[i, 1], class1[i]
            while start < n2 and (
                class2[start] < group or (class2[start] == group and xy2[start, 1] < y - reach)
            ):
                start += 1
            end = max(end, start)
            while end < n2 and class2[end] == group and xy2[end, 1] <= y + reach:
                end += 1
            for k in range(near(bits1[i], bits2, start, end, farthest, found)):
                j, distance = found[k]
                dx, dy = xy2[j, 0] - x, xy2[j, 1] - y
                if dx * dx + dy * dy <= reach * reach:
                    best1[i] = min(best1[i], (distance << 32) + j)
                    best2[j] = min(best2[j], (distance << 32) + i)
        pairs = np.empty((n1, 2), dtype=np.int64)
        count = 0
        for i in range(n1):
            j = best1[i] & 0xFFFFFFFF
            if best1[i] < nothing and best2[j] & 0xFFFFFFFF == i:
                pairs[count] = (i, j)
                count += 1
        return pairs[:count]

    return match

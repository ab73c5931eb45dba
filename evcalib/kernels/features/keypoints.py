"""Loops of keypoints and their descriptors."""

import numpy as np

from evcalib.kernels.jit import jit

_M1 = np.uint64(0x5555555555555555)
_M2 = np.uint64(0x3333333333333333)
_M4 = np.uint64(0x0F0F0F0F0F0F0F0F)
_H01 = np.uint64(0x0101010101010101)
_ONE, _TWO, _FOUR, _TOP = np.uint64(1), np.uint64(2), np.uint64(4), np.uint64(56)


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


@jit
def _add_distance(own, others, distance):
    """Add the number of bits in which one word differs from each of the others."""
    for j in range(others.size):
        distance[j] += _count_bits(own ^ others[j])


@jit
def _nearest(distance, dx, dy, limit, nothing, code, best2):
    """Return the least (distance, index) within the limit; keep each other's least in best2."""
    best = nothing
    for j in range(distance.size):
        key = (distance[j] << 32) if dx[j] * dx[j] + dy[j] * dy[j] <= limit else nothing
        best = min(best, key + j)
        best2[j] = min(best2[j], key + code)
    return best


@jit
def match(bits1, columns2, points1, points2, reach, farthest):
    """Return the matches as an array of index pairs, shape (m, 2).

    Two keypoints match if each is the other's nearest by Hamming distance among those within the
    reach, and the distance is at most `farthest`.  Of equally near ones the first counts.

    The inner loops have no branches, so that they become vector code; distance and index share
    one number, so that a minimum finds both.

    Parameters
    ----------
    bits1 : ndarray of uint64, shape (n1, m)
        Descriptors.
    columns2 : ndarray of uint64, shape (m, n2)
        The other descriptors, transposed.
    points1, points2 : ndarray of float64, shape (3, n1) and (3, n2)
        Rows x, y [px], and a class; only equal classes match.  Sorted by class, then y.
    reach : float
        Largest displacement [px].
    farthest : int
        Largest Hamming distance.
    """
    n1, n2, words = len(bits1), points2.shape[1], bits1.shape[1]
    x2, y2, class2 = points2
    nothing = np.int64((farthest + 1) << 32)
    best1, best2 = np.full(n1, nothing), np.full(n2, nothing)
    start, end = 0, 0
    for i in range(n1):
        x, y, group = points1[:, i]
        while start < n2 and (
            class2[start] < group or (class2[start] == group and y2[start] < y - reach)
        ):
            start += 1
        end = max(end, start)
        while end < n2 and class2[end] == group and y2[end] <= y + reach:
            end += 1
        distance = np.zeros(end - start, dtype=np.int64)
        for word in range(words):
            _add_distance(bits1[i, word], columns2[word, start:end], distance)
        dx, dy = x2[start:end] - x, y2[start:end] - y
        best1[i] = start + _nearest(distance, dx, dy, reach * reach, nothing, i, best2[start:end])
    pairs = np.empty((n1, 2), dtype=np.int64)
    found = 0
    for i in range(n1):
        j = best1[i] & 0xFFFFFFFF
        if best1[i] < nothing and best2[j] & 0xFFFFFFFF == i:
            pairs[found] = (i, j)
            found += 1
    return pairs[:found]

"""Loops of keypoints and their descriptors."""

import numpy as np

from evcalib.kernels._jit import jit

_M1 = np.uint64(0x5555555555555555)
_M2 = np.uint64(0x3333333333333333)
_M4 = np.uint64(0x0F0F0F0F0F0F0F0F)
_H01 = np.uint64(0x0101010101010101)
_ONE, _TWO, _FOUR, _TOP = np.uint64(1), np.uint64(2), np.uint64(4), np.uint64(56)


@jit
def gather_corners(events, owner, reach, sums):
    """Gather corner events into keypoints, newest first; return the number of keypoints.

    The newest event that no keypoint of its polarity owns founds one, which then owns the disc of
    radius `reach` around it; every other event adds to its owner.

    Parameters
    ----------
    events : tuple of x, y, t, p
        Columns of the corner events, ascending in time.
    owner : ndarray of int32, shape (2, height, width)
        All -1, and left so.
    reach : int
        Radius of a keypoint [px].
    sums : ndarray of float64, shape (n, 5)
        Output, room for one keypoint per event: sums of x, y and t, number of events, polarity.
    """
    xs, ys, ts, ps = events
    _, height, width = owner.shape
    found = 0
    newest = np.empty((xs.size, 3), dtype=np.int64)
    for i in range(xs.size - 1, -1, -1):
        x, y, p = np.int64(xs[i]), np.int64(ys[i]), np.int64(ps[i])
        k = owner[p, y, x]
        if k < 0:
            k = found
            found += 1
            _paint(owner[p], x, y, reach, -1, k)
            newest[k] = (x, y, p)
            sums[k] = 0.0
            sums[k, 4] = p
        sums[k, 0] += x
        sums[k, 1] += y
        sums[k, 2] += ts[i]
        sums[k, 3] += 1.0
    for k in range(found):
        _paint(owner[newest[k, 2]], newest[k, 0], newest[k, 1], reach, k, -1)
    return found


@jit
def _paint(owner, x, y, reach, old, new):
    """Give the pixels of a disc that belong to `old` to `new`."""
    height, width = owner.shape
    for row in range(max(y - reach, 0), min(y + reach + 1, height)):
        for col in range(max(x - reach, 0), min(x + reach + 1, width)):
            inside = (row - y) ** 2 + (col - x) ** 2 <= reach * reach
            if inside and owner[row, col] == old:
                owner[row, col] = new


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
def match(bits1, bits2, points1, points2, reach, farthest):
    """Return the matches as an array of index pairs, shape (m, 2).

    Two keypoints match if each is the other's nearest by Hamming distance among those within the
    reach, and the distance is at most `farthest`.  Of equally near ones the first counts.

    Parameters
    ----------
    bits1, bits2 : ndarray of uint64, shape (n, m)
        Descriptors.
    points1, points2 : ndarray of float64, shape (n, 3)
        Columns x, y [px], and a class; only equal classes match.  Sorted by class, then y.
    reach : float
        Largest displacement [px].
    farthest : int
        Largest Hamming distance.
    """
    n1, n2, words = len(bits1), len(bits2), bits1.shape[1]
    best1, near1 = np.full(n1, farthest + 1), np.full(n1, -1)
    best2, near2 = np.full(n2, farthest + 1), np.full(n2, -1)
    start = 0
    for i in range(n1):
        x, y, group = points1[i]
        while start < n2 and (
            points2[start, 2] < group
            or (points2[start, 2] == group and points2[start, 1] < y - reach)
        ):
            start += 1
        for j in range(start, n2):
            if points2[j, 2] != group or points2[j, 1] > y + reach:
                break
            dx, dy = points2[j, 0] - x, points2[j, 1] - y
            if dx * dx + dy * dy > reach * reach:
                continue
            distance = 0
            for word in range(words):
                distance += _count_bits(bits1[i, word] ^ bits2[j, word])
            if distance < best1[i]:
                best1[i], near1[i] = distance, j
            if distance < best2[j]:
                best2[j], near2[j] = distance, i
    pairs = np.empty((n1, 2), dtype=np.int64)
    found = 0
    for i in range(n1):
        if near1[i] >= 0 and near2[near1[i]] == i:
            pairs[found] = (i, near1[i])
            found += 1
    return pairs[:found]

"""Loops of the corner detectors."""

from typing import NamedTuple

import numpy as np

from evcalib.kernels.jit import jit

NEVER = -(2**62)
"""Time [us] of an event that never came: older than any event, and safe to add a window to."""

# Circles as (dx, dy), starting below the pixel and running counter-clockwise on the screen.
SMALL_CIRCLE = np.array(
    [[0, 3], [1, 3], [2, 2], [3, 1], [3, 0], [3, -1], [2, -2], [1, -3],
     [0, -3], [-1, -3], [-2, -2], [-3, -1], [-3, 0], [-3, 1], [-2, 2], [-1, 3]]
)  # fmt: skip
LARGE_CIRCLE = np.array(
    [[0, 4], [1, 4], [2, 3], [3, 2], [4, 1], [4, 0], [4, -1], [3, -2], [2, -3], [1, -4],
     [0, -4], [-1, -4], [-2, -3], [-3, -2], [-4, -1], [-4, 0], [-4, 1], [-3, 2], [-2, 3], [-1, 4]]
)  # fmt: skip


class Sizes(NamedTuple):
    """Elements of a circle, and fewest and most of them in the arc of a corner."""

    circle: int
    least: int
    most: int


class Circles(NamedTuple):
    """Steps to the pixels of both circles, from `circle_steps`."""

    small: np.ndarray  # (16,) uint64
    large: np.ndarray  # (20,) uint64


class Arc(NamedTuple):
    """An arc that grows: where it goes on, and the oldest elements [us]."""

    up: np.uint64
    down: np.uint64
    up_oldest: int  # of those passed on this side
    down_oldest: int
    oldest: int  # of the arc


SMALL_SIZES = Sizes(16, 3, 6)
LARGE_SIZES = Sizes(20, 4, 8)
BORDER = 4

# Unsigned indices spare the test for indices counted from the end.
_U = np.uint64
_ONE = np.uint64(1)


def circle_steps(circle, width):
    """Return a circle as flat steps from the pixel BORDER rows and columns before its centre."""
    return ((circle[:, 1] + BORDER) * width + circle[:, 0] + BORDER).astype(np.uint64)


@jit
def _rest_is_older(ring, up, n_rest, oldest):
    """Tell whether all n_rest elements not yet in the arc are older than its oldest."""
    newest = NEVER
    for i in range(n_rest):
        newest = max(newest, ring[up + _U(i)])
    return newest < oldest


@jit
def _grow(ring, arc, steps, always):
    """Grow the arc by a number of steps, written without branches."""
    up, down = arc.up, arc.down
    up_oldest, down_oldest, oldest = arc.up_oldest, arc.down_oldest, arc.oldest
    for _ in range(steps):
        up_head, down_head = ring[up], ring[down]
        upward = up_head > down_head
        up_oldest = min(up_oldest, up_head)
        down_oldest = min(down_oldest, down_head)
        side_oldest = up_oldest if upward else down_oldest
        joins = always or max(up_head, down_head) >= oldest
        oldest = min(oldest, side_oldest) if joins else oldest
        up += _U(upward)
        down -= _U(not upward)
    return Arc(up, down, up_oldest, down_oldest, oldest)


@jit
def _is_corner_circle(flat, steps, origin, ring, sizes):
    """Tell whether the newest arc of one circle, or its complement, has one of the sizes.

    The minimum of the arc only falls, so a remaining element that is no older than it will join
    when its turn comes.  Hence "the size stays at most k" is the same as "after k elements all
    the others are older than the arc's oldest", and no arc need be grown to its end.
    """
    n, k_min, k_max = sizes.circle, sizes.least, sizes.most
    start, newest = _U(0), flat[origin + steps[0]]
    for i in range(n):
        value = flat[origin + steps[i]]
        ring[i] = value
        ring[i + n] = value
        if value > newest:
            start, newest = _U(i), value
    arc = Arc(start + _ONE, start + _U(n - 1), newest, newest, newest)
    arc = _grow(ring, arc, k_min - 1, True)
    arc = _grow(ring, arc, k_max - k_min, False)
    if _rest_is_older(ring, arc.up, n - k_max, arc.oldest):
        return True
    arc = _grow(ring, arc, n - 2 * k_max - 1, False)
    too_short = _rest_is_older(ring, arc.up, k_max + 1, arc.oldest)
    arc = _grow(ring, arc, k_max + 1 - k_min, False)
    return not too_short and _rest_is_older(ring, arc.up, k_min, arc.oldest)


@jit
def arc_star(events, last, sae, filter_us, circles, flags):
    """Mark the Arc* corners among events; `last` and `sae` are updated in place.

    Parameters
    ----------
    events : EventColumns
        The events.
    last : ndarray of int64, shape (height, width, 2)
        Time [us] of the last event of each polarity.
    sae : ndarray of int64, shape (2, height, width)
        Time [us] of the last event of each polarity that passed the filter.
    filter_us : int
        An event passes if its polarity came longer ago than this, or not since the other one.
    circles : Circles
        Of this width.
    flags : ndarray of bool, shape (n,)
        Output.
    """
    _, height, width = sae.shape
    flat = sae.reshape(-1)
    ring = np.empty(2 * circles.large.size, dtype=np.int64)
    for i in range(events.t.size):
        x, y, t = np.int64(events.x[i]), np.int64(events.y[i]), events.t[i]
        p = np.int64(events.p[i])
        flags[i] = False
        same, other = last[y, x, p], last[y, x, 1 - p]
        last[y, x, p] = t
        if t <= same + filter_us and other <= same:
            continue
        at = (p * height + y) * width + x
        flat[at] = t
        if x < BORDER or y < BORDER or x >= width - BORDER or y >= height - BORDER:
            continue
        origin = _U(at - BORDER * width - BORDER)
        if _is_corner_circle(flat, circles.small, origin, ring, SMALL_SIZES):
            flags[i] = _is_corner_circle(flat, circles.large, origin, ring, LARGE_SIZES)

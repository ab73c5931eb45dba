"""Loops of the corner detectors."""

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
# Elements of a circle, and fewest and most of them in the arc of a corner.
SMALL_SIZES = (16, 3, 6)
LARGE_SIZES = (20, 4, 8)
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
    """Grow the arc by a number of steps, written without branches.

    An arc is (up, down, up_oldest, down_oldest, oldest): the two heads, the oldest element passed
    on either side, and the oldest of the arc.
    """
    up, down, up_oldest, down_oldest, oldest = arc
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
    return up, down, up_oldest, down_oldest, oldest


@jit
def _is_corner_circle(flat, steps, origin, ring, sizes):
    """Tell whether the newest arc of one circle, or its complement, has one of the sizes.

    The minimum of the arc only falls, so a remaining element that is no older than it will join
    when its turn comes.  Hence "the size stays at most k" is the same as "after k elements all
    the others are older than the arc's oldest", and no arc need be grown to its end.
    """
    n, k_min, k_max = sizes
    start, newest = _U(0), flat[origin + steps[0]]
    for i in range(n):
        value = flat[origin + steps[i]]
        ring[i] = value
        ring[i + n] = value
        if value > newest:
            start, newest = _U(i), value
    arc = (start + _ONE, start + _U(n - 1), newest, newest, newest)
    arc = _grow(ring, arc, k_min - 1, True)
    arc = _grow(ring, arc, k_max - k_min, False)
    if _rest_is_older(ring, arc[0], n - k_max, arc[4]):
        return True
    arc = _grow(ring, arc, n - 2 * k_max - 1, False)
    too_short = _rest_is_older(ring, arc[0], k_max + 1, arc[4])
    arc = _grow(ring, arc, k_max + 1 - k_min, False)
    return not too_short and _rest_is_older(ring, arc[0], k_min, arc[4])


@jit
def arc_star(events, last, sae, filter_us, circles, flags):
    """Mark the Arc* corners among events; `last` and `sae` are updated in place.

    Parameters
    ----------
    events : tuple of x, y, t, p
        Columns of the events; pixels lie on the sensor.
    last : ndarray of int64, shape (height, width, 2)
        Time [us] of the last event of each polarity.
    sae : ndarray of int64, shape (2, height, width)
        Time [us] of the last event of each polarity that passed the filter.
    filter_us : int
        An event passes if its polarity came longer ago than this, or not since the other one.
    circles : tuple of two ndarrays of uint64
        Small and large circle, from `circle_steps`.
    flags : ndarray of bool, shape (n,)
        Output.
    """
    xs, ys, ts, ps = events
    small, large = circles
    _, height, width = sae.shape
    flat = sae.reshape(-1)
    ring = np.empty(2 * large.size, dtype=np.int64)
    for i in range(xs.size):
        x, y, t, p = np.int64(xs[i]), np.int64(ys[i]), ts[i], np.int64(ps[i])
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
        if _is_corner_circle(flat, small, origin, ring, SMALL_SIZES):
            flags[i] = _is_corner_circle(flat, large, origin, ring, LARGE_SIZES)

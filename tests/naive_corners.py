"""Plain-Python truth for the corner detectors: one event, one pixel, one step at a time."""

import math

NEVER = -math.inf
FILTER_US = 50_000
BORDER = 4

# Circles as (dx, dy), starting below the pixel and running counter-clockwise on the screen.
SMALL = [
    (0, 3), (1, 3), (2, 2), (3, 1), (3, 0), (3, -1), (2, -2), (1, -3),
    (0, -3), (-1, -3), (-2, -2), (-3, -1), (-3, 0), (-3, 1), (-2, 2), (-1, 3),
]  # fmt: skip
LARGE = [
    (0, 4), (1, 4), (2, 3), (3, 2), (4, 1), (4, 0), (4, -1), (3, -2), (2, -3), (1, -4),
    (0, -4), (-1, -4), (-2, -3), (-3, -2), (-4, -1), (-4, 0), (-4, 1), (-3, 2), (-2, 3), (-1, 4),
]  # fmt: skip


def arc_size(values: list[float], k_min: int) -> int:
    """Return the length of the newest arc of a circle, growing it element by element."""
    n = len(values)
    newest = values.index(max(values))
    up, down = newest + 1, newest - 1
    oldest = values[newest]
    up_oldest, down_oldest = math.inf, math.inf
    size = 1
    for processed in range(2, n + 1):
        up_head, down_head = values[up % n], values[down % n]
        if up_head > down_head:
            head, up = up_head, up + 1
            up_oldest = side_oldest = min(up_oldest, head)
        else:
            head, down = down_head, down - 1
            down_oldest = side_oldest = min(down_oldest, head)
        if processed <= k_min or head >= oldest:
            size = processed
            oldest = min(oldest, side_oldest)
    return size


def arc_star(x, y, t, p, width, height):
    """Return one flag per event: is it an Arc* corner."""
    last = [[[NEVER] * width for _ in range(height)] for _ in range(2)]
    sae = [[[NEVER] * width for _ in range(height)] for _ in range(2)]
    flags = []
    for xi, yi, ti, pi in zip(x.tolist(), y.tolist(), t.tolist(), p.tolist(), strict=True):
        same, other = last[pi][yi][xi], last[1 - pi][yi][xi]
        last[pi][yi][xi] = ti
        flags.append(False)
        if not (ti > same + FILTER_US or other > same):
            continue
        sae[pi][yi][xi] = ti
        if not (BORDER <= xi < width - BORDER and BORDER <= yi < height - BORDER):
            continue
        small = arc_size([sae[pi][yi + dy][xi + dx] for dx, dy in SMALL], 3)
        large = arc_size([sae[pi][yi + dy][xi + dx] for dx, dy in LARGE], 4)
        small_fits = small <= 6 or 10 <= small <= 13
        large_fits = large <= 8 or 12 <= large <= 16
        flags[-1] = small_fits and large_fits
    return flags

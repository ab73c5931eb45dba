"""Plain-Python truth for the filters: one event, one neighbour at a time."""

import math


def neighbours(x, y, t, p, *, within_us, support, hot=(), band=0):
    """Return one flag per event: does it stay; and how many events were flicker."""
    last, level, flags, flickered = {}, {}, [], 0
    for xi, yi, ti, pi in zip(x.tolist(), y.tolist(), t.tolist(), p.tolist(), strict=True):
        if (xi, yi) in hot:
            flags.append(False)
            continue
        if band:
            now = level.get((xi, yi), 0)
            moved = min(max(now + (1 if pi else -1), 0), band)
            level[xi, yi] = moved
            if moved != now:
                flickered += 1
                flags.append(False)
                continue
        around = [(xi + dx, yi + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy]
        of_late = [ti - last.get((*pixel, pi), -math.inf) <= within_us for pixel in around]
        flags.append(sum(of_late) >= support)
        last[xi, yi, pi] = ti
    return flags, flickered


def hot_pixels(heat, factor, least):
    """Return the pixels (x, y) above `least` and `factor` times their second hottest neighbour."""
    height, width = heat.shape
    found = set()
    for y in range(height):
        for x in range(width):
            around = sorted(
                (
                    heat[v, u]
                    for v in range(max(y - 1, 0), min(y + 2, height))
                    for u in range(max(x - 1, 0), min(x + 2, width))
                    if (u, v) != (x, y)
                ),
                reverse=True,
            )
            second = around[1] if len(around) > 1 else 0.0
            if heat[y, x] > least + factor * second:
                found.add((x, y))
    return found

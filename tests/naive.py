"""Plain-Python twins of the surfaces: the definitions, one pixel at a time.

Events are lists of (x, y, t_us, p) in order; images are lists of rows, merged over polarity.
"""

import math


def blank(width, height, value=0):
    return [[value] * width for _ in range(height)]


def patch(x, y, reach, width, height):
    """Yield the pixels of a square patch that are inside the image."""
    for row in range(max(0, y - reach), min(height, y + reach + 1)):
        for col in range(max(0, x - reach), min(width, x + reach + 1)):
            yield row, col


def time_surface(events, t, width, height, tau):
    last = blank(width, height, None)
    for x, y, stamp, _ in events:
        last[y][x] = stamp
    return [[0.0 if s is None else math.exp(-(t - s) / (tau * 1e6)) for s in row] for row in last]


def tos(events, width, height, k, threshold):
    image = blank(width, height)
    for x, y, _, _ in events:
        for row, col in patch(x, y, k // 2, width, height):
            image[row][col] -= 1
            if image[row][col] < threshold:
                image[row][col] = 0
        image[y][x] = 255
    return image


def tos_test_first(events, width, height, k, threshold):
    """The known variant: what is below the threshold becomes 0, else 1 is subtracted."""
    image = blank(width, height)
    for x, y, _, _ in events:
        for row, col in patch(x, y, k // 2, width, height):
            image[row][col] = 0 if image[row][col] < threshold else image[row][col] - 1
        image[y][x] = 255
    return image


def silc(events, width, height, r):
    image = blank(width, height)
    for x, y, _, _ in events:
        centre = image[y][x]
        for row, col in patch(x, y, r, width, height):
            if image[row][col] >= centre and image[row][col] > 0:
                image[row][col] -= 1
        image[y][x] = (2 * r + 1) ** 2
    return image


def tos_ts(events, t, width, height, k, threshold, tau, ts_threshold):
    order = tos(events, width, height, k, threshold)
    decayed = time_surface(events, t, width, height, tau)
    return [
        [o if d > ts_threshold else 0 for o, d in zip(*rows, strict=True)]
        for rows in zip(order, decayed, strict=True)
    ]


def dist(events, start, width, height, alpha, side, clip):
    """`start` is the first time of the stream, of either polarity."""
    times = {}
    for x, y, stamp, _ in events:
        times.setdefault((y, x), []).append(stamp)
    counts = sorted(len(times.get((y, x), [])) for y in range(height) for x in range(width))
    enough = [n for k, n in enumerate(counts, start=1) if k >= clip * len(counts)]
    limit = max(1, enough[0])
    values = blank(width, height, 0.0)
    for (y, x), stamps in times.items():
        near = [times[at] for at in patch(x, y, side // 2, width, height) if at in times]
        number = sum(min(len(others), limit) for others in near)
        span = max(s[-1] for s in near) - min(s[0] for s in near)
        if number > 1:
            values[y][x] = max(0.0, float(stamps[-1] - start) - alpha * span / number)
    unique = sorted({v for row in values for v in row})
    rank = {v: k / len(unique) for k, v in enumerate(unique)}
    return [[rank[v] for v in row] for row in values]

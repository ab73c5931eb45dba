"""Plain-Python twin of the event image: each event counted by what follows it at its pixel."""


def draw(events, start, end, last, width, height):
    """Return the image as rows; events are lists of (x, y, t_us, p) in order."""
    image = [[0.0] * width for _ in range(height)]
    for k, (x, y, t, p) in enumerate(events):
        if not start <= t < end:
            continue
        later = [q for a, b, _, q in events[k + 1 :] if (a, b) == (x, y)]
        weight = 0.5 * (1 + last) if not later else (1.0 if later[0] == p else last)
        image[y][x] += weight if p else -weight
    return image

"""Plain-Python twin of the event image: each event counted by what follows it at its pixel."""

import numpy as np


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


def compare_sums(patch, image, top, left, weights):
    """Return the sums of `compare_sums` pixel by pixel, all in float32 and in its order."""
    side = patch.shape[1]
    totals = [np.float32(0.0)] * 4
    for j in range(side):
        sums = [np.float32(0.0)] * 4
        for i in range(side):
            pixels = image[top + i : top + i + 2, left + j : left + j + 2].ravel()
            v = weights[0] * pixels[0]
            for w, pixel in zip(weights[1:], pixels[1:], strict=True):
                v = v + w * pixel
            factors = (*patch[:, i, j], v)
            sums = [total + factor * v for total, factor in zip(sums, factors, strict=True)]
        totals = [a + b for a, b in zip(totals, sums, strict=True)]
    return totals

"""Random event streams for the tests of surfaces."""

import numpy as np
from hypothesis import strategies as st

from evcalib._event_columns import MAX_TIME_US
from evcalib.events import Events


@st.composite
def streams(draw, largest=24):
    """Sensors of one pixel and more, crowded pixels, equal times, from 0 or near the largest."""
    width, height = draw(st.integers(1, largest)), draw(st.integers(1, largest))
    n = draw(st.integers(1, 120))
    seed, step = draw(st.integers(0, 2**32 - 1)), draw(st.sampled_from([1, 3, 500, 40_000]))
    last = draw(st.sampled_from([None, None, MAX_TIME_US - 200_000]))
    return random_events(width, height, n, seed, step, hot=draw(st.booleans()), last=last)


def random_events(width, height, n, seed, step, *, hot=False, last=None):
    rng = np.random.default_rng(seed)
    x, y = rng.integers(0, width, n), rng.integers(0, height, n)
    if hot:
        x[rng.random(n) < 0.7] = width // 2
        y[rng.random(n) < 0.7] = height // 2
    t = np.cumsum(rng.integers(0, step, n, endpoint=True))
    t += -t[0] if last is None else last - t[-1]
    return Events.from_arrays(x, y, t, rng.random(n) < 0.4, width, height)


def rows(events):
    return list(zip(*(getattr(events, name).tolist() for name in "xytp"), strict=True))


def size(events):
    return events.width, events.height

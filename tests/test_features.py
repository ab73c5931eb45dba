"""Keypoints, descriptors and matches against plain twins, OpenCV and cases drawn by hand."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.features import KeypointFinder, Keypoints, brief_pattern, match

WIDTH, HEIGHT = 60, 50


def corners(rows):
    """Events from rows of x, y, t [us], p."""
    x, y, t, p = np.array(rows, dtype=np.int64).reshape(-1, 4).T
    return Events.from_arrays(x, y, t, p, WIDTH, HEIGHT)


def keypoints(bits, xy=None, p=None):
    n = len(bits)
    xy = np.zeros((n, 2)) if xy is None else xy
    p = np.zeros(n, bool) if p is None else p
    order = np.lexsort((xy[:, 1], p))
    ones = np.ones(n, np.int64)
    return Keypoints(xy[order], np.zeros(n), p[order], ones, bits[order])


def random_keypoints(seed, n, near=None, words=4):
    rng = np.random.default_rng(seed)
    bits = rng.integers(0, 2**64, (n, words), dtype=np.uint64)
    if near is not None:
        flips = rng.random((n, words, 64)) < 0.08
        bits = near[rng.integers(0, len(near), n)] ^ (flips << np.arange(64, dtype=np.uint64)).sum(
            axis=2, dtype=np.uint64
        )
    return keypoints(bits, rng.uniform(0, 60, (n, 2)), rng.random(n) < 0.5)


def test_a_keypoint_is_where_and_when_its_events_were():
    streak = [(20, 20, 100, 1), (21, 20, 200, 1), (22, 21, 600, 1)]
    other_polarity = [(21, 20, 300, 0), (21, 22, 500, 0)]
    elsewhere = [(40, 30, 650, 1), (40, 32, 700, 1)]
    rows = sorted(streak + other_polarity + elsewhere, key=lambda row: row[2])
    finder = KeypointFinder(WIDTH, HEIGHT, reach=3)
    found = finder.find(np.zeros((HEIGHT, WIDTH)), corners(rows))
    np.testing.assert_allclose(found.xy, [(21, 21), (21, 61 / 3), (40, 31)])
    np.testing.assert_allclose(found.t, [400e-6, 300e-6, 675e-6], rtol=1e-12)
    assert found.p.tolist() == [False, True, True]
    assert found.support.tolist() == [2, 3, 2]
    again = finder.find(np.zeros((HEIGHT, WIDTH)), corners(rows))
    assert np.array_equal(again.xy, found.xy)


def test_the_newest_event_founds_and_a_long_streak_is_cut():
    rows = [(10 + k, 20, 100 * k, 1) for k in range(10)]
    found = KeypointFinder(WIDTH, HEIGHT, reach=4).find(np.zeros((HEIGHT, WIDTH)), corners(rows))
    # Around 19: 15 to 19.  Then around 14: 10 to 14.
    assert sorted(found.xy[:, 0]) == [12, 17]
    assert found.support.tolist() == [5, 5]


def test_what_is_left_out_or_clipped_is_counted():
    rows = [(30, 25, 1, 1)] * 3 + [(2, 2, 2, 1)] * 2 + [(30, 40, 3, 1)] + [(50, 10, 4, 0)] * 4
    surface = np.zeros((HEIGHT, WIDTH))
    finder = KeypointFinder(WIDTH, HEIGHT, pattern=brief_pattern(side=9))
    found = finder.find(surface, corners(rows))
    assert (len(found), found.weak, found.clipped, found.surplus) == (3, 1, 1, 0)
    few = KeypointFinder(WIDTH, HEIGHT, most=1).find(surface, corners(rows))
    assert (len(few), few.surplus) == (1, 2)
    assert few.support.tolist() == [4]
    none = finder.find(surface, corners([]))
    assert len(none) == 0
    assert none.bits.shape == (0, 4)


def plain_brief(image, x, y, pattern):
    padded = np.pad(image, 12)
    bits = [
        padded[y + b + 12, x + a + 12] < padded[y + d + 12, x + c + 12] for a, b, c, d in pattern
    ]
    return [
        sum(1 << k for k in range(64) if bits[64 * word + k]) for word in range(len(bits) // 64)
    ]


def test_descriptors_equal_the_plain_twin_up_to_the_border():
    rng = np.random.default_rng(0)
    surface = rng.integers(0, 256, (HEIGHT, WIDTH)).astype(np.uint8)
    places = [(30, 25), (12, 12), (0, 0), (59, 49), (59, 3), (5, 49)]
    rows = [(x, y, k, 1) for k, (x, y) in enumerate(places)]
    pattern = brief_pattern()
    finder = KeypointFinder(WIDTH, HEIGHT, support=1, smooth=1)
    found = finder.find(surface, corners(rows))
    assert found.clipped == 4
    for (x, y), bits in zip(found.xy.astype(int), found.bits, strict=True):
        assert bits.tolist() == plain_brief(surface.astype(float), x, y, pattern)


def test_the_surface_is_smoothed_by_a_box():
    surface = np.zeros((HEIGHT, WIDTH))
    surface[20:30, 25:40] = 200.0
    mean = cv2.blur(surface, (5, 5))
    rows = corners([(30, 25, 0, 1)] * 2)
    bits = KeypointFinder(WIDTH, HEIGHT).find(surface, rows).bits
    assert bits[0].tolist() == plain_brief(mean.astype(np.float32), 30, 25, brief_pattern())


def test_the_pattern_is_documented_and_fixed():
    pattern = brief_pattern(side=25, tests=256, seed=0)
    drawn = np.random.default_rng(0).normal(0, 5, (256, 4))
    assert np.array_equal(pattern, np.clip(np.round(drawn), -12, 12))
    assert pattern[:2].tolist() == [[1, -1, 3, 1], [-3, 2, 7, 5]]
    assert not np.array_equal(pattern, brief_pattern(seed=1))


@pytest.mark.parametrize("seed", range(5))
def test_matches_equal_opencv_with_cross_check(seed):
    first = random_keypoints(seed, 90)
    second = random_keypoints(seed + 100, 110, near=first.bits)
    found = match(first, second, farthest=256)
    expected = []
    for polarity in (False, True):
        rows = [np.flatnonzero(k.p == polarity) for k in (first, second)]
        sides = [
            np.ascontiguousarray(k.bits[r]).view(np.uint8)
            for k, r in zip((first, second), rows, strict=True)
        ]
        matcher = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True)
        expected += [(rows[0][m.queryIdx], rows[1][m.trainIdx]) for m in matcher.match(*sides)]
    assert found.tolist() == [list(map(int, pair)) for pair in sorted(expected)]
    assert len(found) > 20


def plain_match(first, second, reach, farthest):
    """Mutual nearest neighbours, the first of equals."""

    def nearest(a, b):
        out = []
        for i in range(len(a)):
            best = (farthest + 1, -1)
            for j in range(len(b)):
                if a.p[i] != b.p[j] or np.linalg.norm(a.xy[i] - b.xy[j]) > reach:
                    continue
                distance = sum(
                    int(u ^ v).bit_count() for u, v in zip(a.bits[i], b.bits[j], strict=True)
                )
                best = min(best, (distance, j))
            out.append(best[1])
        return out

    ahead, back = nearest(first, second), nearest(second, first)
    return [[i, j] for i, j in enumerate(ahead) if j >= 0 and back[j] == i]


@settings(deadline=None, max_examples=60)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(0, 14),
    st.integers(0, 14),
    st.sampled_from([3.0, 20.0, np.inf]),
    st.integers(0, 4),
)
def test_matches_equal_the_plain_twin_with_ties(seed, n1, n2, reach, farthest):
    rng = np.random.default_rng(seed)
    # Descriptors of two bits and positions on a grid: most distances and limits tie.
    sides = [
        keypoints(
            rng.integers(0, 4, (n, 2)).astype(np.uint64),
            rng.integers(0, 12, (n, 2)).astype(float),
            rng.random(n) < 0.5,
        )
        for n in (n1, n2)
    ]
    found = match(*sides, reach=reach, farthest=farthest)
    assert found.tolist() == plain_match(*sides, reach, farthest)


def test_unusable_options_are_refused():
    for side in (4, 1, -3):
        with pytest.raises(InputError, match="side"):
            brief_pattern(side=side)
    with pytest.raises(InputError, match="multiple of 64"):
        brief_pattern(tests=100)
    for option in ({"reach": 0}, {"support": 0}, {"most": 0.5}, {"smooth": 4}):
        with pytest.raises(InputError, match=next(iter(option))):
            KeypointFinder(WIDTH, HEIGHT, **option)
    with pytest.raises(InputError, match="pattern"):
        KeypointFinder(WIDTH, HEIGHT, pattern=np.zeros((64, 3), int))
    with pytest.raises(InputError, match="finder was made for"):
        KeypointFinder(WIDTH, HEIGHT).find(np.zeros((WIDTH, HEIGHT)), corners([]))
    few, more = random_keypoints(0, 5), random_keypoints(0, 5, words=1)
    with pytest.raises(InputError, match="different lengths"):
        match(few, more)
    with pytest.raises(InputError, match="reach"):
        match(few, few, reach=0)

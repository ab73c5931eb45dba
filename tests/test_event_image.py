"""Event images against a plain twin, and displacements against known ones."""

from functools import lru_cache

import naive_event_image
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evcalib.events import Events
from evcalib.features import EventImage, EventImager, align_patches
from evcalib.features._event_image import AHEAD, RADIUS
from evcalib.kernels.events import EventColumns
from evcalib.kernels.features import event_image as kernels
from evcalib.kernels.features.patch_sums import compare_sums
from evcalib.kernels.jit import jit

WIDTH, HEIGHT = 60, 50


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(0, 60), st.sampled_from([0.0, 0.5, 1.0]))
def test_images_equal_the_plain_twin(seed, n, last):
    rng = np.random.default_rng(seed)
    x, y = rng.integers(0, 4, n), rng.integers(0, 3, n)
    t, p = np.sort(rng.integers(0, 30, n)), rng.random(n) < 0.5
    events = Events.from_arrays(x, y, t, p, 4, 3)
    image, following = np.zeros((3, 4), np.float32), np.zeros((3, 4), np.int8)
    kernels.draw(EventColumns.of(events), 8, 22, last, following, image)
    rows = list(zip(x.tolist(), y.tolist(), t.tolist(), p.tolist(), strict=True))
    np.testing.assert_array_equal(image, naive_event_image.draw(rows, 8, 22, last, 4, 3))


@lru_cache
def summed(side):
    @jit
    def kernel(patch, image, top, left, weights):
        width = image.shape[1]
        return compare_sums(patch, image, top * width + left, width, weights, side)

    return kernel


@pytest.mark.parametrize("side", [3, 7, 8, 15, 16, 29])
def test_sums_over_a_patch_equal_the_plain_twin_in_every_corner_of_an_image(side):
    rng = np.random.default_rng(side)
    size = side + 3
    patch = rng.normal(size=(3, side, side)).astype(np.float32)
    weights = tuple(rng.random(4).astype(np.float32))
    # Pixels beyond the image would be seen: whatever is multiplied with NaN is NaN.
    around = np.full((size + 2) * size, np.nan, dtype=np.float32)
    image = around[size:-size].reshape(size, size)
    image[:] = rng.normal(size=(size, size))
    for top, left in [(0, 0), (0, 2), (2, 0), (2, 2), (1, 1)]:
        found = summed(side)(patch, image, top, left, weights)
        assert found == tuple(naive_event_image.compare_sums(patch, image, top, left, weights))


def blobs(shift, seed=0, gain=1.0):
    """A smooth random picture, exact at any shift: a sum of Gaussian bells."""
    rng = np.random.default_rng(seed)
    place = rng.uniform((0, 0), (WIDTH, HEIGHT), (150, 2)) + shift
    height = rng.normal(size=150)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    square = (x[..., None] - place[:, 0]) ** 2 + (y[..., None] - place[:, 1]) ** 2
    return image(gain * (height * np.exp(-square / (2 * 2.0**2))).sum(axis=2))


def image(values):
    return EventImage(np.ascontiguousarray(values, dtype=np.float32), 0.0, 0.1)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (3.3, -2.6), (-7.5, 4.25)])
def test_displacements_are_found_at_any_gain(shift):
    rng = np.random.default_rng(1)
    centres = rng.uniform((20, 17), (40, 33), (40, 2))
    guesses = np.rint(centres) + shift + rng.uniform(-0.7, 0.7, (40, 2))
    found = align_patches(blobs((0, 0)), blobs(shift, gain=2.5), centres, guesses)
    good = np.isfinite(found[:, 0])
    assert good.mean() > 0.9
    moved = found[good, 2:] - found[good, :2]
    assert np.abs(moved - shift).max() < 0.05
    # The place is that of the structure in the patch.
    assert np.abs(found[good, :2] - centres[good]).max() < RADIUS


def test_a_growing_patch_moves_at_its_centroid():
    rng = np.random.default_rng(2)
    y, x = np.mgrid[:HEIGHT, :WIDTH] - np.array([25.0, 30.0])[:, None, None]
    bells = rng.uniform(-8, 8, (12, 2))

    def picture(scale):
        bell = [np.exp(-((x - scale * a) ** 2 + (y - scale * b) ** 2) / 8) for a, b in bells]
        return image(sum(bell))

    centres = np.array([[28.0, 23.0], [33.0, 27.0], [30.0, 25.0], [26.0, 28.0]])
    found = align_patches(picture(1.0), picture(1.04), centres, centres)
    expected = 0.04 * (found[:, :2] - [30.0, 25.0])
    assert np.abs(found[:, 2:] - found[:, :2] - expected).max() < 0.1
    assert np.abs(found[:, :2] - centres).max() > 0.5


def test_no_answer_where_none_is_sure():
    edge = image(np.exp(-((np.arange(WIDTH) - 30.0) ** 2) / 4) * np.ones((HEIGHT, 1)))
    centre = np.array([[30.0, 25.0]])
    assert np.isnan(align_patches(edge, edge, centre, centre)).all(), "slides along the edge"
    flat = image(np.zeros((HEIGHT, WIDTH)))
    assert np.isnan(align_patches(flat, flat, centre, centre)).all()
    assert np.isnan(align_patches(blobs((0, 0)), flat, centre, centre)).all()
    other = align_patches(
        blobs((0, 0)), blobs((0, 0), seed=5), *2 * [np.argwhere(np.ones((50, 60)))[:, ::-1] * 1.0]
    )
    assert np.isnan(other[:, 0]).mean() > 0.9, "other pictures correlate by chance only"
    far = align_patches(blobs((0, 0)), blobs((4, 0)), centre, centre)
    assert np.isnan(far).all() or abs(far[0, 2] - far[0, 0]) < 2.6


@settings(deadline=None, max_examples=30)
@given(
    st.sampled_from([(1, 1), (16, 15), (17, 17), (40, 12), (40, 30)]),
    st.lists(st.tuples(st.floats(-50, 90), st.floats(-50, 90)), min_size=1, max_size=6),
)
def test_patches_beyond_the_border_are_refused(size, guesses):
    rng = np.random.default_rng(0)
    width, height = size
    picture = image(rng.normal(size=(height, width)))
    guesses = np.array(guesses)
    centres = np.clip(guesses, 0, np.array(size) - 1)
    found = align_patches(picture, picture, centres, guesses)
    inside = np.isfinite(found[:, 0])
    low, high = RADIUS, np.array(size) - 1 - RADIUS
    assert ((np.rint(centres) > low) & (np.rint(centres) < high)).all(axis=1)[inside].all()


def stream(n=4000, start=1_000_000, duration=400_000):
    rng = np.random.default_rng(3)
    t = start + np.sort(rng.integers(0, duration, n))
    x, y = rng.integers(0, WIDTH, n), rng.integers(0, HEIGHT, n)
    return Events.from_arrays(x, y, t, rng.random(n) < 0.5, WIDTH, HEIGHT)


def test_an_image_lies_just_before_its_time_and_needs_a_stream_that_old():
    events = stream()
    imager = EventImager(WIDTH, HEIGHT)
    assert imager.draw(1_000_000, 30.0) is None
    imager.update(events.between(0, 1_060_000))
    assert imager.draw(1_060_000, 30.0) is None
    assert imager.draw(1_060_000, 60.0) is not None
    imager.update(events.between(1_060_000, 1_200_000))
    drawn = imager.draw(1_200_000, 30.0)
    # 1.5 px at 30 px/s are 50 ms, and what follows is watched for half as long.
    assert drawn.end == pytest.approx(1.2 - 0.05 * AHEAD)
    assert drawn.end - drawn.start == pytest.approx(0.05)
    assert drawn.t == pytest.approx(0.5 * (drawn.start + drawn.end))
    slow, unknown = imager.draw(1_200_000, 1e-3), imager.draw(1_200_000, 0.0)
    assert slow.end - slow.start == pytest.approx(0.12)
    assert unknown.end - unknown.start == pytest.approx(0.06)


def test_pieces_of_a_stream_give_the_same_image():
    events = stream()
    whole, pieced = EventImager(WIDTH, HEIGHT), EventImager(WIDTH, HEIGHT)
    whole.update(events)
    for k in range(0, len(events), 37):
        pieced.update(events[k : k + 37])
    pieced.update(events[:0])
    a, b = (imager.draw(1_400_000, 20.0) for imager in (whole, pieced))
    np.testing.assert_array_equal(a.values, b.values)
    assert np.abs(a.values).max() > 0
    assert (a.start, a.end) == (b.start, b.end)

"""Figures of a surface's quality, on images small enough to check by eye, and on OpenCV."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.features.repeatability import SurfaceScore, score_surface
from evcalib.surfaces import SURFACES
from evcalib.surfaces.quality import (
    edges,
    grey,
    harris_corners,
    likeness,
    share_found,
    share_on_edges,
    surface_images,
)

PICTURE = np.array([[0, 0, 0, 90], [0, 0, 0, 90], [0, 0, 0, 90]], dtype=np.uint8)
EDGE = np.array([[0, 0, 1, 1]] * 3, dtype=bool)


def squares(side=60):
    image = np.zeros((side, side), dtype=np.uint8)
    image[15:30, 20:40] = 200
    image[40:50, 12:18] = 90
    return image


def test_grey_reaches_255_and_an_empty_surface_stays_black():
    assert grey(np.array([[0.0, 0.25, 0.5]])).tolist() == [[0, 128, 255]]
    assert grey(np.zeros((2, 2))).max() == 0
    with pytest.raises(InputError, match="height, width"):
        grey(np.zeros((2, 3, 4)))


@settings(deadline=None)
@given(arrays(np.uint8, (5, 6)), st.integers(1, 9), st.integers(-20, 20))
def test_likeness_ignores_brightness_and_contrast(image, gain, shift):
    expected = 0.0 if np.ptp(image) == 0 else 1.0
    other = gain * image.astype(float) + shift
    assert likeness(image, other) == pytest.approx(expected, abs=1e-9)
    assert likeness(image, -other) == pytest.approx(-expected, abs=1e-9)


def test_edges_are_on_both_sides_of_a_step():
    assert np.array_equal(edges(PICTURE), EDGE)
    assert np.array_equal(edges(PICTURE.T), EDGE.T)
    assert not edges(PICTURE, step=91).any()


def test_share_on_edges_weighs_brightness():
    image = np.zeros((3, 4), dtype=np.uint8)
    image[0, 0], image[1, 3] = 30, 10
    assert share_on_edges(image, EDGE) == 0.25
    assert share_on_edges(image, EDGE, reach=2) == 1.0
    assert share_on_edges(np.zeros((3, 4), dtype=np.uint8), EDGE) == 0.0


def test_harris_corners_are_those_of_rectangles():
    found = harris_corners(squares(), 20)
    corners = [(20, 15), (39, 15), (20, 29), (39, 29), (12, 40), (17, 40), (12, 49), (17, 49)]
    assert len(found) == 8
    assert share_found(corners, found, reach=1.5) == 1.0
    # The bright rectangle comes first.
    assert (found[:4, 1] < 35).all()
    assert np.array_equal(harris_corners(squares(), 3), found[:3])


def test_harris_strength_is_that_of_opencv():
    image = np.random.default_rng(2).integers(0, 256, (40, 50)).astype(np.uint8)
    strength = cv2.cornerHarris(image.astype(np.float32), 5, 3, 1 / 16)
    x, y = harris_corners(image, 10, spacing=3).T
    assert (np.diff(strength[y, x]) <= 1e-3 * strength.max()).all()
    inner = strength[6:-6, 6:-6]
    assert strength[y[0], x[0]] == pytest.approx(inner.max(), rel=1e-4)


@settings(deadline=None, max_examples=30)
@given(arrays(np.uint8, (24, 25)), st.integers(0, 50))
def test_harris_corners_are_inside_and_apart(image, count):
    found = harris_corners(image, count, border=4)
    assert len(found) <= count
    assert ((found >= 4) & (found < [21, 20])).all()


def test_harris_wants_an_image():
    with pytest.raises(InputError, match="uint8"):
        harris_corners(np.zeros((20, 20)), 5)


def test_share_found_counts_only_what_can_be_seen():
    expected = [[0, 0], [10, 0], [np.nan, 3]]
    assert share_found(expected, [[1, 1], [50, 50]]) == 0.5
    assert share_found(expected, [[2, 0], [10, 2]]) == 1.0
    assert share_found(expected, np.empty((0, 2))) == 0.0
    assert np.isnan(share_found([[np.nan, np.nan]], [[0, 0]]))


class Still:
    """A scene in which nothing moves."""

    frames = np.stack([squares()] * 3)

    def moved(self, xy, before, after):
        return np.asarray(xy, dtype=float)


@pytest.fixture(scope="module")
def stream():
    rng = np.random.default_rng(4)
    n = 20_000
    y, x = np.nonzero(edges(squares()))
    k = rng.integers(0, x.size, n)
    t = np.sort(rng.integers(0, 300_000, n))
    return Events.from_arrays(x[k], y[k], t, rng.integers(0, 2, n), 60, 60)


@pytest.mark.parametrize("name", SURFACES)
def test_images_at_several_times_are_those_of_single_calls(stream, name):
    # The second time is that of an event, which belongs to the image.
    t_us = [100_000, int(stream.t[10_000]), 299_999]
    images = surface_images(name, stream, t_us)
    for t, image in zip(t_us, images, strict=True):
        alone = SURFACES[name](60, 60, polarity="merged")
        alone.update(stream.between(0, t + 1))
        assert np.array_equal(alone.render(t), image)


@pytest.mark.parametrize("name", SURFACES)
def test_a_scene_that_stands_still_is_clean_and_found_again(stream, name):
    t_us = [200_000, 200_000, 200_000]
    x, y = np.tile([[20, 39, 20, 39], [15, 15, 29, 29]], 3)
    corners = Events.from_arrays(x, y, 190_000 + np.arange(12), [1] * 12, 60, 60)
    score = score_surface(Still(), surface_images(name, stream, t_us), corners, t_us, 50_000)
    assert score == SurfaceScore(on_edges=1.0, repeatability=1.0, right=4.0, wrong=0.0)


def test_every_image_needs_its_picture(stream):
    with pytest.raises(InputError, match="as many"):
        score_surface(Still(), [np.zeros((60, 60))], stream[:0], [0], 50_000)

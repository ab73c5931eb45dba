"""Keypoints and matches at chosen times, against a motion that is known."""

from pathlib import Path

import numpy as np
import pytest

from data_tools.course.samples import load_sample
from data_tools.simulation.point_matches import random_matches
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.features import match
from evcalib.heading import Matches
from evcalib.heading._matches import CELL_PX
from evcalib.heading.two_views import keypoints_at, matched
from evcalib.plots.heading import offsets

CAMERA = Camera(80, 60, 70.0, 70.0, 39.5, 29.5)


@pytest.fixture(scope="module")
def sample():
    """A drive to the right and a little ahead, at 1.6 m/s."""
    return load_sample(Path(__file__).parents[1] / "notebooks" / "data" / "speed_160.npz")


def pairs(n=12, seed=0):
    return random_matches(CAMERA, [0.2, 0, 0], np.random.default_rng(seed), count=n, noise=0.0)


def test_keypoints_come_from_the_time_before(sample):
    t_us = [125_000, 200_000]
    found = keypoints_at(sample.events, t_us, gather_us=20_000)
    for t, keypoints in zip(t_us, found, strict=True):
        assert len(keypoints) > 50
        assert (keypoints.t >= 1e-6 * t - 0.02).all()
        assert (keypoints.t <= 1e-6 * t).all()


def test_matches_are_those_of_the_matcher_and_move_to_the_left(sample):
    first, second = keypoints_at(sample.events, [125_000, 187_500], gather_us=20_000)
    found = matched(sample.camera, first, second)
    i, j = match(first, second).T
    assert np.array_equal(found.xy1, first.xy[i])
    assert np.array_equal(found.xy2, second.xy[j])
    np.testing.assert_allclose(sample.camera.project(found.r2), found.xy2, atol=1e-9)
    assert np.median(found.xy2[:, 0] - found.xy1[:, 0]) < -2
    near = matched(sample.camera, first, second, reach=6)
    assert 20 < len(near) <= len(found)
    assert (np.hypot(*(near.xy2 - near.xy1).T) <= 6).all()


def test_pooling_keeps_every_row_in_order():
    parts = [pairs(5, 1), pairs(7, 2)]
    pool = Matches.pooled(parts)
    assert len(pool) == 12
    assert np.array_equal(pool.r1[5:], parts[1].r1)
    with pytest.raises(InputError, match="no matches"):
        Matches.pooled([])


def test_groups_are_cells_of_the_midpoint():
    some = pairs(40)
    middle = (some.xy1 + some.xy2) / 2
    same_cell = (middle[:, None] // CELL_PX == middle[None] // CELL_PX).all(axis=2)
    assert np.array_equal(some.groups[:, None] == some.groups[None], same_cell)


def test_offsets_are_angles_to_the_right_and_downwards():
    degree = np.pi / 180
    right = [np.sin(3 * degree), 0, np.cos(3 * degree)]
    down = [0, np.sin(2 * degree), np.cos(2 * degree)]
    np.testing.assert_allclose(offsets([right, down], [0, 0, 1]), [[3, 0], [0, 2]], atol=1e-12)
    np.testing.assert_allclose(offsets([[0, 1, 0]], [0, 1, 0]), [[0, 0]], atol=1e-12)

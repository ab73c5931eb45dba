"""Recordings of notebooks: there and back, and where points go, against the projection itself."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data_tools.course.samples import Sample, load_sample, slider_depth, write_sample
from data_tools.simulation.point_matches import random_matches
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.geometry import rotation_vector_to_matrix, unit

CAMERA = Camera(40, 30, 30.0, 30.0, 19.5, 14.5)
FOLDER = Path(__file__).parents[1] / "notebooks" / "data"


@pytest.fixture
def wall():
    """A camera that moves 0.3 m to the right in front of a wall 2 m away."""
    y, x = np.mgrid[:30, :40]
    rays = CAMERA.bearings(np.column_stack((x.ravel(), y.ravel())))
    depth = (2.0 / rays[:, 2]).reshape(30, 40)
    events = Events.from_arrays([3, 4, 39], [0, 2, 29], [0, 50, 60_000], [1, 0, 1], 40, 30)
    frames = np.arange(2400, dtype=np.uint8).reshape(2, 30, 40)
    depths = np.stack([depth, depth])
    return Sample(events, CAMERA, np.array([1.0, 0, 0]), 0.5, np.array([0.1, 0.7]), frames, depths)


def test_a_sample_is_read_as_it_was_written(wall, tmp_path):
    write_sample(tmp_path / "s.npz", wall)
    read = load_sample(tmp_path / "s.npz")
    for name in "xytp":
        assert np.array_equal(getattr(read.events, name), getattr(wall.events, name))
    assert read.camera == wall.camera
    assert read.speed == wall.speed
    for name in ("direction", "frame_times", "frames"):
        assert np.array_equal(getattr(read, name), getattr(wall, name))
    np.testing.assert_allclose(read.depths, wall.depths, atol=0.0005001)


def test_points_of_a_wall_move_by_focal_length_times_shift_over_depth(wall):
    xy = np.array([[20.0, 10.0], [30.5, 20.0]])
    # The depth is that of the nearest pixel around, which here is up to 3 % less.
    np.testing.assert_allclose(wall.moved(xy, 0, 1), xy - [30 * 0.3 / 2, 0], atol=0.03 * 4.5)
    np.testing.assert_allclose(wall.moved(wall.moved(xy, 0, 1), 1, 0), xy, atol=0.03 * 4.5)


def test_points_that_leave_the_image_or_hide_are_nan(wall):
    assert np.isnan(wall.moved([[2.0, 10.0]], 0, 1)).all()
    near = wall.depths.copy()
    near[1] *= 0.5
    assert np.isnan(replace(wall, depths=near).moved([[20.0, 10.0]], 0, 1)).all()


@pytest.mark.parametrize("steps", [[0, 70_000], [0, 10, 80_000]])
def test_a_silence_that_does_not_fit_is_refused(wall, steps, tmp_path):
    n = len(steps)
    events = Events.from_arrays([1] * n, [1] * n, steps, [1] * n, 40, 30)
    with pytest.raises(InputError, match="silence"):
        write_sample(tmp_path / "s.npz", replace(wall, events=events))


def test_a_lens_that_distorts_is_refused(wall, tmp_path):
    lens = replace(CAMERA, distortion=(0.1, 0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="distortion"):
        write_sample(tmp_path / "s.npz", replace(wall, camera=lens))


def test_the_real_slider_is_found_where_it_is(data, tmp_path, monkeypatch):
    sample = slider_depth(data)
    assert sample.events.t[0] < 1_000
    assert sample.events.duration == pytest.approx(1.5, abs=0.05)
    assert sample.camera.distortion
    monkeypatch.setenv("EVCALIB_DATA", str(data))
    assert len(slider_depth().events) == len(sample.events)


def test_without_the_real_slider_there_is_none(tmp_path, monkeypatch):
    assert slider_depth(tmp_path) is None
    monkeypatch.delenv("EVCALIB_DATA", raising=False)
    assert slider_depth() is None


def test_what_is_no_sample_is_refused(tmp_path):
    with pytest.raises(InputError, match="no file"):
        load_sample(tmp_path / "none.npz")
    np.savez(tmp_path / "other.npz", x=[1])
    with pytest.raises(InputError, match="not a sample"):
        load_sample(tmp_path / "other.npz")
    (tmp_path / "text.npz").write_text("text")
    with pytest.raises(InputError, match="not a sample"):
        load_sample(tmp_path / "text.npz")


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.npz")), ids=lambda path: path.stem)
def test_committed_samples_are_small_and_whole(path):
    sample = load_sample(path)
    assert path.stat().st_size < 400_000
    assert len(sample.events) > 50_000
    assert np.isclose(np.linalg.norm(sample.direction), 1)
    assert sample.frames.shape == sample.depths.shape
    assert sample.frames.shape[0] == sample.frame_times.size


def test_random_matches_obey_the_epipolar_constraint():
    shift, turn = np.array([0.1, 0.05, 0.2]), np.array([0.0, 0.02, 0.01])
    rng = np.random.default_rng(0)
    pair = random_matches(CAMERA, shift, rng, count=50, noise=0.0, turn=turn)
    turned = pair.r2 @ rotation_vector_to_matrix(turn).T
    np.testing.assert_allclose(np.cross(pair.r1, turned) @ unit(shift), 0, atol=1e-12)
    assert len(pair.r1) == 50


def test_a_motion_that_leaves_nothing_in_sight_is_refused():
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="too few points"):
        random_matches(CAMERA, [0, 0, 100.0], rng)
    with pytest.raises(InputError, match="outliers"):
        random_matches(CAMERA, [0.1, 0, 0], rng, outliers=2.0)

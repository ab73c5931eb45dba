"""The camera against OpenCV, and its round trip."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.logs.camera_files import read_camera
from evcalib.camera import Camera
from evcalib.errors import InputError

CAMERAS = [
    Camera(240, 180, 199.1, 198.8, 132.2, 110.7),
    Camera(240, 180, 199.1, 198.8, 132.2, 110.7, (-0.368, 0.151, -3e-4, -7.6e-4)),
    Camera(346, 260, 335.4, 335.3, 129.9, 99.2, (-0.139, 0.093, -3e-4, 1.7e-4, 0.01)),
    Camera(346, 260, 200.0, 201.0, 170.0, 130.0, (), "fisheye"),
    Camera(640, 480, 190.0, 191.0, 318.0, 242.0, (-0.02, 0.01, -0.003, 1e-3), "fisheye"),
]


def grid(camera, step=7.5):
    x, y = np.meshgrid(np.arange(0, camera.width, step), np.arange(0, camera.height, step))
    return np.column_stack((x.ravel(), y.ravel()))


def opencv_pixels(camera, rays):
    zero, k = np.zeros(3), np.array(camera.distortion or (0.0,) * 4)
    if camera.model == "fisheye":
        return cv2.fisheye.projectPoints(rays[:, None], zero, zero, camera.matrix, k)[0][:, 0]
    return cv2.projectPoints(rays, zero, zero, camera.matrix, k)[0][:, 0]


@pytest.mark.parametrize("camera", CAMERAS)
def test_every_pixel_comes_back(camera):
    pixels = grid(camera)
    bearings = camera.bearings(pixels)
    np.testing.assert_allclose(np.linalg.norm(bearings, axis=1), 1, rtol=0, atol=1e-15)
    np.testing.assert_allclose(camera.project(bearings), pixels, rtol=0, atol=1e-9)


@pytest.mark.parametrize("camera", CAMERAS)
def test_projection_equals_opencv(camera):
    # OpenCV's fisheye divides by z, so that only directions in front can be compared.
    rays = camera.bearings(grid(camera))
    rays = rays[rays[:, 2] > 0.05]
    np.testing.assert_allclose(camera.project(rays), opencv_pixels(camera, rays), rtol=0, atol=1e-9)


def test_the_principal_point_looks_ahead_and_x_points_right():
    camera = CAMERAS[0]
    axis, right = camera.bearings([[132.2, 110.7], [132.2 + 199.1, 110.7]])
    assert axis.tolist() == [0, 0, 1]
    np.testing.assert_allclose(right, [0.5**0.5, 0, 0.5**0.5], rtol=0, atol=1e-12)


def test_length_does_not_matter_and_behind_is_nan():
    for camera in CAMERAS[:3]:
        pixels = camera.project([[0.1, 0.2, 1], [0.3, 0.6, 3], [0.1, 0.2, -1], [0, 0, 0]])
        np.testing.assert_allclose(pixels[0], pixels[1], rtol=0, atol=1e-12)
        assert np.isnan(pixels[2:]).all()


def test_a_fisheye_sees_sideways_and_behind():
    camera = CAMERAS[3]
    pixels = camera.project([[1, 0, 0], [1, 0, -0.1], [0, 0, 0], [0, 0, -1]])
    assert pixels[0, 0] == pytest.approx(170 + 200 * np.pi / 2)
    assert pixels[1, 0] > pixels[0, 0]
    assert np.isnan(pixels[2:]).all()
    np.testing.assert_allclose(camera.bearings(pixels[:1]), [[1, 0, 0]], rtol=0, atol=1e-12)


def test_beyond_the_turning_point_there_is_no_answer():
    camera = Camera(400, 400, 100, 100, 200, 200, (-0.3, 0, 0, 0))
    # r (1 - 0.3 r^2) turns at r = 1.054, where it is 0.703.
    assert np.isnan(camera.project([[1.1, 0, 1]])).all()
    assert np.isnan(camera.bearings([[200 + 71, 200]])).all()
    inside = camera.bearings([[200 + 70, 200]])
    np.testing.assert_allclose(camera.project(inside), [[270, 200]], rtol=0, atol=1e-9)


@given(
    st.lists(st.floats(-0.4, 0.4), min_size=5, max_size=5),
    st.lists(st.floats(-0.01, 0.01), min_size=2, max_size=2),
)
@settings(deadline=None, max_examples=100)
def test_whatever_has_a_bearing_comes_back(radial, tangential):
    k1, k2, k3, *_ = radial
    camera = Camera(240, 180, 200, 200, 120, 90, (k1, k2, *tangential, k3))
    pixels = grid(camera, 20)
    bearings = camera.bearings(pixels)
    known = ~np.isnan(bearings[:, 0])
    assert known.any()
    back = camera.project(bearings[known])
    np.testing.assert_allclose(back, pixels[known], rtol=0, atol=1e-6)


def test_no_pixels_no_bearings():
    for camera in CAMERAS:
        assert camera.bearings(np.empty((0, 2))).shape == (0, 3)
        assert camera.project(np.empty((0, 3))).shape == (0, 2)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fx": 0}, "fx must be a positive"),
        ({"fy": np.nan}, "fy must be a positive"),
        ({"cx": np.inf}, "cx, cy"),
        ({"width": -1}, "width"),
        ({"width": 1.5}, "whole number"),
        ({"distortion": (1, 2)}, "0, 4, 5 coefficients, not 2"),
        ({"distortion": (1, 2, 3, 4, 5), "model": "fisheye"}, "0, 4 coefficients, not 5"),
        ({"distortion": (np.nan,) * 4}, "NaN"),
        ({"model": "omni"}, "model must be one of"),
    ],
)
def test_bad_cameras_are_refused(changes, message):
    good = {"width": 240, "height": 180, "fx": 200, "fy": 200, "cx": 120, "cy": 90}
    with pytest.raises(InputError, match=message):
        Camera(**{**good, **changes})


def test_bad_pixels_are_refused():
    with pytest.raises(InputError, match="pixels must have shape"):
        CAMERAS[0].bearings([1, 2, 3])
    with pytest.raises(InputError, match="NaN"):
        CAMERAS[0].bearings([[np.nan, 1]])


def test_another_resolution_is_refused():
    CAMERAS[0].require_size(240, 180)
    with pytest.raises(InputError, match="calibrated for 240x180 pixels, the events have 346x260"):
        CAMERAS[0].require_size(346, 260)


def test_calib_txt_of_the_slider(data):
    camera = read_camera(data / "slider_depth" / "calib.txt", 240, 180)
    assert (camera.fx, camera.cy, camera.distortion[0]) == (
        335.419462958,
        99.1864303447,
        -0.138592767408,
    )
    pixels = grid(camera)
    np.testing.assert_allclose(camera.project(camera.bearings(pixels)), pixels, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "camera", [*CAMERAS, Camera(346, 260, 100, 100, 173, 130, (-0.3, 0, 0, 0))]
)
def test_half_of_newtons_steps_find_the_same_bearings(camera, monkeypatch):
    y, x = np.mgrid[: camera.height : 3, : camera.width : 3]
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    full = camera.bearings(pixels)
    monkeypatch.setattr("evcalib.camera._STEPS", 15)
    np.testing.assert_allclose(camera.bearings(pixels), full, rtol=0, atol=1e-12)

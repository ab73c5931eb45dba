import cv2
import naive_hand_eye as naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from trajectories import camera_of, pair, smooth_body

from data_tools.logs.trajectory_files import read_tum
from evcalib.baselines.hand_eye import closed_form, hand_eye
from evcalib.errors import InputError
from evcalib.geometry import rotation_angle
from evcalib.poses import PoseSeries, associate, motions


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 10_000), scale=st.floats(0.05, 20), planar=st.booleans())
def test_exact_trajectories_give_x_and_scale_exactly(seed, scale, planar):
    camera, body, X, lever = pair(seed, n=20, scale=scale, planar=planar)
    found = hand_eye(camera, body)
    assert rotation_angle(found.R_body_cam, X) < 1e-6
    assert found.scale == pytest.approx(scale, rel=1e-6)
    known = np.isfinite(found.lever_arm)
    np.testing.assert_allclose(found.lever_arm[known], lever[known], atol=1e-5)
    assert known.tolist() == [True, True, not planar]
    assert found.cost < 1e-10


def test_the_closed_form_alone_is_exact_where_axes_span_space():
    camera, body, X, _ = pair(3)
    pairs = motions(camera, body, camera.t, 0.0)
    assert rotation_angle(closed_form(pairs), X.T) < 1e-9


@pytest.mark.parametrize("monocular", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_noisy_trajectories_give_the_optimum_of_the_plain_loop(seed, monocular):
    scale = 2.5 if monocular else 1.0
    camera, body, _, _ = pair(seed, n=10, noise=0.1, scale=scale)
    found = hand_eye(camera, body, monocular=monocular)
    R, lever, scale, cost = naive.hand_eye(camera, body, monocular=monocular)
    assert found.cost == pytest.approx(cost, rel=1e-9)
    assert rotation_angle(found.R_body_cam, R) < 1e-6
    np.testing.assert_allclose(found.lever_arm, lever, atol=1e-5)
    assert found.scale == pytest.approx(scale, rel=1e-6)


@pytest.mark.skipif(not hasattr(cv2, "calibrateHandEye"), reason="this OpenCV has none")
def test_opencv_agrees():
    camera, body, X, lever = pair(4)
    inverse = [(R.T, -R.T @ p) for R, p in zip(camera.rotation, camera.position, strict=True)]
    R, t = cv2.calibrateHandEye(
        list(body.rotation), list(body.position), *map(list, zip(*inverse, strict=True))
    )
    assert rotation_angle(R, X) < 1e-6
    np.testing.assert_allclose(t.ravel(), lever, atol=1e-6)


def test_pure_translation_is_the_registration_of_all_translations():
    rng = np.random.default_rng(5)
    t, position, _ = smooth_body(rng, 30)
    X, still = Rotation.random(random_state=rng), Rotation.identity(30)
    camera = camera_of(rng, t, position, still, X=X, lever=[1.0, 2.0, 3.0], scale=4.0)
    camera = PoseSeries(t, camera.position + 0.02 * rng.normal(size=(30, 3)), camera.rotation)
    body = PoseSeries(t, position)
    found = hand_eye(camera, body)

    i, j = np.triu_indices(30, 1)
    seen = (camera.position[j] - camera.position[i]) @ camera.matrices[0]
    expected = Rotation.align_vectors(position[j] - position[i], seen)[0].as_matrix()
    assert rotation_angle(found.R_body_cam, expected) < 1e-9
    assert np.isnan(found.lever_arm).all()
    assert found.reason == "The lever arm is unobservable: the camera does not turn."
    assert found.scale == pytest.approx(4.0, rel=0.02)
    assert found.unknown_axis is None


def test_noise_does_not_pass_for_turning():
    """The rank tolerance is absolute: of turns by 0.1 deg, each axis has a large share."""
    rng = np.random.default_rng(6)
    t, position, _ = smooth_body(rng, 30)
    shake = Rotation.from_rotvec(np.radians(0.1) * rng.normal(size=(30, 3)))
    camera = camera_of(rng, t, position, shake, X=Rotation.identity(), lever=[1.0, 2.0, 3.0])
    found = hand_eye(camera, PoseSeries(t, position))
    assert np.isnan(found.lever_arm).all()


def test_a_straight_line_leaves_the_rotation_about_it_unknown():
    rng = np.random.default_rng(7)
    t = np.linspace(0, 10, 40)
    position = np.outer(t, [1.0, 0.0, 0.0])
    X = Rotation.random(random_state=rng)
    camera = camera_of(rng, t, position, Rotation.identity(40), X=X, lever=np.zeros(3))
    found = hand_eye(camera, PoseSeries(t, position))
    assert abs(found.unknown_axis[0]) == pytest.approx(1.0)
    assert "The rotation about the body's forward axis is unobservable." in found.reason
    np.testing.assert_allclose(found.R_body_cam @ X.as_matrix().T @ [1, 0, 0], [1, 0, 0], atol=1e-6)


@pytest.mark.parametrize("offset", [-0.73, 0.0, 0.31])
def test_the_offset_is_found_with_x(offset):
    camera, body, X, lever = pair(8, n=500, offset=offset, scale=3.0)
    found = hand_eye(camera, body, max_offset=1.0)
    assert found.offset == pytest.approx(offset, abs=1e-3)
    assert rotation_angle(found.R_body_cam, X) < 1e-3
    np.testing.assert_allclose(found.lever_arm, lever, atol=5e-3)
    assert found.scale == pytest.approx(3.0, rel=1e-3)
    assert not found.curve.at_edge
    given = hand_eye(camera, body, offset=offset)
    assert rotation_angle(given.R_body_cam, X) < 1e-3


def test_an_offset_beyond_the_search_is_at_its_edge():
    camera, body, _, _ = pair(9, n=300, offset=0.6)
    assert hand_eye(camera, body, max_offset=0.3).curve.at_edge


def test_poses_are_associated_only_where_both_are_known():
    t = np.arange(100) * 0.1
    keep = (t < 2.95) | (t > 3.65)
    body = PoseSeries(t[keep], np.outer(t[keep], [1.0, 0.5, 0.0]))
    camera = PoseSeries(np.arange(80) * 0.1 + 0.05, np.zeros((80, 3)))
    found = associate(camera, body, np.array([0.0, 1.0]), keyframes=1000)
    # Times in [0, 1.9] and [3.7, 8.9] do not meet the gap on their way from t to t + 1.
    expected = camera.t[(camera.t < 1.9) | (camera.t > 3.7)]
    np.testing.assert_array_equal(found, expected)
    few = associate(camera, body, np.array([0.0]), keyframes=5)
    assert few.size == 5
    assert (few[0], few[-1]) == (camera.t[0], camera.t[-1])


def test_trajectories_without_common_instants_are_refused():
    camera, body, _, _ = pair(1, offset=100.0)
    with pytest.raises(
        InputError, match=r"share 0 pose\(s\) at offsets of 0 to 0 s.*check the clo"
    ):
        hand_eye(camera, body)


@pytest.mark.parametrize("which", ["camera", "body"])
def test_a_sensor_that_stands_is_refused(which):
    camera, body, _, _ = pair(1)
    still = PoseSeries(camera.t, np.ones((50, 3)), camera.rotation)
    pairs = (still, body) if which == "camera" else (camera, still)
    with pytest.raises(InputError, match=f"the {which} does not move"):
        hand_eye(*pairs)


def test_a_visual_odometry_of_a_car_is_aligned_with_its_ground_truth(data):
    """Both are camera trajectories; the two frames are half a turn about the view apart."""
    vo = read_tum(data / "dsec_traj" / "vo_04a.txt")
    truth = read_tum(data / "dsec_traj" / "gt_04a.txt")
    found = hand_eye(vo, truth, max_offset=1.0)
    assert rotation_angle(found.R_body_cam, np.diag([-1.0, -1.0, 1.0])) < np.radians(5)
    assert found.scale == pytest.approx(1.0, abs=0.03)
    assert abs(found.offset) < 0.05

"""Rotations and directions against SciPy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from evcalib import geometry
from evcalib.geometry import (
    angle_between,
    matrix_to_quaternion,
    matrix_to_rpy,
    quaternion_to_matrix,
    random_rotation,
    rotation_angle,
    rotation_vector,
    rotation_vector_to_matrix,
    rpy_to_matrix,
    unit,
)

vectors = st.tuples(*[st.floats(-4, 4)] * 3)
TRUTH = Rotation.random(200, random_state=0)


@settings(deadline=None)
@given(vectors)
def test_a_rotation_vector_gives_the_matrix_that_scipy_gives(vector):
    expected = Rotation.from_rotvec(vector).as_matrix()
    np.testing.assert_allclose(rotation_vector_to_matrix(vector), expected, atol=1e-14)


@settings(deadline=None)
@given(vectors)
def test_roll_pitch_yaw_turn_about_the_fixed_axes_in_that_order(rpy):
    expected = Rotation.from_euler("xyz", rpy).as_matrix()
    np.testing.assert_allclose(rpy_to_matrix(rpy), expected, atol=1e-14)


@settings(deadline=None)
@given(vectors)
def test_roll_pitch_yaw_of_a_matrix_give_the_matrix_back(rpy):
    R = Rotation.from_euler("xyz", rpy).as_matrix()
    np.testing.assert_allclose(rpy_to_matrix(matrix_to_rpy(R)), R, atol=1e-8)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_at_the_poles_yaw_is_zero_and_the_matrix_stays(pitch):
    R = Rotation.from_euler("xyz", [0.3, pitch, -0.8]).as_matrix()
    rpy = matrix_to_rpy(R)
    assert rpy[2] == 0
    np.testing.assert_allclose(rpy_to_matrix(rpy), R, atol=1e-8)


def test_quaternions_of_matrices_are_those_of_scipy():
    for R, (x, y, z, w) in zip(TRUTH.as_matrix(), TRUTH.as_quat(canonical=True), strict=True):
        np.testing.assert_allclose(matrix_to_quaternion(R), [w, x, y, z], atol=1e-12)


@pytest.mark.parametrize("axis", range(3))
def test_a_half_turn_has_a_quaternion_without_real_part(axis):
    R = -np.eye(3)
    R[axis, axis] = 1
    np.testing.assert_allclose(matrix_to_quaternion(R), [0, *np.eye(3)[axis]], atol=1e-15)


def test_a_quaternion_of_any_length_gives_the_same_matrix():
    q = np.array([0.2, -0.5, 0.7, 1.1])
    np.testing.assert_allclose(quaternion_to_matrix(3 * q), quaternion_to_matrix(q), atol=1e-15)
    expected = Rotation.from_quat(q[[1, 2, 3, 0]]).as_matrix()
    np.testing.assert_allclose(quaternion_to_matrix(q), expected, atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 0.5, 3.0, np.pi - 1e-9, np.pi])
def test_the_angle_of_a_rotation_keeps_its_digits_near_zero_and_pi(angle):
    R = Rotation.from_rotvec(angle * unit([1, 2, -2])).as_matrix()
    # A half turn's skew part is rounding alone, 1e-16, and costs no more.
    np.testing.assert_allclose(rotation_angle(R), angle, rtol=1e-12, atol=1e-15)


def test_the_angle_between_rotations_is_that_of_the_turn_from_one_to_the_other():
    a, b = TRUTH[0], TRUTH[1]
    expected = (a.inv() * b).magnitude()
    assert rotation_angle(a.as_matrix(), b.as_matrix()) == pytest.approx(expected, abs=1e-14)
    assert rotation_angle(a.as_matrix(), a.as_matrix()) < 1e-15


@pytest.mark.parametrize("angle", [0.0, 1e-10, 1.0, np.pi - 1e-10, np.pi])
def test_the_angle_between_vectors_does_not_depend_on_their_lengths(angle):
    found = angle_between([2, 0, 0], [3 * np.cos(angle), 3 * np.sin(angle), 0])
    assert found == pytest.approx(angle, abs=1e-15)


def test_random_rotations_are_uniform():
    rng = np.random.default_rng(0)
    R = np.array([random_rotation(rng) for _ in range(2000)])
    np.testing.assert_allclose(
        R @ R.transpose(0, 2, 1), np.broadcast_to(np.eye(3), R.shape), atol=1e-14
    )
    # Each element has mean 0 and variance 1/3 under the Haar measure: five standard errors.
    assert np.abs(R.mean(axis=0)).max() < 5 * np.sqrt(1 / 3 / 2000)
    angle = np.array([rotation_angle(r) for r in R])
    # The angle's density (1 - cos a) / pi has mean pi / 2 + 2 / pi.
    assert angle.mean() == pytest.approx(np.pi / 2 + 2 / np.pi, abs=5 * 0.65 / np.sqrt(2000))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 3.0])
def test_a_rotation_vector_comes_back_from_its_matrix(angle):
    vector = angle * unit([2, -1, 2])
    np.testing.assert_allclose(
        rotation_vector(rotation_vector_to_matrix(vector)), vector, rtol=1e-9, atol=1e-15
    )


def test_a_seed_draws_the_rotation_that_it_always_drew():
    expected = Rotation.from_quat(np.random.default_rng(5).standard_normal(4)[[1, 2, 3, 0]])
    found = random_rotation(np.random.default_rng(5))
    np.testing.assert_allclose(found, expected.as_matrix(), atol=1e-15)


def test_no_rotation_has_no_angle():
    assert np.isnan(rotation_angle(np.full((3, 3), np.nan)))
    assert np.isnan(matrix_to_rpy(np.full((3, 3), np.nan))).all()


@pytest.mark.parametrize(
    ("rpy", "words"),
    [
        ((0, 0, 0), "forward; image upright"),
        ((0, 12, 0), "forward, tilted down by 12 deg; image upright"),
        ((2, -30, 20), "forward, turned to the left by 20 deg, tilted up by 30 deg; image upright"),
        ((180, 0, 0), "forward; image upside down"),
        ((30, 0, -90), "to the right; image rolled, its right side down by 30 deg"),
        ((-30, 0, 100), "to the left, turned to the left by 10 deg; image rolled, its left side"),
        ((0, 0, 178), "backward, turned to the right by 2 deg; image upright"),
        ((0, 90, 0), "down; the top of the image points forward"),
        ((0, 85, 90), "down; the top of the image points to the left"),
        ((0, -90, 0), "up; the top of the image points backward"),
    ],
)
def test_where_a_camera_looks_is_said_in_words(rpy, words):
    R = geometry.rpy_to_matrix(np.radians(rpy)) @ geometry.LOOKS_FORWARD
    assert geometry.camera_looks(R).startswith(words)
    np.testing.assert_allclose(
        geometry.rpy_to_matrix(np.radians(geometry.mounting(R))) @ geometry.LOOKS_FORWARD,
        R, atol=1e-9,
    )  # fmt: skip

"""The attitude of a camera by its gyro, and the gyro against a yaw rate that wheels tell."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from evcalib.errors import InputError
from evcalib.imu import GAP, MAX_RATE, ImuSeries, attitude_of, yaw_agreement

T = np.arange(0, 2, 0.001)


def steady(rate, t=T):
    return ImuSeries(t, np.tile(np.asarray(rate, dtype=float), (len(t), 1)))


@settings(deadline=None, max_examples=25)
@given(st.tuples(*[st.floats(-5, 5)] * 3), st.floats(0, 1.999), st.floats(0, 1.999))
def test_a_steady_rate_turns_by_rate_times_time(rate, t1, t2):
    found = attitude_of(steady(rate)).between(t1, t2)
    expected = Rotation.from_rotvec(np.array(rate) * (t2 - t1))
    assert (found.inv() * expected).magnitude() < 1e-9


def test_coning_is_followed_as_by_a_much_finer_integration():
    """An axis that goes round: the sum of the rates alone misses the turn about the cone's axis."""

    def rate(t):
        w = 2 * np.pi * 10.0
        return np.column_stack([np.cos(w * t), np.sin(w * t), np.zeros_like(t)]) * 3.0

    slow = Rotation.identity()
    fine = np.arange(0, 1, 1e-5)
    for step in Rotation.from_rotvec(1e-5 * rate(fine + 0.5e-5)):
        slow = slow * step
    found = attitude_of(ImuSeries(T, rate(T))).between(0.0, 1.0)
    assert (found.inv() * slow).magnitude() < 2e-4
    assert slow.as_rotvec()[2] > 0.05


def test_bearings_at_a_time_come_to_the_camera_as_it_stood_before():
    """A camera that turns to the right sees a fixed point move to the left; turned back, not."""
    attitude = attitude_of(steady([0.0, 0.5, 0.0]))
    point = np.array([0.2, 0.1, 1.0])
    later = Rotation.from_rotvec([0.0, 0.5, 0.0]).inv().apply(point)
    assert later[0] < point[0]
    np.testing.assert_allclose(attitude.between(0.0, 1.0).apply(later), point, atol=1e-12)


def test_the_axes_of_the_imu_and_its_bias():
    R = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
    found = attitude_of(steady([1.3, 0.0, 0.2]), R, bias=[0.3, 0.0, 0.2])
    np.testing.assert_allclose(found.between(0, 1).as_rotvec(), [0, 0, 1.0], atol=1e-12)


def test_what_lies_in_a_gap_or_outside_is_not_covered():
    t = np.concatenate([T, T + T[-1] + 2 * GAP])
    attitude = attitude_of(steady([0, 0, 1], t))
    start = np.array([0.1, 1.9, 1.9, -0.1, 2.3, 4.0])
    end = np.array([0.5, 1.999, 2.25, 0.1, 2.4, 4.3])
    np.testing.assert_array_equal(
        attitude.covers(start, end), [True, True, False, False, True, False]
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate": np.full((3, 3), MAX_RATE + 1)}, r"41 rad/s.*degrees per second"),
        ({"rate": np.full((3, 3), np.nan)}, "NaN"),
        ({"rate": np.zeros((3, 2))}, r"shape \(3, 3\)"),
        ({"t": [0.0, 0.0, 1.0]}, "repeats"),
        ({"acceleration": np.zeros((2, 3))}, r"acceleration must have shape \(3, 3\)"),
    ],
)
def test_bad_samples_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        ImuSeries(**{"t": [0.0, 0.1, 0.2], "rate": np.zeros((3, 3)), **change})
    with pytest.raises(InputError, match="two samples"):
        ImuSeries([0.0], np.zeros((1, 3)))
    with pytest.raises(InputError, match="not a rotation"):
        attitude_of(steady([0, 0, 1]), np.diag([1.0, 1, -1]))


def driven(rng, axis, bias, offset=0.13, swing=0.5):
    """Return a gyro whose `axis` turns as a yaw rate of two sines, and that yaw rate."""
    t = np.arange(0, 12, 0.02)

    def yaw(t):
        return swing * (np.sin(1.1 * t) + 0.4 * np.sin(2.9 * t + 1.0))

    at = np.arange(0.5, 11, 0.001)
    rate = np.outer(yaw(at + offset), axis) + bias + 0.002 * rng.standard_normal((at.size, 3))
    return ImuSeries(at, rate), t, yaw(t) + 0.01 * rng.standard_normal(t.size)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("scale", [1.0, 57.3])
def test_bias_axis_and_scale_by_the_wheels(seed, scale):
    rng = np.random.default_rng(seed)
    axis, bias = np.array([0.1, -0.9, 0.3]), rng.normal(0, 0.03, 3)
    axis /= np.linalg.norm(axis)
    imu, t, yaw = driven(rng, axis * scale / 20, bias)
    found = yaw_agreement(imu, t, yaw, 1.0)
    np.testing.assert_allclose(found.bias, bias, atol=0.003 * max(scale / 20, 1))
    np.testing.assert_allclose(found.axis, axis * scale / 20, atol=0.02 * max(scale / 20, 1))


def test_noise_of_a_yaw_rate_tells_no_axis():
    """Wheels that drive straight: the noise of their yaw rate must not pass for turning."""
    rng = np.random.default_rng(5)
    imu, t, yaw = driven(rng, np.array([0, -1.0, 0]), np.array([0.01, 0.02, 0.03]), swing=0.0)
    found = yaw_agreement(imu, t, yaw, 1.0)
    assert found.axis is None
    np.testing.assert_allclose(found.bias, [0.01, 0.02, 0.03], atol=1e-3)
    silent = yaw_agreement(imu, t, None, 1.0)
    np.testing.assert_allclose(silent.bias, imu.rate.mean(axis=0))

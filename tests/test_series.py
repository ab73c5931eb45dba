"""What the two streams accept, and what they say of the rest."""

import numpy as np
import pytest

from evcalib.errors import InputError
from evcalib.series import MAX_SPEED, HeadingSeries, VelocitySeries

T = np.array([0.0, 0.1, 0.2, 0.3])
FORWARD = np.tile([1.0, 0.0, 0.0], (4, 1))

BAD_TIMES = {
    "repeats row 1": [0.0, 0.1, 0.1, 0.3],
    "goes back from row 1": [0.0, 0.2, 0.1, 0.3],
    "NaN or infinite, first in row 2": [0.0, 0.1, np.nan, 0.3],
    r"must have shape \(n\)": [[0.0], [0.1], [0.2], [0.3]],
    "must be numbers": ["a", "b", "c", "d"],
}


@pytest.mark.parametrize("series", [VelocitySeries, HeadingSeries])
@pytest.mark.parametrize("message", BAD_TIMES)
def test_bad_times_are_refused_with_their_row(series, message):
    with pytest.raises(InputError, match=message):
        series(BAD_TIMES[message], FORWARD)


@pytest.mark.parametrize("series", [VelocitySeries, HeadingSeries])
def test_vectors_must_be_three_numbers_for_each_time(series):
    with pytest.raises(InputError, match=r"must have shape \(4, 3\), not \(3, 3\)"):
        series(T, FORWARD[:3])
    with pytest.raises(InputError, match=r"must have shape \(4, 3\), not \(4, 2\)"):
        series(T, FORWARD[:, :2])


@pytest.mark.parametrize("series", [VelocitySeries, HeadingSeries])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_values_must_be_finite(series, bad):
    v = FORWARD.copy()
    v[2, 1] = bad
    with pytest.raises(InputError, match=r"1 value\(s\) that are NaN or infinite, first in row 2"):
        series(T, v)


def test_a_speed_above_the_limit_is_taken_for_a_mistake_of_units():
    v = FORWARD.copy()
    v[3] *= 400
    with pytest.raises(InputError, match=r"row 3 has a speed of 400 m/s.*metres per second"):
        VelocitySeries(T, v)
    assert VelocitySeries(T, FORWARD * MAX_SPEED).speed.max() == MAX_SPEED


def test_the_yaw_rate_must_have_a_value_for_each_time():
    with pytest.raises(InputError, match=r"yaw_rate must have shape \(4\), not \(3,\)"):
        VelocitySeries(T, FORWARD, np.zeros(3))


@pytest.mark.parametrize("length", [0.96, 1.04])
def test_headings_of_nearly_unit_length_are_normalised(length):
    np.testing.assert_allclose(HeadingSeries(T, length * FORWARD).v, FORWARD, rtol=1e-15)


@pytest.mark.parametrize("length", [0.0, 0.94, 1.06])
def test_headings_of_other_lengths_are_refused(length):
    v = FORWARD.copy()
    v[1] *= length
    with pytest.raises(InputError, match=f"heading row 1 has length {length:.4g}, not 1"):
        HeadingSeries(T, v)


def test_starts_and_ends_come_together_and_in_order():
    with pytest.raises(InputError, match="t_start and t_end must be given together"):
        HeadingSeries(T, FORWARD, t_start=T - 0.05)
    with pytest.raises(InputError, match="heading row 2 ends"):
        HeadingSeries(T, FORWARD, t_start=T, t_end=T + [0.1, 0.1, -0.1, 0.1])


@pytest.mark.parametrize("name", ["weight", "sd", "inliers"])
def test_weights_and_their_like_are_not_negative(name):
    with pytest.raises(InputError, match=f"heading {name} is negative in row 1"):
        HeadingSeries(T, FORWARD, **{name: [1.0, -1.0, 1.0, 1.0]})


@pytest.mark.parametrize("valid", [[1, 0, 1, 1], [True, False]])
def test_validity_is_a_boolean_for_each_row(valid):
    with pytest.raises(InputError, match="heading valid must be 4 booleans"):
        HeadingSeries(T, FORWARD, valid=valid)


def test_selecting_rows_keeps_every_column():
    columns = {"weight": [1, 2, 3, 4], "sd": [5, 6, 7, 8], "t_start": T - 1, "t_end": T + 1}
    part = HeadingSeries(T, FORWARD, **columns, frame="left").select(T > 0.15)
    np.testing.assert_array_equal(part.t, T[2:])
    for name, values in columns.items():
        np.testing.assert_array_equal(getattr(part, name), values[2:])
    assert part.inliers is None
    assert part.frame == "left"


def test_selecting_velocities_keeps_yaw_rate_and_frame():
    part = VelocitySeries(T, FORWARD, T, frame="rear axle").select(T < 0.15)
    np.testing.assert_array_equal(part.yaw_rate, T[:2])
    assert (len(part), part.frame) == (2, "rear axle")


def test_usable_rows_are_valid_and_carry_weight():
    valid = np.array([True, True, False, True])
    series = HeadingSeries(T, FORWARD, weight=[1, 0, 1, 2], valid=valid)
    np.testing.assert_array_equal(series.usable().t, [0.0, 0.3])
    plain = HeadingSeries(T, FORWARD)
    assert plain.usable() is plain


def test_a_series_does_not_change_the_arrays_it_was_given():
    v = 1.02 * FORWARD
    HeadingSeries(T, v)
    np.testing.assert_array_equal(v, 1.02 * FORWARD)

"""Directions of a sampled velocity: by hand, against a plain twin, and what smoothing may do."""

import naive_backend as naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.simulation import drives
from data_tools.simulation.streams import Noise, simulate
from evcalib.alignment import StreamPair
from evcalib.errors import InputError
from evcalib.kernels.kinematics import velocity_track as kernel
from evcalib.kinematics.velocity_track import SMOOTHING, SMOOTHING_GATE, rebuilt, velocity_track
from evcalib.series import HeadingSeries, VelocitySeries
from evcalib.uncertainty import white_noise

EAST, NORTH = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
THREE = VelocitySeries([0.0, 1.0, 2.0], [EAST, EAST + NORTH, 3 * NORTH])


def track_of(velocities=THREE, **more):
    return velocity_track(velocities, **{"smooth": False, **more})


def at(track, *times, offset=0.0):
    return track.directions(np.array(times), np.array(times), offset)


def over(track, start, end, offset=0.0):
    return track.directions(np.array([start]), np.array([end]), offset)[0]


def unit(*v):
    return np.array(v) / np.linalg.norm(v)


def random_velocities(seed, n=60):
    """Return irregular samples with gaps, some of them slow."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(0.01, 0.03, n) + np.where(rng.random(n) < 0.1, rng.uniform(0.1, 0.5, n), 0)
    v = rng.standard_normal((n, 3)) * rng.choice([0.05, 1.0], (n, 1))
    return VelocitySeries(np.cumsum(steps), v), rng


# By hand ----------------------------------------------------------------------------------------


def test_the_velocity_at_an_instant_lies_on_the_line_between_its_samples():
    found = at(track_of(), 0.0, 0.5, 1.0, 1.5, 2.0)
    expected = [EAST, unit(2, 1, 0), unit(1, 1, 0), unit(1, 4, 0), NORTH]
    np.testing.assert_allclose(found, expected, rtol=1e-15)


@pytest.mark.parametrize(
    ("start", "end", "mean"),
    [
        (0.0, 1.0, (1, 0.5, 0)),
        (1.0, 2.0, (0.5, 2, 0)),
        (0.0, 2.0, (1.5, 2.5, 0)),
        # Over the second half of the first step and the first half of the next.
        (0.5, 1.5, (1 + 0.75, 0.75 + 1.5, 0)),
        (0.25, 0.75, (1, 0.5, 0)),
    ],
)
def test_the_direction_over_an_interval_is_that_of_the_mean_velocity(start, end, mean):
    np.testing.assert_allclose(over(track_of(), start, end), unit(*mean), rtol=1e-14)


def test_an_offset_is_added_to_the_times():
    np.testing.assert_allclose(at(track_of(), -1.0, offset=2.0), [unit(1, 1, 0)])
    np.testing.assert_allclose(over(track_of(), -1.0, 0.0, 2.0), unit(0.5, 2, 0))


def test_there_is_no_direction_before_the_first_or_after_the_last_sample():
    assert not at(track_of(), -1e-9, 2 + 1e-9).any()
    assert not over(track_of(), -1e-9, 0.5).any()
    assert not over(track_of(), 1.5, 2 + 1e-9).any()


def test_there_is_no_direction_inside_a_gap_or_over_one():
    v = VelocitySeries([0.0, 0.1, 0.2, 1.0, 1.1, 1.2], np.tile(EAST, (6, 1)))
    track = track_of(v)
    assert not at(track, 0.2 + 1e-9, 0.6, 1.0 - 1e-9).any()
    assert not over(track, 0.1, 1.1).any()
    assert not over(track, 0.1, 0.3).any()
    np.testing.assert_array_equal(at(track, 0.2, 1.0), [EAST, EAST])
    np.testing.assert_array_equal(over(track, 0.05, 0.2), EAST)
    np.testing.assert_array_equal(at(track_of(v, max_gap=1.0), 0.6), [EAST])


def test_an_interval_may_start_on_the_first_sample_after_a_gap():
    v = VelocitySeries([0.0, 0.1, 0.2, 1.0, 1.1, 1.2], np.tile(EAST, (6, 1)))
    np.testing.assert_array_equal(over(track_of(v), 1.0, 1.1), EAST)


def test_held_samples_stand_beyond_the_ends_of_their_run_for_so_long():
    v = VelocitySeries([0.0, 0.1, 0.2, 1.0, 1.1], [EAST, EAST, EAST, NORTH, NORTH])
    found = at(track_of(v, hold=0.05), -0.06, -0.04, 0.24, 0.26, 0.96, 1.14, 1.16)
    np.testing.assert_array_equal(found, [0 * EAST, EAST, EAST, 0 * EAST, NORTH, NORTH, 0 * EAST])


def test_there_is_no_direction_below_the_lowest_speed():
    v = VelocitySeries([0.0, 1.0, 2.0], [EAST, 0.2 * EAST, 0 * EAST])
    track = track_of(v, min_speed=0.2)
    np.testing.assert_array_equal(at(track, 0.0, 0.99, 1.01), [EAST, EAST, 0 * EAST])
    assert over(track, 0.0, 2.0).any()
    assert not over(track, 1.0, 2.0).any()


def test_a_standing_vehicle_has_no_direction_even_if_any_speed_will_do():
    v = VelocitySeries([0.0, 1.0, 2.0], [EAST, 0 * EAST, 0 * EAST])
    found = at(track_of(v, min_speed=0.0), 0.5, 1.5, 3.0)
    np.testing.assert_array_equal(found, [EAST, 0 * EAST, 0 * EAST])


def test_a_tenth_of_the_usual_top_speed_counts_as_standing():
    v = VelocitySeries(np.arange(11.0), np.outer([10] * 9 + [1.01, 0.99], EAST))
    assert track_of(v).min_speed == pytest.approx(1.0)
    np.testing.assert_array_equal(at(track_of(v), 9.0, 10.0), [EAST, 0 * EAST])


# Against the twin -------------------------------------------------------------------------------


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10**6), st.booleans())
def test_directions_equal_those_of_the_twin(seed, instants):
    velocities, rng = random_velocities(seed)
    t = velocities.t
    start = np.sort(rng.uniform(t[0] - 0.1, t[-1] + 0.1, 80))
    end = start if instants else start + 0.07
    found = track_of(velocities, max_gap=0.1, min_speed=0.3).directions(start, end, 0.05)
    args = (t, velocities.v, 0.1, 0.3)
    expected = [naive.direction(*args, a, b) for a, b in zip(start + 0.05, end + 0.05, strict=True)]
    np.testing.assert_allclose(found, expected, atol=1e-9)


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10**6))
def test_smoothing_equals_that_of_the_twin(seed):
    velocities, rng = random_velocities(seed)
    segment, sigma = naive.segments(velocities.t, 0.1), np.array([0.5, 1.5, 0.0])
    args = (velocities.t, velocities.v, segment, SMOOTHING, sigma, SMOOTHING_GATE)
    np.testing.assert_allclose(kernel.smooth(*args), naive.smooth(*args), atol=1e-7)


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 10**6), st.floats(-1, 1), st.floats(0, 0.2))
def test_directions_are_unit_or_zero_and_zero_outside_the_samples(seed, offset, length):
    velocities, rng = random_velocities(seed)
    track = velocity_track(velocities, max_gap=0.1)
    start = np.sort(rng.uniform(velocities.t[0] - 1, velocities.t[-1] + 1, 100))
    norm = np.linalg.norm(track.directions(start, start + length, offset), axis=1)
    assert np.all((norm == 0) | (np.abs(norm - 1) < 1e-12))
    a, b = start + offset, start + length + offset
    assert not norm[(a < velocities.t[0]) | (b > velocities.t[-1])].any()
    for gap in np.flatnonzero(np.diff(velocities.t) > 0.1):
        low, high = velocities.t[gap], velocities.t[gap + 1]
        assert not norm[(a < high) & (b > low) & ((a > low) | (b < high))].any()


# Preparing --------------------------------------------------------------------------------------


def test_the_path_is_the_integral_of_the_velocity():
    t = np.linspace(0, 2, 21)
    track = track_of(VelocitySeries(t, np.stack([np.ones_like(t), t, 0 * t], axis=1)))
    np.testing.assert_allclose(track.path, np.stack([t, t**2 / 2, 0 * t], axis=1), atol=1e-14)


def test_segments_end_at_steps_above_five_times_the_median():
    t = np.array([0.0, 0.1, 0.2, 0.7, 0.8, 1.4, 1.5, 1.6])
    track = track_of(VelocitySeries(t, np.tile(EAST, (8, 1))), max_gap=None)
    np.testing.assert_array_equal(track.segment, [0, 0, 0, 0, 0, 1, 1, 1])


def test_rebuilding_a_track_on_its_own_velocities_changes_nothing():
    velocities, _ = random_velocities(1)
    track = velocity_track(velocities)
    again = rebuilt(track, track.v)
    for mine, other in zip(track.arrays, again.arrays, strict=True):
        np.testing.assert_array_equal(mine, other)


# Smoothing --------------------------------------------------------------------------------------


def test_smoothing_leaves_a_clean_curve_alone():
    """Second differences of a clean S-curve are a "noise" of 1e-4; no more may be changed."""
    drive = drives.s_curve(20.0)
    t = np.arange(0, 20, 0.02)
    smoothed = velocity_track(VelocitySeries(t, drive.velocity(t))).v
    np.testing.assert_allclose(smoothed, drive.velocity(t), atol=1e-3)


def test_smoothing_takes_most_of_the_noise_from_a_smooth_drive():
    drive, rng = drives.s_curve(60.0), np.random.default_rng(0)
    noise = Noise(0.05)
    v = simulate(drive, rng, velocity_noise=noise).velocities
    error = velocity_track(v).v - drive.velocity(v.t)
    # A parabola over 1.6 s at 50 Hz leaves 9 / (4 * 81) of the variance: a sixth of the sigma.
    assert error[:, :2].std() < 0.05 / 4


def test_smoothing_keeps_instant_turns_sharp():
    """Beyond 0.1 s from a turn of 45 degrees no direction may be off by more than 5 degrees."""
    drive, rng = drives.polyline(30.0), np.random.default_rng(0)
    v = simulate(drive, rng, velocity_noise=Noise(0.02)).velocities
    track = velocity_track(v)
    t = np.arange(0.1, 29.9, 0.01)
    t = t[np.abs((t + 1.5) % 3.0 - 1.5) > 0.1]
    wrong = np.linalg.norm(at(track, *t) - drive.velocity(t), axis=1)
    assert wrong.max() < np.radians(5)


def test_smoothing_does_not_reach_across_a_gap():
    t = np.r_[np.arange(0, 2, 0.02), np.arange(2.5, 4.5, 0.02)]
    rng = np.random.default_rng(0)
    v = np.where((t < 2.2)[:, None], EAST, NORTH) + 0.01 * rng.standard_normal((t.size, 3))
    whole, first = (velocity_track(VelocitySeries(t[k], v[k])) for k in (t > -1, t < 2.2))
    # The two runs' noise is one number; the second changes it a little, and smoothing with it.
    np.testing.assert_allclose(whole.v[t < 2.2], first.v, atol=0.01)


# Noise ------------------------------------------------------------------------------------------


def test_second_differences_give_the_white_noise_of_a_smooth_drive():
    drive, rng = drives.s_curve(100.0), np.random.default_rng(0)
    v = drive.velocity(np.arange(0, 100, 0.02)) + [0.02, 0.05, 0.1] * rng.standard_normal((5000, 3))
    found = white_noise(v, np.zeros(5000, dtype=np.int64))
    # Second differences are correlated: 5000 of them are worth 36 / 70 as many.
    np.testing.assert_allclose(found, [0.02, 0.05, 0.1], rtol=5 / np.sqrt(2 * 5000 * 36 / 70))


@pytest.mark.parametrize("lag", [1, 4])
def test_jumps_and_gaps_do_not_count_as_noise(lag):
    rng = np.random.default_rng(0)
    segment = np.repeat(np.arange(4), 500)
    v = 0.1 * rng.standard_normal((2000, 3)) + 100.0 * segment[:, None]
    v[rng.integers(2000, size=20)] += 50
    assert white_noise(v, segment, lag) == pytest.approx(0.1, rel=0.15)


@pytest.mark.parametrize("count", [0, 1, 11, 12])
def test_fewer_than_eight_differences_tell_no_noise(count):
    v = np.random.default_rng(0).standard_normal((count, 2))
    noise = white_noise(v, np.zeros(count, dtype=np.int64))
    assert noise.shape == (2,)
    assert (noise > 0).all() == (count == 12)


def test_short_segments_tell_no_noise():
    v = np.random.default_rng(0).standard_normal((40, 2))
    np.testing.assert_array_equal(white_noise(v, np.arange(40) // 4), np.zeros(2))


def test_a_parabola_has_no_noise():
    t = np.arange(0, 1, 0.01)
    v = np.stack([t, t**2, 1 - t**2], axis=1)
    assert white_noise(v, np.zeros(100, dtype=np.int64)).max() < 1e-4


# Intervals and bad input ------------------------------------------------------------------------


def test_headings_without_intervals_stand_for_instants():
    headings = HeadingSeries([0.0, 1.0], [EAST, EAST])
    track = velocity_track(VelocitySeries([0.0, 1.0], [EAST, EAST]))
    columns = StreamPair.of(headings, track).columns
    np.testing.assert_array_equal(columns.start, columns.end)


def test_intervals_may_come_in_any_order():
    """Windows of headings overlap, and a later one may start before an earlier one."""
    rng = np.random.default_rng(3)
    t = np.sort(rng.uniform(0, 10, 300))
    track = velocity_track(VelocitySeries(t, rng.standard_normal((300, 3))), max_gap=0.1)
    start = rng.uniform(-0.5, 10.5, 500)
    end = start + rng.choice([0.0, 0.05, 0.6], 500)
    alone = [track.directions(start[i : i + 1], end[i : i + 1], 0.1)[0] for i in range(500)]
    np.testing.assert_array_equal(track.directions(start, end, 0.1), alone)


def test_a_track_needs_two_samples():
    with pytest.raises(InputError, match="velocities: at least 2 rows are needed, not 1"):
        velocity_track(VelocitySeries([0.0], [EAST]))
    with pytest.raises(InputError, match="velocities: at least 2 rows are needed, not 0"):
        velocity_track(VelocitySeries(np.empty(0), np.empty((0, 3))))


@pytest.mark.parametrize("moving", [0, 1])
def test_a_vehicle_at_rest_has_no_track(moving):
    v = np.zeros((20, 3))
    v[:moving] = EAST
    with pytest.raises(InputError, match="the vehicle does not move"):
        velocity_track(VelocitySeries(np.arange(20.0), v))


@pytest.mark.parametrize("gap", [0.0, -1.0, np.nan])
def test_the_longest_step_must_be_positive(gap):
    with pytest.raises(InputError, match="max_gap must be a positive number of seconds"):
        velocity_track(THREE, max_gap=gap)


@pytest.mark.parametrize("name", ["min_speed", "hold"])
@pytest.mark.parametrize("value", [-0.1, np.nan])
def test_limits_must_be_finite_and_not_negative(name, value):
    with pytest.raises(InputError, match=f"{name} must be a finite number of at least 0"):
        velocity_track(THREE, **{name: value})

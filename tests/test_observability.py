"""What a motion can tell: the heading-rate test, a steady rival, and the spread of directions."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from data_tools.simulation import drives
from data_tools.simulation.streams import Noise, simulate
from evcalib.alignment.observability import (
    RATE_GATE,
    _slow_variance,
    axis_name,
    direction_spread,
    heading_rate_test,
    speed_test,
    steady_turning,
)
from evcalib.geometry import unit
from evcalib.kinematics.velocity_track import velocity_track
from evcalib.series import VelocitySeries
from evcalib.uncertainty import coloured_noise

ONE = np.zeros(5000, dtype=np.int64)


def track_of(drive, seed=0, **noise):
    rng = np.random.default_rng(seed)
    noise = Noise(**{"sigma": 0.02, **noise})
    return velocity_track(simulate(drive, rng, velocity_noise=noise).velocities)


def z_values(drive, trials=40, **noise):
    tracks = (track_of(drive, seed, **noise) for seed in range(trials))
    return np.array([heading_rate_test(track, 0.0, drive.duration) for track in tracks])


# Heading rate -----------------------------------------------------------------------------------


@pytest.mark.parametrize("drive", [drives.straight(), drives.arc()], ids=lambda d: d.kind)
@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_noise_alone_does_not_pass_for_turning(drive, rho):
    """z is about normal for white noise, and rather too low than too high for coloured noise.

    Of 40 values the mean lies within five standard errors, 0.8, and one in 700 passes 3.
    """
    z = z_values(drive, rho=rho)
    assert z.mean() < 0.8
    assert rho > 0 or z.mean() > -0.8
    assert (z > RATE_GATE).sum() <= 1


@pytest.mark.parametrize("degrees", [5, 10, 45])
def test_an_s_curve_of_five_degrees_passes(degrees):
    z = z_values(drives.s_curve(amplitude=np.radians(degrees)), trials=20)
    assert z.min() > RATE_GATE


def test_a_straight_drive_without_noise_does_not_turn():
    t = np.arange(0, 20, 0.02)
    track = velocity_track(VelocitySeries(t, drives.straight(heading=0.3).velocity(t)))
    assert heading_rate_test(track, 0, 20) < RATE_GATE


def test_an_arc_without_noise_turns_steadily():
    t = np.arange(0, 20, 0.02)
    track = velocity_track(VelocitySeries(t, drives.arc().velocity(t)))
    assert heading_rate_test(track, 0, 20) < RATE_GATE


def test_only_the_part_that_is_asked_for_counts():
    """Straight for 20 s, then an S-curve."""
    t = np.arange(0, 40, 0.02)
    angle = np.where(t < 20, 0.0, np.sin(t - 20))
    v = np.stack([np.cos(angle), np.sin(angle), 0 * t], axis=1)
    v[:, :2] += 0.02 * np.random.default_rng(0).standard_normal((t.size, 2))
    track = velocity_track(VelocitySeries(t, v))
    assert heading_rate_test(track, 0, 19) < RATE_GATE
    assert heading_rate_test(track, 20, 40) > RATE_GATE


def test_a_part_without_samples_or_motion_tells_nothing():
    track = track_of(drives.s_curve())
    assert heading_rate_test(track, 100, 120) == 0.0
    assert heading_rate_test(track, 5.0, 5.5) == 0.0


def test_turning_across_a_gap_is_not_looked_at():
    """Two straight runs in different directions with a gap between: nothing turned while seen."""
    t = np.r_[np.arange(0, 10, 0.02), np.arange(12, 22, 0.02)]
    v = np.where((t < 11)[:, None], [1.0, 0, 0], [0, 1.0, 0])
    v[:, :2] += 0.02 * np.random.default_rng(0).standard_normal((t.size, 2))
    assert heading_rate_test(velocity_track(VelocitySeries(t, v)), 0, 22) < RATE_GATE


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9, 0.98, 0.999])
def test_means_of_neighbouring_blocks_differ_by_no_more_than_is_allowed_for(rho):
    """The double sum over two blocks of 25 samples of AR(1) noise; half as much at the least."""
    i = np.arange(25)
    within, across = (rho ** np.abs(np.subtract.outer(i, i + k)).astype(float) for k in (0, 25))
    exact = 2 * (within.mean() - across.mean())
    allowed = 2 * _slow_variance(rho, 25.0) / 25
    assert exact <= allowed * (1 + 1e-9)
    assert allowed < 2.6 * exact


# Coloured noise ---------------------------------------------------------------------------------


@pytest.mark.parametrize("rho", [0.0, 0.4, 0.8])
def test_ar1_noise_on_a_smooth_drive_is_measured(rho):
    noise = Noise(0.03, rho=rho)
    drive = drives.s_curve(100.0)
    v = simulate(drive, np.random.default_rng(0), velocity_noise=noise).velocities.v
    sigma, found = coloured_noise(v, np.zeros(len(v), dtype=np.int64))
    assert found == pytest.approx(rho, abs=0.05)
    np.testing.assert_allclose(sigma[:2], 0.03, rtol=0.15)
    assert sigma[2] == 0


def test_no_noise_has_no_memory():
    sigma, rho = coloured_noise(np.zeros((100, 3)), ONE[:100])
    assert not sigma.any()
    assert rho == 0.0


# The steady rival -------------------------------------------------------------------------------


def test_the_steady_rival_of_an_arc_is_the_arc():
    t = np.arange(0, 20, 0.02)
    drive = drives.arc(heading=0.5)
    track = velocity_track(VelocitySeries(t, drive.velocity(t)))
    # Chords over half a second are shorter than the arc by (0.25 * 0.5)^2 / 24 of it.
    np.testing.assert_allclose(steady_turning(track, 0, 20).v, drive.velocity(t), atol=0.01)


def test_the_steady_rival_of_an_s_curve_keeps_times_and_speeds():
    track = track_of(drives.s_curve())
    rival = steady_turning(track, 0, 20)
    np.testing.assert_array_equal(rival.t, track.t)
    lengths = [np.linalg.norm(x.v, axis=1) for x in (rival, track)]
    np.testing.assert_allclose(*lengths, rtol=1e-9)
    assert np.linalg.norm(rival.v - track.v, axis=1).max() > 0.5


def test_the_steady_rival_turns_each_segment_at_the_common_rate():
    t = np.r_[np.arange(0, 5, 0.02), np.arange(8, 13, 0.02)]
    angle = np.where(t < 6, 0.2 * t, 1.5 + 0.2 * t)
    v = np.stack([np.cos(angle), np.sin(angle), 0 * t], axis=1)
    rival = steady_turning(velocity_track(VelocitySeries(t, v)), 0, 13)
    np.testing.assert_allclose(rival.v, v, atol=0.01)


# Spread -----------------------------------------------------------------------------------------


def spread_of(d, **noise):
    return direction_spread(d, track_of(drives.straight(), **noise))


@pytest.mark.parametrize("degrees", [2, 10])
def test_the_spread_is_the_rms_angle_from_the_main_axis(degrees):
    a = np.radians(degrees) * np.sin(np.linspace(0, 20 * np.pi, 2000))
    found = spread_of(np.stack([np.cos(a), np.sin(a), 0 * a], axis=1), sigma=0.0)
    assert np.degrees(found.spread) == pytest.approx(degrees / np.sqrt(2), rel=0.02)
    np.testing.assert_allclose(found.axis, [1, 0, 0], atol=1e-3)


def test_what_noise_of_the_velocities_explains_is_no_spread():
    rng = np.random.default_rng(0)
    d = unit([1.0, 0, 0] + rng.standard_normal((5000, 3)) * [0, 0.02, 0])
    assert spread_of(d, sigma=0.02).spread < 0.005
    assert spread_of(d, sigma=0.0).spread == pytest.approx(0.02, rel=0.05)


def test_the_main_axis_points_forward_or_else_left():
    d = np.tile([-1.0, 0.0, 0.0], (50, 1))
    np.testing.assert_allclose(spread_of(d).axis, [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(spread_of(d[:, [1, 0, 2]]).axis, [0, 1, 0], atol=1e-12)


def test_out_and_back_is_one_axis():
    d = np.repeat([[1.0, 0, 0], [-1.0, 0, 0]], 50, axis=0)
    assert spread_of(d).axes == 1


@pytest.mark.parametrize("count", [1, 2, 3, 6])
def test_axes_thirty_degrees_apart_are_counted(count):
    rng = np.random.default_rng(0)
    a = np.repeat(np.radians(30) * np.arange(count), 40) + np.radians(1) * rng.standard_normal(
        40 * count
    )
    d = np.stack([np.cos(a), np.sin(a), 0 * a], axis=1) * rng.choice([-1, 1], (a.size, 1))
    assert spread_of(rng.permutation(d)).axes == count


def test_an_axis_that_few_directions_hold_does_not_count():
    d = np.r_[np.tile([1.0, 0, 0], (97, 1)), np.tile([0.0, 1, 0], (3, 1))]
    assert spread_of(d).axes == 1


def test_many_directions_are_thinned_before_axes_are_counted():
    a = np.repeat([0.0, 1.0, 2.0], 2000)
    assert spread_of(np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)).axes == 3


@pytest.mark.parametrize(
    ("axis", "name"),
    [
        ([1, 0, 0], "forward"),
        ([0, -1, 0], "left"),
        ([0.1, 0, 0.99], "up"),
        ([0.6, 0.8, 0], "(0.60, 0.80, 0.00)"),
    ],
)
def test_axes_have_names(axis, name):
    assert name in axis_name(np.array(axis, dtype=float))


def test_the_test_is_calibrated_at_its_gate():
    """Of 200 straight drives at most 4 pass by chance where 3 standard deviations allow 0.27."""
    z = z_values(drives.straight(6.0), trials=200)
    assert (z > RATE_GATE).sum() <= stats.binom.ppf(0.9999, 200, stats.norm.sf(RATE_GATE)) + 1


# Speed ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("drive", [drives.straight(), drives.arc()], ids=lambda d: d.kind)
@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_noise_alone_does_not_pass_for_a_change_of_speed(drive, rho):
    """How long noise remembers is known less surely: then one in ten may pass."""
    tracks = (track_of(drive, seed, rho=rho) for seed in range(40))
    z = np.array([speed_test(track, 0.0, drive.duration) for track in tracks])
    assert z.mean() < 0.8
    assert rho > 0 or z.mean() > -0.8
    assert (z > RATE_GATE).sum() <= (4 if rho else 1)


def test_a_change_of_speed_of_a_few_percent_shows():
    drive = replace(drives.straight(), speed=lambda t: 1.0 + 0.03 * np.sin(t))
    assert speed_test(track_of(drive), 0.0, 20.0) > 2 * RATE_GATE
    # Over too short a part nothing shows.
    assert speed_test(track_of(drive), 3.0, 3.5) == 0.0

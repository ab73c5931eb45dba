"""Synthetic drives against closed forms, and their noise against its own statistics."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.simulation import drives
from data_tools.simulation.streams import Noise, dead_reckon, simulate
from evcalib.errors import InputError
from evcalib.geometry import angle_between
from evcalib.series import VelocitySeries

T = np.linspace(0, 20, 2001)
DRIVES = [drives.straight(), drives.arc(), drives.s_curve(), drives.polyline(), drives.zigzag()]
LONG = drives.s_curve(600.0)


def turned(streams):
    """Return the headings in the body frame and the true directions at the same instants."""
    true = streams.drive.velocity(streams.headings.t + streams.offset)
    return streams.headings.v @ streams.R_body_cam.T, true / np.linalg.norm(true, axis=1)[:, None]


# Drives -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("drive", DRIVES, ids=lambda d: d.kind)
def test_a_drive_is_planar_at_constant_speed(drive):
    v = drive.velocity(T)
    np.testing.assert_allclose(np.linalg.norm(v, axis=1), 1.0, rtol=1e-14)
    assert not v[:, 2].any()


def test_an_arc_turns_at_speed_over_radius():
    angle = drives.arc(radius=-4.0, speed=2.0, heading=0.3).angle(T)
    np.testing.assert_allclose(angle, 0.3 - 0.5 * T, rtol=1e-14)


def test_an_arc_driven_round_closes_its_circle():
    t = np.linspace(0, 2 * np.pi * 4, 4001)
    position = dead_reckon(VelocitySeries(t, drives.arc(radius=4.0).velocity(t)))
    np.testing.assert_allclose(position[-1], 0, atol=1e-9)
    np.testing.assert_allclose(position[2000], [0, 8, 0], atol=1e-4)


def test_an_s_curve_swings_by_its_amplitude_once_a_period():
    angle = drives.s_curve(amplitude=0.4, period=8.0, heading=1.0, phase=np.pi / 2).angle
    np.testing.assert_allclose(angle(np.array([0.0, 2.0, 4.0, 8.0])), [1.4, 1.0, 0.6, 1.4])


def test_a_polyline_turns_by_the_same_angle_after_each_side():
    angle = drives.polyline(turn=0.5, side=3.0, heading=0.1).angle(np.array([0, 2.9, 3.1, 6.1]))
    np.testing.assert_allclose(angle, [0.1, 0.1, 0.6, 1.1])


def test_a_zigzag_swings_to_and_fro_about_its_heading():
    angle = drives.zigzag(turn=0.5, side=3.0, heading=0.1).angle(np.array([1.0, 4.0, 7.0, 10.0]))
    np.testing.assert_allclose(angle, [-0.15, 0.35, -0.15, 0.35])


@pytest.mark.parametrize("make", [drives.polyline, drives.zigzag])
def test_a_turn_that_takes_time_is_smooth_and_centred_on_its_instant(make):
    slow, instant = make(turn=1.0, turn_time=0.4), make(turn=1.0)
    outside = np.abs((T + 1.5) % 3.0 - 1.5) > 0.21
    np.testing.assert_allclose(slow.angle(T)[outside], instant.angle(T)[outside], atol=1e-12)
    before, middle, after = slow.angle(np.array([2.8, 3.0, 3.2]))
    assert middle == pytest.approx((before + after) / 2)


def test_fingers_go_out_and_come_back_along_each_angle():
    drive = drives.fingers([0.0, 1.0], out=2.0, pause=0.5)
    t = np.linspace(0, drive.duration, 10_001)
    position = dead_reckon(VelocitySeries(t, drive.velocity(t)))
    tip, back, second = (position[np.searchsorted(t, s)] for s in (2.25, 4.75, 7.25))
    assert drive.duration == 10.0
    np.testing.assert_allclose([back, position[-1]], 0, atol=1e-3)
    np.testing.assert_allclose(
        second / np.linalg.norm(second), [np.cos(1), np.sin(1), 0], atol=1e-9
    )
    np.testing.assert_allclose(tip, [np.linalg.norm(second), 0, 0], atol=1e-3)


def test_fingers_stand_in_the_pauses():
    speed = drives.fingers([0.0], out=2.0, pause=0.5).speed(np.array([0.0, 1.0, 2.0, 2.4, 2.5]))
    np.testing.assert_allclose(speed, [0, 1, 0, 0, 0], atol=1e-12)


def test_dead_reckoning_turns_body_velocities_into_the_world():
    t = np.linspace(0, np.pi, 2001)
    forward = np.tile([1.0, 0.0, 0.0], (t.size, 1))
    position = dead_reckon(VelocitySeries(t, forward, np.ones_like(t)))
    circle = np.stack([np.sin(t), 1 - np.cos(t), 0 * t], axis=1)
    np.testing.assert_allclose(position, circle, atol=1e-6)


# Streams ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("drive", [*DRIVES, drives.fingers()], ids=lambda d: d.kind)
def test_clean_headings_are_the_true_directions_seen_by_the_camera(drive):
    streams = simulate(drive, np.random.default_rng(0), offset=0.3)
    np.testing.assert_allclose(*turned(streams), atol=1e-12)


def test_clean_velocities_are_those_of_the_drive_on_the_body_clock():
    streams = simulate(drives.s_curve(), np.random.default_rng(0), offset=0.3)
    expected = streams.drive.velocity(streams.velocities.t)
    np.testing.assert_array_equal(streams.velocities.v, expected)


def test_each_stream_has_its_rate_and_a_phase_of_its_own():
    starts = []
    for seed in range(200):
        streams = simulate(drives.straight(2.0), np.random.default_rng(seed))
        np.testing.assert_allclose(np.diff(streams.headings.t), 1 / 30)
        np.testing.assert_allclose(np.diff(streams.velocities.t), 1 / 50)
        starts.append((30 * streams.headings.t[0], 50 * streams.velocities.t[0]))
    starts = np.array(starts)
    # Uniform on [0, 1]: mean 1/2, and no correlation; four standard errors.
    assert np.abs(starts.mean(axis=0) - 0.5).max() < 4 / np.sqrt(12 * 200)
    assert abs(np.corrcoef(starts.T)[0, 1]) < 4 / np.sqrt(200)
    assert ((starts >= 0) & (starts < 1)).all()


def test_there_are_no_headings_where_the_vehicle_stands():
    streams = simulate(drives.fingers(), np.random.default_rng(0), offset=0.2)
    assert streams.drive.speed(streams.headings.t + 0.2).min() > 0.05
    assert (streams.velocities.speed == 0).any()


def test_white_noise_has_its_sigma_and_no_memory():
    streams = simulate(LONG, np.random.default_rng(1), heading_noise=Noise(0.05))
    seen, true = turned(streams)
    across = np.cross(true, seen)[:, 2]
    n = across.size
    assert across.std() == pytest.approx(0.05, rel=5 / np.sqrt(2 * n))
    assert abs(np.corrcoef(across[1:], across[:-1])[0, 1]) < 5 / np.sqrt(n)


@pytest.mark.parametrize("rho", [0.4, 0.8])
def test_coloured_noise_is_stationary_with_correlation_rho(rho):
    noise = Noise(0.05, rho=rho)
    streams = simulate(LONG, np.random.default_rng(1), velocity_noise=noise)
    error = streams.velocities.v - LONG.velocity(streams.velocities.t)
    x, n = error[:, 0], len(error)
    assert np.corrcoef(x[1:], x[:-1])[0, 1] == pytest.approx(rho, abs=5 / np.sqrt(n))
    # The variance of n samples is worth (1 - rho^2) / (1 + rho^2) n independent ones.
    assert x.std() == pytest.approx(0.05, rel=5 * np.sqrt((1 + rho**2) / (1 - rho**2) / 2 / n))
    assert not error[:, 2].any()


@pytest.mark.parametrize("share", [0.2, 0.6])
def test_outliers_come_in_their_share_and_point_anywhere(share):
    streams = simulate(LONG, np.random.default_rng(2), heading_noise=Noise(outliers=share))
    seen, true = turned(streams)
    wrong = angle_between(seen, true) > 1e-6
    assert wrong.mean() == pytest.approx(share, abs=5 * 0.5 / np.sqrt(wrong.size))
    assert np.abs(seen[wrong].mean(axis=0)).max() < 5 / np.sqrt(3 * wrong.sum())


def test_clustered_outliers_share_one_direction():
    noise = Noise(outliers=0.4, cluster=True)
    streams = simulate(LONG, np.random.default_rng(2), heading_noise=noise)
    seen, true = turned(streams)
    wrong = seen[angle_between(seen, true) > 1e-6]
    assert np.linalg.norm(wrong.mean(axis=0)) > 0.9


def test_flips_turn_the_sign_of_their_share():
    streams = simulate(LONG, np.random.default_rng(2), heading_noise=Noise(flips=0.4))
    cosine = np.sum(np.multiply(*turned(streams)), axis=1)
    np.testing.assert_allclose(np.abs(cosine), 1)
    assert (cosine < 0).mean() == pytest.approx(0.4, abs=5 * 0.5 / np.sqrt(cosine.size))


def test_spoiled_velocities_keep_their_speed_and_stay_planar():
    noise = Noise(outliers=0.3, flips=0.3)
    streams = simulate(LONG, np.random.default_rng(2), velocity_noise=noise)
    np.testing.assert_allclose(streams.velocities.speed, 1.0)
    assert not streams.velocities.v[:, 2].any()


def test_drop_outs_lose_their_share():
    noise = Noise(dropout=0.3)
    streams = simulate(LONG, np.random.default_rng(2), heading_noise=noise, velocity_noise=noise)
    for series, rate in ((streams.headings, 30), (streams.velocities, 50)):
        assert len(series) == pytest.approx(0.7 * rate * 600, abs=5 * np.sqrt(0.21 * rate * 600))


def test_gaps_are_intervals_of_body_time_without_samples():
    noise = Noise(gaps=((3.0, 4.0), (10.0, 12.5)))
    streams = simulate(
        drives.arc(),
        np.random.default_rng(0),
        offset=0.4,
        heading_noise=noise,
        velocity_noise=noise,
    )
    for t in (streams.headings.t + 0.4, streams.velocities.t):
        assert not ((t >= 3.0) & (t <= 4.0)).any()
        assert np.diff(t)[np.searchsorted(t, 12.5) - 1] == pytest.approx(2.5, abs=0.1)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_the_same_seed_gives_the_same_bytes(seed):
    noise = Noise(0.1, rho=0.5, outliers=0.1, flips=0.1, dropout=0.1)
    one, two = (
        simulate(
            drives.s_curve(), np.random.default_rng(seed), heading_noise=noise, velocity_noise=noise
        )
        for _ in range(2)
    )
    assert one.headings.v.tobytes() == two.headings.v.tobytes()
    assert one.velocities.v.tobytes() == two.velocities.v.tobytes()
    assert one.R_body_cam.tobytes() == two.R_body_cam.tobytes()


# Bad input --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["rho", "outliers", "flips", "dropout"])
@pytest.mark.parametrize("value", [-0.1, 1.1, np.nan])
def test_shares_lie_between_zero_and_one(name, value):
    with pytest.raises(InputError, match=f"{name} is a share between 0 and 1"):
        Noise(0.1, **{name: value})


@pytest.mark.parametrize(
    "noise", [{"sigma": -1.0}, {"rho": 1.0}, {"sigma": np.nan}, {"sigma": np.inf}]
)
def test_noise_without_a_variance_is_refused(noise):
    with pytest.raises(InputError, match="sigma must be finite and not negative"):
        Noise(**noise)


def test_unusable_drives_are_refused():
    with pytest.raises(InputError, match="fingers need at least one angle"):
        drives.fingers([])
    with pytest.raises(InputError, match="period must be a positive number of seconds"):
        drives.s_curve(period=0)
    with pytest.raises(InputError, match="side must be a positive number of seconds"):
        drives.polyline(side=-1)
    with pytest.raises(InputError, match="turn_time must not be negative"):
        drives.zigzag(turn_time=-0.1)
    with pytest.raises(InputError, match="rate must be a positive number of samples per second"):
        simulate(drives.arc(), np.random.default_rng(0), heading_rate=0)

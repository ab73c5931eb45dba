"""Simulated drives: what vehicles do and log, against closed forms and the simulator's truth."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_tools.simulation.body_effects import SWAY_DAMPING, SWAY_HZ, obeyed, sway, vibration
from data_tools.simulation.drives import Drive, fingers, s_curve, straight
from data_tools.simulation.gyro import Gyro, angular_rates
from data_tools.simulation.random_drives import CAR_WHEELBASE, RECORDED, TURNING
from data_tools.simulation.recorded_drive import (
    LARGEST_REACH,
    VEHICLE,
    Disturbances,
    record_drive,
)
from data_tools.simulation.trajectory import Trajectory
from data_tools.simulation.wheel_effects import LogEffects, lateness, wheel_log
from evcalib.camera import Camera
from evcalib.errors import InputError

SMALL = Camera(32, 24, 40.0, 40.0, 15.5, 11.5)


@pytest.mark.parametrize("motion", TURNING)
@pytest.mark.parametrize("seed", [1, 2])
def test_wheels_and_position_tell_the_velocity_of_the_camera(motion, seed):
    """v_cam = v_o + w x lever, from the wheel log alone, is what the simulated camera does."""
    made = record_drive(seed, motion=motion, duration=8.0, speed=0.7, camera=SMALL)
    told, (x, y, z) = made.velocities(), made.lever
    t = told.t - made.offset
    keep = (t > made.simulator.trajectory.t[0]) & (t < made.simulator.trajectory.t[-1])
    truth = made.simulator.truth(t[keep])
    v = told.v[keep] + np.outer(told.yaw_rate[keep], [0, 0, 1]) @ [[0, 0, 0], [0, 0, 0], [-y, x, 0]]
    np.testing.assert_allclose(v @ made.R_body_cam, truth.v_cam, atol=0.01)
    np.testing.assert_allclose(told.yaw_rate[keep], truth.rate_body[:, 2], atol=0.01)
    assert np.hypot(x, y) <= LARGEST_REACH
    assert 0.3 <= z <= 0.9


@pytest.mark.parametrize("seed", range(5))
def test_what_the_turning_vehicles_do(seed):
    """Bounds of speeds and rates, from the definitions of the motions."""
    t = np.linspace(1.0, 16.0, 4001)
    rng = np.random.default_rng(seed)
    made = {name: RECORDED[name](rng, 16.0, 0.7) for name in TURNING}
    rate = {name: np.degrees(drive.yaw_rate(t)) for name, drive in made.items()}
    speed = {name: drive.speed(t) for name, drive in made.items()}
    assert 38 < np.abs(rate["figure-eight"]).max() <= 60
    assert 0.29 < speed["figure-eight"].min() < 0.45 < 0.6 < speed["figure-eight"].max() <= 0.7
    steer = np.arctan(CAR_WHEELBASE * np.radians(rate["slalom"]) / speed["slalom"])
    assert 14.5 < np.degrees(np.abs(steer).max()) <= 30.0
    assert not speed["spin"].any()
    assert 10 < np.abs(rate["spin"]).max() <= 60
    assert np.ptp(rate["circle"]) == np.ptp(speed["circle"]) == 0.0
    assert not rate["stops"].any()
    assert speed["stops"].min() == 0.0
    for name in ("figure-eight", "slalom", "circle", "stops"):
        assert not made[name].velocity(t)[:, 1].any(), f"{name} does not go sideways"


def test_a_lobe_of_an_eight_turns_all_round():
    """The body turns by 200 to 250 degrees one way, then back."""
    t = np.linspace(0.0, 30.0, 30001)
    for seed in range(5):
        drive = RECORDED["figure-eight"](np.random.default_rng(seed), 30.0, 0.7)
        yaw = np.degrees(np.concatenate([[0], np.cumsum(drive.yaw_rate(t)[1:] * 1e-3)]))
        turns = np.flatnonzero(np.diff(np.sign(drive.yaw_rate(t))))
        lobe = np.abs(np.diff(yaw[turns[turns > 1000]]))
        assert ((lobe > 199) & (lobe < 251)).all()


def rest(t):
    return np.zeros_like(t)


def test_a_body_leans_back_as_it_speeds_up_and_outwards_in_a_bend():
    """Constant accelerations, after the swing: pitch -gain a_x, roll gain a_y."""
    gain = np.radians(0.3)
    rush = Drive("rush", 5.0, rest, lambda t: 2.0 * t)
    path = Trajectory.of_drive(rush, shake=lambda t, a: sway(t, a, gain))
    forward = path.rotation_at([4.9])[0, :, 0]
    assert np.arcsin(forward[2]) == pytest.approx(2.0 * gain, rel=0.01), "the nose goes up"
    bend = Drive("bend", 6.0, rest, lambda t: np.full_like(t, 1.5), lambda t: np.full_like(t, 0.8))
    path = Trajectory.of_drive(bend, shake=lambda t, a: sway(t, a, gain))
    left = path.rotation_at([5.9])[0, :, 1]
    assert np.arcsin(left[2]) == pytest.approx(1.5 * 0.8 * gain, rel=0.01), "the inside goes up"


def test_a_step_of_acceleration_overshoots_as_a_second_order_system_does():
    """By exp(-pi d / sqrt(1 - d^2)), half a damped period after the step."""
    t = np.arange(0.0, 4.0, 0.002)
    step = np.zeros((t.size, 3))
    step[:, 0] = 1.0
    pitch = -sway(t, step, 1.0)[:, 1]
    damped = np.sqrt(1 - SWAY_DAMPING**2)
    assert pitch.max() - 1 == pytest.approx(np.exp(-np.pi * SWAY_DAMPING / damped), rel=0.01)
    assert t[pitch.argmax()] == pytest.approx(0.5 / (SWAY_HZ * damped), abs=0.005)


def test_vibration_has_its_size_and_its_band():
    t = np.arange(0.0, 200.0, 0.002)
    shaken = vibration(t, 0.01, (5.0, 15.0), np.random.default_rng(1))
    np.testing.assert_allclose(shaken.std(axis=0), 0.01, rtol=0.05)
    np.testing.assert_allclose(np.corrcoef(shaken.T), np.eye(3), atol=0.1)
    power = (np.abs(np.fft.rfft(shaken, axis=0)) ** 2).sum(axis=1)
    hertz = np.fft.rfftfreq(t.size, 0.002)
    assert power[(hertz > 4) & (hertz < 18)].sum() > 0.9 * power.sum()
    with pytest.raises(InputError, match="band"):
        vibration(t, 0.01, (15.0, 5.0), np.random.default_rng(1))


def test_controllers_without_overshoot_are_late_by_dead_time_and_two_poles():
    """A ramp comes late by the dead time and 2 / w."""
    ramp = Drive("ramp", 4.0, rest, lambda t: 0.3 * t)
    done = obeyed(ramp, 0.1, 2.0)
    t = np.linspace(2.0, 4.0, 50)
    late = 0.1 + 2 / (2 * np.pi * 2.0)
    np.testing.assert_allclose(done.speed(t), 0.3 * (t - late), atol=1e-3)
    assert obeyed(ramp, 0.0, 0.0) is ramp
    line = Drive("line", 4.0, rest, lambda t: np.full_like(t, 0.4))
    np.testing.assert_allclose(obeyed(line, 0.2, 1.0).speed(t), 0.4, atol=1e-9)


WAVE = s_curve(12.0, amplitude=0.8, period=4.0, speed=0.5)
FINGERS = fingers([0.0, 1.0, -1.0], speed=0.5)


@pytest.mark.parametrize(("effects", "late"), [
    (LogEffects(), 0.0),
    (LogEffects(slip=0.05, drop_out=0.2), 0.0),
    (LogEffects(low_pass=0.05), 0.05),
    (LogEffects(encoder_step=1e-4, rate=20.0), 0.025),
    (LogEffects(jitter=0.005), 0.0),
    (LogEffects(rate=10.0), 0.0),
])  # fmt: skip
def test_how_late_a_log_is(effects, late):
    """A low-pass by its time constant, counts by half a row, the rest not at all."""
    log = wheel_log(FINGERS, VEHICLE, effects, np.random.default_rng(2))
    assert lateness(log, VEHICLE, FINGERS) == pytest.approx(late, abs=0.003)


def test_a_log_of_commands_is_early():
    made = record_drive(
        3,
        motion="fingers",
        duration=12.0,
        camera=SMALL,
        disturbances=Disturbances(dead_time=0.12, bandwidth=3.0, logs_commands=True),
    )
    assert made.late == pytest.approx(-0.12 - 2 / (2 * np.pi * 3.0), abs=0.02)
    plain = record_drive(3, motion="fingers", duration=12.0, camera=SMALL)
    assert made.offset - made.late == pytest.approx(plain.offset)


def test_nothing_is_late_where_nothing_changes():
    line = straight(8.0, speed=0.5)
    log = wheel_log(line, VEHICLE, LogEffects(low_pass=0.05), np.random.default_rng(1))
    assert lateness(log, VEHICLE, line) == 0.0


def test_encoders_count_steps_and_forget_nothing():
    log = wheel_log(WAVE, VEHICLE, LogEffects(encoder_step=0.005), np.random.default_rng(1))
    counts = log.states.speed / (0.005 * 50.0)
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-6)
    assert (counts.sum(axis=0) * 0.005) == pytest.approx(0.5 * 12.0, abs=0.02)


def test_steering_with_play_stays_behind_by_half_of_it():
    rng = np.random.default_rng(1)
    play = np.radians(2.0)
    log = wheel_log(WAVE, VEHICLE, LogEffects(backlash=play), rng)
    behind = log.states.steer[:, 0] - WAVE.angle(log.t)
    assert np.abs(behind).max() <= 0.5 * play + 1e-6
    turning = np.gradient(WAVE.angle(log.t), log.t)
    fast = (np.abs(turning) > 0.9) & (log.t > 1.0)
    np.testing.assert_allclose(behind[fast], -np.sign(turning[fast]) * 0.5 * play, atol=1e-3)


def test_rows_and_their_loss():
    log = wheel_log(WAVE, VEHICLE, LogEffects(rate=200.0, drop_out=0.3), np.random.default_rng(1))
    assert abs(len(log.t) - 0.7 * 2400) < 4 * np.sqrt(0.21 * 2400)
    jittered = wheel_log(WAVE, VEHICLE, LogEffects(jitter=0.02), np.random.default_rng(1))
    assert (np.diff(jittered.t) > 0).all()
    with pytest.raises(InputError, match="slip"):
        LogEffects(slip=-0.1)


def test_a_body_may_turn_untold():
    made = record_drive(
        1, duration=6.0, camera=SMALL, disturbances=Disturbances(untold_yaw_rate=np.radians(3.0))
    )
    told = made.velocities()
    assert np.abs(told.yaw_rate).max() < 1e-9
    t = np.linspace(*made.simulator.trajectory.t[[0, -1]], 200)
    assert 0.3 < np.degrees(np.abs(made.simulator.truth(t).rate_body[:, 2])).max() <= 3.0


SHAKEN = Disturbances(tilt=np.radians(0.5), vibration=np.radians(0.3))


def test_the_gyro_integrates_to_the_attitude_of_the_camera():
    made = record_drive(2, motion="fingers", duration=4.0, camera=SMALL, disturbances=SHAKEN)
    t, rate = angular_rates(made.simulator, Gyro(noise=0.0))
    turned = Rotation.identity()
    for w in rate:
        turned = turned * Rotation.from_rotvec(1e-3 * w)
    R = made.simulator.truth(t[[0, -1]] + [-0.5e-3, 0.5e-3]).R_world_cam
    np.testing.assert_allclose(turned.as_matrix(), R[0].T @ R[1], atol=1e-6)
    assert np.degrees(np.abs(rate).max()) > 5.0


def test_the_gyro_has_its_noise_and_bias():
    made = record_drive(2, motion="sweep", duration=4.0, camera=SMALL)
    bias, density = (0.01, -0.02, 0.005), 1e-4
    _, rate = angular_rates(made.simulator, Gyro(400.0, density, bias), seed=3)
    np.testing.assert_allclose(rate.mean(axis=0), bias, atol=2e-4)
    np.testing.assert_allclose(rate.std(axis=0), density * np.sqrt(200.0), rtol=0.08)
    with pytest.raises(InputError, match="noise"):
        Gyro(noise=-1.0)

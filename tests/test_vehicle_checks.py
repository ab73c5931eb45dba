"""What a drive says about its vehicle: parameters put wrong on purpose are found, others are not.

Run with ``-s`` for the table of errors and stated sd.
"""

import numpy as np
import pytest

from data_tools.logs.series_files import write_velocities
from data_tools.logs.vehicle_files import write_vehicle
from data_tools.logs.velocity_sources import read_body_velocities
from data_tools.logs.wheel_logs import write_wheel_log
from evcalib.errors import InputError
from evcalib.kinematics import (
    Mecanum,
    Omni,
    OmniWheel,
    Rolling,
    Swerve,
    Wheel,
    WheelLog,
    WheelStates,
    check_vehicle,
    turning_centre,
)
from evcalib.series import VelocitySeries

T = np.arange(0.0, 40.0, 0.02)
RATE = 0.5 * np.sin(0.7 * T) + 0.25 * np.sin(1.9 * T)
AHEAD = np.stack([0.5 + 0.4 * np.sin(0.9 * T), 0 * T], axis=1)
AROUND = 0.5 * np.stack([np.cos(0.5 * T), np.sin(0.8 * T)], axis=1)
CORNERS = [("fl", 0.3, 0.25), ("fr", 0.3, -0.25), ("rl", -0.3, 0.25), ("rr", -0.3, -0.25)]
SWERVE = Swerve(tuple(Wheel(*corner) for corner in CORNERS))


def drive(vehicle, v, rate, seed, *, zeros=0.0, speeds=1.0, gyro=True):
    """Log a drive with the noise of encoders (5 mm/s, 0.1 deg) and of a gyro with a bias."""
    rng = np.random.default_rng(seed)
    states = vehicle.wheel_states(v, rate)
    speed = states.speed * speeds + rng.normal(0, 0.005, states.speed.shape)
    steer = states.steer
    if steer is not None:
        steer = steer + zeros + rng.normal(0, np.radians(0.1), steer.shape)
    told = rate + 0.01 + rng.normal(0, 0.01, rate.size) if gyro else None
    return WheelLog(T, WheelStates(speed, steer), told)


def found(check, kind, wheel=""):
    (one,) = [p for p in check.parameters if (p.kind, p.wheel) == (kind, wheel)]
    return one


@pytest.mark.parametrize("seed", range(11, 16))
def test_track_and_ratio_of_radii_of_a_differential_drive(seed):
    """Issue: a ratio off by 1 % is found to 0.2 %, a track off by 3 % to 0.5 %."""
    log = drive(Rolling.differential(0.412), AHEAD, RATE, seed, speeds=[0.995, 1.005])
    check = check_vehicle(log, Rolling.differential(0.400))
    track, left = found(check, "size"), found(check, "radius", "left")
    right = found(check, "radius", "right")
    print(f"\ntrack {track.value:+.4f} ({track.sd:.4f}), left {left.value:+.4f} ({left.sd:.4f})")
    assert track.value == pytest.approx(0.03, abs=0.005)
    assert left.value - right.value == pytest.approx(0.01, abs=0.002)
    assert abs(track.value - 0.03) < 4 * track.sd
    assert abs(left.value - 0.005) < 4 * left.sd
    assert any("track" in line for line in check.advice)


@pytest.mark.parametrize("seed", range(11, 16))
@pytest.mark.parametrize("zeros", [[1.0, 0.0, 0.0, 0.0], [1.0, 1.0, 1.0, 1.0]])
def test_steering_zeros_of_a_swerve_that_turns(zeros, seed):
    """Issue: a zero of 1 deg is found to 0.1 deg; turning shows even one that all share."""
    log = drive(SWERVE, AROUND, RATE, seed, zeros=np.radians(zeros), gyro=False)
    check = check_vehicle(log, SWERVE)
    for (name, *_), zero in zip(CORNERS, zeros, strict=True):
        one = found(check, "steering zero", name)
        assert np.degrees(one.value) == pytest.approx(zero, abs=0.1)
        assert one.off == (zero > 0)
    assert "offset: -" in check.advice[0]


def test_without_turning_a_common_zero_is_a_rotation_and_stays_untold():
    log = drive(SWERVE, AROUND, 0 * T, 11, zeros=np.radians(1.0))
    check = check_vehicle(log, SWERVE)
    assert check.advice == ()
    assert all(p.kind != "size" for p in check.parameters)


@pytest.mark.parametrize(
    ("vehicle", "v", "rate"),
    [
        (Rolling.differential(0.4), AHEAD, RATE),
        (Rolling.differential(0.4, (0, 0), ("fl", "rl"), ("fr", "rr")), AHEAD, RATE),
        (Rolling.bicycle(1.0), AHEAD, 0.4 * RATE),
        (Rolling.ackermann(0.6, 0.4), AHEAD, 0.4 * RATE),
        (Rolling.tricycle(1.0), AHEAD, 0.4 * RATE),
        (Mecanum(0.3, 0.2), AROUND, RATE),
        (SWERVE, AROUND, RATE),
        (
            Omni(tuple(OmniWheel(n, np.cos(a), np.sin(a), a + 1.57) for n, a in
                       zip("abcd", np.arange(4) * np.pi / 2, strict=True))),
            AROUND, RATE,
        ),
    ],
    ids=repr,
)  # fmt: skip
@pytest.mark.parametrize("gyro", [True, False])
def test_right_parameters_raise_no_alarm(vehicle, v, rate, gyro):
    advice = [
        check_vehicle(drive(vehicle, v, rate, seed, gyro=gyro), vehicle).advice
        for seed in range(20, 30)
    ]
    assert sum(map(bool, advice)) <= 1, advice


def test_a_car_is_told_of_its_steering_and_wheelbase():
    log = drive(Rolling.bicycle(1.03), AHEAD, 0.4 * RATE, 12, zeros=np.radians(1.0))
    check = check_vehicle(log, Rolling.bicycle(1.0))
    assert np.degrees(found(check, "steering zero", "front").value) == pytest.approx(1.0, abs=0.3)
    assert found(check, "size").value == pytest.approx(0.03, abs=0.006)


def test_wheels_that_determine_a_motion_and_no_more_tell_nothing():
    log = drive(Rolling.differential(0.41), AHEAD, RATE, 11, gyro=False)
    assert check_vehicle(log, Rolling.differential(0.4)).parameters == ()
    short = WheelLog(T[:100], WheelStates(log.states.speed[:100]))
    assert check_vehicle(short, Rolling.differential(0.4)).parameters == ()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (np.degrees, "57 times that of the wheels: it is in degrees per second"),
        (np.negative, "sign opposite to that of the wheels"),
        (lambda rate: np.random.default_rng(1).normal(0, 0.3, rate.size), "does not go with"),
    ],
)
def test_a_yaw_rate_that_contradicts_the_wheels_is_told(change, message, tmp_path):
    vehicle = Rolling.differential(0.4)
    log = drive(vehicle, AHEAD, RATE, 11)
    write_vehicle(tmp_path / "vehicle.yaml", vehicle)
    wrong = WheelLog(log.t, log.states, change(log.yaw_rate))
    write_wheel_log(tmp_path / "wheels.csv", wrong, vehicle)
    source = read_body_velocities(tmp_path / "wheels.csv", vehicle=tmp_path / "vehicle.yaml")
    assert any(message in note for note in source.notes), source.notes
    np.testing.assert_allclose(source.velocities.yaw_rate, RATE, atol=0.1)


def test_a_differential_drive_called_mecanum_is_told():
    vehicle = Rolling.differential(0.4, (0, 0), ("fl", "rl"), ("fr", "rr"))
    states = vehicle.wheel_states(AHEAD, RATE)
    fl, rl, fr, rr = states.speed.T
    log = WheelLog(T, WheelStates(np.stack([fl, fr, rl, rr], axis=1)))
    (advice,) = check_vehicle(log, Mecanum(0.3, 0.2)).advice
    assert "never went sideways" in advice
    wrong = Mecanum(0.3, 0.2).twist(log.states).yaw_rate
    np.testing.assert_allclose(RATE, wrong * 0.5 / 0.2, atol=1e-12)
    assert "2.50 times as fast" in advice


def test_the_turning_centre_of_a_car_seen_from_elsewhere(tmp_path):
    x = -0.35
    car = VelocitySeries(T, np.column_stack([AHEAD[:, 0], -x * RATE, 0 * T]), RATE)
    assert turning_centre(car) == pytest.approx(x)
    write_velocities(tmp_path / "v.csv", car)
    notes = read_body_velocities(tmp_path / "v.csv").notes
    assert any("turns about a point 0.35 m behind the origin" in note for note in notes), notes
    strafing = VelocitySeries(T, np.column_stack([AROUND, 0 * T]), RATE)
    assert turning_centre(strafing) is None
    assert turning_centre(VelocitySeries(T, car.v)) is None
    assert turning_centre(VelocitySeries(T, 0 * car.v, RATE)) is None


def test_what_is_no_log_is_refused():
    with pytest.raises(InputError, match="wheel_log must be WheelLog"):
        check_vehicle("log", SWERVE)

"""Wheels that contradict each other: judged by their speed, told, counted, refused."""

import numpy as np
import pytest

from data_tools.logs.series_files import read_velocities, write_velocities
from evcalib.alignment import align
from evcalib.errors import InputError
from evcalib.kinematics import (
    Mecanum,
    Swerve,
    Wheel,
    WheelLog,
    WheelStates,
    body_velocities,
)
from evcalib.series import HeadingSeries, VelocitySeries

CORNERS = [("fl", 0.3, 0.25), ("fr", 0.3, -0.25), ("rl", -0.3, 0.25), ("rr", -0.3, -0.25)]
SWERVE = Swerve(tuple(Wheel(*corner) for corner in CORNERS))
T = np.arange(0.0, 12.0, 0.05)
COURSE = 0.9 * np.sin(2 * np.pi * T / 5)
V = 0.6 * np.column_stack([np.cos(COURSE), np.sin(COURSE)])
YAW = 0.1 * np.sin(T)


def log(change=lambda speed, steer: (speed, steer), vehicle=SWERVE):
    states = vehicle.wheel_states(V, YAW)
    return WheelLog(T, WheelStates(*change(states.speed, states.steer)))


def test_sound_wheels_have_no_slip():
    body = body_velocities(log(), SWERVE)
    assert body.slip_share < 1e-12
    assert body.velocities.direction_sd == 0
    assert "contradict" not in body.summary()
    assert body.wheel_speed == pytest.approx(0.6, abs=0.01)


@pytest.mark.parametrize(
    "change",
    [
        lambda speed, steer: (speed, np.degrees(steer)),
        lambda speed, steer: (speed, steer + [0.5, 1.7, -2.1, 0.9]),
        lambda speed, steer: (speed * [1, -1, 1, -1], steer),
    ],
)
def test_wheels_that_no_rigid_body_has_are_refused_with_likely_causes(change):
    with pytest.raises(InputError, match=r"wheels contradict each other: .* of their speed") as no:
        body_velocities(log(change), SWERVE)
    for cause in ("degrees", "steering zero", "another order", "mecanum rollers"):
        assert cause in str(no.value)


def test_standing_still_is_no_contradiction_and_the_average_is_judged_by_the_fit():
    zero = np.zeros((5, 4))
    assert body_velocities(WheelLog(T[:5], WheelStates(zero, zero)), SWERVE).slip_share == 0
    spinning = Swerve(SWERVE.wheels, "average")
    states = spinning.wheel_states(0 * V, np.ones(T.size))
    assert body_velocities(WheelLog(T, states), spinning).slip_share < 1e-12


def test_exchanged_mecanum_wheels_are_refused():
    mecanum = Mecanum(0.3, 0.2)
    speed = mecanum.wheel_states(V, YAW).speed
    assert body_velocities(WheelLog(T, WheelStates(speed)), mecanum).slip_share < 1e-12
    with pytest.raises(InputError, match="contradict"):
        body_velocities(WheelLog(T, WheelStates(speed * [1, 1, 1, -1])), mecanum)


def test_between_a_tenth_and_a_third_is_told_and_widens_the_answer(tmp_path):
    """Zeros that lean to one side: the common part turns the answer, the rest shows as slip."""
    zeros = np.array([0.55, 0.0, 0.1, 0.25])
    body = body_velocities(log(lambda speed, steer: (speed, steer + zeros)), SWERVE)
    assert 0.1 < body.slip_share < 1 / 3
    assert body.velocities.direction_sd == body.slip_share
    assert "contradict each other by" in body.summary()
    write_velocities(tmp_path / "v.csv", body.velocities)
    told = read_velocities(tmp_path / "v.csv")
    assert told.direction_sd == pytest.approx(body.slip_share, rel=1e-12)

    R = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    true = np.column_stack([np.cos(COURSE), np.sin(COURSE), 0 * T])
    noise = np.random.default_rng(1).normal(0, 0.02, true.shape)
    seen = (true + noise) @ R
    headings = HeadingSeries(T, seen / np.linalg.norm(seen, axis=1, keepdims=True))
    found = align(headings, told)
    error = np.arccos((np.trace(found.R_body_cam @ R.T) - 1) / 2)
    assert np.radians(5) < error < found.rotation_radius
    assert "directions may be off" in found.verdict.doubts[0]
    plain = align(headings, VelocitySeries(told.t, told.v, told.yaw_rate))
    assert plain.rotation_radius < np.radians(2)
    assert plain.verdict.doubts == ()


def test_a_yaw_rate_in_degrees_is_refused():
    with pytest.raises(InputError, match=r"yaw rate of 30 rad/s.* degrees per second\? .*deg/s"):
        VelocitySeries([0, 1], [[1, 0, 0], [1, 0, 0]], [0.0, -30.0])


def test_lengths_in_millimetres_are_refused():
    with pytest.raises(InputError, match=r"wheel a is 300 m from .* in\s+metres"):
        Wheel("a", 300, 250)
    with pytest.raises(InputError, match=r"half_width is 200 m from"):
        Mecanum(0.3, 200)

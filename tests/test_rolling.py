"""Vehicles whose wheels do not slide sideways: textbooks, a moving body, round trips, refusals."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.logs.vehicle_files import read_vehicle, write_vehicle
from data_tools.logs.wheel_logs import read_wheel_log, wanted_columns, write_wheel_log
from evcalib.errors import InputError
from evcalib.kinematics import (
    Mecanum,
    Rolling,
    RollingWheel,
    WheelLog,
    WheelStates,
    body_velocities,
)
from evcalib.plots.kinematics import motion_figure

AXLE = (-0.3, 0.05)
VEHICLES = {
    "differential": Rolling.differential(0.4),
    "four wheels": Rolling.differential(0.4, AXLE, ("fl", "rl"), ("fr", "rr")),
    "skid": Rolling.skid_steer((0.35, -0.30), -0.02),
    "bicycle": Rolling.bicycle(1.1, AXLE),
    "ackermann": Rolling.ackermann(0.6, 0.4, AXLE),
    "tricycle": Rolling.tricycle(0.9, AXLE),
    "steered behind": Rolling(
        (RollingWheel("axle", 0.5, 0.1), RollingWheel("rear", -0.4, 0.0, speed=False, steer=True))
    ),
}


def axle_x(vehicle):
    return next(wheel.x for wheel in vehicle.wheels if not wheel.steer)


def motion(vehicle, n=60, seed=0):
    """Return twists that the vehicle can do, without turning in place."""
    rng = np.random.default_rng(seed)
    ahead, rate = rng.uniform(0.2, 2, n) * rng.choice([-1, 1], n), rng.uniform(-1, 1, n)
    return np.stack([ahead, -axle_x(vehicle) * rate], axis=1), rate


@pytest.mark.parametrize("name", VEHICLES)
def test_wheel_states_and_back_give_the_same_twist_without_slip(name):
    vehicle = VEHICLES[name]
    v, rate = motion(vehicle)
    twist = vehicle.twist(vehicle.wheel_states(v, rate))
    np.testing.assert_allclose(twist.v, v, atol=1e-12)
    np.testing.assert_allclose(twist.yaw_rate, rate, atol=1e-12)
    assert twist.slip.max() < 1e-12


def test_a_differential_drive_is_the_printed_one():
    """Siegwart & Nourbakhsh 3.2.2: v = r (right + left) / 2, omega = r (right - left) / (2 l)."""
    left, right = np.random.default_rng(1).uniform(-1, 1, (2, 20))
    twist = Rolling.differential(0.4).twist(WheelStates(np.stack([left, right], axis=1)))
    np.testing.assert_allclose(twist.v[:, 0], (left + right) / 2, atol=1e-15)
    np.testing.assert_allclose(twist.v[:, 1], 0, atol=1e-15)
    np.testing.assert_allclose(twist.yaw_rate, (right - left) / 0.4, atol=1e-14)


def test_a_skid_steer_vehicle_is_the_printed_one():
    """Mandow et al. 2007: the motion from the speeds of the tracks and three coordinates."""
    left, right = np.random.default_rng(2).uniform(-1, 1, (2, 20))
    y_left, y_right, x = 0.5, -0.4, 0.1
    twist = Rolling.skid_steer((y_left, y_right), x).twist(
        WheelStates(np.stack([left, right], axis=1))
    )
    width = y_left - y_right
    np.testing.assert_allclose(twist.v[:, 0], (right * y_left - left * y_right) / width)
    np.testing.assert_allclose(twist.v[:, 1], (left - right) * x / width, atol=1e-15)
    np.testing.assert_allclose(twist.yaw_rate, (right - left) / width)


def test_a_bicycle_turns_about_the_point_that_its_steering_gives():
    """omega = v tan(angle) / wheelbase, the usual kinematic car."""
    speed, angle = np.array([[0.5], [-1.0], [2.0]]), np.radians([[20.0], [-35.0], [0.0]])
    twist = Rolling.bicycle(2.6).twist(WheelStates(speed, angle))
    np.testing.assert_allclose(twist.yaw_rate, speed[:, 0] * np.tan(angle[:, 0]) / 2.6, atol=1e-12)
    np.testing.assert_allclose(twist.v, np.column_stack([speed, 0 * speed]), atol=1e-12)


def test_ackermann_angles_differ_as_their_cotangents_say():
    """cot(outer) - cot(inner) = track / wheelbase."""
    states = VEHICLES["ackermann"].wheel_states([[1.0, 0.3 * 0.5]], [0.5])
    inner, outer = states.steer[0]
    assert 1 / math.tan(outer) - 1 / math.tan(inner) == pytest.approx(0.4 / 0.6)
    # The track lies about y = 0.05, and so does the turning circle of 1 / 0.5 m.
    np.testing.assert_allclose(states.speed[0], [1 - 0.5 * 0.25, 1 + 0.5 * 0.15])


def test_a_tricycle_steered_across_turns_in_place():
    states = WheelStates([[0.9]], [[np.pi / 2]])
    twist = Rolling.tricycle(0.9).twist(states)
    np.testing.assert_allclose([*twist.v[0], twist.yaw_rate[0]], [0, 0, 1], atol=1e-12)
    again = Rolling.tricycle(0.9).wheel_states([[0.0, 0.0]], [1.0])
    np.testing.assert_allclose([again.speed[0, 0], again.steer[0, 0]], [0.9, np.pi / 2])


def test_the_axle_says_where_the_origin_is():
    """The same wheels, another origin: its velocity is v + omega x r of the first one."""
    states = VEHICLES["differential"].wheel_states([[0.5, 0.0]], [0.8])
    moved = Rolling.differential(0.4, AXLE).twist(states)
    np.testing.assert_allclose(moved.v[0], [0.5 + 0.8 * 0.05, 0.8 * 0.3])
    assert moved.yaw_rate[0] == pytest.approx(0.8)


def test_redundant_wheels_show_slip_by_hand():
    """Of an error e in one of four wheels of a differential drive half stays: its side's other."""
    vehicle = VEHICLES["four wheels"]
    states = vehicle.wheel_states([[1.0, 0.0]], [0.0])
    states.speed[0, 0] += 0.2
    # fl and rl read 1.2 and 1: their mean fits, what is left is +-0.1 of four wheels.
    assert vehicle.twist(states).slip[0] == pytest.approx(math.sqrt(2 * 0.1**2 / 4))
    two = WheelStates([[0.3, -7.0]])
    assert VEHICLES["differential"].twist(two).slip[0] == pytest.approx(0, abs=1e-12)


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.booleans()), min_size=2, max_size=6),
    st.floats(-3, 3),
    st.floats(-2, 2),
)
def test_any_wheels_on_one_axle_and_any_that_steer_round_trip(places, ahead, rate):
    wheels = [RollingWheel("axle", 0.0, 0.0)] + [
        RollingWheel(f"w{k}", x if steer else 0.0, y, steer=steer)
        for k, (x, y, steer) in enumerate(places)
    ]
    points = np.array([(w.x, w.y) for w in wheels])
    if np.linalg.norm(points[:, None] - points, axis=2).max() < 0.1:
        return
    vehicle = Rolling(tuple(wheels))
    states = vehicle.wheel_states([[ahead, 0.0]], [rate])
    try:
        twist = vehicle.twist(states)
    except InputError:
        return
    if np.abs(states.speed).max() < 1e-6:
        return
    np.testing.assert_allclose([*twist.v[0], twist.yaw_rate[0]], [ahead, 0, rate], atol=1e-6)


@pytest.mark.parametrize("name", VEHICLES)
def test_files_and_logs_of_every_vehicle_round_trip_and_are_drawn(name, tmp_path):
    vehicle = VEHICLES[name]
    write_vehicle(tmp_path / "vehicle.yaml", vehicle)
    assert read_vehicle(tmp_path / "vehicle.yaml") == vehicle
    v, rate = motion(vehicle)
    log = WheelLog(0.1 * np.arange(len(v)), vehicle.wheel_states(v, rate), rate)
    write_wheel_log(tmp_path / "wheels.csv", log, vehicle)
    again = read_wheel_log(tmp_path / "wheels.csv", vehicle)
    np.testing.assert_array_equal(again.states.speed, log.states.speed)
    np.testing.assert_array_equal(again.yaw_rate, rate)
    body = body_velocities(again, vehicle)
    np.testing.assert_allclose(body.velocities.v[:, :2], v, atol=1e-12)
    assert len(motion_figure(body.velocities, vehicle, again.states).axes) == 2


@pytest.mark.parametrize(
    ("text", "want"),
    [
        ("type: differential\ntrack: 0.4", VEHICLES["differential"]),
        (
            "type: differential\ntrack: 0.4\naxle: {x: -0.3, y: 0.05}\n"
            "left_wheels: [fl, rl]\nright_wheels: [fr, rr]",
            VEHICLES["four wheels"],
        ),
        ("type: skid_steer\ncentres: {left: 0.35, right: -0.30, x: -0.02}", VEHICLES["skid"]),
        ("type: bicycle\nwheelbase: 1.1\naxle: {x: -0.3, y: 0.05}", VEHICLES["bicycle"]),
        (
            "type: ackermann\nwheelbase: 0.6\ntrack: 0.4\naxle: {x: -0.3, y: 0.05}",
            VEHICLES["ackermann"],
        ),
        ("type: tricycle\nwheelbase: 0.9\naxle: {x: -0.3, y: 0.05}", VEHICLES["tricycle"]),
        (
            "type: rolling\nwheels:\n  axle: {x: 0.5, y: 0.1}\n"
            "  rear: {x: -0.4, y: 0, speed: false, steer: true}",
            VEHICLES["steered behind"],
        ),
    ],
)
def test_the_types_of_vehicle_files(text, want, tmp_path):
    path = tmp_path / "vehicle.yaml"
    path.write_text(text + "\n")
    assert read_vehicle(path) == want


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("type: differential", "a differential vehicle needs track"),
        ("type: differential\ntrack: 400", "track is 400 m from the body's origin, over 20 m"),
        ("type: differential\ntrack: 0.0004", "track is 0.0004 m, under 0.02 m; are lengths in"),
        ("type: bicycle\nwheelbase: 0.015", "wheelbase is 0.015 m, under 0.02 m; are lengths in m"),
        ("type: tricycle\nwheelbase: 1200", "are lengths in metres (not millimetres)?"),
        ("type: ackermann\nwheelbase: 0.6", "an ackermann vehicle needs track"),
        ("type: mecanum\nwheelbase: 0.01\ntrack: 0.4", "half_length is 0.005 m, under 0.01 m"),
        ("type: skid_steer\ncentres: 0.4", "centres must be like {left: 0.3"),
        ("type: skid_steer\ncentres: {left: 0.4}", "the centres needs right"),
        ("type: skid_steer\ncentres: {left: -0.4, right: 0.4}", "must lie to the left of"),
        ("type: bicycle\nwheelbase: 1\naxle: 3", "the axle must hold x, y, not 3"),
        ("type: bicycle\nwheelbase: 1\naxle: {x: 300, y: 0}", "wheel rear is 300 m from"),
        ("type: differential\ntrack: 1\nleft_wheels: fl", "left_wheels must be a list of names"),
        ("type: rolling\nwheels: {a: {x: 0, y: 1, speed: 3}}", "speed of wheel a must be true or"),
        ("type: rolling\nwheels: {a: {x: 0}}", "wheel a needs y"),
        (
            "type: rolling\nwheels: {a: {x: 0, y: 1, speed: false}, b: {x: 0, y: 2, speed: false}}",
            "no wheel tells its speed",
        ),
        (
            "type: rolling\nwheels: {a: {x: 0, y: 1}, b: {x: 3, y: 1}}",
            "wheels that do not steer stand at x = 0 and 3 m: the vehicle could not turn; a",
        ),
        ("type: swerve\nwheels: {a: {x: 0, y: 0}, b: {x: 0.01, y: 0}}", "between two wheels is"),
    ],
)
def test_refused_files(text, message, tmp_path):
    path = tmp_path / "vehicle.yaml"
    path.write_text(text + "\n")
    with pytest.raises(InputError, match=r"vehicle\.yaml") as refusal:
        read_vehicle(path)
    assert message in str(refusal.value), str(refusal.value)


def test_motions_that_the_vehicle_cannot_do_are_refused():
    with pytest.raises(InputError, match=r"row 1: wheel left would slide sideways at 0\.2 m/s"):
        Rolling.differential(0.4).wheel_states([[1, 0], [1, 0.2]], [0, 0])


def test_a_car_steered_across_its_wheels_is_refused_while_it_moves():
    car = Rolling.bicycle(1.0)
    states = WheelStates([[0.0], [1.0]], [[np.pi / 2], [np.pi / 2]])
    with pytest.raises(InputError, match=r"row 1: .*steering angles in radians"):
        car.twist(states)
    standing = car.twist(WheelStates([[0.0]], [[np.pi / 2]]))
    np.testing.assert_allclose([*standing.v[0], standing.yaw_rate[0]], 0, atol=1e-12)


def test_the_log_of_another_vehicle_is_told(tmp_path):
    path = tmp_path / "wheels.csv"
    path.write_text("t,speed_left,speed_right\n0,1,1\n1,1,1\n")
    with pytest.raises(InputError, match=r"another type of vehicle \(differential, skid_steer\)"):
        read_wheel_log(path, Rolling.bicycle(1.0))
    path.write_text("t,speed_rl,speed_rr,steer_fl,steer_fr\n0,1,1,0,0\n1,1,1,0,0\n")
    with pytest.raises(InputError, match=r"another type of vehicle \(ackermann\)"):
        read_wheel_log(path, Rolling.differential(1.0))
    path.write_text("t,speed_a,speed_b,speed_c\n0,1,1,0\n1,1,1,0\n")
    with pytest.raises(InputError, match=r"type of vehicle \(mecanum, .*omni\)\? say so"):
        read_wheel_log(path, Rolling.tricycle(1.0))
    path.write_text("t,speed_a,steer_a,speed_b,steer_b\n0,1,0,1,0\n1,1,0,1,0\n")
    with pytest.raises(InputError, match=r"another type of vehicle \(swerve\)"):
        read_wheel_log(path, Rolling.differential(1.0))
    assert wanted_columns(VEHICLES["ackermann"]) == (
        "t", "speed_rl", "speed_rr", "steer_fl", "steer_fr",
    )  # fmt: skip


def test_a_differential_drive_does_not_strafe_as_a_mecanum_vehicle_does():
    t = np.arange(0.0, 10.0, 0.05)
    v = np.stack([np.cos(t), np.sin(t)], axis=1)
    log = WheelLog(t, Mecanum(0.2, 0.2).wheel_states(v, 0 * t))
    with pytest.raises(InputError, match=r"contradict each other.*another type of vehicle"):
        body_velocities(log, Rolling.differential(0.4, (0, 0), ("fl", "rl"), ("fr", "rr")))

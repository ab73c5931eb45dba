"""Kinematics against textbook formulas, a moving rigid body, another solver, and round trips."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from evcalib.errors import InputError
from evcalib.kinematics import (
    Mecanum,
    Omni,
    OmniWheel,
    Swerve,
    Wheel,
    WheelLog,
    WheelStates,
    body_velocities,
)

CORNERS = (
    Wheel("fl", 0.30, 0.25),
    Wheel("fr", 0.30, -0.25),
    Wheel("rl", -0.30, 0.25),
    Wheel("rr", -0.30, -0.25),
)
ODD = (Wheel("a", 0.4, 0.1), Wheel("b", -0.2, 0.5), Wheel("c", -0.1, -0.3))
KIWI = Omni(
    tuple(
        OmniWheel(name, 0.2 * math.cos(a), 0.2 * math.sin(a), a + math.pi / 2)
        for name, a in zip("abc", (0.0, 2 * math.pi / 3, 4 * math.pi / 3), strict=True)
    )
)
VEHICLES = [Swerve(CORNERS), Swerve(ODD), Swerve(ODD[:2]), Mecanum(0.25, 0.20), KIWI]

speeds = st.floats(-5, 5)
angles = st.floats(-math.pi, math.pi)
positions = st.floats(-2, 2)


def random_twists(n=50, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-2, 2, (n, 2)), rng.uniform(-3, 3, n)


# Round trips ------------------------------------------------------------------------------------


@pytest.mark.parametrize("vehicle", VEHICLES, ids=repr)
def test_wheel_states_and_back_give_the_same_twist_without_slip(vehicle):
    v, yaw_rate = random_twists()
    twist = vehicle.twist(vehicle.wheel_states(v, yaw_rate))
    np.testing.assert_allclose(twist.v, v, atol=1e-12)
    np.testing.assert_allclose(twist.yaw_rate, yaw_rate, atol=1e-12)
    assert twist.slip.max() < 1e-12


@settings(deadline=None)
@given(st.lists(st.tuples(positions, positions), min_size=2, max_size=8), speeds, speeds, speeds)
def test_swerve_of_any_placement_round_trips_or_is_refused(places, vx, vy, omega):
    wheels = [Wheel(f"w{i}", x, y) for i, (x, y) in enumerate(places)]
    points = np.array(places)
    spread = np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean())
    if np.linalg.norm(points[:, None] - points, axis=2).max() < 0.02:
        with pytest.raises(InputError, match=r"same place|in metres"):
            Swerve(wheels)
        return
    vehicle = Swerve(wheels)
    twist = vehicle.twist(vehicle.wheel_states([[vx, vy]], [omega]))
    np.testing.assert_allclose(
        [*twist.v[0], twist.yaw_rate[0]], [vx, vy, omega], atol=1e-10 / spread
    )


@settings(deadline=None)
@given(st.lists(st.tuples(positions, positions, angles), min_size=3, max_size=8), speeds, speeds)
def test_omni_of_any_placement_round_trips_or_is_refused(places, vx, omega):
    wheels = [OmniWheel(f"w{i}", *place) for i, place in enumerate(places)]
    condition = np.linalg.cond([[rim_speed(w, w.drive, 0.0, e) for e in np.eye(3)] for w in wheels])
    if condition > 1e6:
        with pytest.raises(InputError, match="not observable"):
            Omni(wheels)
    if condition < 50:
        vehicle = Omni(wheels)
        twist = vehicle.twist(vehicle.wheel_states([[vx, 0.5]], [omega]))
        np.testing.assert_allclose([*twist.v[0], twist.yaw_rate[0]], [vx, 0.5, omega], atol=1e-9)


# Closed forms and textbooks ---------------------------------------------------------------------


def test_swerve_spin_points_every_wheel_across_its_radius():
    states = Swerve(CORNERS).wheel_states([[0, 0]], [2.0])
    radius = math.hypot(0.30, 0.25)
    np.testing.assert_allclose(states.speed, 2.0 * radius)
    across = [math.atan2(w.y, w.x) + math.pi / 2 for w in CORNERS]
    np.testing.assert_allclose(np.cos(states.steer[0] - across), 1.0)


def test_swerve_translation_gives_all_wheels_the_body_velocity():
    states = Swerve(ODD).wheel_states([[-1.0, 1.0]], [0.0])
    np.testing.assert_allclose(states.speed, math.sqrt(2))
    np.testing.assert_allclose(states.steer, 3 * math.pi / 4)


def test_swerve_is_ackermann_when_the_rear_axle_rolls_straight():
    """With the centre of rotation on the rear axle at (-L/2, R): tan(steer) = L / (R -+ w)."""
    length, width, radius, omega = 0.60, 0.25, 3.0, 0.4
    v = [[omega * radius, omega * length / 2]]
    fl, fr, rl, rr = Swerve(CORNERS).wheel_states(v, [omega]).steer[0]
    np.testing.assert_allclose(math.tan(fl), length / (radius - width))
    np.testing.assert_allclose(math.tan(fr), length / (radius + width))
    np.testing.assert_allclose([rl, rr], 0, atol=1e-15)
    cotangents = 1 / math.tan(fr) - 1 / math.tan(fl)
    np.testing.assert_allclose(cotangents, 2 * width / length)


def test_contact_velocities_are_those_of_a_body_moved_a_little():
    """The wheels of a body that follows exp(twist t) move, in its frame, as the wheels say."""
    (vx, vy, omega), dt = (0.7, -0.4, 1.3), 1e-6

    def pose(t):
        s, c = math.sin(omega * t), math.cos(omega * t)
        arc = np.array([[s, -(1 - c)], [1 - c, s]]) / omega
        return np.array([[c, -s], [s, c]]), arc @ [vx, vy]

    (r1, p1), (r0, p0) = pose(dt), pose(-dt)
    points = np.array([(w.x, w.y) for w in ODD])
    moved = ((points @ r1.T + p1) - (points @ r0.T + p0)) / (2 * dt)
    states = Swerve(ODD).wheel_states([[vx, vy]], [omega])
    said = states.speed[0][:, None] * np.stack([np.cos(states.steer), np.sin(states.steer)], -1)[0]
    np.testing.assert_allclose(said, moved, atol=1e-9)


@pytest.mark.parametrize(
    ("twist", "fl", "fr", "rl", "rr"),
    [
        ((1, 0, 0), 1, 1, 1, 1),
        ((0, 1, 0), -1, 1, 1, -1),
        ((0, 0, 1), -0.45, 0.45, -0.45, 0.45),
        ((1, 1, 0), 0, 2, 2, 0),
    ],
)
def test_mecanum_by_hand(twist, fl, fr, rl, rr):
    states = Mecanum(0.25, 0.20).wheel_states([twist[:2]], [twist[2]])
    np.testing.assert_allclose(states.speed, [[fl, fr, rl, rr]])


def rim_speed(wheel, drive, roller, twist):
    """Return the rim speed by Siegwart & Nourbakhsh's constraint of the Swedish wheel.

    sin(a + b + g) x' - cos(a + b + g) y' - l cos(b + g) w = s cos(g), the wheel at polar
    coordinates (l, a), its axle at angle b against the radius, its rollers turned by g.
    """
    length, alpha = math.hypot(wheel.x, wheel.y), math.atan2(wheel.y, wheel.x)
    beta = drive + math.pi / 2 - alpha
    angle = alpha + beta + roller
    row = [math.sin(angle), -math.cos(angle), -length * math.cos(beta + roller)]
    return np.dot(row, twist) / math.cos(roller)


@pytest.mark.parametrize("seed", range(5))
def test_omni_matches_the_swedish_wheel_constraint(seed):
    rng = np.random.default_rng(seed)
    v, yaw_rate = random_twists(1, seed)
    wheels = [OmniWheel(f"w{i}", *rng.uniform(-1, 1, 2), rng.uniform(-3, 3)) for i in range(4)]
    want = [rim_speed(w, w.drive, 0.0, [*v[0], yaw_rate[0]]) for w in wheels]
    np.testing.assert_allclose(Omni(wheels).wheel_states(v, yaw_rate).speed[0], want, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_mecanum_matches_the_swedish_wheel_constraint(seed):
    """Seen from above the upper rollers form an X; those on the ground lie mirrored."""
    v, yaw_rate = random_twists(1, seed)
    vehicle = Mecanum(0.25, 0.20)
    rollers = [-math.pi / 4, math.pi / 4, math.pi / 4, -math.pi / 4]
    want = [
        rim_speed(w, 0.0, g, [*v[0], yaw_rate[0]])
        for w, g in zip(vehicle.wheels, rollers, strict=True)
    ]
    np.testing.assert_allclose(vehicle.wheel_states(v, yaw_rate).speed[0], want, atol=1e-12)


def test_kiwi_matrix_is_the_printed_one():
    """Lynch & Park, Modern Robotics, 13.2: three wheels at distance d, driving clockwise."""
    d = 0.2
    printed = np.array(
        [[1, 0, -d], [-1 / 2, -math.sqrt(3) / 2, -d], [-1 / 2, math.sqrt(3) / 2, -d]]
    )
    places = [math.pi / 2, -math.pi / 6, -5 * math.pi / 6]
    wheels = [
        OmniWheel(n, d * math.cos(a), d * math.sin(a), a - math.pi / 2)
        for n, a in zip("abc", places, strict=True)
    ]
    np.testing.assert_allclose(Omni(wheels).matrix, printed, atol=1e-15)


# Least squares, slip, ambiguities ---------------------------------------------------------------


@pytest.mark.parametrize("vehicle", [Swerve(CORNERS), Swerve(ODD)], ids=repr)
def test_swerve_equals_a_general_solver_on_noisy_wheels(vehicle):
    rng = np.random.default_rng(3)
    k = len(vehicle.wheels)
    speed, steer = rng.uniform(-2, 2, (1, k)), rng.uniform(-3, 3, (1, k))

    def misfit(p):
        rows = []
        for w, s, a in zip(vehicle.wheels, speed[0], steer[0], strict=True):
            rows += [s * math.cos(a) - (p[0] - p[2] * w.y), s * math.sin(a) - (p[1] + p[2] * w.x)]
        return rows

    other = least_squares(misfit, np.zeros(3), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    twist = vehicle.twist(WheelStates(speed, steer))
    np.testing.assert_allclose([*twist.v[0], twist.yaw_rate[0]], other.x, atol=1e-7)
    np.testing.assert_allclose(twist.slip[0], math.sqrt(2 * other.cost / k), rtol=1e-9)


def test_slip_of_one_wheel_on_ice_by_hand():
    """Of an error e in one of four symmetric wheels, e / 4 goes into v and nothing more for x."""
    vehicle = Swerve((Wheel("a", 1, 0), Wheel("b", 0, 1), Wheel("c", -1, 0), Wheel("d", 0, -1)))
    speed, steer = np.array([[1.4, 1.0, 1.0, 1.0]]), np.zeros((1, 4))
    twist = vehicle.twist(WheelStates(speed, steer))
    np.testing.assert_allclose(twist.v, [[1.1, 0]], atol=1e-15)
    np.testing.assert_allclose(twist.yaw_rate, 0, atol=1e-15)
    np.testing.assert_allclose(twist.slip, math.sqrt((0.3**2 + 3 * 0.1**2) / 4))


def test_mecanum_slip_is_a_quarter_of_the_closing_sum():
    speed = np.random.default_rng(1).uniform(-1, 1, (20, 4))
    fl, fr, rl, rr = speed.T
    twist = Mecanum(0.25, 0.20).twist(WheelStates(speed))
    np.testing.assert_allclose(twist.slip, np.abs(fl + fr - rl - rr) / 4)
    np.testing.assert_allclose(twist.v[:, 0], speed.mean(axis=1), atol=1e-15)
    np.testing.assert_allclose(twist.v[:, 1], (-fl + fr + rl - rr) / 4, atol=1e-15)
    np.testing.assert_allclose(twist.yaw_rate, (-fl + fr - rl + rr) / (4 * 0.45), atol=1e-14)


def test_three_omni_wheels_never_show_slip():
    speed = np.random.default_rng(1).uniform(-1, 1, (20, 3))
    assert KIWI.twist(WheelStates(speed)).slip.max() < 1e-14


@pytest.mark.parametrize("method", ["least_squares", "average"])
@settings(deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.01, 5), angles), min_size=4, max_size=4),
    st.lists(st.booleans(), min_size=4, max_size=4),
)
def test_a_wheel_that_runs_backwards_the_other_way_round_is_the_same(method, wheels, turned):
    vehicle = Swerve(CORNERS, method)
    speed, steer = np.array(wheels).T[:, None, :]
    other = WheelStates(np.where(turned, -speed, speed), steer + np.pi * np.array(turned))
    want, have = vehicle.twist(WheelStates(speed, steer)), vehicle.twist(other)
    resultant = abs(np.exp(1j * steer).mean())
    if method == "average" and resultant < 1e-6:
        return
    np.testing.assert_allclose(have.v, want.v, atol=1e-6)
    np.testing.assert_allclose(have.slip, want.slip, atol=1e-6)


# The paper's average ----------------------------------------------------------------------------


@settings(deadline=None)
@given(st.floats(0.01, 5), angles)
def test_average_of_equal_wheels_is_the_papers_formula_with_a_plus_sign(speed, angle):
    states = WheelStates(np.full((1, 4), speed), np.full((1, 4), angle))
    want = [speed * math.cos(angle), +speed * math.sin(angle)]
    np.testing.assert_allclose(Swerve(CORNERS, "average").twist(states).v[0], want, atol=1e-12)


def test_average_takes_angles_on_the_circle():
    steer = np.radians([[179.0, -179.0, 178.0, -178.0]])
    v = Swerve(CORNERS, "average").twist(WheelStates(np.ones((1, 4)), steer)).v
    np.testing.assert_allclose(v, [[-1, 0]], atol=1e-15)


def test_average_overstates_the_speed_of_a_turning_body_and_slip_says_so():
    states = Swerve(CORNERS).wheel_states([[1.0, 0.0]], [1.0])
    average, fit = (
        Swerve(CORNERS, method).twist(states) for method in ("average", "least_squares")
    )
    np.testing.assert_allclose(fit.v, [[1, 0]], atol=1e-12)
    np.testing.assert_allclose(average.yaw_rate, 1.0)
    assert average.v[0, 0] > 1.02
    np.testing.assert_allclose(average.slip, average.v[:, 0] - 1)


def test_average_of_a_spin_is_no_velocity_and_the_yaw_rate_explains_all():
    vehicle = Swerve(CORNERS, "average")
    twist = vehicle.twist(vehicle.wheel_states([[0, 0]], [1.0]))
    np.testing.assert_array_equal(twist.v, 0)
    np.testing.assert_allclose(twist.yaw_rate, 1.0)
    assert twist.slip[0] < 1e-12


# Refusals ---------------------------------------------------------------------------------------


def test_refused_wheels():
    on_circle = [(math.cos(a), math.sin(a), a) for a in (0.0, 2.0, 4.0)]
    with pytest.raises(InputError, match=r"same place, \(1.000, 2.000\) m"):
        Swerve((Wheel("a", 1, 2), Wheel("b", 1, 2)))
    with pytest.raises(InputError, match=r"turning about the point \(0.000, 0.000\) m"):
        Omni([OmniWheel(f"w{i}", *w) for i, w in enumerate(on_circle)])
    with pytest.raises(InputError, match=r"sliding at -?90 deg"):
        Omni([OmniWheel(f"w{i}", x, y, 0.0) for i, (x, y, _) in enumerate(on_circle)])
    with pytest.raises(InputError, match="at least 2 wheels"):
        Swerve(CORNERS[:1])
    with pytest.raises(InputError, match="at least 3 wheels"):
        Omni(KIWI.wheels[:2])
    with pytest.raises(InputError, match="fl is given twice"):
        Swerve(CORNERS + CORNERS[:1])
    with pytest.raises(InputError, match="must be OmniWheel"):
        Omni(CORNERS)
    with pytest.raises(InputError, match="x of wheel a must be a finite number, not nan"):
        Wheel("a", math.nan, 0)
    with pytest.raises(InputError, match="must be a word"):
        Wheel("front left", 0, 0)
    with pytest.raises(InputError, match="method must be one of"):
        Swerve(CORNERS, "mean")
    with pytest.raises(InputError, match="half_width must be a positive number"):
        Mecanum(0.2, 0)


def test_moving_the_origin_far_away_does_not_make_wheels_singular():
    far = Swerve([Wheel(w.name, w.x + 19, w.y - 15) for w in CORNERS])
    v, yaw_rate = random_twists()
    np.testing.assert_allclose(far.twist(far.wheel_states(v, yaw_rate)).v, v, atol=1e-6)


def test_refused_states():
    one = np.ones((2, 4))
    with pytest.raises(InputError, match="3 wheel speeds, but the wheels are fl, fr, rl, rr"):
        Swerve(CORNERS).twist(WheelStates(one[:, :3], one[:, :3]))
    with pytest.raises(InputError, match="swerve vehicle needs the steering angles"):
        Swerve(CORNERS).twist(WheelStates(one))
    with pytest.raises(InputError, match="mecanum vehicle has no steering angles"):
        Mecanum(1, 1).twist(WheelStates(one, one))
    with pytest.raises(InputError, match="steer must have shape"):
        WheelStates(one, one[:1])
    with pytest.raises(InputError, match="3 times but 2 rows"):
        WheelLog([0, 1, 2], WheelStates(one))
    with pytest.raises(InputError, match=r"yaw_rate must have shape \(2\)"):
        Mecanum(1, 1).wheel_states([[1, 0], [0, 1]], [1.0])


# The front door ---------------------------------------------------------------------------------


def drive_with_faults():
    """Return ten rows of straight driving: one wheel slips in row 2, row 5 and 6 turn fast."""
    vehicle = Swerve(CORNERS)
    yaw_rate = np.zeros(10)
    yaw_rate[5:7] = -1.0
    states = vehicle.wheel_states(np.tile([1.0, 0.2], (10, 1)), yaw_rate)
    states.speed[2, 0] += 0.4
    states.speed[6, 3] += 0.4
    return vehicle, WheelLog(0.02 * np.arange(10), states)


def test_body_velocities_of_a_log():
    vehicle, log = drive_with_faults()
    result = body_velocities(log, vehicle)
    assert (result.rows, result.removed, result.over_slip, result.over_yaw_rate) == (10, 0, 0, 0)
    assert result.velocities.frame == "body"
    np.testing.assert_array_equal(result.velocities.t, log.t)
    np.testing.assert_array_equal(result.velocities.v[:, 2], 0)
    np.testing.assert_allclose(result.velocities.v[5], [1.0, 0.2, 0.0], atol=1e-12)
    np.testing.assert_allclose(result.velocities.yaw_rate[5], -1.0)


def test_gates_remove_and_count_rows():
    vehicle, log = drive_with_faults()
    result = body_velocities(log, vehicle, max_slip=0.05, max_yaw_rate=0.5)
    kept = np.array([0, 1, 3, 4, 7, 8, 9])
    np.testing.assert_array_equal(result.velocities.t, log.t[kept])
    assert (result.over_slip, result.over_yaw_rate, result.removed) == (2, 2, 3)
    assert result.slip.shape == (7,)
    assert "7 of 10 rows kept (2 over the slip, 2 over the yaw-rate limit)" in result.summary()
    by_slip = body_velocities(log, vehicle, max_slip=0.05)
    assert (by_slip.removed, by_slip.over_yaw_rate) == (2, 0)


def test_gates_that_leave_nothing_or_mean_nothing_are_refused():
    vehicle, log = drive_with_faults()
    with pytest.raises(InputError, match="no wheel row is left of 10"):
        body_velocities(
            WheelLog(log.t, vehicle.wheel_states(np.ones((10, 2)), np.ones(10))),
            vehicle,
            max_yaw_rate=0.5,
        )
    with pytest.raises(InputError, match="max_slip must be a positive number of m/s"):
        body_velocities(log, vehicle, max_slip=-1)


def test_speeds_in_wrong_units_are_refused():
    vehicle = Mecanum(0.2, 0.2)
    with pytest.raises(InputError, match="400 m/s"):
        body_velocities(WheelLog([0.0, 0.1], WheelStates(np.full((2, 4), 400.0))), vehicle)


def test_a_wrong_type_is_told_with_what_makes_the_right_one():
    vehicle, log = drive_with_faults()
    with pytest.raises(InputError, match=r"wheel_log must be WheelLog, not str; .*read_wheel_log"):
        body_velocities("wheels.csv", vehicle)
    with pytest.raises(
        InputError, match="vehicle must be Swerve or Mecanum or Omni or Rolling, not"
    ):
        body_velocities(log, {"type": "mecanum"})


def test_vehicles_are_values():
    assert Swerve(CORNERS) == Swerve(list(CORNERS))
    assert hash(KIWI) == hash(Omni(KIWI.wheels))
    assert all(a != b for a, b in pairwise(VEHICLES))

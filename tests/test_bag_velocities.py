"""Velocities of bags: twists, odometry and joints, from every kind of bag."""

import numpy as np
import pytest
from bag_writing import DVS, KINDS, Maker

from data_tools.logs.velocity_sources import read_body_velocities
from data_tools.recordings import open_recording
from evcalib.errors import InputError
from evcalib.kinematics import Mecanum, Swerve, Wheel

START = 1_675_956_550_123_456_789
TIMES = [START + k * 20_000_000 for k in range(5)]
V = np.array([[1.0, 0.5, 0.1], [1.2, 0.4, 0.0], [0.9, -0.3, 0.0], [0.2, -0.1, 0.0], [0, 0, 0]])
YAW = np.array([0.0, 0.1, -0.2, 0.3, 0.0])
ORIGIN = START // 1_000_000_000 * 1_000_000
TWO = Swerve((Wheel("a", 0.5, 0.0), Wheel("b", -0.5, 0.0)))
JOINTS = {
    "speed_a": "a_drive",
    "steer_a": {"column": "a_turn", "unit": "rad"},  # of several turns
    "speed_b": "b_drive",
    "steer_b": "b_turn",
}


def seconds(times):
    return (np.array(times) - 1000 * ORIGIN) / 1e9


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("form", ["twist_stamped", "odometry"])
def test_twists_are_read_exactly(tmp_path, kind, form):
    make = Maker(kind)
    rows = [
        (t + 7_000, getattr(make, form)(t, v.tolist(), float(w)))
        for t, v, w in zip(TIMES, V, YAW, strict=True)
    ]
    source = read_body_velocities(make.write(tmp_path, [("/odom", rows)]), origin_us=ORIGIN)
    np.testing.assert_array_equal(source.velocities.v, V)
    np.testing.assert_array_equal(source.velocities.yaw_rate, YAW)
    np.testing.assert_allclose(source.velocities.t, seconds(TIMES), atol=1e-9)
    assert source.notes[0].startswith("topic /odom (")
    assert "5 messages" in source.notes[0]


def joint_bag(folder, kind="sqlite3", change=None):
    """Write joint states of TWO, in an order of joints that changes, with others between."""
    make = Maker(kind)
    states = TWO.wheel_states(V[:, :2], YAW)
    rows = []
    for k, t in enumerate(TIMES):
        rows.append((t, make.joints(t, ["arm"], [1.0], [2.0])))
        names = ["a_drive", "a_turn", "b_turn", "b_drive"]
        position = [99.0, states.steer[k, 0] + 4 * np.pi, states.steer[k, 1], 98.0]
        velocity = [states.speed[k, 0] / 0.05, 0.0, 0.0, states.speed[k, 1] / 0.05]
        if k % 2:
            names, position, velocity = names[::-1], position[::-1], velocity[::-1]
        if change is not None:
            names, position, velocity = change(k, names, position, velocity)
        rows.append((t, make.joints(t, names, position, velocity)))
    return make.write(folder, [("/joint_states", rows)])


@pytest.mark.parametrize("kind", KINDS)
def test_joints_become_wheel_states(tmp_path, kind):
    path = joint_bag(tmp_path, kind)
    source = read_body_velocities(
        path, vehicle=TWO, columns=JOINTS, wheel_radius=0.05, origin_us=ORIGIN
    )
    np.testing.assert_allclose(source.velocities.v[:, :2], V[:, :2], atol=1e-12)
    np.testing.assert_allclose(source.velocities.yaw_rate, YAW, atol=1e-12)
    np.testing.assert_allclose(source.velocities.t, seconds(TIMES), atol=1e-9)
    assert source.wheels.rows == 5
    gated = read_body_velocities(
        path, vehicle=TWO, columns=JOINTS | {"wheel_radius": 0.05}, max_yaw_rate=0.15
    )
    assert (gated.wheels.removed, gated.wheels.over_yaw_rate) == (2, 2)


def test_joints_need_vehicle_map_radius_and_all_wheels(tmp_path):
    path = joint_bag(tmp_path)
    with pytest.raises(InputError, match=r"holds joints; say which vehicle \(--vehicle\), and"):
        read_body_velocities(path, vehicle=TWO)
    with pytest.raises(InputError, match="speed_a is in rad/s: give the wheel_radius"):
        read_body_velocities(path, vehicle=TWO, columns=JOINTS)
    renamed = JOINTS | {"steer_b": "c_turn"}
    with pytest.raises(InputError, match=r"lacks the joint\(s\) c_turn of the .* it has a_drive"):
        read_body_velocities(path, vehicle=TWO, columns=renamed, wheel_radius=1)
    with pytest.raises(InputError, match=r"map must name speed_a, .*, and names steer_a, steer_b"):
        read_body_velocities(path, vehicle=TWO, columns={"steer_a": "c", "steer_b": "d"})
    with pytest.raises(InputError, match=r"map must name speed_fl, .*, and names speed_a"):
        read_body_velocities(path, vehicle=Mecanum(1, 1), columns=JOINTS, wheel_radius=0.05)
    (tmp_path / "bare").mkdir()
    bare = joint_bag(tmp_path / "bare", change=lambda k, names, p, v: (names, p, []))
    with pytest.raises(InputError, match="message 1 of /joint_states has no velocity of the joi"):
        read_body_velocities(bare, vehicle=TWO, columns=JOINTS, wheel_radius=0.05)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0, 20, 10, 30, 5, 9], r"message 2: its time is 0\.010 s before that of the row before"),
        ([0, 20, 90_000, 90_020], r"message 2: its time is 89\.980 s after that of the row before"),
        ([0], "has 1 usable messages, two at least"),
    ],
)
def test_clocks_that_were_set_are_refused(tmp_path, times, message):
    make = Maker("mcap")
    rows = [
        (START + k, make.odometry(START + t * 1_000_000, [1.0, 0.0, 0.0], 0.0))
        for k, t in enumerate(times)
    ]
    path = make.write(tmp_path, [("/odom", rows)])
    with pytest.raises(InputError, match=message):
        read_body_velocities(path)


def test_missing_stamps_are_refused_and_repeated_ones_left_out(tmp_path):
    make = Maker("ros1")
    stamps = [TIMES[0], TIMES[1], TIMES[1], TIMES[2]]
    rows = [(t, make.odometry(t, [float(k), 0.0, 0.0], 0.0)) for k, t in enumerate(stamps)]
    source = read_body_velocities(make.write(tmp_path, [("/odom", rows)]), origin_us=ORIGIN)
    np.testing.assert_array_equal(source.velocities.v[:, 0], [0, 1, 3])
    assert source.notes[1].startswith("1 rows with the time of the row before were left out (the f")
    assert source.notes[1].endswith("message 2)")
    (tmp_path / "zero").mkdir()
    rows = [(t, make.odometry(0, [1.0, 0.0, 0.0], 0.0)) for t in TIMES]
    with pytest.raises(InputError, match="message 0 has no stamp"):
        read_body_velocities(make.write(tmp_path / "zero", [("/odom", rows)]))


def test_speeds_in_another_unit_are_refused(tmp_path):
    make = Maker("ros1")
    rows = [(t, make.odometry(t, [900.0, 0.0, 0.0], 0.0)) for t in TIMES]
    with pytest.raises(InputError, match=r"topic /odom: velocity row 0 has a speed of 900 m/s"):
        read_body_velocities(make.write(tmp_path, [("/odom", rows)]))


def test_events_and_wheels_of_one_bag_are_on_one_clock(tmp_path):
    make = Maker("mcap")
    arrays = [(t, make.array(DVS, [(1, 2, t, True)], 640, 480)) for t in TIMES]
    odometry = [(t, make.odometry(t, [1.0, 0.0, 0.0], 0.0)) for t in TIMES]
    path = make.write(tmp_path, [("/events", arrays), ("/odom", odometry)])
    with pytest.raises(InputError, match=r"/odom \(nav_msgs/msg/Odometry\) takes no column map"):
        read_body_velocities(path, columns=JOINTS, wheel_radius=1)
    recording = open_recording(path)
    source = read_body_velocities(path, origin_us=recording.origin_us)
    (piece,) = recording
    np.testing.assert_allclose(piece.t / 1e6, source.velocities.t, atol=1e-6)
    with pytest.raises(InputError, match="no topic /up of velocities, odometry or joints; it"):
        read_body_velocities(path, topic="/up")


def test_joints_of_several_messages_are_joined(tmp_path):
    """Steering comes 1 ms after the drives, so rows stand there; one steering message is lost."""
    make = Maker("sqlite3")
    states = TWO.wheel_states(V[:, :2], YAW)
    rows = []
    for k, t in enumerate(TIMES):
        drives = states.speed[k] / 0.05
        rows.append((t, make.joints(t, ["a_drive", "b_drive"], [], drives)))
        rows.append((t, make.joints(t + 10_000_000, ["arm"], [1.0], [])))
        late = t + 1_000_000
        if k != 1:
            rows.append((late, make.joints(late, ["a_turn", "b_turn"], states.steer[k], [])))
    path = make.write(tmp_path, [("/joint_states", sorted(rows, key=lambda row: row[0]))])
    source = read_body_velocities(
        path, vehicle=TWO, columns=JOINTS, wheel_radius=0.05, origin_us=ORIGIN
    )
    use = [0, 2, 3, 4]
    np.testing.assert_allclose(source.velocities.t, seconds(TIMES)[use] + 1e-3, atol=1e-9)
    np.testing.assert_allclose(source.velocities.v[:, :2], V[use, :2], atol=1e-12)
    assert "joints come in several messages: each row takes the latest" in source.notes[1]
    assert "up to 0.001 s old" in source.notes[1]


def test_joint_positions_may_be_counts_of_turns(tmp_path):
    make = Maker("mcap")
    times = [START + k * 20_000_000 for k in range(50)]
    speed = np.array([[0.4, 0.6]])
    turns = speed * 0.02 * np.arange(50)[:, None] / (2 * np.pi * 0.05)
    rows = [
        (t, make.joints(t, ["a_d", "a_t", "b_d", "b_t"], [turns[k, 0], 0.1, turns[k, 1], 0.1], []))
        for k, t in enumerate(times)
    ]
    path = make.write(tmp_path, [("/joint_states", rows)])
    columns = {"wheel_radius": 0.05, "steer_a": "a_t", "steer_b": "b_t"} | {
        f"speed_{name}": {"column": f"{name}_d", "unit": "turns"} for name in "ab"
    }
    source = read_body_velocities(path, vehicle=TWO, columns=columns, origin_us=ORIGIN)
    np.testing.assert_allclose(source.wheels.wheel_speed, np.sqrt(0.26), rtol=1e-9)
    np.testing.assert_allclose(source.velocities.t, seconds(times)[1:] - 0.01, atol=1e-6)
    degrees = [(t, make.joints(t, ["a_d", "a_t", "b_d", "b_t"], [0, 40, 0, 40], [])) for t in times]
    (tmp_path / "deg").mkdir()
    path = make.write(tmp_path / "deg", [("/joint_states", degrees)])
    with pytest.raises(InputError, match=r"steer_a is 40 rad, beyond 6\.283 rad; .*unit: deg"):
        read_body_velocities(path, vehicle=TWO, columns=columns)


def test_frames_of_twists_are_read_from_the_bag(tmp_path):
    make = Maker("ros1")
    stamped = [(t, make.twist_stamped(t, [1.0, 0.0, 0.0], 0.0)) for t in TIMES]
    for _, message in stamped:
        message.header.frame_id = "/map"
    path = make.write(tmp_path, [("/twist", stamped)])
    with pytest.raises(InputError, match=r"topic /twist: its twist is in 'map', the frame of the"):
        read_body_velocities(path)
    assert len(read_body_velocities(path, twist_frame="body").velocities) == 5

    quarter = 0.5 * np.sqrt(2.0)
    rows = [(t, make.odometry(t, [0.0, 1.0, 0.0], 0.0)) for t in TIMES]
    for k, (_, message) in enumerate(rows):
        message.child_frame_id = "odom"
        message.pose.pose.position.y = 0.02 * k
        message.pose.pose.orientation.z = message.pose.pose.orientation.w = quarter
    (tmp_path / "odom").mkdir()
    source = read_body_velocities(make.write(tmp_path / "odom", [("/odom", rows)]))
    np.testing.assert_allclose(source.velocities.v, np.tile([1.0, 0, 0], (5, 1)), atol=1e-12)
    assert "was turned by the pose" in source.notes[1]

    rows[2][1].child_frame_id = "other"
    (tmp_path / "two").mkdir()
    with pytest.raises(
        InputError, match=r"messages are of several frames \(odom in odom; other in"
    ):
        read_body_velocities(make.write(tmp_path / "two", [("/odom", rows)]))


def test_one_strange_stamp_and_one_twist_without_numbers_are_left_out(tmp_path):
    make = Maker("mcap")
    stamps = [START + k * 20_000_000 for k in range(30)]
    stamps[0] = 0
    stamps[7] += 3_600_000_000_000
    rows = [(START + k, make.odometry(t, [1.0, 0.0, 0.0], 0.0)) for k, t in enumerate(stamps)]
    rows[9][1].twist.twist.linear.x = float("nan")
    source = read_body_velocities(make.write(tmp_path, [("/odom", rows)]), origin_us=ORIGIN)
    kept = np.delete(np.array(stamps), [0, 7, 9])
    np.testing.assert_allclose(source.velocities.t, seconds(kept), atol=1e-9)
    assert source.notes[1].startswith("2 rows whose time is not between those of their neighbours")
    assert source.notes[2] == "1 messages whose twist is no finite number were left out"


@pytest.mark.parametrize(("name", "told"), [("/cmd_vel", True), ("/odom/twist", False)])
def test_a_topic_of_commands_is_told(tmp_path, name, told):
    make = Maker("sqlite3")
    rows = [(t, make.twist_stamped(t, (1.0, 0.0, 0.0), 0.0)) for t in TIMES]
    notes = read_body_velocities(make.write(tmp_path, [(name, rows)])).notes
    assert any("tells what was commanded, by its name" in note for note in notes) == told

"""Velocities from transforms of a bag: against a closed form, and against a real robot's twist."""

import numpy as np
import pytest
from bag_writing import KINDS, Maker, get_types_from_msg

from data_tools.logs.pose_velocities import velocities_of_poses
from data_tools.logs.velocity_sources import read_body_velocities
from evcalib.errors import InputError

START = 1_675_956_550_000_000_000
STEP = 20_000_000
SECONDS = 0.02 * np.arange(200)


def motion(t):
    """Return x, y, yaw of a body, and its velocity (vx, vy, yaw rate) in its own frame."""
    yaw = 0.8 * np.sin(0.9 * t)
    rate = 0.72 * np.cos(0.9 * t)
    world = (0.5 - 0.3 * np.sin(t)) + 1j * 0.4 * np.cos(t)
    x, y = 0.5 * t + 0.3 * np.cos(t), 0.4 * np.sin(t)
    body = world * np.exp(-1j * yaw)
    return x, y, yaw, np.column_stack([body.real, body.imag, rate])


def poses(t):
    x, y, yaw, _ = motion(t)
    zero = np.zeros_like(t)
    return np.column_stack([x, y, zero, zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)])


def test_velocities_are_those_of_the_body_in_the_middle_of_each_way():
    found = velocities_of_poses(SECONDS, poses(SECONDS))
    truth = motion(found.t)[3]
    np.testing.assert_allclose(found.v[:, :2], truth[:, :2], atol=2e-3)
    np.testing.assert_allclose(found.v[:, 2], 0, atol=1e-12)
    np.testing.assert_allclose(found.yaw_rate, truth[:, 2], atol=2e-3)
    np.testing.assert_allclose(found.t, SECONDS[: found.t.size] + 0.05)


def test_a_tilted_body_that_turns_about_its_own_axis_keeps_its_velocity():
    """Forward at 1 m/s and turning at 0.5 rad/s about its own z: a circle in a tilted plane."""
    from scipy.spatial.transform import Rotation

    tilt = Rotation.from_euler("y", 30, degrees=True)
    a = 0.5 * SECONDS
    circle = np.column_stack([np.sin(a), 1 - np.cos(a), 0 * a]) / 0.5
    turned = tilt * Rotation.from_rotvec(np.outer(a, [0, 0, 1]))
    found = velocities_of_poses(SECONDS, np.hstack([tilt.apply(circle), turned.as_quat()]))
    np.testing.assert_allclose(found.v, np.tile([1.0, 0, 0], (len(found), 1)), atol=2e-4)
    np.testing.assert_allclose(found.yaw_rate, 0.5, atol=1e-9)


def test_poses_that_are_published_again_and_again_count_once():
    """A pose of 10 Hz that is published at 50 Hz: as wanted, but for a stamp's step."""
    held = poses(SECONDS[np.arange(200) // 5 * 5])
    found = velocities_of_poses(SECONDS, held)
    np.testing.assert_allclose(found.v[:, :2], motion(found.t)[3][:, :2], atol=2e-3)
    held[100:] = held[100]
    found = velocities_of_poses(SECONDS, held)
    assert found.t[-1] > 3.9
    assert (found.v[found.t > 2.06] == 0).all()


def test_gaps_are_kept():
    keep = np.abs(SECONDS - 2) > 0.31
    found = velocities_of_poses(SECONDS[keep], poses(SECONDS[keep]))
    assert np.diff(found.t).max() > 0.5
    np.testing.assert_allclose(found.v[:, :2], motion(found.t)[3][:, :2], atol=2e-3)


def test_poses_that_are_none_are_refused():
    bad = poses(SECONDS)
    bad[7, 6] = 5
    with pytest.raises(InputError, match="pose 7 has no position, or no quaternion of length 1"):
        velocities_of_poses(SECONDS, bad)
    with pytest.raises(InputError, match=r"no two poses are within 0\.5 s"):
        velocities_of_poses(100 * SECONDS, poses(SECONDS))


def maker(kind, old=False):
    """Return a maker that knows transforms, which the library does for ROS 2 only."""
    make = Maker(kind)
    make.transforms = "tf/msg/tfMessage" if old else "tf2_msgs/msg/TFMessage"
    if make.transforms not in make.store.types:
        text = "geometry_msgs/TransformStamped[] transforms"
        make.store.register(get_types_from_msg(text, make.transforms))
    return make


def transforms(make, ns, edges):
    vector, turn = "geometry_msgs/msg/Vector3", "geometry_msgs/msg/Quaternion"
    return make.make(
        make.transforms,
        transforms=[
            make.make(
                "geometry_msgs/msg/TransformStamped",
                header=make.header(ns, parent),
                child_frame_id=child,
                transform=make.make(
                    "geometry_msgs/msg/Transform",
                    translation=make.make(vector, x=p[0], y=p[1], z=p[2]),
                    rotation=make.make(turn, x=p[3], y=p[4], z=p[5], w=p[6]),
                ),
            )
            for parent, child, p in edges
        ],
    )


STILL = [0.1, 0, 0, 0, 0, 0, 1.0]


def write(folder, kind="sqlite3", base="base_link", more=(), topics=(), old=False):
    """Write a bag whose transforms hold a base, a wheel, and a map that is corrected at times."""
    make = maker(kind, old)
    rows = []
    for k, pose in enumerate(poses(SECONDS).tolist()):
        edges = [("odom", base, pose), (base, "wheel", STILL), *((*e, pose) for e in more)]
        if k % 10 == 0:
            edges = [("map", "odom", [k, 0, 0, 0, 0, 0, 1.0]), *edges]
        ns = START + k * STEP
        rows.append((ns, transforms(make, ns, edges[::-1] if k % 2 else edges)))
    static = [(START, transforms(make, START, [(base, "cam", STILL)]))]
    return make.write(folder, [("/tf", rows), ("/tf_static", static), *topics])


@pytest.mark.parametrize(("kind", "old"), [*((kind, False) for kind in KINDS), ("ros1", True)])
def test_the_base_of_a_tree_of_transforms_is_found(tmp_path, kind, old):
    source = read_body_velocities(write(tmp_path, kind, old=old), origin_us=START // 1000)
    velocities = source.velocities
    truth = motion(velocities.t)[3]
    np.testing.assert_allclose(velocities.v[:, :2], truth[:, :2], atol=2e-3)
    np.testing.assert_allclose(velocities.yaw_rate, truth[:, 2], atol=2e-3)
    assert "velocities are those of base_link in odom, from its poses" in source.notes


def test_of_several_bases_one_is_named(tmp_path):
    path = write(tmp_path, base="r1/base_link", more=[("r2/odom", "r2/base_link")])
    with pytest.raises(InputError, match=r"r1/base_link, r2/base_link; name that of the body, as"):
        read_body_velocities(path)
    source = read_body_velocities(path, topic="/tf:r2/base_link")
    assert "velocities are those of r2/base_link in r2/odom, from its poses" in source.notes
    with pytest.raises(InputError, match=r"has no frame r3; it has odom, r1/base_link"):
        read_body_velocities(path, topic="tf:r3")


def test_a_tree_that_does_not_move_is_no_motion(tmp_path):
    make = maker("sqlite3")
    rows = [(START, transforms(make, START, [("body", "wheel", STILL)]))]
    path = make.write(tmp_path, [("/tf", rows)])
    with pytest.raises(InputError, match=r"has no frame that moves in odom or map; it has wheel"):
        read_body_velocities(path)


def test_a_topic_of_velocities_goes_before_transforms(tmp_path):
    make = Maker("sqlite3")
    twists = [
        (START + k * STEP, make.twist_stamped(START + k * STEP, (1.0, 0, 0), 0.0)) for k in range(9)
    ]
    path = write(tmp_path, topics=[("/twist", twists)])
    assert read_body_velocities(path).notes[0].startswith("topic /twist ")
    assert read_body_velocities(path, topic="/tf").notes[0].startswith("topic /tf ")


def test_the_transforms_of_a_real_robot_agree_with_its_twist(data):
    pytest.importorskip("rosbags")
    path = data / "wheels" / "evo_nav2_turtlebot.mcap"
    told = read_body_velocities(path, topic="/odom").velocities
    found = read_body_velocities(path, topic="/tf").velocities
    off = found.v[:, 0] - np.interp(found.t, told.t, told.v[:, 0])
    turn = found.yaw_rate - np.interp(found.t, told.t, told.yaw_rate)
    print(f"\n/tf against /odom: {100 * off.std():.2f} cm/s, {np.degrees(turn.std()):.2f} deg/s")
    assert off.std() < 0.005
    assert abs(off.mean()) < 0.001
    assert np.abs(found.v[:, 1]).max() < 0.005
    assert turn.std() < 0.01

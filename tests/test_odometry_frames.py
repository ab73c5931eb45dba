"""Twists in the frame of the ground, empty, or at odds with their pose."""

from dataclasses import replace

import numpy as np
import pytest

from data_tools.logs.odometry_frames import Twists, in_body
from evcalib.errors import InputError

T = np.arange(0.0, 10.0, 0.05)


def drive(start=1.5, turn=0.3):
    """Return velocities in the body and on the ground, and the pose, by fine integration."""
    fine = np.arange(0.0, 10.0, 0.001)
    yaw = start + turn * np.sin(fine)
    body = np.column_stack([0.5 + 0.2 * np.sin(2 * fine), 0.3 * np.cos(fine), 0 * fine])
    c, s = np.cos(yaw), np.sin(yaw)
    ground = np.column_stack(
        [c * body[:, 0] - s * body[:, 1], s * body[:, 0] + c * body[:, 1], 0 * fine]
    )
    place = np.cumsum(ground, axis=0) * 0.001 + [3.0, 4.0, 0.0]
    q = np.column_stack([0 * yaw, 0 * yaw, np.sin(yaw / 2), np.cos(yaw / 2)])
    rate = turn * np.cos(fine)
    return (x[::50] for x in (body, ground, place, q, rate))


BODY, GROUND, PLACE, TURN, RATE = drive()


def twists(v=BODY, frame="base_link", **more):
    fields = {"yaw_rate": RATE, "ground": "odom", "position": PLACE, "quaternion": TURN}
    return Twists(T, v, frame=frame, **{**fields, **more})


def test_a_twist_in_the_body_is_taken_as_it_is():
    v, rate, notes = in_body(twists())
    np.testing.assert_array_equal(v, BODY)
    np.testing.assert_array_equal(rate, RATE)
    assert notes == []


@pytest.mark.parametrize("frame", ["odom", "/odom", ""])
def test_a_twist_on_the_ground_is_turned_by_the_pose(frame):
    v, _, notes = in_body(twists(GROUND, frame))
    np.testing.assert_allclose(v, BODY, atol=1e-12)
    assert "was turned by the pose" in notes[0]


def test_a_message_that_contradicts_its_pose_is_refused_unless_it_is_said():
    with pytest.raises(InputError, match=r"contradict each other: .* say --twist-frame ground"):
        in_body(twists(GROUND))
    with pytest.raises(InputError, match=r"contradict each other: .* say --twist-frame body"):
        in_body(twists(BODY, "odom"))
    np.testing.assert_allclose(in_body(twists(GROUND), "ground")[0], BODY, atol=1e-12)
    np.testing.assert_array_equal(in_body(twists(GROUND), "body")[0], GROUND)
    with pytest.raises(InputError, match="twist_frame must be one of body, ground"):
        in_body(twists(), "odom")


def test_frames_that_cannot_be_told_apart_are_no_contradiction():
    v, _, notes = in_body(twists(ground="map", quaternion=np.tile([0.0, 0, 0, 1], (T.size, 1)),
                                 position=np.cumsum(BODY, axis=0) * 0.05))  # fmt: skip
    np.testing.assert_array_equal(v, BODY)
    assert notes == []


@pytest.mark.parametrize("frame", ["map", "odom", "robot1/odom", "/world", "local_origin"])
def test_a_stamped_twist_of_the_ground_is_refused(frame):
    with pytest.raises(InputError, match="the frame of the ground, and it has no pose to turn it"):
        in_body(Twists(T, GROUND, RATE, frame))
    assert in_body(Twists(T, GROUND, RATE, frame), "body")[0] is GROUND


def test_odometry_of_another_frame_of_the_ground_is_refused():
    with pytest.raises(InputError, match=r"'odom' \(child_frame_id\), the frame of the ground"):
        in_body(twists(BODY, "odom", ground="map"))


def test_zeros_beside_a_moving_pose_are_told():
    with pytest.raises(InputError, match="all 200 twists are zero while the pose moves by"):
        in_body(twists(0 * BODY))
    v, _, notes = in_body(twists(0 * BODY, position=0 * PLACE, yaw_rate=0 * RATE,
                                 quaternion=np.tile([0.0, 0, 0, 1], (T.size, 1))))  # fmt: skip
    assert not v.any()
    assert "could not be checked" in notes[0]


def test_other_contradictions_are_refused_or_told():
    with pytest.raises(InputError, match=r"in any frame: .* another unit, a swapped sign"):
        in_body(twists(1000 * BODY / 300))
    with pytest.raises(InputError, match="in any frame"):
        in_body(twists(BODY * [1, -1, 1]))
    assert "part by 20 %" in in_body(twists(1.2 * BODY))[2][0]
    still = twists(BODY, position=0 * PLACE + 7)
    assert "could not be checked" in in_body(still)[2][0]
    with pytest.raises(InputError, match="does not move along, cannot turn it"):
        in_body(replace(still, frame="odom"))
    assert "could not be checked" in in_body(twists(quaternion=0 * TURN))[2][0]


def test_yaw_rates_are_held_against_the_pose():
    with pytest.raises(InputError, match="57 times that of its pose: degrees per second"):
        in_body(twists(yaw_rate=np.degrees(RATE)))
    body, _, place, turn, rate = drive(turn=0.08)  # too little to judge a pose by, but by its form
    slow = {"position": place, "quaternion": turn}
    with pytest.raises(InputError, match="degrees per second in place of radians"):
        in_body(twists(body, yaw_rate=np.degrees(rate), **slow))
    assert in_body(twists(body, yaw_rate=rate, **slow))[2] == []
    noise = np.random.default_rng(2).normal(0, 1, T.size)
    assert in_body(twists(body, yaw_rate=noise, **slow))[2] == []
    _, rate, notes = in_body(twists(yaw_rate=0 * RATE))
    assert rate is None
    assert "taken to be unknown" in notes[0]
    assert "-1.00 times that of the pose" in in_body(twists(yaw_rate=-RATE))[2][0]

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from data_tools.logs.trajectory_files import read_tum, write_tum
from evcalib.errors import InputError
from evcalib.poses import PoseSeries

T = np.array([0.0, 1.0, 2.0, 3.0])
LINE = np.outer(T, [1.0, 2.0, 0.0])


def about_z(degrees):
    return Rotation.from_rotvec(np.outer(np.radians(degrees), [0, 0, 1])).as_matrix()


def test_positions_are_linear_and_turns_are_even_between_poses():
    poses = PoseSeries(T, LINE, about_z([0, 90, 90, 0]))
    position, rotation = poses.at([0.5, 1.0, 2.25])
    np.testing.assert_allclose(position, [[0.5, 1, 0], [1, 2, 0], [2.25, 4.5, 0]])
    np.testing.assert_allclose(rotation, about_z([45, 90, 67.5]), atol=1e-12)


def test_quaternions_begin_with_w():
    half = np.sqrt(0.5)
    poses = PoseSeries(
        T, LINE, [[1, 0, 0, 0], [half, 0, 0, half], [half, 0, 0, -half], [0, 1, 0, 0]]
    )
    expected = [*about_z([0, 90, -90]), np.diag([1.0, -1.0, -1.0])]
    np.testing.assert_allclose(poses.matrices, expected, atol=1e-12)


def test_a_trajectory_without_rotations_does_not_turn():
    poses = PoseSeries(T, LINE)
    assert not poses.turns
    np.testing.assert_array_equal(poses.at([0.3])[1], [np.eye(3)])
    assert PoseSeries(T, LINE, about_z([0, 0, 0, 1])).turns


def test_segments_end_at_gaps():
    t = np.array([0.0, 1.0, 2.0, 8.0, 20.0, 21.0])
    poses = PoseSeries(t, np.zeros((6, 3)), max_gap=3.0)
    asked = [-0.1, 0.0, 0.5, 2.0, 2.1, 8.0, 8.1, 19.9, 20.0, 20.5, 21.0, 21.1]
    assert poses.segment_at(asked).tolist() == [-1, 0, 0, 0, -1, 1, -1, -1, 2, 2, 2, -1]
    assert PoseSeries(t, np.zeros((6, 3))).gap == 5.0


@settings(deadline=None, max_examples=50)
@given(shares=st.lists(st.floats(0, 1), min_size=1, max_size=5), seed=st.integers(0, 1000))
def test_lookups_are_those_of_scipy(shares, seed):
    rng = np.random.default_rng(seed)
    t, turns = np.cumsum(rng.uniform(0.1, 0.2, 9)), Rotation.random(9, random_state=rng)
    poses = PoseSeries(t, rng.normal(size=(9, 3)), turns.as_matrix())
    asked = t[0] + np.array(shares) * (t[-1] - t[0])
    position, rotation = poses.at(asked)
    for k, time in enumerate(asked):
        j = min(int(np.sum(t <= time)) - 1, 7)
        u = (time - t[j]) / (t[j + 1] - t[j])
        step = (turns[j].inv() * turns[j + 1]).as_rotvec()
        np.testing.assert_allclose(
            position[k], (1 - u) * poses.position[j] + u * poses.position[j + 1], atol=1e-9
        )
        expected = (turns[j] * Rotation.from_rotvec(u * step)).as_matrix()
        np.testing.assert_allclose(rotation[k], expected, atol=1e-9)


@pytest.mark.parametrize("time", [-0.1, 3.1, 1.5])
def test_nothing_is_extrapolated_or_interpolated_across_a_gap(time):
    poses = PoseSeries(np.array([0, 1, 2, 3.0]), LINE, max_gap=0.9)
    with pytest.raises(InputError, match=r"does not cover 1 of 2 times, the first of them"):
        poses.at([1.0, time])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((T[:2], LINE[:2]), "a trajectory of 2 pose.s. is too short: at least 3 are needed"),
        ((T[::-1], LINE), "pose t must increase strictly"),
        ((T, LINE[:3]), r"pose position must have shape \(4, 3\)"),
        ((T, LINE * np.nan), "pose position holds 12 value.s. that are NaN"),
        ((T, LINE, np.full((4, 4), 0.6)), "pose 0 has a quaternion of length 1.2, not 1"),
        ((T, LINE, np.ones((4, 3, 3))), "pose rotation 0 is not a rotation matrix"),
        ((T, LINE, np.tile(np.diag([1, 1, -1.0]), (4, 1, 1))), "not a rotation"),
        ((T, LINE, None, 0.0), "max_gap must be a positive number"),
    ],
)
def test_unusable_poses_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        PoseSeries(*arguments)


@pytest.mark.parametrize("between", [" ", ",", "\t"])
def test_a_tum_file_is_read_as_its_columns_say(tmp_path, between):
    path = tmp_path / "poses.txt"
    rows = "0 1 2 3 0 0 0 1\n\n0.1 1 2 4 1 0 0 0\n0.2 1 2 5 0 0 1 0\n"
    path.write_text("# t x y z qx qy qz qw\n" + rows.replace(" ", between))
    poses = read_tum(path)
    np.testing.assert_array_equal(poses.t, [0, 0.1, 0.2])
    np.testing.assert_array_equal(poses.position[:, 2], [3, 4, 5])
    expected = [np.eye(3), np.diag([1.0, -1, -1]), np.diag([-1.0, -1, 1])]
    np.testing.assert_allclose(poses.matrices, expected, atol=1e-12)


def test_a_written_trajectory_reads_the_same(tmp_path):
    rng = np.random.default_rng(0)
    poses = PoseSeries(
        1.6e9 + np.cumsum(rng.uniform(0.01, 0.02, 20)),
        rng.normal(size=(20, 3)),
        Rotation.random(20, random_state=rng).as_matrix(),
    )
    write_tum(tmp_path / "t.txt", poses)
    again = read_tum(tmp_path / "t.txt")
    np.testing.assert_array_equal(again.t, poses.t)
    np.testing.assert_array_equal(again.position, poses.position)
    np.testing.assert_allclose(again.matrices, poses.matrices, atol=1e-14)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("0 0 0 0 0 0 1\n", "line 1 has 7 numbers; .* there must be 8 .t, x, y, z, qx, qy, qz, qw"),
        ("# x\n0 0 0 0 0 0 0 one\n1 0 0 0 0 0 0 1\n", "line 2.*'one'"),
        ("0 0 0 0 0 0 0 nan\n", "at least two are needed"),
        ("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "a trajectory of 2 pose"),
        (
            "0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 2\n",
            "pose 2 has a quaternion of length 2",
        ),
        ("0 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "a trajectory of 2 pose"),
    ],
)
def test_unusable_files_are_refused(tmp_path, text, message):
    path = tmp_path / "bad.txt"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        read_tum(path)
    assert "bad.txt" in str(error.value)


def test_a_file_that_is_missing_or_binary_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot read"):
        read_tum(tmp_path / "none.txt")
    (tmp_path / "binary").write_bytes(b"\x00\x01\xff\xfe")
    with pytest.raises(InputError, match="is not a CSV text file"):
        read_tum(tmp_path / "binary")


def test_published_trajectories_are_read(data):
    poses = read_tum(data / "dsec_traj" / "vo_04a.txt")
    assert len(poses) == 3454
    assert poses.turns

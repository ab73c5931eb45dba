import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_tools.logs.series_files import read_paired_rows
from data_tools.simulation import drives
from data_tools.simulation.streams import Noise, simulate
from data_tools.studies.baseline_runs import (
    baseline_table,
    body_poses,
    reckoned_poses,
    run_baselines,
)
from evcalib.alignment import align
from evcalib.baselines import (
    METHODS,
    TRAJECTORY_METHODS,
    CertifiedCalibration,
    RivalCalibration,
    RivalInput,
    TrajectoryCalibration,
    calibrate_with,
)
from evcalib.baselines.authors import paired_rows, with_alignment
from evcalib.errors import InputError
from evcalib.geometry import rotation_angle
from evcalib.poses import PoseSeries
from evcalib.series import HeadingSeries, VelocitySeries

RIVALS = [name for name in METHODS if name != "ours"]
ALIGNING = ["vc", "authors", "cross_correlation", "cca", "hand_eye_offset"]


def streams(drive, seed=0, offset=0.3, sigma=0.05, **more):
    rng = np.random.default_rng(seed)
    return simulate(
        drive,
        rng,
        offset=offset,
        heading_noise=Noise(sigma),
        velocity_noise=Noise(0.02),
        **more,
    )


@pytest.fixture(scope="module")
def lively():
    return streams(drives.s_curve(amplitude=np.pi / 2, period=5.0))


@pytest.fixture(scope="module")
def reckoned(lively):
    return reckoned_poses(lively.headings, lively.velocities)


def installed(name):
    if name == "cgoc":
        pytest.importorskip("cvxpy")


@pytest.mark.parametrize("name", RIVALS)
def test_rivals_return_a_calibration_that_claims_nothing(name, lively, reckoned):
    installed(name)
    found = calibrate_with(name, reckoned)
    assert isinstance(found, RivalCalibration)
    assert found.method == name
    R = found.R_body_cam
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(R) == pytest.approx(1)
    assert not found.offset_observable
    assert not found.rotation_observable
    stated = [found.offset_sd, *found.offset_interval, found.rotation_sd, found.rotation_radius]
    assert np.isnan([*stated, *found.rotation_covariance.ravel()]).all()
    assert "states no uncertainty" in found.verdict.summary
    assert "Run evcalib's own method" in str(found.verdict)
    assert np.isfinite(found.residuals.angle).all()
    assert found.inlier_share > 0.8
    assert (found.curve is not None) == (name in ALIGNING)


@pytest.mark.parametrize("name", ALIGNING)
def test_methods_that_align_find_offset_and_rotation_of_a_lively_drive(name, lively, reckoned):
    found = calibrate_with(name, reckoned)
    # The released script extrapolates its spline where the offset takes headings off the ends.
    assert found.offset == pytest.approx(0.3, abs=0.1 if name == "authors" else 0.04)
    assert found.curve.offset == found.offset
    # Noise turns the closed form of CCA away from the best rotation.
    assert rotation_angle(found.R_body_cam, lively.R_body_cam) < np.radians(5)


@pytest.mark.parametrize("name", ["vc_wota", "hand_eye", "cgoc"])
def test_methods_that_do_not_align_use_the_clocks_as_they_are(name, reckoned):
    installed(name)
    assert calibrate_with(name, reckoned).offset == 0.0


def test_ours_is_align(lively):
    found = calibrate_with("ours", RivalInput(lively.headings, lively.velocities), seed=3)
    expected = align(lively.headings, lively.velocities, seed=3)
    np.testing.assert_array_equal(found.R_body_cam, expected.R_body_cam)
    assert found.verdict == expected.verdict


def test_vc_without_alignment_is_the_registration_of_what_is_simultaneous(lively):
    h, v = lively.headings, lively.velocities
    found = calibrate_with("vc_wota", RivalInput(h, v))
    inside = (h.t >= v.t[0]) & (h.t <= v.t[-1])
    d = np.stack([np.interp(h.t[inside], v.t, column) for column in v.v.T], axis=1)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    expected = Rotation.align_vectors(d, h.v[inside])[0].as_matrix()
    assert rotation_angle(found.R_body_cam, expected) < 1e-9
    assert found.residuals.t.size == inside.sum()


def test_vc_takes_its_peak_on_an_arc_where_ours_says_that_there_is_none():
    arc = streams(drives.arc(radius=4.0), sigma=0.1)
    vc = calibrate_with("vc", RivalInput(arc.headings, arc.velocities))
    ours = calibrate_with("ours", RivalInput(arc.headings, arc.velocities))
    assert vc.offset == vc.curve.offset != 0
    assert not ours.offset_observable
    assert ours.offset == 0.0


def test_the_search_is_as_wide_as_asked(reckoned):
    for name in ("vc", "cca", "cross_correlation", "hand_eye_offset"):
        found = calibrate_with(name, reckoned, max_offset=0.2)
        assert found.curve.offsets[[0, -1]] == pytest.approx([-0.2, 0.2])
        assert found.curve.at_edge
        assert "border of the search" in str(found.verdict)


def test_headings_are_paired_with_the_nearest_velocity_that_has_a_direction():
    headings = HeadingSeries(np.arange(8) * 0.1 + 0.003, np.tile([0, 0, 1.0], (8, 1)))
    t = np.array([0.0, 0.098, 0.106, 0.2, 0.304, 0.42, 0.503, 0.603, 0.703])
    v = np.outer(np.arange(1.0, 10), [0.0, 2.0, 0.0])
    v[4] = 0.0
    rows = paired_rows(RivalInput(headings, VelocitySeries(t, v)))
    # 0.003 and 0.203 lie 3 ms after a velocity; 0.103 has two near it; that of 0.303 stands,
    # and that of 0.403 is 17 ms away.
    np.testing.assert_allclose(rows.t_e, [0.003, 0.103, 0.203, 0.503, 0.603, 0.703])
    np.testing.assert_allclose(rows.t_o, [0.0, 0.106, 0.2, 0.503, 0.603, 0.703])
    np.testing.assert_allclose(rows.v_o, np.tile([0, 1.0, 0], (6, 1)))


def test_authors_is_the_released_procedure_on_the_pairs(reckoned):
    expected = with_alignment(paired_rows(reckoned))
    found = calibrate_with("authors", reckoned)
    np.testing.assert_array_equal(found.R_body_cam, expected.R_body_cam)
    assert found.offset == expected.offset


def test_authors_gives_the_published_angle_on_the_authors_rows(data):
    rows = read_paired_rows(data / "evcalib" / "calib_data_time_5traj.npz")
    truth = Rotation.from_euler("x", -90, degrees=True).as_matrix()
    assert np.degrees(rotation_angle(with_alignment(rows).R_body_cam, truth)) == pytest.approx(
        1.68, abs=0.01
    )


@pytest.mark.parametrize("name", TRAJECTORY_METHODS)
def test_methods_that_align_trajectories_say_which_one_they_lack(name, lively, reckoned):
    with pytest.raises(InputError, match=r"aligns trajectories and needs camera_poses: read one"):
        calibrate_with(name, RivalInput(lively.headings, lively.velocities))
    half = RivalInput(lively.headings, lively.velocities, reckoned.camera_poses)
    with pytest.raises(InputError, match="needs body_poses"):
        calibrate_with(name, half)


@pytest.mark.parametrize("name", TRAJECTORY_METHODS)
def test_trajectories_tell_scale_and_what_is_unobservable(name, reckoned):
    installed(name)
    found = calibrate_with(name, reckoned)
    assert isinstance(found, TrajectoryCalibration)
    assert found.scale == pytest.approx(1.0, abs=0.1)
    assert np.isnan(found.lever_arm).all()
    assert found.reason in found.verdict.reasons
    assert "does not turn" in found.reason
    assert found.cost > 0


def test_cgoc_brings_its_certificate(reckoned):
    pytest.importorskip("cvxpy")
    found = calibrate_with("cgoc", reckoned)
    assert isinstance(found, CertifiedCalibration)
    assert found.certified
    assert found.relative_gap <= 1e-4
    assert found.duality_gap == pytest.approx(found.relative_gap * found.cost, rel=1e-6)
    assert found.min_eigenvalue > -1e-6 * found.cost
    hand_eye = calibrate_with("hand_eye", reckoned)
    assert rotation_angle(found.R_body_cam, hand_eye.R_body_cam) < 1e-6


@pytest.mark.parametrize(
    ("name", "max_offset", "message"),
    [
        ("best", 1.0, "method must be one of ours, vc, vc_wota, .*, cgoc, not 'best'"),
        ("vc", 0.0, "max_offset must be a positive number of seconds"),
    ],
)
def test_unusable_arguments_are_refused(lively, name, max_offset, message):
    with pytest.raises(InputError, match=message):
        calibrate_with(name, RivalInput(lively.headings, lively.velocities), max_offset=max_offset)


@pytest.mark.parametrize("name", [n for n in RIVALS if n not in TRAJECTORY_METHODS])
def test_streams_without_overlap_are_refused(name, lively):
    late = HeadingSeries(lively.headings.t + 1e4, lively.headings.v)
    with pytest.raises(InputError, match=r"do not overlap|Are the clocks that far apart"):
        calibrate_with(name, RivalInput(late, lively.velocities))


def test_too_few_headings_are_refused(lively):
    few = HeadingSeries(lively.headings.t[:5], lively.headings.v[:5])
    for name in ("vc", "vc_wota", "authors"):
        with pytest.raises(InputError, match="headings: 5 usable row"):
            calibrate_with(name, RivalInput(few, lively.velocities))


def test_the_body_is_reckoned_with_its_yaw():
    """A quarter of a circle of radius 2 at 1 m/s, pointing along the path."""
    t = np.linspace(0, np.pi, 2000)
    v = np.tile([1.0, 0.0, 0.0], (t.size, 1))
    poses = body_poses(VelocitySeries(t, v, np.full(t.size, 0.5)))
    np.testing.assert_allclose(poses.position[-1], [2, 2, 0], atol=1e-6)
    expected = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    np.testing.assert_allclose(poses.matrices[-1], expected, atol=1e-9)


def test_the_camera_is_reckoned_at_its_speed():
    t = np.arange(5.0)
    headings = HeadingSeries(
        t, np.tile([0, 0, 1.0], (5, 1)), valid=np.array([True, True, True, True, False])
    )
    velocities = VelocitySeries(t, np.tile([1.0, 0, 0], (5, 1)))
    even = reckoned_poses(headings, velocities).camera_poses
    np.testing.assert_allclose(even.position[:, 2], [0, 1, 2, 3])
    speeding = reckoned_poses(headings, velocities, np.array([0, 2, 2, 4, 9.0])).camera_poses
    np.testing.assert_allclose(speeding.position[:, 2], [0, 1, 3, 6])


@pytest.mark.parametrize("rows", [1, 2])
def test_too_short_a_drive_gives_no_trajectory(rows):
    velocities = VelocitySeries(np.arange(float(rows)), np.tile([1.0, 0, 0], (rows, 1)))
    with pytest.raises(InputError, match="at least 3 are needed"):
        body_poses(velocities)


def test_nothing_is_reckoned_across_a_gap():
    t = np.array([0.0, 1, 2, 3, 50, 51, 52])
    poses = body_poses(VelocitySeries(t, np.tile([1.0, 0, 0], (7, 1))))
    np.testing.assert_allclose(poses.position[:, 0], [0, 1, 2, 3, 4, 5, 6])
    np.testing.assert_array_equal(poses.t, t)


def test_headings_do_not_tell_how_a_camera_turned():
    t = np.arange(5.0)
    headings = HeadingSeries(t, np.tile([0, 0, 1.0], (5, 1)))
    turning = VelocitySeries(t, np.tile([1.0, 0, 0], (5, 1)), np.full(5, 0.2))
    with pytest.raises(InputError, match="headings do not tell how the camera turned"):
        reckoned_poses(headings, turning)


def test_all_methods_run_on_one_pair_of_streams_and_failures_stay_in_their_row(lively):
    late = PoseSeries(1e6 + np.arange(4.0), np.eye(4)[:, :3])
    rows = run_baselines(
        lively.headings,
        lively.velocities,
        trajectory=late,
        methods=("vc", "hand_eye", "vc_wota"),
    )
    assert [row.method for row in rows] == ["vc", "hand_eye", "vc_wota"]
    assert rows[1].calibration is None
    assert "share 0 pose(s)" in rows[1].failure
    assert rows[0].failure == rows[2].failure == ""
    table = baseline_table(rows).splitlines()
    assert len(table) == 5
    assert table[3].startswith("hand_eye          failed: trajectories: the camera's")
    assert table[2].split()[:3] == ["vc", f"{1e3 * rows[0].calibration.offset:.1f}", "-"]
    apart = np.degrees(
        rotation_angle(rows[0].calibration.R_body_cam, rows[2].calibration.R_body_cam)
    )
    assert f"{apart:8.2f}" in table[4]


def test_a_given_trajectory_is_used(lively):
    v = lively.drive.velocity(lively.headings.t + lively.offset) @ lively.R_body_cam
    exact = body_poses(VelocitySeries(lively.headings.t, v))
    (row,) = run_baselines(
        lively.headings, lively.velocities, trajectory=exact, methods=["hand_eye_offset"]
    )
    assert row.calibration.offset == pytest.approx(lively.offset, abs=0.01)
    assert rotation_angle(row.calibration.R_body_cam, lively.R_body_cam) < np.radians(0.5)
    (row,) = run_baselines(lively.headings, lively.velocities, methods=["hand_eye_offset"])
    assert rotation_angle(row.calibration.R_body_cam, lively.R_body_cam) > np.radians(0.01)


def test_a_method_that_does_not_exist_is_refused_before_any_runs(lively):
    with pytest.raises(InputError, match=r"unknown method\(s\) best; there are ours, vc"):
        run_baselines(lively.headings, lively.velocities, methods=["vc", "best"])


def test_an_empty_table_is_its_heading():
    assert len(baseline_table([]).splitlines()) == 2

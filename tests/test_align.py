"""The whole alignment: symmetries, what it says of each motion, real data, and bad input."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from data_tools.logs.series_files import read_paired_streams
from data_tools.simulation import drives
from data_tools.simulation.streams import Noise, simulate
from evcalib.alignment import align, one_answer
from evcalib.errors import InputError
from evcalib.geometry import random_rotation, rotation_angle, rotation_vector_to_matrix, unit
from evcalib.series import HeadingSeries, VelocitySeries

FORWARD_CAMERA = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""R_body_cam of a camera that looks forward."""


def streams(drive=None, seed=0, *, offset=0.2, sigma=0.05, sigma_o=0.02, velocity=None, **more):
    return simulate(
        drive or drives.s_curve(),
        np.random.default_rng(seed),
        offset=offset,
        heading_noise=Noise(sigma, **more),
        velocity_noise=Noise(sigma_o, **(velocity or {})),
    )


def aligned(made, **more):
    return align(made.headings, made.velocities, **more)


def error(found, made):
    """Return the rotation's error [deg]."""
    return np.degrees(rotation_angle(found.R_body_cam, made.R_body_cam))


# Symmetries -------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=5)
@given(st.integers(0, 10**6))
def test_turning_the_camera_turns_the_answer_and_nothing_else(seed):
    made, R = streams(seed=seed), random_rotation(np.random.default_rng(seed))
    plain = aligned(made)
    turned = align(HeadingSeries(made.headings.t, made.headings.v @ R.T), made.velocities)
    assert rotation_angle(turned.R_body_cam, plain.R_body_cam @ R.T) < 1e-3
    assert turned.offset == pytest.approx(plain.offset, abs=1e-4)


@settings(deadline=None, max_examples=5)
@given(st.integers(0, 10**6), st.floats(-0.3, 0.3))
def test_shifting_the_cameras_clock_shifts_the_offset_and_nothing_else(seed, shift):
    made = streams(seed=seed, offset=0.0)
    plain = aligned(made)
    moved = align(HeadingSeries(made.headings.t - shift, made.headings.v), made.velocities)
    # Other headings reach over the ends of the odometry; half a standard deviation is 3 ms.
    assert moved.offset == pytest.approx(plain.offset + shift, abs=0.5 * plain.offset_sd)
    assert rotation_angle(moved.R_body_cam, plain.R_body_cam) < 0.5 * plain.rotation_sd


@pytest.mark.parametrize("scale", [0.01, 9.0])
def test_the_speed_does_not_matter(scale):
    made = streams()
    plain, scaled = (
        align(made.headings, VelocitySeries(made.velocities.t, s * made.velocities.v))
        for s in (1.0, scale)
    )
    assert scaled.offset == pytest.approx(plain.offset, abs=1e-4)
    assert rotation_angle(scaled.R_body_cam, plain.R_body_cam) < 1e-4
    assert scaled.rotation_sd == pytest.approx(plain.rotation_sd, rel=1e-2)


def test_both_clocks_may_start_at_any_time():
    made = streams()
    later = 1.7e9
    plain = aligned(made)
    moved = align(
        HeadingSeries(made.headings.t + later, made.headings.v),
        VelocitySeries(made.velocities.t + later, made.velocities.v),
    )
    assert moved.offset == pytest.approx(plain.offset, abs=1e-4)
    assert rotation_angle(moved.R_body_cam, plain.R_body_cam) < 1e-4


def test_which_headings_are_outliers_does_not_matter():
    made = streams()
    rng, wild = np.random.default_rng(0), unit(np.random.default_rng(1).standard_normal((90, 3)))
    for _ in range(3):
        v = made.headings.v.copy()
        v[rng.permutation(len(v))[:90]] = wild
        found = align(HeadingSeries(made.headings.t, v), made.velocities)
        assert abs(found.offset - 0.2) < 5 * found.offset_sd < 0.06
        assert error(found, made) < 1
        assert found.inlier_share == pytest.approx(1 - 90 / len(v), abs=0.05)


def test_the_same_input_gives_the_same_bytes():
    made = streams(drives.polyline(), offset=0.1)
    one, two = aligned(made, seed=4), aligned(made, seed=4)
    assert one.R_body_cam.tobytes() == two.R_body_cam.tobytes()
    assert (one.offset, one.offset_sd) == (two.offset, two.offset_sd)
    assert one.rotation_covariance.tobytes() == two.rotation_covariance.tobytes()


# What it finds ----------------------------------------------------------------------------------


def test_an_s_curve_tells_everything():
    made = streams()
    found = aligned(made)
    assert found.offset_observable
    assert found.rotation_observable
    assert found.unknown_axis is None
    assert abs(found.offset - 0.2) < 4 * found.offset_sd < 0.03
    assert error(found, made) < 1
    assert str(found.verdict) == "The motion determines the rotation and the offset."


@pytest.mark.parametrize("offset_method", ["profile", "trace", "canonical", "scalar"])
def test_every_offset_method_finds_an_offset(offset_method):
    made = streams(drives.s_curve(amplitude=1.2, period=6.0), sigma=0.02)
    found = aligned(made, offset_method=offset_method)
    assert found.offset == pytest.approx(0.2, abs=0.03)
    assert found.curve.method == offset_method


@pytest.mark.parametrize("rotation_method", ["tukey", "l1", "kabsch", "gnc", "cca"])
def test_every_rotation_method_finds_a_rotation(rotation_method):
    made = streams(drives.s_curve(amplitude=1.2))
    assert error(aligned(made, rotation_method=rotation_method), made) < 2


def test_residuals_are_the_angles_between_turned_headings_and_directions():
    found = aligned(streams())
    r = found.residuals
    cosine = np.sum(r.turned * r.direction, axis=1)
    np.testing.assert_allclose(np.cos(r.angle), cosine, atol=1e-12)
    assert np.median(r.angle) == pytest.approx(0.05 * np.sqrt(2 * np.log(2)), rel=0.15)


def test_settings_keep_the_parameters_of_the_call():
    found = aligned(streams(), max_offset=0.7, rotation_method="l1")
    assert found.settings["max_offset"] == 0.7
    assert found.settings["rotation_method"] == "l1"


def test_headings_without_weight_or_validity_do_not_count():
    made = streams()
    v, n = made.headings.v.copy(), len(made.headings)
    v[::3] = [0, 0, 1]
    valid = np.arange(n) % 3 > 0
    by_flag = align(HeadingSeries(made.headings.t, v, valid=valid), made.velocities)
    by_weight = align(HeadingSeries(made.headings.t, v, weight=valid * 2.0), made.velocities)
    expected = align(made.headings.select(valid), made.velocities)
    for found in (by_flag, by_weight):
        assert found.offset == pytest.approx(expected.offset, abs=1e-6)
        assert rotation_angle(found.R_body_cam, expected.R_body_cam) < 1e-6


def test_gaps_and_drop_outs_cost_precision_only():
    gaps = ((4.0, 5.5), (12.0, 12.8))
    made = streams(gaps=gaps, dropout=0.3, velocity={"gaps": ((8.0, 9.0),), "dropout": 0.3})
    found = aligned(made)
    assert found.offset_observable
    assert abs(found.offset - 0.2) < 4 * found.offset_sd < 0.05
    assert error(found, made) < 1


def test_instant_turns_are_noticed_and_bootstrapped():
    found = aligned(streams(drives.polyline(), sigma=0.1), max_offset=0.7)
    assert found.diagnostics.sharp_turns
    assert abs(found.offset - 0.2) < 4 * found.offset_sd < 0.1
    assert not aligned(streams()).diagnostics.sharp_turns


def test_40_percent_flips_are_reported():
    found = aligned(streams(flips=0.4))
    assert abs(found.offset - 0.2) < 0.03
    assert "of the headings point backwards: check their sign" in str(found.verdict)


def test_headings_that_agree_with_nothing_are_no_calibration():
    made = streams()
    v = unit(np.random.default_rng(0).standard_normal(made.headings.v.shape))
    found = align(HeadingSeries(made.headings.t, v), made.velocities)
    assert not found.offset_observable
    assert not found.rotation_observable


# What a motion cannot tell ----------------------------------------------------------------------


@pytest.mark.parametrize("drive", [drives.arc(), drives.straight()], ids=lambda d: d.kind)
def test_steady_motion_hides_the_offset_and_with_it_the_rotation(drive):
    found = aligned(streams(drive))
    assert not found.offset_observable
    assert not found.rotation_observable
    assert found.offset == 0.0
    low, high = found.offset_interval
    assert low < 0.2 < high
    assert "does not turn at a changing rate" in str(found.verdict)
    assert any("S-curves" in advice for advice in found.verdict.advice)


def test_an_arcs_rotation_uncertainty_includes_that_of_the_offset():
    """An offset of 0.2 s turns the rotation by 0.25 rad/s * 0.2 s = 2.9 deg."""
    made = streams(drives.arc())
    found = aligned(made)
    assert error(found, made) == pytest.approx(np.degrees(0.05), abs=0.6)
    assert error(found, made) < np.degrees(found.rotation_radius)


def test_given_the_offset_an_arc_determines_the_rotation():
    made = streams(drives.arc())
    found = aligned(made, offset=0.2)
    assert not found.offset_observable
    assert found.rotation_observable
    assert found.offset == 0.2
    assert error(found, made) < np.degrees(found.rotation_radius) < 2
    assert "The offset of 0.2 s that was given is used" in str(found.verdict)


def test_without_a_search_the_given_offset_is_used():
    made = streams()
    found = aligned(made, offset_method="none", offset=0.2)
    assert found.curve is None
    assert found.rotation_observable
    assert error(found, made) < 1
    assert "The offset was not searched" in str(found.verdict)


@pytest.mark.parametrize("seed", range(4))
def test_fingers_determine_the_rotation_whatever_the_offset(seed):
    """Their directions stand still but for the pauses, so an offset does not matter."""
    angles = 0.4 * seed + np.radians([0, 60, 120])
    made = streams(drives.fingers(angles), seed, offset=0.1 * seed - 0.15, sigma=0.02)
    found = aligned(made)
    assert not found.offset_observable
    assert found.rotation_observable
    assert error(found, made) < 1
    assert np.degrees(found.diagnostics.offset_matters) < 1
    assert "This does not matter to the rotation" in str(found.verdict)


def test_a_straight_drive_names_the_axis_that_it_leaves_unknown():
    found = aligned(streams(drives.straight()))
    np.testing.assert_allclose(np.abs(found.unknown_axis), [1, 0, 0], atol=0.1)
    assert "rotation about the body's forward axis is unknown" in str(found.verdict)
    assert found.rotation_sd > np.radians(90)
    assert any("30 degrees or more apart" in advice for advice in found.verdict.advice)


def test_sideways_out_and_back_leaves_the_left_axis_unknown():
    found = aligned(streams(drives.fingers([np.pi / 2]), offset=0.0))
    assert "rotation about the body's left axis is unknown" in str(found.verdict)


def test_a_quick_zigzag_repeats_itself_within_the_search():
    drive = drives.zigzag(side=0.8, turn=np.pi / 3, turn_time=0.3)
    found = aligned(streams(drive), max_offset=1.5)
    assert found.diagnostics.second_peak_ratio > 0.9
    assert not found.offset_observable
    assert "Search less far" in str(found.verdict)


def test_the_same_zigzag_tells_the_offset_within_half_a_period():
    drive = drives.zigzag(side=0.8, turn=np.pi / 3, turn_time=0.3)
    found = aligned(streams(drive), max_offset=0.4)
    assert found.offset_observable
    assert found.offset == pytest.approx(0.2, abs=0.02)


def test_an_offset_outside_the_search_is_not_claimed():
    found = aligned(streams(offset=0.6), max_offset=0.4)
    assert not found.offset_observable
    assert "raise max_offset" in str(found.verdict)


# Real data --------------------------------------------------------------------------------------


@pytest.mark.parametrize("fingers", [3, 5])
def test_the_papers_data_give_the_rotation_and_hide_the_offset(data, fingers):
    """The authors' truth: R_body_cam = Rx(-90 deg); directions are constant within each stroke."""
    made = read_paired_streams(data / "evcalib" / f"calib_data_time_{fingers}traj.npz")
    found = align(made.headings, made.velocities, hold=made.hold)
    truth = rotation_vector_to_matrix([-np.pi / 2, 0, 0])
    wrong = np.degrees(rotation_angle(found.R_body_cam, truth))
    assert wrong < 3
    assert np.degrees(found.rotation_sd) >= wrong
    assert found.rotation_observable
    assert not found.offset_observable
    assert np.degrees(found.diagnostics.offset_matters) < 1
    assert "This does not matter to the rotation" in str(found.verdict)


@pytest.mark.parametrize("drive", ["04a", "04c"])
def test_a_car_leaves_the_roll_about_its_forward_axis_unknown(data, drive):
    """Velocities from the ground truth (5 Hz), headings from visual odometry over 0.2 s."""
    t, v = camera_velocities(data / "dsec_traj" / f"gt_{drive}.txt", 1)
    t_e, e = camera_velocities(data / "dsec_traj" / f"vo_{drive}.txt", 20)
    moving = np.linalg.norm(e, axis=1) > 1
    headings = HeadingSeries(t_e[moving], unit(e[moving]))
    found = align(headings, VelocitySeries(t, v @ FORWARD_CAMERA.T))
    np.testing.assert_allclose(found.unknown_axis, [1, 0, 0], atol=0.05)
    assert not found.rotation_observable
    assert "rotation about the body's forward axis is unknown" in str(found.verdict)
    # What can be known of it, where forward is, holds.
    forward = found.R_body_cam @ FORWARD_CAMERA.T @ [1, 0, 0]
    assert np.degrees(np.arccos(forward[0])) < 3


def camera_velocities(path, step):
    """Return times and velocities in the camera's frame from poses `step` rows apart."""
    rows = np.loadtxt(path)
    a, b = rows[:-step], rows[step:]
    v = (b[:, 1:4] - a[:, 1:4]) / (b[:, 0] - a[:, 0])[:, None]
    return 0.5 * (a[:, 0] + b[:, 0]), Rotation.from_quat(a[:, 4:]).inv().apply(v)


# Bad input --------------------------------------------------------------------------------------


def test_unknown_names_are_refused_with_those_that_are_known():
    made = streams()
    with pytest.raises(
        InputError, match=r"offset_method must be one of profile, .*, none, not 'x'"
    ):
        aligned(made, offset_method="x")
    with pytest.raises(InputError, match=r"rotation_method must be one of tukey, .*, cca, not 'y'"):
        aligned(made, rotation_method="y")


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_the_search_must_have_a_width(bad):
    with pytest.raises(InputError, match="max_offset must be a positive number of seconds"):
        aligned(streams(), max_offset=bad)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_given_offset_must_be_a_number(bad):
    with pytest.raises(InputError, match="offset must be a finite number of seconds"):
        aligned(streams(), offset=bad)


@pytest.mark.parametrize("rows", [0, 1, 5])
def test_a_handful_of_headings_is_refused(rows):
    made = streams()
    few = made.headings.select(np.arange(len(made.headings)) < rows)
    with pytest.raises(
        InputError, match=rf"headings: {rows} usable row\(s\), at least 6 are needed"
    ):
        align(few, made.velocities)


@pytest.mark.parametrize("rows", [0, 1])
def test_one_velocity_is_refused(rows):
    made = streams()
    few = made.velocities.select(np.arange(len(made.velocities)) < rows)
    with pytest.raises(InputError, match=f"velocities: at least 2 rows are needed, not {rows}"):
        align(made.headings, few)


def test_a_vehicle_at_rest_is_refused():
    made = streams()
    still = VelocitySeries(made.velocities.t, 0 * made.velocities.v)
    with pytest.raises(InputError, match="the vehicle does not move"):
        align(made.headings, still)


@pytest.mark.parametrize("offset_method", ["profile", "trace", "canonical", "scalar", "none"])
def test_streams_apart_are_refused(offset_method):
    made = streams()
    late = HeadingSeries(made.headings.t + 1000, made.headings.v)
    with pytest.raises(InputError, match="do not overlap"):
        align(late, made.velocities, offset_method=offset_method)


def test_all_parallel_directions_determine_nothing_but_do_not_fail():
    t = np.arange(0, 10, 0.05)
    same = np.tile([0.0, 0.0, 1.0], (t.size, 1))
    found = align(HeadingSeries(t, same), VelocitySeries(t, same[:, [2, 0, 1]]))
    assert not found.rotation_observable
    assert not found.offset_observable
    np.testing.assert_allclose(found.unknown_axis, [1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(found.R_body_cam @ [0, 0, 1], [1, 0, 0], atol=1e-6)


def test_opposite_directions_determine_nothing_but_do_not_fail():
    t = np.arange(0, 10, 0.05)
    e = np.where(np.arange(t.size)[:, None] % 40 < 20, [0.0, 0.0, 1.0], [0.0, 0.0, -1.0])
    found = align(HeadingSeries(t, e), VelocitySeries(t, e[:, [2, 0, 1]]))
    assert not found.rotation_observable


def test_exact_headings_agree():
    """Residuals that remember all of the drive, but are tiny, do not speak against a result."""
    streams = simulate(drives.s_curve(20.0), np.random.default_rng(1), offset=0.2)
    found = align(streams.headings, streams.velocities)
    assert found.diagnostics.agrees
    assert found.offset_observable
    assert found.offset == pytest.approx(0.2, abs=1e-3)
    assert rotation_angle(found.R_body_cam, streams.R_body_cam) < np.radians(0.02)


@pytest.mark.parametrize("sigma", [0.0075, 0.01, 0.02])
def test_precise_headings_on_instant_turns_determine_the_offset(sigma):
    """The few headings next to the turns are outliers at most offsets nearby, which is no alias."""
    streams = simulate(
        drives.polyline(20.0),
        np.random.default_rng(2),
        offset=0.2,
        heading_noise=Noise(sigma),
        velocity_noise=Noise(0.02),
    )
    found = align(streams.headings, streams.velocities)
    assert found.offset_observable
    assert found.offset_interval[0] < 0.2 < found.offset_interval[1]


@pytest.mark.parametrize(("given", "told"), [(0.0, True), (0.2, False), (0.4, True)])
def test_a_given_offset_that_the_motion_contradicts_is_told(given, told):
    streams = simulate(drives.s_curve(20.0), np.random.default_rng(1), offset=0.2)
    found = align(streams.headings, streams.velocities, offset=given)
    assert found.offset == pytest.approx(0.2, abs=1e-3)
    assert ("that was given is not used" in str(found.verdict)) == told


@pytest.mark.parametrize(
    ("plausible", "one"),
    [
        ([], True),
        ([-0.08, 0.08], True),
        ([0.0625, 0.125, 0.1875, 0.2], True),
        ([0.0625, 0.125, 0.1875, 0.25], False),  # as far as the widest
        ([-0.0625, -0.125, -0.1875, -0.3], False),
        ([0.2], False),  # a hole in between
    ],
)
def test_one_answer_lies_around_the_best_offset_without_holes(plausible, one):
    assert one_answer(np.array(plausible), 0.0, 0.25) == one

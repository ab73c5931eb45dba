"""Headings against sightings, all checks together, and what of the error bars is odometry."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from data_tools.logs.series_files import write_headings, write_velocities
from data_tools.runs.export import summary_dict, summary_text
from data_tools.simulation import random_drives
from data_tools.simulation.drives import s_curve, straight
from data_tools.simulation.streams import Noise, simulate
from data_tools.studies.sighting_drives import sight
from data_tools.studies.sightings import Corners
from evcalib.alignment import align
from evcalib.alignment._answers import OffsetAnswer, RotationAnswer
from evcalib.alignment.observability import HEADING_BIAS, DirectionSpread
from evcalib.alignment.verdict import CONTRADICTED, DISAGREE, judge
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.geometry import LOOKS_FORWARD, rotation_angle, rotation_vector_to_matrix
from evcalib.joint import SURE
from evcalib.kinematics import Mecanum, WheelLog, body_velocities
from evcalib.kinematics.velocity_track import velocity_track
from evcalib.pipeline import calibrate_estimate
from evcalib.pipeline._assessment import TURNING, finish, keep
from evcalib.pipeline._stage_agreement import (
    GROSS,
    OFFSET_BIAS,
    OFFSETS_APART,
    ROTATIONS_APART,
    STRAINED,
    StageAgreement,
    strain,
)
from evcalib.series import HeadingSeries, VelocitySeries
from evcalib.uncertainty import rotation_radius

WIDE = DirectionSpread(np.array([1.0, 0, 0]), 1.0, 3)
"""Directions over a radian: headings' bias weighs the same about all axes."""


@pytest.fixture(scope="module")
def clean():
    """A drive with curves, its estimate, and its calibration."""
    camera = Camera(240, 180, 200.0, 200.0, 120.0, 90.0)
    rng = np.random.default_rng(4)
    made = sight(
        s_curve(9.0, period=4.0),
        rng,
        camera=camera,
        R_body_cam=LOOKS_FORWARD,
        offset=0.12,
        corners=Corners(count=8, noise=0.25, false=0.1),
    )
    return made, made.estimate(), made.calibrate(max_offset=0.5)


@pytest.fixture(scope="module")
def finished(clean):
    """What the last stage is given for it."""
    made, estimate, found = clean
    aligned = align(estimate.headings, made.velocities, max_offset=0.5)
    return aligned, found.joint, estimate.headings, velocity_track(made.velocities), 0.5


# Two answers ------------------------------------------------------------------------------------


def test_a_clean_drive_agrees_and_has_no_doubt(clean):
    *_, found = clean
    assert found.offset_observable
    assert found.rotation_observable
    assert found.verdict.doubts == ()
    assert found.agreement.rotation < ROTATIONS_APART
    assert found.agreement.offset < OFFSETS_APART


def test_what_was_tried_for_headings_says_nothing_where_a_refinement_is_backed(clean):
    *_, found = clean
    offset = OffsetAnswer(found.offset, found.offset, found.offset_sd, observable=True)
    rotation = RotationAnswer(found.R_body_cam, found.rotation_covariance, determined=True)
    agrees = replace(found.diagnostics, agrees=True)
    tried = replace(agrees, cause="The speeds of one axis are in other units.")
    assert judge(tried, offset, rotation) == judge(agrees, offset, rotation)
    assert judge(replace(tried, agrees=False), offset, rotation).summary == DISAGREE


def test_distances_are_in_standard_deviations_of_both_and_of_what_headings_share(clean):
    *_, found = clean
    joint = replace(found.joint, covariance=1e-4 * np.eye(4))
    apart = np.array([0.01, -0.02, 0.03])
    R = rotation_vector_to_matrix(apart) @ joint.R_body_cam
    aligned = replace(found, offset=joint.offset + 0.05, offset_sd=0.02, offset_observable=True)
    seen = StageAgreement.of(R, 3e-4 * np.eye(3), joint, WIDE, aligned)
    assert seen.rotation == pytest.approx(apart @ apart / (4e-4 + HEADING_BIAS**2))
    assert seen.rotation_apart == pytest.approx(np.linalg.norm(apart))
    assert seen.offset == pytest.approx(0.05 / np.sqrt(0.02**2 + 1e-4 + OFFSET_BIAS**2))
    assert StageAgreement.of(R, 3e-4 * np.eye(3), joint, WIDE).offset == 0


def test_what_headings_share_turns_parallel_ones_about_their_axis(clean):
    *_, found = clean
    joint = replace(found.joint, covariance=1e-8 * np.eye(4))
    narrow = replace(WIDE, spread=0.1)
    about, across = (
        StageAgreement.of(
            rotation_vector_to_matrix(turn) @ joint.R_body_cam, 0 * np.eye(3), joint, narrow
        )
        for turn in 0.05 * np.eye(3)[:2]
    )
    assert across.rotation / about.rotation == pytest.approx(100, rel=0.01)


@pytest.mark.parametrize(
    ("turn", "late", "words"),
    [
        (12.0, 0.0, "rotation of the headings"),
        (0.0, 0.045, "offset of the headings"),
    ],
)
def test_answers_beyond_each_others_bars_are_doubted_and_far_ones_refused(
    finished, turn, late, words
):
    """The refinement is moved; a little further than the gate, then over twice as far."""
    aligned, joint, *rest = finished
    near = replace(aligned, offset_sd=0.005)
    axis = np.radians(turn) * np.array([0.0, 1.0, 0.0])

    def moved(times):
        R = rotation_vector_to_matrix(times * axis) @ joint.R_body_cam
        there = replace(joint, R_body_cam=R, offset=joint.offset + times * late)
        return finish(near, there, *rest)

    one = moved(1.0).agreement
    size = max(one.rotation / ROTATIONS_APART, (one.offset / OFFSETS_APART) ** 2)
    doubted, refused = moved(1.3 / np.sqrt(size)), moved(2.6 * GROSS / 2 / np.sqrt(size))
    assert any(words in doubt for doubt in doubted.verdict.doubts)
    assert doubted.rotation_observable
    assert doubted.offset_observable
    assert any(words in doubt for doubt in refused.verdict.doubts)
    assert not refused.rotation_observable
    assert not refused.offset_observable
    assert refused.verdict.summary == CONTRADICTED
    low, high = refused.offset_interval
    assert low <= aligned.offset_interval[0]
    assert high >= aligned.offset_interval[1]


def test_a_rotation_at_a_kept_offset_is_held_against_the_headings_too(finished):
    aligned, joint, headings, *_ = finished
    near = keep(aligned, joint, headings)
    assert near.rotation_observable
    far = rotation_vector_to_matrix([0.0, 0.5, 0.0]) @ joint.R_body_cam
    found = keep(aligned, replace(joint, R_body_cam=far), headings)
    assert not found.rotation_observable
    assert found.verdict.summary == CONTRADICTED


def test_headings_that_agree_with_nothing_need_a_majority_of_sightings(finished):
    """As where they are of another drive: the refinement then meets a third of what it sees."""
    aligned, joint, headings, track, reach = finished
    rng = np.random.default_rng(0)
    v = rng.standard_normal((len(headings), 3))
    noise = HeadingSeries(headings.t, v / np.linalg.norm(v, axis=1, keepdims=True))
    few = finish(aligned, replace(joint, inlier_share=0.4), noise, track, reach)
    assert not few.rotation_observable
    assert not few.offset_observable
    assert few.verdict.summary == DISAGREE


# All checks together ----------------------------------------------------------------------------


def test_strain_is_the_sum_of_squares_of_what_each_check_says(clean):
    joint = clean[-1].joint
    none = replace(joint.drift, z=0.0)
    quiet = replace(joint, drift=none, distortion=none, turning=0.0, lag=0.0)
    calm = StageAgreement(0.0, 0.0, 0.0, 0.0)
    assert strain(quiet, calm, TURNING) == pytest.approx(0.0, abs=1e-12)
    loud = replace(quiet, drift=replace(none, z=1.0), turning=TURNING, lag=0.2)
    assert strain(loud, calm, TURNING) == pytest.approx(1 + SURE**2 + 4)
    # A chi-square of three that is as rare as two standard deviations counts as two.
    rare = StageAgreement(float(stats.chi2.isf(2 * stats.norm.sf(2.0), 3)), 0.0, 1.5, 0.0)
    assert strain(quiet, rare, TURNING) == pytest.approx(4 + 1.5**2)


def test_many_checks_that_are_each_just_missed_make_a_doubt(finished):
    """As the distortion of 2.79 standard deviations with a turning of 0.009 rad/s."""
    aligned, joint, *rest = finished
    just = replace(
        joint,
        drift=replace(joint.drift, z=2.0),
        distortion=replace(joint.distortion, z=2.79),
        turning=0.012,
        lag=0.15,
    )
    (doubt,) = finish(aligned, just, *rest).verdict.doubts
    assert "together more than one drive in 300" in doubt
    assert strain(just, StageAgreement(0.0, 0.0, 0.0, 0.0), TURNING) > STRAINED


# Odometry ---------------------------------------------------------------------------------------


def test_directions_that_differ_beyond_noise_widen_the_rotation_about_z(finished):
    aligned, joint, *rest = finished
    shape = replace(joint.distortion, values=np.zeros(2), covariance=1e-6 * np.eye(2), z=0.0)
    none = finish(aligned, replace(joint, distortion=shape), *rest)
    shape = replace(shape, values=np.array([0.03, 0.04]), z=2.5)
    some = finish(aligned, replace(joint, distortion=shape), *rest)
    assert none.odometry_sd == 0
    assert some.odometry_sd == pytest.approx(np.sqrt(0.05**2 - 2e-6))
    more = some.rotation_covariance - none.rotation_covariance
    np.testing.assert_allclose(more, np.diag([0, 0, 0.05**2 - 2e-6]), atol=1e-12)
    assert "Directions of travel differ by 2.9 deg" in str(some.verdict)


def test_the_users_error_of_the_odometry_is_counted_and_told_apart(clean):
    made, estimate, found = clean
    options = {"focal": made.camera.focal, "max_offset": 0.5}
    sd = np.radians(2.0)
    told = calibrate_estimate(estimate, made.velocities, odometry_sd=sd, **options)
    both = np.hypot(sd, found.odometry_sd)
    assert told.odometry_sd == pytest.approx(both)
    assert told.verdict.doubts == ()
    assert told.odometry_radius == pytest.approx(1.96 * both, rel=1e-3)
    assert told.data_radius == pytest.approx(found.data_radius)
    square = told.data_radius**2 + told.odometry_radius**2
    assert square == pytest.approx(told.rotation_radius**2)
    parts = f"{np.degrees(told.data_radius):.2f} of the data"
    assert parts in " ".join(repr(told).split())
    assert parts in summary_text(told)
    written = summary_dict(told)
    assert written["rotation_radius_of_odometry_deg"] == pytest.approx(
        np.degrees(1.96 * both), 1e-3
    )
    assert "9 ms at 50 Hz" in written["pixel_delay"]


def test_a_given_error_replaces_that_of_the_velocities():
    made = simulate(s_curve(10), np.random.default_rng(0), heading_noise=Noise(0.05))
    shared = replace(made.velocities, direction_sd=0.02)
    assert align(made.headings, shared).odometry_sd == 0.02
    assert align(made.headings, shared, odometry_sd=0.0).odometry_sd == 0
    wide = align(made.headings, shared, odometry_sd=0.2)
    assert wide.odometry_sd == 0.2
    assert wide.verdict.doubts == ()
    assert "as was given" in str(wide.verdict)
    with pytest.raises(InputError, match="odometry_sd"):
        align(made.headings, shared, odometry_sd=-1.0)


def test_wheels_on_rollers_are_known_to_creep():
    """4.5 deg for mecanum wheels, measured on real ones; a reason, and no doubt."""
    t = np.arange(0, 10, 0.02)
    v = np.stack([np.cos(np.sin(t)), np.sin(np.sin(t))], axis=1)
    mecanum = Mecanum(0.3, 0.2)
    states = mecanum.wheel_states(v, 0 * t)
    body = body_velocities(WheelLog(t, states), mecanum).velocities
    assert np.degrees(body.direction_sd) == pytest.approx(4.5)
    rng = np.random.default_rng(0)
    e = body.v + 0.02 * rng.standard_normal(body.v.shape)
    found = align(HeadingSeries(t, e / np.linalg.norm(e, axis=1, keepdims=True)), body)
    assert found.verdict.doubts == ()
    assert "Wheels like these creep" in str(found.verdict)
    assert found.odometry_radius == pytest.approx(
        rotation_radius(np.diag([0, 0, np.radians(4.5) ** 2]))
    )


# The command line -------------------------------------------------------------------------------


@pytest.fixture
def files(tmp_path):
    made = simulate(
        s_curve(15),
        np.random.default_rng(2),
        offset=0.2,
        heading_noise=Noise(0.05),
        velocity_noise=Noise(0.02),
    )
    headings, velocities = tmp_path / "headings.csv", tmp_path / "velocities.csv"
    write_headings(headings, made.headings)
    return made, headings, velocities


def test_an_answer_with_doubts_ends_with_4(run, files):
    made, headings, velocities = files
    write_velocities(velocities, made.velocities)
    assert run("align", headings, velocities)[0] == 0
    write_velocities(velocities, replace(made.velocities, direction_sd=0.15))
    code, out, _ = run("align", headings, velocities)
    assert code == 4
    assert "The wheels contradict each other" in out
    code, out, _ = run("align", headings, velocities, "--odometry-sd", "3")
    assert code == 0
    assert "off by 3.0 deg (sd)" in out


def test_one_file_given_twice_is_refused_and_one_stream_doubted(run, files):
    made, headings, _ = files
    code, _, err = run("align", headings, headings)
    assert code == 2
    assert "given twice" in err
    t, v = made.headings.t, made.headings.v
    same = align(made.headings, VelocitySeries(t, 0.7 * v))
    assert "same numbers" in same.verdict.doubts[0]
    other = align(made.headings, VelocitySeries(t, 0.7 * v + [1e-6, 0, 0]))
    assert other.verdict.doubts == ()


# Causes -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("axis", "name"), [(0, "forward"), (1, "sideways")])
def test_a_speed_in_another_unit_is_named(axis, name):
    made = simulate(
        s_curve(20), np.random.default_rng(0), heading_noise=Noise(0.1), velocity_noise=Noise(0.02)
    )
    v = made.velocities.v.copy()
    v[:, axis] *= 1e-3
    verdict = align(made.headings, replace(made.velocities, v=v)).verdict
    assert verdict.summary == DISAGREE
    assert len(verdict.advice) == 1
    assert f"if the {name} speed is multiplied by 1000" in verdict.advice[0]


def test_velocities_in_the_frame_of_the_ground_are_named():
    drive = replace(s_curve(20), yaw_rate=lambda t: 0.5 * np.sin(t))
    made = simulate(
        drive, np.random.default_rng(0), heading_noise=Noise(0.1), velocity_noise=Noise(0.02)
    )
    yaw = 0.5 * (1 - np.cos(made.velocities.t))
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, z = made.velocities.v.T
    ground = replace(made.velocities, v=np.stack([c * x - s * y, s * x + c * y, z], axis=1))
    (advice,) = align(made.headings, ground).verdict.advice
    assert "are they in the frame of the ground" in advice


def test_no_cause_is_named_where_none_shows():
    rng = np.random.default_rng(1)
    v = rng.standard_normal((300, 3))
    headings = HeadingSeries(np.arange(300) / 30, v / np.linalg.norm(v, axis=1, keepdims=True))
    odometry = simulate(s_curve(10), rng, velocity_noise=Noise(0.02)).velocities
    advice = align(headings, odometry).verdict.advice
    assert advice[0].startswith("No cause shows")


# Slow noise of the odometry ---------------------------------------------------------------------


@pytest.mark.parametrize(("drift", "answered"), [(0.1, 5), (0.2, 3)])
def test_slow_noise_of_the_odometry_leaves_the_offset_of_a_polyline(drift, answered):
    """Noise with a memory of a second, a tenth and a fifth of the speed: turns of 45 deg show."""
    answers = []
    for seed in range(6):
        made = random_drives.streams(
            {
                "motion": "polyline",
                "turn_deg": 45.0,
                "heading_noise": {"sigma": 0.1},
                "velocity_noise": {"sigma": drift, "rho": 0.98},
            },
            np.random.default_rng(seed),
        )
        found = align(made.headings, made.velocities)
        answers.append(found.offset_observable)
        if found.offset_observable:
            assert abs(found.offset - made.offset) < 0.05
            low, high = found.offset_interval
            assert low < made.offset < high
            assert rotation_angle(found.R_body_cam, made.R_body_cam) < 2 * found.rotation_radius
    assert sum(answers) >= answered


def test_a_straight_drive_under_slow_noise_stays_unobservable():
    for seed in range(5):
        made = simulate(
            straight(20),
            np.random.default_rng(seed),
            heading_noise=Noise(0.1),
            velocity_noise=Noise(0.1, rho=0.98),
        )
        assert not align(made.headings, made.velocities).offset_observable


def test_rows_far_apart_are_answered_whatever_the_search():
    """Two fingers most of a minute apart: a candidate with hardly a partner is no candidate."""
    rng = np.random.default_rng(3)
    t = np.r_[np.arange(10), 57 + np.arange(9)].astype(float)
    d = np.where((t < 30)[:, None], [1.0, 0, 0], [0.5, np.sqrt(0.75), 0])
    e = d @ LOOKS_FORWARD + 0.03 * rng.standard_normal(d.shape)
    headings = HeadingSeries(t, e / np.linalg.norm(e, axis=1, keepdims=True))
    for reach in (0.3, 1.0, 5.0):
        found = align(
            headings, VelocitySeries(t, 0.3 * d), max_offset=reach, max_gap=1.5, hold=0.01
        )
        assert not found.offset_observable
        assert found.rotation_observable
        assert rotation_angle(found.R_body_cam, LOOKS_FORWARD) < found.rotation_radius

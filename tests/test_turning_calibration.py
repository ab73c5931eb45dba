"""Calibrations of bodies that turn: from nothing, with the position, and what stays unknown."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from data_tools.runs.export import read_calibration, summary_text, write_calibration
from data_tools.simulation.drives import Drive
from data_tools.simulation.recorded_drive import CAMERA
from data_tools.simulation.trajectory import Trajectory
from data_tools.studies.sighting_drives import Fault, sight
from data_tools.studies.sightings import Corners
from evcalib.alignment.verdict import CONTRADICTED
from evcalib.errors import InputError, NoAnswerError
from evcalib.geometry import LOOKS_FORWARD, rotation_angle, rotation_vector_to_matrix
from evcalib.kinematics.velocity_track import velocity_track
from evcalib.pipeline import calibrate_estimate
from evcalib.pipeline._by_turning import _at_offset
from evcalib.pipeline._derotation import at_camera, derotated
from evcalib.pipeline._turning import (
    LEADS,
    TURNS,
    turning_beyond_noise,
    turns_variously,
    yaw_rate_changes,
)
from evcalib.series import VelocitySeries
from evcalib.uncertainty import t_quantile

R_BODY_CAM = rotation_vector_to_matrix([0.2, -0.3, 0.4]) @ LOOKS_FORWARD
OFFSET, LEVER = 0.21, (0.25, -0.18, 0.3)
DURATION = 12.0


def constant(value):
    return lambda t: np.full_like(t, value)


def wave(middle, swing, period):
    return lambda t: middle + swing * np.sin(2 * np.pi * np.asarray(t) / period)


DRIVES = {
    "eight": (wave(0.0, 0.0, 1.0), wave(0.5, 0.2, 3.1), wave(0.0, 0.9, 5.7)),
    "circle": (wave(0.0, 0.0, 1.0), constant(0.5), constant(0.6)),
    "in place": (wave(0.0, 0.0, 1.0), constant(1e-4), wave(0.0, 0.9, 5.7)),
    "sweep": (wave(0.0, 1.5, 5.7), wave(0.5, 0.2, 3.1), constant(0.0)),
}


@cache
def made(kind, seed=1):
    drive = Drive(kind, DURATION, *DRIVES[kind])
    return sight(
        drive, np.random.default_rng(seed), camera=CAMERA, R_body_cam=R_BODY_CAM, offset=OFFSET,
        corners=Corners(noise=0.3, false=0.1), fault=Fault(lever=LEVER),
    )  # fmt: skip


@cache
def estimated(kind):
    return made(kind).estimate()


@cache
def calibrated(kind, position=None, height=None):
    return calibrate_estimate(
        estimated(kind), made(kind).velocities, focal=CAMERA.focal, camera_position=position,
        camera_height=height,
    )  # fmt: skip


def unknown(found, name):
    return next(one for one in found.unknowns if one.name == name)


def test_figure_eights_show_all_but_the_height():
    found = calibrated("eight")
    assert found.rotation_observable
    assert found.offset_observable
    assert rotation_angle(found.R_body_cam, R_BODY_CAM) < found.rotation_radius < np.radians(1.5)
    low, high = found.offset_interval
    assert low < OFFSET < high
    assert found.position_observable == (True, True)
    off = np.abs(found.position[:2] - LEVER[:2])
    assert (off < t_quantile(found.joint.samples) * found.position_sd[:2]).all()
    assert (found.position_sd[:2] < 0.03).all()
    assert np.isnan(found.position[2])
    assert np.isinf(found.position_sd[2])
    assert [one.determined for one in found.unknowns] == [True] * 4 + [False]
    assert not found.verdict.doubts
    assert "position x +0.2" in str(found)
    assert "z not seen" in str(found)


def test_one_covariance_holds_all_error_bars():
    found = calibrated("eight")
    whole = found.covariance
    np.testing.assert_allclose(whole[:3, :3], found.rotation_covariance)
    sd = [found.offset_sd, *found.position_sd[:2]]
    np.testing.assert_allclose(np.sqrt(np.diag(whole)[3:]), sd)
    np.testing.assert_allclose(whole, whole.T)
    assert np.linalg.eigvalsh(whole).min() > 0
    # Where nothing is known of the position, it says so.
    assert np.isinf(np.diag(calibrated("sweep").covariance)[4:]).all()


def test_headings_of_a_body_that_turns_agree_once_the_turning_is_out():
    found, drive = calibrated("eight"), Drive("eight", DURATION, *DRIVES["eight"])
    assert found.inlier_share > 0.9
    path = Trajectory.of_drive(drive)
    t = found.residuals.t + OFFSET
    velocity = np.einsum("nji,nj->ni", path.rotation_at(t), path.velocity_at(t))
    rate = path.rate_at(t)[:, 2]
    velocity += np.stack([-rate * LEVER[1], rate * LEVER[0], 0 * rate], axis=1)
    truth = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
    angle = np.degrees(np.arccos(np.clip((truth * found.residuals.turned).sum(axis=1), -1, 1)))
    assert np.median(angle) < 2.0
    before = calibrate_estimate(
        estimated("eight"), made("eight").velocities, focal=CAMERA.focal, refinement="none"
    )
    assert before.inlier_share < found.inlier_share


def test_a_position_that_was_given_is_used_or_contradicted():
    free = calibrated("eight")
    told = calibrated("eight", LEVER)
    np.testing.assert_allclose(told.position, LEVER)
    assert not told.verdict.doubts
    assert told.data_radius <= free.data_radius
    assert rotation_angle(told.R_body_cam, R_BODY_CAM) < told.rotation_radius
    wrong = calibrated("eight", (LEVER[0], LEVER[1] + 0.3, LEVER[2]))
    (doubt,) = wrong.verdict.doubts
    assert "cm from where it was said to be" in doubt
    np.testing.assert_allclose(wrong.position[:2], free.position[:2], atol=0.02)
    assert wrong.position[2] == LEVER[2]


@pytest.mark.parametrize("kind", ["circle", "in place"])
def test_motion_about_one_point_hides_yaw_and_position(kind):
    found = calibrated(kind)
    assert not found.rotation_observable
    assert found.position_observable == (False, False)
    assert np.isnan(found.position).all()
    assert abs(found.unknown_axis[2]) > 0.9
    for name in ("rotation", "x", "y"):
        assert not unknown(found, name).determined
        assert "figure-eights" in unknown(found, name).advice
    assert "trades with its yaw" in unknown(found, "x").reason
    assert found.offset_observable == (kind == "in place")
    if found.offset_observable:
        low, high = found.offset_interval
        assert low < OFFSET < high
    # The axis that the body turns about is known all the same.
    tilt = np.arccos(np.clip(found.R_body_cam[2] @ R_BODY_CAM[2], -1, 1))
    sd = np.sqrt(np.diag(found.rotation_covariance)[:2].sum())
    assert tilt < 4 * sd < np.radians(20)


def test_a_body_that_does_not_turn_says_that_the_position_is_not_seen():
    found = calibrated("sweep")
    assert found.rotation_observable
    assert found.offset_observable
    assert np.isnan(found.position).all()
    assert "does not turn" in unknown(found, "x").reason
    told = calibrated("sweep", (0.1, 0.2, 0.3))
    np.testing.assert_allclose(told.position, (0.1, 0.2, 0.3))
    assert told.position_observable == (False, False)
    assert "taken as given" in unknown(told, "y").reason
    # But for the noise of a yaw rate that is none.
    np.testing.assert_allclose(told.R_body_cam, found.R_body_cam, atol=1e-3)


def test_the_height_is_taken_from_the_user_alone():
    found = calibrated("sweep", None, 0.8)
    assert found.position[2] == 0.8
    assert "taken as given" in unknown(found, "z").reason
    assert not unknown(found, "z").advice
    for bad in ({"camera_position": (0, 0, 1.0), "camera_height": 0.8}, {"camera_height": np.nan}):
        with pytest.raises(InputError, match="camera_height"):
            calibrate_estimate(estimated("sweep"), made("sweep").velocities, focal=200.0, **bad)
    with pytest.raises(InputError, match="millimetres"):
        calibrate_estimate(
            estimated("sweep"), made("sweep").velocities, focal=200.0, camera_height=800.0
        )


def test_the_file_of_a_calibration_holds_position_and_unknowns(tmp_path):
    found = calibrated("eight")
    write_calibration(tmp_path / "calibration.yaml", found)
    content = yaml.safe_load((tmp_path / "calibration.yaml").read_text())
    assert content["position_m"][:2] == list(found.position[:2])
    assert content["position_m"][2] is None
    assert content["position_sd_m"][2] is None
    assert content["position_observable"] == [True, True, False]
    assert [one["name"] for one in content["unknowns"]] == ["rotation", "offset", "x", "y", "z"]
    assert content["unknowns"][4]["sd"] is None
    stored = read_calibration(tmp_path / "calibration.yaml")
    assert stored.position[:2] == tuple(found.position[:2])
    assert np.isnan(stored.position[2])
    assert stored.position_sd == tuple(found.position_sd[:2])
    assert "Position   of the camera in the body frame: x +0.2" in summary_text(found)


def test_too_few_sightings_of_a_body_that_turns_are_no_answer():
    drive, estimate = made("eight"), estimated("eight")
    few = estimate.correspondences.select(np.arange(len(estimate.correspondences)) < 40)
    with pytest.raises(NoAnswerError, match="too few"):
        calibrate_estimate(_with(estimate, few), drive.velocities, focal=CAMERA.focal)


def _with(estimate, correspondences):
    return replace(estimate, correspondences=correspondences)


def test_derotated_headings_without_matches_are_none():
    estimate = estimated("eight")
    none = estimate.correspondences.select(np.zeros(len(estimate.correspondences), dtype=bool))
    found = derotated(
        _with(estimate, none), np.array([0.0, -1.0, 0.0]), np.zeros_like, focal=CAMERA.focal
    )
    assert len(found.headings) == 0
    assert not found.gaps


def series(v, yaw_rate, noise=0.0):
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 12.0, 0.02)
    ones = np.ones_like(t)
    v = np.stack([v * ones, 0 * t, 0 * t], axis=1) + noise * rng.standard_normal((t.size, 3)) * [
        1, 1, 0
    ]  # fmt: skip
    return t, VelocitySeries(t, v, yaw_rate * ones + noise * rng.standard_normal(t.size))


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_what_the_odometry_says_of_turning(noise):
    t, still = series(0.5, 0.0, noise)
    track = velocity_track(still)
    assert turning_beyond_noise(still, track) < TURNS
    assert yaw_rate_changes(still, track, 0.0, 12.0) < 3.0
    _, circle = series(0.5, 0.4, noise)
    assert turning_beyond_noise(circle, track) == pytest.approx(0.4, rel=0.05)
    assert 0.4 > LEADS
    assert yaw_rate_changes(circle, track, 0.0, 12.0) < 3.0
    assert not turns_variously(circle, track, 0.0, 12.0)
    _, swinging = series(0.5, 0.4 * np.sin(t), noise)
    assert yaw_rate_changes(swinging, track, 0.0, 12.0) > 5.0
    assert turns_variously(swinging, track, 0.0, 12.0)
    # Twists that are multiples of one, though their size changes.
    _, same = series(0.5 + 0.2 * np.sin(t), 0.4 + 0.16 * np.sin(t), noise)
    assert yaw_rate_changes(same, track, 0.0, 12.0) > 5.0
    assert not turns_variously(same, track, 0.0, 12.0)
    silent = VelocitySeries(still.t, still.v)
    assert turning_beyond_noise(silent, track) == 0.0
    assert yaw_rate_changes(silent, track, 0.0, 12.0) == 0.0
    assert not turns_variously(silent, track, 0.0, 12.0)


def test_the_velocity_of_the_cameras_place_is_that_of_a_rigid_body():
    """By finite differences of its position in the world."""
    drive = Drive("eight", DURATION, *DRIVES["eight"])
    path, t = Trajectory.of_drive(drive), np.arange(1.0, 11.0, 0.1)
    told = VelocitySeries(t, drive.velocity(t), drive.yaw_rate(t))
    place = [path.position_at(t + h) + path.rotation_at(t + h) @ LEVER for h in (-1e-3, 1e-3)]
    world = (place[1] - place[0]) / 2e-3
    moved = at_camera(told, np.array(LEVER))
    assert moved.yaw_rate is None
    want = np.einsum("nji,nj->ni", path.rotation_at(t), world)
    np.testing.assert_allclose(moved.v, want, atol=2e-3)
    straight = VelocitySeries(t, told.v)
    assert at_camera(straight, np.array(LEVER)) is straight


@pytest.mark.parametrize("given", [None, OFFSET])
def test_headings_that_contradict_a_refinement_at_a_given_offset_take_it_back(given):
    found = calibrated("eight")
    turned = replace(found, R_body_cam=rotation_vector_to_matrix([0, 0, 0.3]) @ found.R_body_cam)
    asked = SimpleNamespace(offset=given, max_offset=1.0)
    for aligned, contradicted in ((found, False), (turned, given is not None)):
        held = _at_offset(aligned, found.joint, estimated("eight").headings, 0.5, asked)
        assert (held.verdict.summary == CONTRADICTED) is contradicted
        assert bool(held.verdict.doubts) is contradicted
        assert held.rotation_observable is (given is not None and not contradicted)


def test_headings_that_say_nothing_do_not_stand_in_the_way():
    """The sightings start by themselves, where the alignment has no answer."""
    estimate = estimated("sweep")
    v = np.random.default_rng(0).standard_normal(estimate.headings.v.shape)
    odd = replace(estimate.headings, v=v / np.linalg.norm(v, axis=1, keepdims=True))
    found = calibrate_estimate(
        replace(estimate, headings=odd), made("sweep").velocities, focal=CAMERA.focal
    )
    assert found.joint is not None
    assert np.degrees(rotation_angle(found.joint.R_body_cam, R_BODY_CAM)) < 1.0
    assert abs(found.joint.offset - OFFSET) < 0.02


def test_a_body_that_only_turns_shows_the_offset_and_its_axis():
    """Wheels that say 0.0 m/s all the time."""
    drive = made("in place")
    velocities = replace(drive.velocities, v=np.zeros_like(drive.velocities.v))
    found = calibrate_estimate(estimated("in place"), velocities, focal=CAMERA.focal)
    assert not found.rotation_observable
    assert found.offset_observable
    assert abs(found.offset - OFFSET) < 0.03
    straight = replace(velocities, yaw_rate=0 * velocities.t)
    with pytest.raises(InputError, match="does not move"):
        velocity_track(straight)

"""The campaign: sightings against closed forms, errors of the model that are told, the study."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from data_tools.simulation import random_drives
from data_tools.simulation.drives import Drive, s_curve, straight
from data_tools.studies import Study, campaign, run_study, sighting_drives
from data_tools.studies import _campaign_faults as draws
from data_tools.studies.sighting_drives import Fault, sight
from data_tools.studies.sightings import Corners, unit_noise
from evcalib.camera import Camera
from evcalib.geometry import LOOKS_FORWARD, random_rotation, rotation_angle

CAMERA = Camera(240, 180, 150.0, 150.0, 119.5, 89.5)
EXACT = Corners(noise=0.0)
OFFSET = 0.2


def seen(drive, *, corners=EXACT, seed=0, R=None, noise=0.0, **fault):
    rng = np.random.default_rng(seed)
    return sight(
        drive,
        rng,
        camera=CAMERA,
        R_body_cam=random_rotation(rng) if R is None else R,
        offset=OFFSET,
        corners=corners,
        odometry_noise=noise,
        fault=Fault(**fault),
    )


def tracks_of(made, shortest=4):
    """Yield times and pixels of each corner."""
    s = made.sightings
    for corner in np.unique(s.corner):
        rows = s.corner == corner
        if rows.sum() >= shortest:
            yield s.t[s.keyframe[rows]], s.xy[rows]


# Sightings --------------------------------------------------------------------------------------


def test_ahead_of_a_straight_drive_corners_run_from_its_goal_as_one_over_what_is_left():
    """A corner at distance Z off the axis by X: f X / (Z - v t), so one over it is linear."""
    made, count = seen(straight(8.0, speed=0.5), R=LOOKS_FORWARD), 0
    for t, xy in tracks_of(made):
        x, y = (xy - (CAMERA.cx, CAMERA.cy)).T
        for away in (x, y):
            slope, level = np.polyfit(t, 1.0 / away, 1)
            np.testing.assert_allclose(1.0 / away, slope * t + level, rtol=1e-6, atol=1e-9)
            # It would be reached at Z / v: never before it is last seen.
            assert -level / slope > t[-1]
        count += 1
    assert count > 30


def test_beside_a_straight_drive_corners_pass_evenly():
    sideways = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    for t, xy in tracks_of(seen(straight(8.0, speed=0.5), R=sideways)):
        line = np.polyfit(t, xy, 1)
        np.testing.assert_allclose(xy, np.outer(t, line[0]) + line[1], atol=1e-6)
        assert line[0, 0] < 0
        assert abs(line[0, 1]) < 1e-6


def test_matches_lie_on_their_epipolar_planes():
    made = seen(straight(8.0, heading=0.4, speed=0.5))
    c = made.estimate().correspondences
    heading = made.R_body_cam.T @ [np.cos(0.4), np.sin(0.4), 0.0]
    assert np.abs(np.cross(c.r1, c.r2) @ heading).max() < 1e-9
    assert c.inlier.all()


def test_false_matches_are_a_share_of_all_and_those_on_movers_agree_with_none():
    drive = straight(8.0, heading=0.4, speed=0.5)
    heading = [np.cos(0.4), np.sin(0.4), 0.0]
    for corners, at_least, at_most in [
        (replace(EXACT, false=0.3), 0.2, 0.3),
        (replace(EXACT, movers=((2.0, 4.0),)), 0.05, 0.5),
    ]:
        made = seen(drive, corners=corners)
        c = made.estimate().correspondences
        off = np.abs(np.cross(c.r1, c.r2) @ made.R_body_cam.T @ heading) > 1e-6
        assert at_least < off.mean() < at_most


def test_noise_has_the_size_and_the_memory_that_are_asked_for():
    rng, corner = np.random.default_rng(0), np.repeat(np.arange(3000), 3)
    keyframe = np.tile([0, 1, 40], 3000)
    for memory, expected in [(0.0, 0.0), (0.5, 0.5 * np.exp(-1 / 8 / 0.5))]:
        noise = unit_noise(rng, corner, keyframe, memory).reshape(3000, 3, 2)
        assert noise.std() == pytest.approx(1.0, abs=0.03)
        across = np.mean(noise[:, 0] * noise[:, 1])
        assert across == pytest.approx(expected, abs=0.05)
        assert np.mean(noise[:, 0] * noise[:, 2]) == pytest.approx(0.0, abs=0.05)


def test_gaps_are_kept_free():
    made = seen(straight(8.0), corners=replace(EXACT, gaps=((2.0, 3.0),)))
    assert not ((made.sightings.t > 2.0) & (made.sightings.t < 3.0)).any()
    assert made.sightings.t.size > 40


# Errors of the model ----------------------------------------------------------------------------


def test_velocities_are_told_as_the_errors_say():
    drive = straight(8.0, heading=0.4, speed=0.5)
    plain = seen(drive).velocities
    v = plain.v[0]
    assert v == pytest.approx([0.5 * np.cos(0.4), 0.5 * np.sin(0.4), 0.0])
    assert seen(drive, radius=1.05).velocities.v[0] == pytest.approx(1.05 * v)
    assert seen(drive, slip=0.1).velocities.v[0] == pytest.approx(v * [1, 1.1, 1])
    turned = seen(drive, steering=0.1).velocities.v[0]
    assert turned == pytest.approx([0.5 * np.cos(0.5), 0.5 * np.sin(0.5), 0.0])
    assert seen(drive, yaw=0.1, yaw_told=False).velocities.yaw_rate is None
    assert np.abs(seen(drive, yaw=0.1).velocities.yaw_rate).max() > 0.05


def test_times_that_are_cut_are_whole_multiples_and_never_late():
    plain, cut = (seen(straight(8.0), quantum=q).velocities.t for q in (0.0, 0.02))
    np.testing.assert_allclose(cut / 0.02, np.rint(cut / 0.02), atol=1e-6)
    assert ((plain - cut > -1e-9) & (plain - cut < 0.02)).all()


def test_a_drifting_clock_is_right_in_the_middle():
    """Seen ahead of a straight drive, the time of reaching a corner tells the camera's clock."""
    t = np.linspace(0.0, 7.0, 57)
    rng = np.random.default_rng(0)
    off = sighting_drives._clock_error(Fault(drift=1e-3), t, rng)
    assert off == pytest.approx(1e-3 * (t - 3.5))
    swing = sighting_drives._clock_error(Fault(latency=0.01, latency_period=3.5), t, rng)
    assert swing.mean() == pytest.approx(0.0, abs=1e-12)
    assert np.ptp(swing) == pytest.approx(0.02, rel=0.02)


def shaken(drive, **fault):
    """Return times, and rotation vectors (n, 3) of a body that should not turn [rad]."""
    t = np.arange(0.0, drive.duration, 0.005)
    return t, sighting_drives._shake(drive, np.random.default_rng(0), Fault(**fault))(t)


def test_a_body_that_speeds_up_evenly_leans_back_and_to_the_outside():
    """At 0.5 m/s^2 forward, and to the left: the nose goes up, and the left side."""
    for heading, axis, sense in ((0.0, 1, -1.0), (np.pi / 2, 0, 1.0)):
        drive = Drive("even", 8.0, lambda t, h=heading: h + 0.0 * t, lambda t: 0.5 * t)
        t, lean = shaken(drive, tilt=0.02)
        # It swings at 2 Hz, and has settled to 1 % after a few seconds; the end is an end.
        settled = (t > 2.0) & (t < 7.9)
        np.testing.assert_allclose(lean[settled, axis], sense * 0.01, rtol=0.01)
        assert np.abs(np.delete(lean, axis, axis=1)).max() < 1e-12
        # A damping of 0.4 overshoots by exp(-pi 0.4 / sqrt(1 - 0.4^2)).
        most = 0.01 * (1 + np.exp(-np.pi * 0.4 / np.sqrt(0.84)))
        assert np.abs(lean[t < 7.9]).max() == pytest.approx(most, rel=0.02)


def test_a_vibrating_body_turns_by_as_much_as_told_about_each_axis():
    _, turn = shaken(straight(20.0), vibration=0.005)
    np.testing.assert_allclose(turn.std(axis=0), 0.005, rtol=0.1)
    assert not shaken(straight(2.0))[1].any()


# What the calibration makes of them ---------------------------------------------------------------


def swinging(duration=12.0, speed=0.6):
    """An S-curve whose speed changes too."""
    curve = s_curve(duration, amplitude=1.2, period=5.0, heading=0.3, speed=speed)
    return Drive("s", duration, curve.angle, lambda t: speed * (1 + 0.3 * np.sin(2.1 * t)))


def off(found, made):
    """Return the errors: ms, deg."""
    turn = np.degrees(rotation_angle(found.R_body_cam, made.R_body_cam))
    return 1e3 * abs(found.offset - made.offset), turn


def test_exact_sightings_give_the_exact_answer_and_leave_no_doubt():
    made = seen(swinging())
    found = made.calibrate()
    time, turn = off(found, made)
    assert time < 0.3
    assert turn < 0.02
    assert found.offset_observable
    assert found.rotation_observable
    assert found.verdict.doubts == ()


def test_the_noise_of_the_odometry_does_not_bend_the_answer():
    """Velocities smoothed over 0.8 s either way lose their peaks: that was 0.2 to 0.6 deg."""
    corners, turns = Corners(noise=0.05, count=10), []
    for seed in range(4):
        made = seen(swinging(), corners=corners, seed=seed, noise=0.01)
        turns.append(off(made.calibrate(max_offset=0.3), made)[1])
    assert np.median(turns) < 0.1


def test_clocks_that_drift_apart_are_told_with_their_rate():
    corners = Corners(noise=0.2, count=8)
    made = seen(swinging(60.0), corners=corners, noise=0.005, drift=500e-6)
    found = made.calibrate(max_offset=0.3)
    drift = found.joint.drift
    assert drift.values[0] == pytest.approx(500e-6, abs=4 * drift.sd[0])
    assert drift.sd[0] < 150e-6
    assert any("clocks drift apart by" in doubt for doubt in found.verdict.doubts)
    assert "contradict the model" in found.verdict.summary
    assert found.verdict.doubts[0] in str(found.verdict)
    # In the middle of the drive the offset is right.
    assert off(found, made)[0] < 3.0


def test_a_wrong_focal_length_shows_where_directions_are_wide_apart():
    corners = Corners(noise=0.2, count=8)
    drive = swinging(40.0)
    made = seen(drive, corners=corners, noise=0.005, R=LOOKS_FORWARD, focal=1.05)
    found = made.calibrate(max_offset=0.3)
    assert any("check the camera's focal length" in doubt for doubt in found.verdict.doubts)
    # Angles off the axis grow by 5 % sin(2 angle) / 2.
    assert np.hypot(*found.joint.distortion.values) == pytest.approx(0.025, rel=0.4)
    right = seen(drive, corners=corners, noise=0.005, R=LOOKS_FORWARD).calibrate(max_offset=0.3)
    assert right.verdict.doubts == ()


def test_a_body_that_turns_unseen_by_its_wheels_is_noticed_and_costs_little():
    corners = Corners(noise=0.2, count=10)
    made = seen(swinging(), corners=corners, noise=0.005, yaw=0.1, yaw_told=False, seed=1)
    found = made.calibrate(max_offset=0.3)
    assert found.joint.turning > 0.02
    assert any("that the odometry does not tell" in doubt for doubt in found.verdict.doubts)
    time, turn = off(found, made)
    assert turn < 1.0
    assert turn < np.degrees(found.rotation_radius)
    assert time < 1e3 * (found.offset_interval[1] - found.offset)


@pytest.mark.parametrize("trial", [8, 9])
def test_the_offset_of_a_constant_arc_is_not_claimed(monkeypatch, trial):
    """Noise of the odometry picked one of many offsets: 0.5 s and 15 deg off, and sure of it."""
    monkeypatch.setattr(random_drives, "ANY", {"arc": 1.0})
    seed = np.random.SeedSequence(5, spawn_key=(0, trial))
    (row,) = campaign.trial(campaign.CELLS[0].parameters, seed)
    assert row["motion"] == "arc"
    assert not row["determined"]


# The study --------------------------------------------------------------------------------------


def test_every_error_and_every_motion_is_drawn():
    rng = np.random.default_rng(0)
    kinds = {random_drives.any_drive(rng).kind for _ in range(300)}
    assert kinds == set(random_drives.ANY)
    assert sum(random_drives.ANY.values()) == pytest.approx(1.0)
    for cell in campaign.study().cells:
        fault, size = draws.FAULTS[cell.parameters["fault"]](rng, CAMERA)
        assert (fault == Fault()) == (cell.parameters["fault"] == "none")
        assert np.isfinite(size)
    assert {cell.parameters["fault"] for cell in campaign.CELLS} == set(draws.FAULTS)


def test_the_study_gives_the_same_bytes_in_two_processes(tmp_path):
    few = Study("few", campaign.CELLS[:2], campaign.trial)
    one, two = (
        run_study(few, trials=1, seed=1, folder=tmp_path / str(workers), workers=workers)
        for workers in (1, 2)
    )
    assert one.path.read_bytes() == two.path.read_bytes()
    assert not one.failures
    rows = campaign.verdicts([one])
    assert rows[0]["trials"] == 1
    assert rows[-1]["trials"] == 2


def test_verdicts_are_counted_as_by_hand():
    name = campaign.CELLS[4].group
    table = {
        "group": np.array([name] * 4),
        "failure": np.array(["", "", "", "worker died"]),
        "determined": np.array([True, True, False, True]),
        "doubts": np.array(["", "drift", "", ""]),
        "offset_error_s": np.array([-0.004, 0.1, 0.2, 0.3]),
        "rotation_deg": np.array([1.0, 1.0, 1.0, 1.0]),
        "size": np.array([-200.0, 100.0, 100.0, 100.0]),
        **{f"offset_{level}_s": np.full(4, 0.003) for level in (95, 99)},
        **{f"rotation_{level}_deg": np.full(4, 2.0) for level in (95, 99)},
        "cell": np.arange(4),
    }
    rows = campaign.verdicts([SimpleNamespace(table=table)])
    found = next(row for row in rows if row["group"] == name)
    assert found == {
        "group": name,
        "trials": 3,
        "determined": 2,
        "confident": 1,
        "outside_95": 1.0,
        "outside_99": 1.0,
        "offset_ms": 4.0,
        "rotation_deg": 1.0,
        "offset_ms_per_unit": 0.02,
        "rotation_deg_per_unit": 0.005,
    }
    assert rows[-1]["confident"] == 1

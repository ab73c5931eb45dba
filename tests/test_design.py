"""Predicted precision: against closed forms, and against what estimators reach."""

from dataclasses import replace

import numpy as np
import pytest
from naive_design import naive_information

from data_tools.simulation.drives import Drive, arc, fingers, s_curve, straight, zigzag
from evcalib.design import Viewing, _information, predict, self_likeness
from evcalib.design._information import OBSERVATIONS, SPREAD, STEP
from evcalib.errors import InputError
from evcalib.joint import SYSTEMATIC, Systematic
from evcalib.series import VelocitySeries

SHARP = Viewing(focal=2000.0, noise=3.0, lean_sd=0.0)
"""As the usual one, but so sharp that even corners close to the point ahead flow and are seen."""
NOTHING = Systematic(lag_sd=0.0, time_sd=0.0, rotation_sd=0.0, yaw_rate_sd=0.0)
SHIFTS = np.round(np.arange(-1.0, 1.005, 0.01), 2)


def logged(drive):
    t = np.arange(0.0, drive.duration, 0.01)
    return VelocitySeries(t, drive.velocity(t), drive.yaw_rate(t))


def directions(viewing):
    """Return the variance of one direction of travel ahead, from corners seen for 0.6 s.

    A corner at the bearing b shows of a displacement to the left what is across its own way away
    from the point ahead: ``left . (b x ahead) / |b x ahead|``, in units of its distance.
    """
    b = viewing.bearings
    across = np.cross(b, [1.0, 0.0, 0.0])
    share = across[:, 1] ** 2 / (across**2).sum(axis=1)
    near = np.resize([SPREAD, SPREAD[::-1]], len(b)) ** 2
    t = STEP * np.arange(OBSERVATIONS + 1)
    return viewing.step_sd**2 / np.mean(near * share) / (0.25 * np.sum((t - t.mean()) ** 2))


def test_a_slow_s_curve_reaches_the_bound_of_its_headings():
    """Var(offset) = noise^2 per heading / sum (omega - mean)^2; a new corner every 0.6 s."""
    drive, viewing = s_curve(24.0, amplitude=0.05, period=12.0, speed=0.5), SHARP
    rate = (2 * np.pi / 12) * 0.05 * np.cos(2 * np.pi / 12 * np.arange(0.3, 23.7, STEP))
    bound = np.sqrt(directions(viewing) * 12 / np.sum((rate - rate.mean()) ** 2))
    for speed in (True, False):
        found = predict(logged(drive), viewing=viewing, systematic=NOTHING, speed=speed)
        assert found.offset_sd == pytest.approx(bound, rel=0.03)


def test_rotation_about_the_vertical_is_a_mean_of_directions():
    drive, viewing = s_curve(24.0, amplitude=0.01, period=12.0, speed=0.5), SHARP
    corners = (24.0 / STEP - 12) / 12
    found = predict(logged(drive), viewing=viewing, systematic=NOTHING)
    want = np.sqrt(directions(viewing) / corners)
    assert found.rotation_sd[2] == pytest.approx(want, rel=0.03)


@pytest.mark.parametrize("drive", [straight(16.0), arc(16.0, radius=3.0), arc(16.0, radius=1.0)])
def test_lines_and_arcs_at_constant_speed_show_no_offset(drive):
    found = predict(logged(drive))
    assert not found.offset_determined
    assert found.offset_sd > 0.9
    assert found.likeness.min() > 0.999
    assert "not the offset" in found.summary or "neither" in found.summary
    assert "Drive curves" in " ".join(found.advice)


def test_a_straight_line_does_not_show_the_rotation_about_itself():
    found = predict(logged(straight(16.0, heading=0.3)))
    axis = np.array([np.cos(0.3), np.sin(0.3), 0.0])
    assert axis @ found.covariance[:3, :3] @ axis == pytest.approx(np.pi**2, rel=0.01)
    assert not found.rotation_determined
    assert "two directions" in " ".join(found.advice)


def test_fingers_show_the_offset_by_their_speed_alone():
    drive = logged(fingers([0.0, np.pi / 3, -np.pi / 3], speed=0.5))
    assert predict(drive).offset_sd < 0.005
    assert predict(drive, speed=False).offset_sd > 20 * predict(drive).offset_sd
    assert predict(drive).rotation_determined


def test_stop_and_go_on_a_line_shows_the_offset_but_not_the_rotation():
    drive = Drive("go", 16.0, np.zeros_like, lambda t: 0.5 + 0.3 * np.sin(t) + 0.1 * np.sin(3 * t))
    found = predict(logged(drive))
    assert found.offset_determined
    assert not found.rotation_determined
    assert found.summary == "This drive will show the offset, but not the whole rotation."


def test_a_fast_zigzag_repeats_itself_half_a_period_on():
    drive = logged(zigzag(16.0, side=0.7, turn_time=0.3))
    found = predict(drive)
    assert found.repeats
    assert not found.offset_determined
    assert "period" in " ".join(found.advice)
    again = self_likeness(drive, np.array([0.7, 0.35]))
    assert again[0] > 0.99 > again[1] + 0.05
    assert not predict(drive, max_offset=0.3).repeats


def test_the_bound_scales_as_it_should():
    drive = logged(s_curve(16.0, speed=0.5))
    usual = Viewing(lean_sd=0.0)
    one = predict(drive, viewing=usual, systematic=NOTHING).offset_sd
    four = predict(drive, viewing=replace(usual, corners=80), systematic=NOTHING).offset_sd
    assert four == pytest.approx(one / 2, rel=1e-3)
    # Noise goes with the square root, distance with one; but slow corners are not seen.
    loud = predict(drive, viewing=replace(usual, noise=0.6), systematic=NOTHING).offset_sd
    assert loud == pytest.approx(2 * one, rel=1e-3)


def test_what_all_observations_share_is_added():
    drive = logged(s_curve(16.0, speed=0.5))
    shared = Systematic(lag_sd=0.0, time_sd=0.003, rotation_sd=0.01, yaw_rate_sd=0.0)
    one, more = (predict(drive, systematic=known) for known in (NOTHING, shared))
    assert more.offset_sd == pytest.approx(np.hypot(one.offset_sd, 0.003))
    np.testing.assert_allclose(more.rotation_sd, np.hypot(one.rotation_sd, 0.01))
    # A lag of 0.1 px is 2.5 ms at 40 px/s, but changes of speed tell it from an offset.
    assert one.offset_sd < predict(drive).offset_sd
    untold = VelocitySeries(drive.t, drive.v)
    assert predict(untold).rotation_sd[2] > predict(drive).rotation_sd[2]


# Bodies that turn -------------------------------------------------------------------------------


def turning(rate, speed=lambda t: 0.5 + 0.15 * np.sin(0.9 * t), angle=np.zeros_like):
    return logged(Drive("turning", 16.0, angle, speed, rate))


def constant(value):
    return lambda t: np.full_like(t, value)


def test_figure_eights_show_everything():
    found = predict(turning(lambda t: 0.8 * np.sin(2 * np.pi * t / 8)))
    assert found.turns
    assert found.offset_determined
    assert found.rotation_determined
    assert found.position_determined
    assert (found.position_sd < 0.02).all()
    assert found.summary.endswith("the offset, the rotation and the camera's position.")
    assert found.advice == ()


def test_a_constant_circle_trades_yaw_for_position():
    found = predict(turning(constant(0.5), constant(0.5)))
    assert not found.offset_determined
    assert not found.position_determined
    assert np.degrees(found.rotation_sd[:2]).max() < 1 < np.degrees(found.rotation_sd[2])
    assert "neither the offset, the whole rotation nor the camera's position" in found.summary
    assert "figure-eights" in " ".join(found.advice)


def test_turning_in_place_shows_the_axis_and_the_offset_only():
    found = predict(turning(lambda t: 0.6 * np.sin(2 * np.pi * t / 5), constant(0.0)))
    assert found.offset_determined
    assert not found.rotation_determined
    assert not found.position_determined
    assert np.degrees(found.rotation_sd[:2]).max() < 1
    steady = predict(turning(constant(0.6), constant(0.0)))
    assert not steady.offset_determined


def test_without_turning_the_position_stays_as_it_was():
    found = predict(logged(s_curve(16.0, speed=0.5)))
    assert not found.turns
    np.testing.assert_allclose(found.position_sd, 1.0, rtol=1e-6)
    assert "position" not in found.summary
    assert found.covariance.shape == (6, 6)


def test_the_information_is_that_of_exact_projections(monkeypatch):
    """Slow twin: every bearing by projection, derivatives by differences, one corner at a time."""
    monkeypatch.setattr(_information, "GRID", (2, 2))
    rng = np.random.default_rng(3)
    # The fast one is of first order in displacement / distance.
    viewing = Viewing(focal=2000.0, noise=0.1, distance=30.0, direction=0.4, position=(0.15, -0.2))
    rate, side = rng.uniform(0.3, 0.9, 2)
    t = np.arange(0.0, 2.0 + 1e-9, 0.01)
    velocities = VelocitySeries(
        t,
        np.column_stack([0.9 + 0.4 * np.sin(2 * t), 0.5 * np.sin(side + 3 * t), 0 * t]),
        rate * np.cos(2.5 * t),
    )
    fast = np.linalg.inv(_information.information(velocities, viewing, SYSTEMATIC, True) +
                         1e-6 * np.eye(9))  # fmt: skip
    slow = np.linalg.inv(naive_information(velocities, viewing, SYSTEMATIC) + 1e-6 * np.eye(9))
    np.testing.assert_allclose(np.sqrt(np.diag(fast)), np.sqrt(np.diag(slow)), rtol=0.07)
    # Correlations of the mounting; the lag's and the lean's signs are free.
    scale = np.sqrt(np.outer(np.diag(slow), np.diag(slow)))
    mounting = np.ix_([0, 1, 2, 3, 5, 6], [0, 1, 2, 3, 5, 6])
    np.testing.assert_allclose((fast / scale)[mounting], (slow / scale)[mounting], atol=0.1)


def test_likeness_does_not_depend_on_the_frame():
    drive = logged(s_curve(16.0))
    c, s = np.cos(0.7), np.sin(0.7)
    turned = VelocitySeries(drive.t, drive.v @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
    for speed in (True, False):
        here = self_likeness(drive, SHIFTS, speed=speed)
        assert here == pytest.approx(self_likeness(turned, SHIFTS, speed=speed), abs=1e-9)
        assert here[100] == pytest.approx(1.0)
        assert here.max() <= 1 + 1e-9


def test_unusable_drives_are_refused():
    with pytest.raises(InputError, match="must be VelocitySeries, not ndarray; make it"):
        predict(np.zeros((50, 3)))
    with pytest.raises(InputError, match="at least"):
        predict(logged(straight(1.0)))
    still = VelocitySeries(np.arange(0, 5, 0.1), np.zeros((50, 3)))
    with pytest.raises(InputError, match="does not move"):
        predict(still)
    with pytest.raises(InputError, match="max_offset"):
        predict(logged(straight(8.0)), max_offset=0.0)

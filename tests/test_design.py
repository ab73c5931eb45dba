"""Predicted precision: against closed forms, and against what estimators reach."""

import numpy as np
import pytest

from data_tools.simulation.drives import Drive, arc, fingers, s_curve, straight, zigzag
from evcalib.design import Viewing, predict, self_likeness
from evcalib.design._prediction import STEP
from evcalib.errors import InputError
from evcalib.joint import SYSTEMATIC
from evcalib.series import VelocitySeries

SHIFTS = np.round(np.arange(-1.0, 1.005, 0.01), 2)


def logged(drive):
    t = np.arange(0.0, drive.duration, 0.01)
    return VelocitySeries(t, drive.velocity(t))


def without_floor(prediction):
    return np.sqrt(prediction.offset_sd**2 - SYSTEMATIC.time_sd**2)


def test_a_slow_s_curve_reaches_the_bound_of_its_headings():
    """Var(offset) = noise^2 per heading / sum (omega - mean)^2, the heading noise being s / v T."""
    drive, viewing = s_curve(24.0, amplitude=0.2, period=12.0, speed=0.5), Viewing()
    # Displacements since the first observation, less their mean, fix a direction as a line's slope
    # does: variance s^2 / (v^2 sum (t - mean t)^2) per corner, a new one every 0.6 s.
    t = STEP * np.arange(13)
    direction = viewing.step_sd**2 / (0.25 * np.sum((t - t.mean()) ** 2))
    rate = (2 * np.pi / 12) * 0.2 * np.cos(2 * np.pi / 12 * np.arange(0.3, 23.7, STEP))
    bound = np.sqrt(direction * 12 / np.sum((rate - rate.mean()) ** 2))
    assert without_floor(predict(logged(drive))) == pytest.approx(bound, rel=0.02)
    assert without_floor(predict(logged(drive), speed=False)) == pytest.approx(bound, rel=0.1)


def test_rotation_about_the_vertical_is_a_mean_of_directions():
    drive, viewing = s_curve(24.0, amplitude=0.01, period=12.0, speed=0.5), Viewing()
    t = STEP * np.arange(13)
    direction = viewing.step_sd**2 / (0.25 * np.sum((t - t.mean()) ** 2))
    corners = (24.0 / STEP - 12) / 12
    want = np.sqrt(direction / corners + SYSTEMATIC.rotation_sd**2)
    assert predict(logged(drive)).rotation_sd[2] == pytest.approx(want, rel=0.01)


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
    one = without_floor(predict(drive))
    four = without_floor(predict(drive, viewing=Viewing(corners=80)))
    assert four == pytest.approx(one / 2, rel=1e-3)
    far = without_floor(predict(drive, viewing=Viewing(distance=5.0)))
    assert far == pytest.approx(2 * one, rel=1e-3)


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

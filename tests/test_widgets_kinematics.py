"""The swerve panel without a browser: every corner of its sliders, and the numbers it shows."""

import itertools
import re

import matplotlib.image
import numpy as np
import pytest

from evcalib.kinematics import Swerve, Wheel
from evcalib.widgets import SwervePanel
from evcalib.widgets import kinematics as module

PLACES = {"fl": (0.3, 0.25), "fr": (0.3, -0.25), "rl": (-0.3, 0.25), "rr": (-0.3, -0.25)}
CORNERS = Swerve(tuple(Wheel(name, *place) for name, place in PLACES.items()))


@pytest.fixture
def panel():
    return SwervePanel(CORNERS)


def shown(panel):
    """Return the numbers of the table, one row per method: v_x, v_y, yaw rate, slip."""
    cells = re.findall(r"right'>(-?[\d.]+)</td>", panel.numbers.value)
    return np.array(cells, dtype=float).reshape(2, 4)


@pytest.mark.parametrize("motion", module.MOTIONS)
def test_each_start_shows_its_own_motion(panel, motion):
    panel.motion.value = motion
    fit, _ = shown(panel)
    np.testing.assert_allclose(fit, [*module.MOTIONS[motion], 0.0], atol=0.005)


def test_sliders_change_picture_and_numbers(panel):
    before = panel.picture.value
    panel.speed["fl"].value += 0.4
    assert panel.picture.value != before
    fit, average = shown(panel)
    np.testing.assert_allclose(fit[0], 0.9)
    np.testing.assert_allclose(average[0], 0.9)
    assert fit[3] > 0


def test_reversed_wheels_turned_round_change_nothing(panel):
    before = shown(panel)
    for name in ("fl", "rr"):
        panel.speed[name].value *= -1
        panel.steer[name].value = 180.0
    np.testing.assert_array_equal(shown(panel), before)


def test_every_corner_of_the_sliders_is_drawn(panel, monkeypatch, tmp_path):
    """Speeds and angles at their limits and at zero, two wheels at a time; a few as pictures."""
    drawn = []
    monkeypatch.setattr(module, "draw_states", lambda *a: drawn.append(a) or b"")
    sliders = [panel.speed["fl"], panel.steer["fl"], panel.speed["rr"], panel.steer["rr"]]
    for values in itertools.product(*[(s.min, 0.0, s.max) for s in sliders]):
        for slider, value in zip(sliders, values, strict=True):
            slider.value = value
        assert np.isfinite(shown(panel)).all()
    monkeypatch.undo()
    for vehicle, states in drawn[:: len(drawn) // 8]:
        path = tmp_path / "picture.png"
        path.write_bytes(module.draw_states(vehicle, states))
        assert matplotlib.image.imread(path).std() > 0.05


def test_all_wheels_at_rest_are_a_body_at_rest(panel):
    for slider in panel.speed.values():
        slider.value = 0.0
    np.testing.assert_array_equal(shown(panel), 0)


def test_the_same_states_give_the_same_bytes(panel):
    states = panel.states()
    assert module.draw_states(CORNERS, states) == module.draw_states(CORNERS, states)


def test_the_panel_of_a_vehicle_that_averages_draws_too():
    panel = SwervePanel(Swerve(CORNERS.wheels[:2], "average"))
    assert set(panel.speed) == {"fl", "fr"}
    assert bytes(panel.picture.value).startswith(b"\x89PNG")

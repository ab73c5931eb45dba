"""The swerve panel without a browser: every corner of its sliders, and the numbers it shows."""

import itertools
import math
import re

import cv2
import matplotlib.pyplot as plt
import numpy as np
import pytest

from data_tools.simulation.streams import dead_reckon
from evcalib.kinematics import Swerve, Wheel
from evcalib.plots.kinematics import _placed, draw_travel
from evcalib.series import VelocitySeries
from evcalib.widgets import kinematics as module
from evcalib.widgets.kinematics import SwervePanel

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


def test_every_corner_of_the_sliders_is_drawn(panel, monkeypatch):
    """Speeds and angles at their limits and at zero, two wheels at a time; a few as pictures."""
    drawn = []
    monkeypatch.setattr(panel, "draw", lambda states: drawn.append(states) or b"")
    sliders = [panel.speed["fl"], panel.steer["fl"], panel.speed["rr"], panel.steer["rr"]]
    for values in itertools.product(*[(s.min, 0.0, s.max) for s in sliders]):
        with panel._at_once():
            for slider, value in zip(sliders, values, strict=True):
                slider.value = value
        assert np.isfinite(shown(panel)).all()
    monkeypatch.undo()
    for states in drawn[:: len(drawn) // 8]:
        for panel.time.value in (0, 3000):
            image = cv2.imdecode(np.frombuffer(panel.draw(states), np.uint8), cv2.IMREAD_COLOR)
            assert image.std() > 10


@pytest.mark.parametrize("motion", module.MOTIONS)
@pytest.mark.parametrize("t", [0.0, 0.4, 3.0])
def test_a_constant_twist_goes_where_dead_reckoning_goes(motion, t):
    twist = module.MOTIONS[motion]
    place, turn = _placed(twist, t)
    times = np.linspace(0.0, t, 2000) + np.arange(2000) * 1e-12
    v = np.tile([*twist[:2], 0.0], (2000, 1))
    path = dead_reckon(VelocitySeries(times, v, np.full(2000, twist[2])))
    np.testing.assert_allclose(place, path[-1, :2], atol=1e-5)
    np.testing.assert_allclose(
        np.arctan2(turn[1, 0], turn[0, 0]), math.remainder(twist[2] * t, math.tau)
    )


def test_travel_is_drawn_from_the_start_to_the_end():
    figure, ax = plt.subplots()
    states = CORNERS.wheel_states([[0.5, 0.0]], [0.0])
    draw_travel(ax, CORNERS, states, seconds=3.0, now=1.0)
    (line,) = (line for line in ax.lines if len(line.get_xdata()) > 2)
    np.testing.assert_allclose(line.get_xydata()[[0, -1]], [[0, 0], [0, 1.5]], atol=1e-12)
    assert ax.get_xlim()[0] > ax.get_xlim()[1], "left is left"
    plt.close(figure)


def test_reset_brings_the_first_picture_back(panel):
    first, words = panel.picture.value, panel.numbers.value
    panel.motion.value, panel.time.value = "spin on the spot", 2000
    panel.speed["fl"].value = 0.3
    assert panel.picture.value != first
    panel.reset.click()
    assert (panel.picture.value, panel.numbers.value) == (first, words)
    panel.speed["fl"].value = 0.3
    panel.reset.click()
    assert (panel.picture.value, panel.numbers.value) == (first, words)


def test_all_wheels_at_rest_are_a_body_at_rest(panel):
    for slider in panel.speed.values():
        slider.value = 0.0
    np.testing.assert_array_equal(shown(panel), 0)


def test_the_same_states_give_the_same_bytes(panel):
    states = panel.states()
    assert panel.draw(states) == panel.draw(states)


def test_the_panel_of_a_vehicle_that_averages_draws_too():
    panel = SwervePanel(Swerve(CORNERS.wheels[:2], "average"))
    assert set(panel.speed) == {"fl", "fr"}
    assert bytes(panel.picture.value).startswith(b"\x89PNG")

"""The panel of motions that turn, without a browser: every corner, rings, and what it says."""

import itertools

import numpy as np
import pytest

from data_tools.simulation.drives import PLANS
from evcalib.errors import InputError
from evcalib.widgets.turning import TurningPanel

MOTIONS = {name: PLANS[name] for name in ("figure-eight", "parking", "turning in place", "arc")}


@pytest.fixture
def panel():
    return TurningPanel(MOTIONS)


@pytest.fixture
def quiet(monkeypatch):
    """Return a panel that does not draw, which takes half of the time."""
    monkeypatch.setattr("evcalib.widgets.turning.draw_turning", lambda *a, **b: None)
    monkeypatch.setattr("evcalib.widgets.turning.pixels", lambda figure: np.zeros((2, 2, 3)))
    return TurningPanel(MOTIONS)


@pytest.mark.parametrize(
    ("motion", "says"),
    [("figure-eight", "the offset, the rotation and the camera&#x27;s position."),
     ("parking", "the offset and the rotation, but not the camera&#x27;s position."),
     ("turning in place", "the offset, but not the whole rotation nor the camera&#x27;s position."),
     ("arc", "neither the offset nor the whole rotation.")],
)  # fmt: skip
def test_each_motion_gets_its_verdict(quiet, motion, says):
    quiet.motion.value = motion
    assert f"This drive will show {says}" in quiet.numbers.value


def test_more_turning_lessens_the_error_of_the_position(quiet):
    def sd(swing):
        quiet.swing.value = swing
        return quiet._found.position_sd.max()

    assert sd(5.0) > 3 * sd(20.0) > 3 * sd(60.0)


def test_where_the_camera_sits_counts(quiet):
    beside = quiet._found.position_sd[1]
    quiet.x.value = 0.0
    assert quiet._found.position_sd[1] > 2 * beside


def test_every_corner_shows_a_verdict(quiet):
    sliders = (quiet.swing, quiet.period, quiet.speed, quiet.duration)
    for motion in MOTIONS:
        quiet.motion.value = motion
        for values in itertools.product(*((s.min, s.max) for s in sliders)):
            with quiet._at_once():
                for slider, value in zip(sliders, values, strict=True):
                    slider.value = value
            assert "This drive will show" in quiet.numbers.value
            assert "nan" not in quiet.numbers.value


def test_rings_stay_until_they_are_held_and_reset_brings_the_first_ones_back(panel):
    first, rings = panel.picture.value, panel._rings
    panel.motion.value = "parking"
    assert panel._rings == rings
    before = panel.picture.value
    panel.hold.click()
    assert panel._rings["y"] > 10 * rings["y"]
    assert panel.picture.value != before
    panel.reset.click()
    assert panel._rings == rings
    assert panel.picture.value == first


def test_a_drive_that_is_none_is_explained(panel):
    short = TurningPanel({"short": lambda *a: PLANS["slalom"](45.0, 6.0, 0.5, 0.5), **MOTIONS})
    assert "The picture is older" in short.numbers.value
    assert not short.picture.value
    short.hold.click()
    short.motion.value = "parking"
    assert "This drive will show" in short.numbers.value
    assert short.picture.value


def test_without_motions_there_is_nothing_to_choose():
    with pytest.raises(InputError, match="motion"):
        TurningPanel({})

"""The drive designer without a browser: every corner of its ranges, and what it says there."""

import itertools
import re

import matplotlib.image
import numpy as np
import pytest

from data_tools.plans import PLANS
from evcalib.errors import InputError
from evcalib.widgets.designer import DriveDesigner

DRAW = DriveDesigner.draw


@pytest.fixture
def panel():
    return DriveDesigner(PLANS)


@pytest.fixture
def quiet(monkeypatch):
    """Return a designer that shows its numbers without drawing, which takes most of the time."""
    monkeypatch.setattr(DriveDesigner, "draw", lambda *arguments: b"")
    return DriveDesigner(PLANS)


@pytest.mark.parametrize(
    ("motion", "sees"),
    [("S-curve", "the offset and the rotation"), ("fingers", "the offset and the rotation"),
     ("straight", "neither the offset nor the whole rotation"),
     ("arc", "neither the offset nor the whole rotation")],
)  # fmt: skip
def test_each_motion_gets_its_verdict(quiet, motion, sees):
    quiet.motion.value = motion
    assert f"This drive will show {sees}." in quiet.numbers.value


def test_a_wider_swing_lessens_the_error(quiet):
    def offset(swing):
        quiet.swing.value = swing
        return float(re.search(r"with speeds</td><td[^>]*>([\d.]+) ms", quiet.numbers.value)[1])

    assert offset(10.0) > offset(30.0) > offset(90.0)


def test_every_corner_shows_a_verdict_and_a_picture(quiet, tmp_path):
    sliders = quiet._sliders
    for motion in PLANS:
        quiet.motion.value = motion
        for values in itertools.product(*((s.min, s.max) for s in sliders)):
            for slider, value in zip(sliders, values, strict=True):
                slider.value = value
            assert "This drive will show" in quiet.numbers.value
            assert "nan" not in quiet.numbers.value
        drive = quiet.drive()
        path = tmp_path / "picture.png"
        path.write_bytes(DRAW(quiet, drive, quiet.predictions(drive)[0]))
        assert matplotlib.image.imread(path).std() > 0.05


def test_reset_brings_the_first_picture_back(panel):
    first, words = panel.picture.value, panel.numbers.value
    panel.swing.value, panel.duration.value = 90.0, 30.0
    assert panel.picture.value != first
    panel.reset.click()
    assert panel.picture.value == first
    assert panel.numbers.value == words


def test_without_motions_there_is_nothing_to_design():
    with pytest.raises(InputError, match="motion"):
        DriveDesigner({})


def test_plans_last_as_long_as_asked_and_stay_finite():
    for name, make in PLANS.items():
        drive = make(45.0, 6.0, 0.5, 16.0)
        v = drive.velocity(np.linspace(0.0, drive.duration, 400))
        assert np.isfinite(v).all()
        assert np.linalg.norm(v, axis=1).max() <= 0.5 * (1 + 1e-6), name
        assert drive.duration == pytest.approx(16.0), name

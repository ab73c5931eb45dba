"""The drive designer without a browser: every corner of its ranges, and what it says there."""

import itertools
import re
import time
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

from data_tools.simulation.drives import PLANS
from evcalib.errors import InputError
from evcalib.widgets.designer import FIRST_POINTS, OWN, PAD, DriveDesigner

DRAW = DriveDesigner.draw


@pytest.fixture
def panel():
    return DriveDesigner(PLANS)


@pytest.fixture
def quiet(monkeypatch):
    """Return a designer that shows its numbers without drawing, which takes most of the time."""
    monkeypatch.setattr(DriveDesigner, "draw", lambda *arguments: None)
    monkeypatch.setattr(DriveDesigner, "_mark", lambda *arguments: None)
    return DriveDesigner(PLANS)


def set_all(panel, sliders, values):
    with panel._at_once():
        for slider, value in zip(sliders, values, strict=True):
            slider.value = value


def picture(panel):
    return cv2.imdecode(np.frombuffer(panel.picture.value, np.uint8), cv2.IMREAD_COLOR)


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


def test_every_corner_shows_a_verdict(quiet):
    sliders = quiet._sliders
    for motion in (*PLANS, OWN):
        quiet.motion.value = motion
        for values in itertools.product(*((s.min, s.max) for s in sliders)):
            set_all(quiet, sliders, values)
            assert "This drive will show" in quiet.numbers.value
            assert "nan" not in quiet.numbers.value


def test_every_corner_of_what_the_camera_sees_shows_a_verdict(quiet):
    for values in itertools.product(*((s.min, s.max) for s in quiet._camera)):
        set_all(quiet, quiet._camera, values)
        assert "This drive will show" in quiet.numbers.value


def test_every_motion_is_drawn_at_both_ends_of_its_time(panel):
    for motion in (*PLANS, OWN):
        panel.motion.value = motion
        for share in (0, 100):
            panel.time.value = share
            assert picture(panel).std() > 10, motion


def test_the_moment_moves_along_the_course(panel):
    panel.motion.value = OWN
    panel.points.value = "0 0\n4 0"
    seen = {}
    for share in (0, 50, 100):
        panel.time.value = share
        changed = (picture(panel) != panel._bare).any(axis=2)
        # The course is the left third of the picture; forward is up.
        rows, columns = np.nonzero(changed[:, :250])
        seen[share] = rows.mean(), columns.mean()
    assert seen[0][0] > seen[50][0] > seen[100][0]
    assert seen[50][0] == pytest.approx((seen[0][0] + seen[100][0]) / 2, abs=1.5)
    assert seen[0][1] == pytest.approx(seen[100][1], abs=1.5)


def test_arrows_add_legs_and_undo_takes_them_back(quiet):
    quiet.motion.value, quiet.leg.value = OWN, 1.0
    for name in ("↑", "↘", "undo", "→"):
        quiet.pad[name].click()
    assert quiet.points.value == FIRST_POINTS + "\n3.4 1.4\n3.4 0.4"
    for _ in range(20):
        quiet.pad["undo"].click()
    assert quiet.points.value == ""
    assert "way points are needed" in quiet.numbers.value
    for name in PAD:
        quiet.pad[name].click()
    assert "This drive will show" in quiet.numbers.value


@pytest.mark.parametrize(
    "text", ["", "1", "a b", "0 0\n1 nan", "0 0\n0.1 0", "0 0\n1e9 0", "0 0 0"]
)
def test_way_points_that_make_no_drive_are_explained(quiet, text):
    quiet.motion.value = OWN
    quiet.points.value = text
    assert "The picture is older" in quiet.numbers.value or "needed" in quiet.numbers.value
    quiet.pad["↑"].click()
    quiet.pad["undo"].click()
    quiet.reset.click()
    assert "This drive will show the offset and the rotation" in quiet.numbers.value


def test_only_the_controls_of_the_motion_are_shown(quiet):
    hidden = [quiet._tools.layout.display]
    quiet.motion.value = OWN
    hidden += [control.layout.display for control in (quiet.swing, quiet.period, quiet.duration)]
    assert hidden == ["none"] * 4
    assert quiet._tools.layout.display == ""


def test_reset_brings_the_first_picture_back(panel):
    first, words = panel.picture.value, panel.numbers.value
    panel.motion.value, panel.swing.value, panel.focal.value = "fingers", 90.0, 500.0
    panel.time.value = 60
    assert panel.picture.value != first
    panel.reset.click()
    assert panel.picture.value == first
    assert panel.numbers.value == words


def test_callbacks_of_two_threads_draw_one_after_the_other(quiet, monkeypatch):
    """JupyterLab lets callbacks of widgets run in subshells, which are threads."""
    inside, seen = [], []

    def draw(*arguments):
        inside.append(True)
        time.sleep(0.01)
        seen.append(len(inside))
        inside.pop()

    monkeypatch.setattr(quiet, "draw", draw)
    with ThreadPoolExecutor(2) as pool:
        for value in (1.0, 2.0, 3.0, 4.0):
            pool.submit(setattr, quiet.period, "value", value)
            pool.submit(setattr, quiet.speed, "value", value / 2)
    assert len(seen) > 5
    assert set(seen) == {1}


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

"""The cockpit without a browser: every corner of its ranges, and what solving does."""

import itertools
import re

import matplotlib.image
import numpy as np
import pytest

from data_tools.motion import Noise, s_curve, simulate
from evcalib.geometry import LOOKS_FORWARD, rotation_angle, rpy_to_matrix
from evcalib.widgets.cockpit import Cockpit

TRUE, ANGLES = 0.23, (12.0, -7.0, 31.0)
DRAW = Cockpit.draw


@pytest.fixture(scope="module")
def streams():
    return simulate(
        s_curve(12.0, period=6.0),
        np.random.default_rng(7),
        offset=TRUE,
        R_body_cam=rpy_to_matrix(np.radians(ANGLES)) @ LOOKS_FORWARD,
        heading_noise=Noise(sigma=0.02),
        velocity_noise=Noise(sigma=0.01),
    )


@pytest.fixture
def quiet(monkeypatch, streams):
    """Return a cockpit that shows its numbers without drawing, which takes most of the time."""
    monkeypatch.setattr(Cockpit, "draw", lambda panel: b"")
    return Cockpit(streams.headings, streams.velocities)


def set_to(panel, offset, angles):
    panel.offset.value = offset
    panel.roll.value, panel.pitch.value, panel.yaw.value = angles


def test_the_truth_by_hand_leaves_only_the_noise(quiet):
    set_to(quiet, TRUE, ANGLES)
    # the median of a Rayleigh distribution of 0.02 rad
    assert quiet.residual() == pytest.approx(np.degrees(0.02 * 1.177), rel=0.15)
    for offset, turn in ((0.3, (0, 0, 0)), (0.0, (10, 0, 0)), (0.0, (0, 10, 0)), (0.0, (0, 0, 10))):
        set_to(quiet, TRUE + offset, np.add(ANGLES, turn))
        assert quiet.residual() > 3.0


def test_the_angles_turn_a_camera_that_looks_ahead(quiet):
    ahead = quiet.R_body_cam @ [0.0, 0.0, 1.0]
    assert ahead == pytest.approx([1.0, 0.0, 0.0])
    quiet.yaw.value = 90.0
    assert quiet.R_body_cam @ [0.0, 0.0, 1.0] == pytest.approx([0.0, 1.0, 0.0])
    quiet.yaw.value, quiet.pitch.value = 0.0, 30.0
    assert (quiet.R_body_cam @ [0.0, 0.0, 1.0])[2] == pytest.approx(-0.5)


def test_solving_moves_the_sliders_to_the_answer(quiet, streams):
    assert "solution" not in quiet.numbers.value
    quiet.solve.click()
    assert quiet.offset.value == pytest.approx(TRUE, abs=0.02)
    assert np.degrees(rotation_angle(quiet.R_body_cam, streams.R_body_cam)) < 1.5
    late, turn = re.search(r"([+-]\d+) ms and ([\d.]+) deg", quiet.numbers.value).groups()
    assert abs(int(late)) <= 3
    assert float(turn) < 1.0
    assert quiet.calibration.verdict.summary in quiet.numbers.value
    quiet.reset.click()
    assert [slider.value for slider in quiet._sliders] == [0.0] * 4
    assert "solution" not in quiet.numbers.value


def test_every_corner_shows_a_residual_and_a_picture(quiet, tmp_path):
    path = tmp_path / "picture.png"
    for solved in (False, True):
        quiet.solved = solved
        for values in itertools.product(*((s.min, 0.0, s.max) for s in quiet._sliders)):
            for slider, value in zip(quiet._sliders, values, strict=True):
                slider.value = value
            assert 0.0 <= quiet.residual() <= 180.0
            assert re.match(r"median residual [\d.]+ deg", quiet.numbers.value)
        for offset in (quiet.offset.min, 0.0, quiet.offset.max):
            quiet.offset.value = offset
            path.write_bytes(DRAW(quiet))
            assert matplotlib.image.imread(path).std() > 0.05


def test_streams_that_hardly_overlap_give_no_error(monkeypatch, streams):
    monkeypatch.setattr(Cockpit, "draw", lambda panel: b"")
    panel = Cockpit(streams.headings, streams.velocities, max_offset=20.0)
    for offset in (-20.0, 20.0):
        panel.offset.value = offset
        assert "does not cover" in panel.numbers.value
        assert DRAW(panel)[1:4] == b"PNG"


def test_the_same_place_gives_the_same_bytes(streams):
    panel = Cockpit(streams.headings, streams.velocities)
    assert panel.draw() == panel.draw()

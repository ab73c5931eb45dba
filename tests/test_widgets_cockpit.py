"""The cockpit without a browser: every corner of its ranges, and what solving does."""

import itertools
import re
from types import SimpleNamespace

import matplotlib.image
import numpy as np
import pytest

from data_tools.simulation.drives import fingers, s_curve
from data_tools.simulation.streams import Noise, simulate
from evcalib.alignment import align
from evcalib.alignment.offset_refinement import inliers_at
from evcalib.errors import InputError
from evcalib.geometry import LOOKS_FORWARD, rotation_angle, rpy_to_matrix
from evcalib.widgets.cockpit import STEPS, Cockpit, SolvedStreams

TRUE, ANGLES = 0.23, (12.0, -7.0, 31.0)
DRAW = Cockpit.draw


def recording(drive, seed=7):
    s = simulate(
        drive,
        np.random.default_rng(seed),
        offset=TRUE,
        R_body_cam=rpy_to_matrix(np.radians(ANGLES)) @ LOOKS_FORWARD,
        heading_noise=Noise(sigma=0.02),
        velocity_noise=Noise(sigma=0.01),
    )
    truth = SimpleNamespace(offset=s.offset, R_body_cam=s.R_body_cam)
    return SolvedStreams(s.headings, s.velocities, align(s.headings, s.velocities), truth)


@pytest.fixture(scope="module")
def recordings():
    return {
        "curve": recording(s_curve(12.0, period=6.0)),
        "fingers": recording(fingers(out=1.5), seed=8),
    }


@pytest.fixture
def quiet(monkeypatch, recordings):
    """Return a cockpit that shows its numbers without drawing, which takes most of the time."""
    monkeypatch.setattr(Cockpit, "draw", lambda panel: b"")
    return Cockpit(recordings)


def set_to(panel, offset, angles):
    panel.offset.value = offset
    panel.roll.value, panel.pitch.value, panel.yaw.value = angles


def place(panel):
    return [control.value for control in panel._sliders]


def test_the_truth_by_hand_leaves_only_the_noise(quiet):
    set_to(quiet, TRUE, ANGLES)
    # the median of a Rayleigh distribution of 0.02 rad
    assert quiet.residual() == pytest.approx(np.degrees(0.02 * 1.177), rel=0.15)
    assert quiet.gauge.bar_style == "success"
    for offset, turn in ((0.3, (0, 0, 0)), (0.0, (10, 0, 0)), (0.0, (0, 10, 0)), (0.0, (0, 0, 10))):
        set_to(quiet, TRUE + offset, np.add(ANGLES, turn))
        assert quiet.residual() > 3.0
        assert quiet.gauge.bar_style == "info"


def test_the_angles_turn_a_camera_that_looks_ahead(quiet):
    ahead = quiet.R_body_cam @ [0.0, 0.0, 1.0]
    assert ahead == pytest.approx([1.0, 0.0, 0.0])
    quiet.yaw.value = 90.0
    assert quiet.R_body_cam @ [0.0, 0.0, 1.0] == pytest.approx([0.0, 1.0, 0.0])
    quiet.yaw.value, quiet.pitch.value = 0.0, 30.0
    assert (quiet.R_body_cam @ [0.0, 0.0, 1.0])[2] == pytest.approx(-0.5)


def test_the_score_is_that_of_the_search_at_its_best_rotation_and_lower_elsewhere(
    quiet, recordings
):
    given = recordings["curve"]
    # far from the peak headings at the ends, which the search leaves out, move the rotation
    for k, tolerance in ((40, 0.03), (100, 0.01), (quiet.curve.peak, 0.001), (170, 0.03)):
        offset = float(quiet.curve.offsets[k])
        R = inliers_at(given.headings, quiet._track, offset).R_body_cam
        assert quiet._scorer(offset, R) == pytest.approx(quiet.curve.score[k], abs=tolerance)
        quiet.offset.value = offset
        assert quiet.score() <= quiet.curve.score[k] + tolerance


def test_solving_moves_the_sliders_to_the_answer(quiet, recordings):
    truth = recordings["curve"].truth
    set_to(quiet, 0.1, (0.0, 0.0, 30.0))
    assert "Your hand" not in quiet.numbers.value
    assert quiet.replay.disabled
    quiet.solve.click()
    assert quiet.offset.value == pytest.approx(TRUE, abs=0.02)
    assert np.degrees(rotation_angle(quiet.R_body_cam, truth.R_body_cam)) < 1.0
    plain = re.sub("</?b>", "", quiet.numbers.value)
    late, turn = re.search(r"hand was ([+-]\d+) ms and ([\d.]+) deg", plain).groups()
    found = recordings["curve"].calibration
    assert float(late) == pytest.approx(1e3 * (0.1 - found.offset), abs=0.5)
    hand = rpy_to_matrix(np.radians([0.0, 0.0, 30.0])) @ LOOKS_FORWARD
    chord = np.linalg.norm(hand - found.R_body_cam)
    assert float(turn) == pytest.approx(2 * np.degrees(np.arcsin(chord / np.sqrt(8))), abs=0.06)
    assert found.verdict.summary in quiet.numbers.value
    for row in ("by hand", "solved", "true"):
        assert row in quiet.numbers.value
    quiet.reset.click()
    assert place(quiet) == [0.0] * 4
    assert "Your hand" not in quiet.numbers.value
    assert quiet.tried == [(0.0, quiet.score())]


def test_solving_twice_keeps_the_hand(quiet):
    set_to(quiet, 0.5, (0.0, 0.0, 0.0))
    for _ in range(2):
        quiet.solve.click()
        assert "<b>+2" in quiet.numbers.value
    quiet.offset.value = 0.0
    quiet.solve.click()
    assert "<b>-2" in quiet.numbers.value


def test_the_way_from_the_hand_to_the_solution_turns_evenly(quiet):
    set_to(quiet, -0.4, (-50.0, 20.0, 100.0))
    hand = quiet.R_body_cam
    quiet.solve.click()
    end, whole = quiet.R_body_cam, rotation_angle(hand, quiet.R_body_cam)
    for k in (0, STEPS // 4, STEPS // 2, STEPS):
        quiet.replay.value = k
        assert rotation_angle(hand, quiet.R_body_cam) == pytest.approx(k / STEPS * whole, abs=1e-6)
        assert rotation_angle(quiet.R_body_cam, end) == pytest.approx(
            (1 - k / STEPS) * whole, abs=1e-6
        )
    assert quiet.offset.value == quiet._given.calibration.offset


def test_another_recording_starts_anew(quiet, recordings):
    set_to(quiet, 0.3, (10.0, 0.0, 0.0))
    quiet.solve.click()
    quiet.recording.value = "fingers"
    assert place(quiet) == [0.0] * 4
    assert quiet.replay.disabled
    assert len(quiet.tried) == 1
    quiet.replay.value = 3
    assert place(quiet) == [0.0] * 4
    quiet.solve.click()
    found = recordings["fingers"].calibration
    assert not found.offset_observable
    assert found.verdict.summary in quiet.numbers.value


def test_every_corner_shows_a_residual_and_a_picture(quiet, tmp_path):
    path = tmp_path / "picture.png"
    for solve in (False, True):
        if solve:
            quiet.solve.click()
        for values in itertools.product(*((s.min, 0.0, s.max) for s in quiet._sliders)):
            for slider, value in zip(quiet._sliders, values, strict=True):
                slider.value = value
            assert 0.0 <= quiet.residual() <= 180.0
            assert 0.0 <= quiet.gauge.value <= 1.0
            assert re.search(r"median residual <b>[\d.]+ deg", quiet.numbers.value)
        for offset in (quiet.offset.min, 0.0, quiet.offset.max):
            quiet.offset.value = offset
            path.write_bytes(DRAW(quiet))
            assert matplotlib.image.imread(path).std() > 0.05


def test_streams_that_hardly_overlap_give_no_error(monkeypatch, recordings):
    monkeypatch.setattr(Cockpit, "draw", lambda panel: b"")
    panel = Cockpit(recordings, max_offset=20.0)
    for offset in (-20.0, 20.0):
        panel.offset.value = offset
        assert "does not cover" in panel.numbers.value
        assert DRAW(panel)[1:4] == b"PNG"


def test_the_same_place_gives_the_same_bytes(recordings):
    panel = Cockpit(recordings)
    first = bytes(panel.picture.value)
    panel.yaw.value = 40.0
    assert panel.picture.value != first
    panel.reset.click()
    assert panel.picture.value == first


def test_no_recording_is_refused():
    with pytest.raises(InputError, match="at least one recording"):
        Cockpit({})

"""The rivals' panel without a browser: every corner of its ranges, and what it shows there."""

import itertools
import re
from dataclasses import dataclass, replace

import matplotlib.image
import matplotlib.pyplot as plt
import numpy as np
import pytest

import evcalib.widgets.rivals as module
from data_tools.simulation.drives import arc, fingers, polyline, s_curve, straight
from data_tools.simulation.streams import Noise, simulate
from data_tools.studies.baseline_runs import reckoned_poses
from evcalib.alignment import align
from evcalib.baselines import METHODS, RivalInput, calibrate_with
from evcalib.errors import InputError
from evcalib.plots.rivals import LEAST_DEG, draw_errors, draw_paths
from evcalib.widgets.rivals import MAX_DRIFT, MAX_NOISE, MIN_NOISE, RivalPanel

TRUE = 0.31
DRIVES = {
    "arc": arc(9.0, radius=2.0),
    "polyline": polyline(9.0, side=2.0),
    "S-curve": s_curve(9.0, period=4.0),
    "straight": straight(9.0),
    "fingers": fingers(out=1.5),
}
QUICK = ("ours", "vc", "vc_wota", "hand_eye")


@dataclass
class Made:
    given: RivalInput
    R_body_cam: np.ndarray
    offset: float
    path: np.ndarray


def make(kind, noise, drift):
    s = simulate(
        DRIVES[kind],
        np.random.default_rng(4),
        offset=TRUE,
        heading_rate=20.0,
        heading_noise=Noise(noise),
        velocity_noise=Noise(drift, rho=0.98),
    )
    t = s.velocities.t
    path = np.zeros((t.size, 3))
    v = s.drive.velocity(t)
    path[1:] = np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t)[:, None], axis=0)
    speed = s.drive.speed(s.headings.t + TRUE)
    return Made(reckoned_poses(s.headings, s.velocities, speed), s.R_body_cam, TRUE, path)


def shown(panel):
    """Return rotation and offset errors of the table, by method, as they are written."""
    plain = re.sub(r"</?b>", "", panel.numbers.value)
    rows = re.findall(r"<tr>(?:<td[^>]*>(.*?)</td>)" + 3 * r"(?:<td[^>]*>(.*?)</td>)", plain)
    return {row[0]: row[1:] for row in rows}


@pytest.fixture(scope="module")
def whole():
    return RivalPanel(make, list(DRIVES))


@pytest.fixture
def panel():
    return RivalPanel(make, list(DRIVES), QUICK)


def test_the_table_holds_the_errors_of_every_method(whole):
    whole.motion.value = "polyline"
    table = shown(whole)
    assert list(table) == list(METHODS)
    given, R = whole.trial.given, whole.trial.R_body_cam
    for name in ("ours", "vc", "hand_eye_offset"):
        found = calibrate_with(name, given)
        # the angle between two rotations, from the chord |A - B| = 2 sqrt(2) sin(angle / 2)
        chord = np.linalg.norm(found.R_body_cam - R)
        angle = 2 * np.degrees(np.arcsin(chord / np.sqrt(8)))
        assert float(table[name][0]) == pytest.approx(angle, abs=0.006)
        assert float(table[name][1]) == pytest.approx(1000 * (found.offset - TRUE), abs=0.6)
    assert table["vc_wota"][1] == table["hand_eye"][1] == "-310"


def test_only_ours_states_what_it_knows(panel):
    panel.motion.value = "polyline"
    table = shown(panel)
    assert [table[name][2] for name in QUICK[1:]] == 3 * ["nothing"]
    ours = align(panel.trial.given.headings, panel.trial.given.velocities)
    words = f"sd {np.degrees(ours.rotation_sd):.2f} deg, offset sd {1000 * ours.offset_sd:.0f} ms"
    assert words in table["ours"][2]
    panel.motion.value = "arc"
    assert shown(panel)["ours"][2].endswith("offset not determined")
    panel.motion.value = "straight"
    assert shown(panel)["ours"][2].startswith("rotation not determined")


def test_the_clocks_matter_on_a_polyline_and_cannot_be_aligned_on_an_arc(panel):
    panel.motion.value = "polyline"
    errors = panel.errors()
    assert max(errors["ours"], errors["vc"]) < 0.5 * min(errors["vc_wota"], errors["hand_eye"])
    panel.motion.value = "arc"
    errors = panel.errors()
    # an unaligned clock turns the rotation by the rate of turning times the offset
    assert errors["vc_wota"] == pytest.approx(np.degrees(0.5 * TRUE), abs=1.5)
    assert errors["ours"] == pytest.approx(errors["vc_wota"], abs=1.0)


def test_choosing_a_method_runs_none_again(panel, monkeypatch):
    found = dict(panel.found)
    monkeypatch.setattr(module, "calibrate_with", None)
    for name in QUICK:
        before = panel.picture.value
        panel.method.value = name
        assert f"<b>{name}</b>" in panel.numbers.value
        assert (panel.picture.value == before) == (name == QUICK[0])
    assert panel.found == found


def test_a_method_that_fails_says_why_and_the_others_stay(panel, monkeypatch):
    def fails(name, given):
        if name == "vc":
            raise InputError("too <short>")
        return calibrate_with(name, given)

    monkeypatch.setattr(module, "calibrate_with", fails)
    panel.motion.value, panel.method.value = "S-curve", "vc"
    assert shown(panel)["vc"] == ("-", "-", "too &lt;short&gt;")
    assert np.isnan(panel.errors()["vc"])
    assert np.isfinite([panel.errors()[name] for name in QUICK if name != "vc"]).all()
    assert bytes(panel.picture.value).startswith(b"\x89PNG")
    panel.motion.value = "arc"
    assert "too" in panel.numbers.value


def test_every_corner_shows_numbers_and_a_picture(whole, tmp_path):
    """In an order in which one control moves at a time: each move runs every method again."""
    path, turn = tmp_path / "picture.png", itertools.cycle(METHODS)
    around = [(MIN_NOISE, 0), (MIN_NOISE, MAX_DRIFT), (MAX_NOISE, MAX_DRIFT), (MAX_NOISE, 0)]
    whole.noise.value, whole.drift.value = around[0]
    for kind in ("arc", "fingers", "straight", "S-curve"):
        whole.motion.value = kind
        for noise, drift in around:
            whole.noise.value, whole.drift.value = noise, drift
            assert_finite(whole)
        whole.method.value = next(turn)
        around = around[::-1]
        path.write_bytes(whole.picture.value)
        assert matplotlib.image.imread(path).std() > 0.05


def assert_finite(panel):
    values = panel.errors()
    assert {name for name, value in values.items() if np.isnan(value)} <= {"cgoc"}
    assert list(shown(panel)) == list(METHODS)
    assert all(0.0 <= value <= 180.0 for value in values.values() if np.isfinite(value))


def test_streams_without_trajectories_leave_the_methods_that_need_them_out():
    def bare(*settings):
        made = make(*settings)
        return replace(made, given=RivalInput(made.given.headings, made.given.velocities))

    panel = RivalPanel(bare, ["S-curve"], QUICK)
    assert list(panel.failures) == ["hand_eye"]
    assert "needs camera_poses" in shown(panel)["hand_eye"][2]


def test_the_same_place_gives_the_same_bytes_and_reset_goes_back_there(panel):
    first, table = bytes(panel.picture.value), panel.numbers.value
    panel.motion.value, panel.method.value, panel.drift.value = "fingers", "vc", MAX_DRIFT
    assert panel.picture.value != first
    panel.reset.click()
    assert (panel.motion.value, panel.method.value, panel.drift.value) == ("arc", "ours", 2)
    assert panel.picture.value == first
    assert panel.numbers.value == table


def test_nothing_to_choose_from_is_refused():
    with pytest.raises(InputError, match="at least one motion"):
        RivalPanel(make, [])
    with pytest.raises(InputError, match="at least one method"):
        RivalPanel(make, ["arc"], [])


def test_without_noise_the_paths_lie_on_top_of_each_other():
    made = make("S-curve", 0.001, 0.0)
    found = calibrate_with("ours", made.given)
    figure, ax = plt.subplots()
    draw_paths(ax, made.given.body_poses, made.given.camera_poses, found, true=made.path)
    driven, body, camera = (np.transpose(line.get_data()) for line in ax.lines)
    np.testing.assert_allclose(body, driven, atol=1e-9)
    gaps = np.linalg.norm(camera[:, None] - driven[None], axis=2).min(axis=1)
    assert gaps.max() < 0.02
    plt.close(figure)


def test_bars_are_as_long_as_the_errors():
    errors = {"ours": 0.4, "vc": 20.0, "vc_wota": np.nan, "cgoc": 0.0}
    figure, ax = plt.subplots()
    draw_errors(ax, errors, chosen="vc")
    assert [bar.get_width() for bar in ax.patches] == [0.4, 20.0, LEAST_DEG]
    assert [bar.get_linewidth() > 1.5 for bar in ax.patches] == [False, True, False]
    assert [text.get_text() for text in ax.texts] == ["0.4", "20", "none", "0"]
    plt.close(figure)

"""The offset panel without a browser: every corner of its ranges, and what it says there."""

import itertools
import re

import matplotlib.image
import numpy as np
import pytest

from data_tools.simulation.drives import arc, s_curve, straight, zigzag
from data_tools.simulation.streams import Noise, simulate
from evcalib.errors import InputError
from evcalib.widgets.offset import MAX_NOISE, OffsetPanel

TRUE = 0.23
DRIVES = {
    "S-curve": s_curve(12.0, period=6.0),
    "arc": arc(12.0, radius=2.0),
    "straight": straight(12.0),
    "fast zigzag": zigzag(12.0, side=0.7),
}
DRAW = OffsetPanel.draw


def drive(kind, noise):
    return simulate(
        DRIVES[kind],
        np.random.default_rng(7),
        offset=TRUE,
        heading_noise=Noise(sigma=noise),
        velocity_noise=Noise(sigma=0.1 * noise),
    )


@pytest.fixture
def panel():
    return OffsetPanel(drive, list(DRIVES))


@pytest.fixture
def quiet(monkeypatch):
    """Return a panel that shows its numbers without drawing, which takes most of the time."""
    monkeypatch.setattr(OffsetPanel, "draw", lambda panel: b"")
    return OffsetPanel(drive, list(DRIVES))


def score(panel):
    """Return the score that is shown for the slider's place."""
    return float(re.search(r"score ([\d.]+) at", panel.numbers.value).group(1))


def scores(panel, offsets):
    out = []
    for offset in offsets:
        panel.offset.value = offset
        out.append(score(panel))
    return out


def test_the_true_offset_scores_best_by_hand(quiet):
    offsets = np.round(TRUE + np.array([-0.4, -0.2, -0.1, 0.0, 0.1, 0.2, 0.4]), 2)
    assert np.argmax(scores(quiet, offsets)) == 3
    assert "at 0.23 s" in quiet.numbers.value.split("best so far")[1]


@pytest.mark.parametrize("kind", ["arc", "straight"])
def test_without_noise_every_offset_of_a_steady_turn_fits(quiet, kind):
    quiet.motion.value, quiet.noise.value = kind, 0.0
    assert min(scores(quiet, (-1.0, -0.4, TRUE, 0.5, 1.0))) >= 0.999


def test_a_fast_zigzag_fits_again_half_a_period_later(quiet):
    quiet.motion.value = "fast zigzag"
    here, between, again = scores(quiet, (TRUE, TRUE - 0.35, TRUE - 0.7))
    assert again == pytest.approx(here, abs=0.02)
    assert between < here - 0.2


def test_the_score_is_that_of_a_plain_search(quiet):
    """Best of many rotations about the vertical, with the same weights, in plain Python."""
    quiet.noise.value, quiet.offset.value = 0.2, 0.5
    streams = quiet.streams
    # only headings that the odometry covers from -1 to 1 s, all over the search
    inner = streams.headings.select((streams.headings.t > 1) & (streams.headings.t < 11))
    d = DRIVES["S-curve"].velocity(inner.t + 0.5)
    turned = inner.v @ streams.R_body_cam.T
    best = 0.0
    for yaw in np.linspace(-0.6, 0.6, 121):
        c, s = np.cos(yaw), np.sin(yaw)
        fit = np.sum(d * (turned @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])), axis=1)
        best = max(best, np.mean(np.maximum(0.0, 1.0 - (1.0 - fit) / 0.5) ** 3))
    assert score(quiet) == pytest.approx(best, abs=0.01)


def test_comparing_tells_error_and_verdict(panel):
    panel.offset.value = 0.30
    hidden = panel.picture.value
    panel.compare.value = True
    assert panel.picture.value != hidden
    assert "by hand +70 ms" in panel.numbers.value
    assert panel.calibration.verdict.summary in panel.numbers.value
    assert panel.calibration.offset == pytest.approx(TRUE, abs=0.02)
    for kind in ("arc", "straight", "fast zigzag"):
        panel.motion.value = kind
        panel.compare.value = True
        assert not panel.calibration.offset_observable
        assert "not observable" in panel.numbers.value


def test_new_streams_forget_what_was_tried(panel):
    scores(panel, (0.1, 0.2, 0.3))
    panel.compare.value = True
    panel.motion.value = "arc"
    assert len(panel.tried) == 1
    assert not panel.compare.value


def test_every_corner_shows_a_finite_score_and_a_picture(quiet, tmp_path):
    offsets, path = (quiet.offset.min, 0.0, quiet.offset.max), tmp_path / "picture.png"
    for kind, noise in itertools.product(DRIVES, (0.0, MAX_NOISE)):
        quiet.motion.value, quiet.noise.value = kind, noise
        assert all(0.0 < s <= 1.0 for s in scores(quiet, offsets))
        quiet.compare.value = True
        assert re.search(r"by hand [+-]\d+ ms", quiet.numbers.value)
        path.write_bytes(DRAW(quiet))
        assert matplotlib.image.imread(path).std() > 0.05


def test_the_play_button_walks_over_all_offsets(quiet):
    for place in range(quiet.play.max + 1):
        quiet.play.value = place
    assert quiet.offset.value == quiet.offset.max
    tried = quiet.curve.offsets[np.unique(quiet.tried)]
    np.testing.assert_allclose(tried, np.linspace(-1.0, 1.0, quiet.play.max + 1), atol=1e-9)


def test_reset_takes_everything_back(quiet):
    first = quiet.numbers.value
    quiet.motion.value, quiet.noise.value = "arc", 0.2
    quiet.offset.value, quiet.compare.value = 0.4, True
    quiet.reset.click()
    assert (quiet.motion.value, quiet.noise.value, quiet.offset.value) == ("S-curve", 0.05, 0.0)
    assert not quiet.compare.value
    assert quiet.numbers.value == first
    assert len(quiet.tried) == 1
    quiet.offset.value = 0.1
    quiet.reset.click()
    assert len(quiet.tried) == 1


def test_the_same_place_gives_the_same_bytes(panel):
    first = bytes(panel.picture.value)
    panel.offset.value = 0.3
    assert panel.picture.value != first
    panel.reset.click()
    assert panel.picture.value == first


def test_nothing_to_choose_from_is_refused():
    with pytest.raises(InputError, match="at least one motion"):
        OffsetPanel(drive, [])

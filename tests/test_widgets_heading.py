"""The heading panel without a browser: every corner of its sliders, and the numbers it shows."""

import itertools
import re
from pathlib import Path
from types import SimpleNamespace

import matplotlib.image
import matplotlib.pyplot as plt
import numpy as np
import pytest

from data_tools.course.samples import load_sample
from data_tools.simulation.point_matches import random_matches
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.heading import Matches
from evcalib.heading.two_views import keypoints_at, matched
from evcalib.plots.heading import draw_offsets
from evcalib.surfaces import tos_ts
from evcalib.widgets import heading as module
from evcalib.widgets.heading import HeadingPanel

CAMERA = Camera(80, 60, 70.0, 70.0, 39.5, 29.5)


def noise(seed, length=400_000):
    """Events without any order: there is nothing to match but chance."""
    rng = np.random.default_rng(seed)
    x, y, p = rng.integers(0, 80, 30_000), rng.integers(0, 60, 30_000), rng.integers(0, 2, 30_000)
    return Events.from_arrays(x, y, np.sort(rng.integers(0, length, 30_000)), p, 80, 60)


@pytest.fixture
def panel():
    directions = {"ahead": [0.0, 0.0, 1.0], "right": [1.0, 0.0, 0.0]}
    return HeadingPanel(
        {
            name: SimpleNamespace(events=noise(k), camera=CAMERA, direction=np.array(d))
            for k, (name, d) in enumerate(directions.items())
        }
    )


def true_pairs(direction, count=80, noise=0.1):
    shift = 0.2 * np.asarray(direction)
    return random_matches(CAMERA, shift, np.random.default_rng(5), count=count, noise=noise)


@pytest.mark.parametrize("name", ["ahead", "right"])
@pytest.mark.parametrize("solver", module.SOLVERS)
def test_matches_of_a_motion_show_its_heading(panel, name, solver, monkeypatch):
    panel.recording.value, panel.solver.value = name, solver
    monkeypatch.setattr(panel, "pairs", lambda: true_pairs(panel.recordings[name].direction))
    panel.baseline.value += 50
    error = float(re.search(r"Error ([\d.]+) deg", panel.numbers.value).group(1))
    assert error < (2.0 if solver == "two points" else 20.0)
    assert panel.numbers.value.startswith("80 matches")


def test_every_corner_of_the_sliders_says_what_was_found(panel, monkeypatch, tmp_path):
    drawn = []
    monkeypatch.setattr(panel, "draw", lambda *a: drawn.append(a) or b"")
    sliders = (panel.middle, panel.baseline)
    choices = [(s.min, s.max) for s in sliders] + [tuple(module.SOLVERS), (False, True)]
    for name, *values in itertools.product(panel.recordings, *choices):
        panel.recording.value = name
        for control, value in zip((*sliders, panel.solver, panel.pool), values, strict=True):
            control.value = value
        text = panel.numbers.value
        assert "beyond the recording" in text or re.match(r"\d+ matches", text)
        if panel.pairs() is None:
            assert "beyond the recording" in text
    monkeypatch.undo()
    for arguments in drawn[:: max(1, len(drawn) // 4)]:
        (tmp_path / "picture.png").write_bytes(panel.draw(*arguments))
        assert matplotlib.image.imread(tmp_path / "picture.png").std() > 0.05


def test_the_sliders_choose_the_keyframes():
    path = Path(__file__).parents[1] / "notebooks" / "data" / "forward.npz"
    sample = load_sample(path)
    panel = HeadingPanel({"forward": sample})
    panel.middle.value, panel.baseline.value = 350, 200
    times = [250_000, 275_000, 300_000, 400_000, 425_000, 450_000]
    at = dict(zip(times, keypoints_at(sample.events, times), strict=True))
    parts = [
        matched(sample.camera, at[350_000 - half], at[350_000 + half], reach=module.REACH_PX)
        for half in (50_000, 75_000, 100_000)
    ]
    assert len(parts[-1]) > 20
    assert np.array_equal(panel.pairs().xy1, parts[-1].xy1)
    assert np.array_equal(panel.pairs().xy2, parts[-1].xy2)
    panel.pool.value = True
    assert np.array_equal(panel.pairs().r2, Matches.pooled(parts).r2)


def test_without_a_direction_the_panel_says_so(panel, monkeypatch):
    empty = true_pairs([0, 0, 1], count=2)
    monkeypatch.setattr(panel, "pairs", lambda: empty)
    panel.baseline.value += 50
    assert "No direction found" in panel.numbers.value
    assert bytes(panel.picture.value).startswith(b"\x89PNG")


def test_a_heading_far_off_is_counted_in_the_picture():
    figure, ax = plt.subplots()
    draw_offsets(ax, np.eye(3), [0.0, 0.0, 1.0], reach=10.0)
    assert [text.get_text() for text in ax.texts] == ["2 farther off"]
    plt.close(figure)


def test_reset_brings_the_first_picture_back(panel):
    first, words = panel.picture.value, panel.numbers.value
    panel.recording.value, panel.solver.value, panel.pool.value = "right", "five points", True
    panel.middle.value = 250
    assert panel.picture.value != first
    panel.reset.click()
    assert (panel.picture.value, panel.numbers.value) == (first, words)


def test_the_surface_is_that_of_the_later_time(panel):
    panel.middle.value, panel.baseline.value = 200, 200
    events = panel.recordings["ahead"].events
    np.testing.assert_array_equal(panel.surface(), tos_ts(events.between(0, 300_001), 300_000))


def test_recordings_are_needed():
    with pytest.raises(InputError, match="at least one"):
        HeadingPanel({})

"""The surface panel without a browser: every corner of its sliders, and the numbers it shows."""

import itertools
import re
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from ipywidgets import Play

from evcalib import surfaces
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.plots.events import NAMES
from evcalib.widgets.surfaces import CAPTION, ROOM, SurfacePanel, tile

SIDE = ROOM // 48


def moving_bar(speed, width=48, height=32):
    """Events of a vertical bar that crosses the image at a speed [px/s], and of its far side."""
    columns = np.repeat(np.arange(4, width - 4), height)
    rows = np.tile(np.arange(height), width - 8)
    t = np.rint(1e6 * (columns - 4) / speed).astype(np.int64)
    return Events.from_arrays(columns, rows, t, rows % 2, width, height)


@pytest.fixture(scope="module")
def panel():
    frames = np.zeros((3, 32, 48), dtype=np.uint8)
    frames[:, :, 24] = 250
    slow = SimpleNamespace(events=moving_bar(20.0), frames=frames)
    fast = SimpleNamespace(events=moving_bar(400.0), frames=frames[:0])
    return SurfacePanel({"slow": slow, "fast": fast})


@pytest.fixture(autouse=True)
def at_rest(panel):
    panel.speed.value, panel.time.value, panel.patch.value = "slow", 70, 7
    panel.tau.value, panel.threshold.value, panel.corners.value = 30.0, 0.1, True


def picture(panel):
    return cv2.imdecode(np.frombuffer(panel.picture.value, np.uint8), cv2.IMREAD_COLOR)


def shown(panel):
    """Return the numbers of the table: share of lit pixels [%], and likeness."""
    cells = re.findall(r"right'>([\d.-]+)(?: %)?</td>", panel.numbers.value)
    return np.array(cells, dtype=float).reshape(2, 5)


def test_every_corner_of_the_ranges_shows_a_picture_and_numbers(panel):
    sliders = (panel.time, panel.tau, panel.threshold, panel.patch)
    ends = [(slider.min, slider.max) for slider in sliders]
    for speed, *values in itertools.product(("slow", "fast"), *ends):
        panel.speed.value = speed
        for slider, value in zip(sliders, values, strict=True):
            slider.value = value
        lit, like = shown(panel)
        assert picture(panel).shape == (2 * (32 * SIDE + CAPTION + 3), 3 * (48 * SIDE + 6), 3)
        assert ((lit >= 0) & (lit <= 100)).all()
        assert (np.abs(like) <= 1).all()
        lit_of = dict(zip(NAMES, lit, strict=True))
        assert lit_of["tos_ts"] <= lit_of["tos"] <= lit_of["ts"]
        if speed == "slow":
            # An image without contrast is like nothing, not even itself.
            flat = [np.ptp(image) == 0 for image in panel.images().values()]
            assert np.array_equal(like, np.where(flat, 0.0, 1.0))


def test_only_surfaces_with_a_clock_change_with_the_speed(panel):
    panel.speed.value = "fast"
    like = dict(zip(NAMES, shown(panel)[1], strict=True))
    assert like["tos"] == like["silc"] == like["dist"] == 1.0
    assert like["ts"] < 0.9
    assert like["tos_ts"] < 0.9


def test_the_sliders_set_what_they_name(panel):
    panel.speed.value, panel.tau.value = "fast", 10.0
    panel.threshold.value, panel.patch.value = 0.5, 5
    events, images = panel.streams["fast"].between(0, panel.t_us + 1), panel.images()
    t = panel.t_us
    expected = {
        "ts": surfaces.time_surface(events, t, tau=0.01),
        "dist": surfaces.dist(events, t, patch=5, polarity="merged"),
        "silc": surfaces.silc(events, t, r=2, polarity="merged"),
        "tos": surfaces.tos(events, t, k=5),
        "tos_ts": surfaces.tos_ts(events, t, k=5, tau=0.01, ts_threshold=0.5),
    }
    for name, image in expected.items():
        assert np.array_equal(images[name], image), name
    panel.threshold.value = 0.1
    assert not np.array_equal(panel.images()["tos_ts"], expected["tos_ts"])


def test_a_longer_memory_makes_the_and_equal_to_tos(panel):
    panel.tau.value, panel.threshold.value = 200.0, 0.02
    panel.speed.value = "fast"
    images = panel.images()
    assert np.array_equal(images["tos"], images["tos_ts"])


def test_the_clock_stands_where_the_slider_says(panel):
    panel.time.value = 50
    slow = panel.t_us
    panel.speed.value = "fast"
    assert slow == pytest.approx(20 * panel.t_us, abs=20)
    assert f"{1e-3 * panel.t_us:.0f} ms after the start" in panel.numbers.value


def test_corners_can_be_taken_away(panel):
    # A straight bar has no corner; a lone circle is drawn by hand.
    with_circle = tile(np.zeros((32, 48), np.uint8), "x", np.array([[20, 16]]))
    without = tile(np.zeros((32, 48), np.uint8), "x", np.empty((0, 2)))
    rows, columns = np.nonzero((with_circle != without).any(axis=2))
    centre = (3 + 2 * 20.5, CAPTION + 2 * 16.5)
    assert np.abs([columns.mean() - centre[0], rows.mean() - centre[1]]).max() < 1
    panel.corners.value = False
    assert (picture(panel) == picture(panel)[..., :1]).all()


def test_reset_brings_the_first_picture_back(panel):
    first, words = panel.picture.value, panel.numbers.value
    panel.speed.value, panel.time.value, panel.patch.value = "fast", 20, 11
    panel.corners.value = False
    assert panel.picture.value != first
    panel.reset.click()
    assert (panel.picture.value, panel.numbers.value) == (first, words)


def test_the_player_goes_through_the_whole_time(panel):
    (play,) = [w for w in panel.children[0].children if isinstance(w, Play)]
    assert (play.min, play.max, play.value) == (panel.time.min, panel.time.max, 70)


def test_recordings_and_pictures_are_needed():
    with pytest.raises(InputError, match="at least one"):
        SurfacePanel({})
    bare = SimpleNamespace(events=moving_bar(20.0), frames=np.empty((0, 32, 48), np.uint8))
    with pytest.raises(InputError, match="pictures"):
        SurfacePanel({"bare": bare})

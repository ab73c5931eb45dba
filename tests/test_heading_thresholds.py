"""No threshold behind a heading decides by a hair: half or double of each gives the same answer.

None of them was fitted to data.  What each must refuse is tested in `test_heading.py`.
"""

from importlib import import_module

import numpy as np
import pytest

from data_tools.simulation.simulator import simulate_translation
from evcalib.camera import Camera
from evcalib.geometry import angle_between, unit
from evcalib.heading import HeadingOptions, estimate_headings

CAMERA = Camera(346, 260, 250.0, 250.0, 172.5, 129.5)
MOTION = (1, 0, 0.3)

THRESHOLDS = {
    "heading._window_fit": ("STILL_PX", "SURVIVAL", "SHARE", "SHORTEN", "CELLS"),
    "heading._matches": ("CELL_PX",),
    "heading._estimator": ("REACH",),
    "heading._keyframes": ("REACH_PX", "SHORTEST", "LONGEST", "GRID_PX"),
    "heading.epipolar": ("SCORED", "TRIALS", "TURN_TRIALS"),
    "features._event_image": ("WAY_PX", "AHEAD", "SIGMA_PX", "RADIUS", "FARTHEST", "LEAST"),
}
NAMES = [f"evcalib.{module}.{name}" for module, names in THRESHOLDS.items() for name in names]
SHARES = ("SURVIVAL", "SHARE", "SHORTEN", "LEAST")


@pytest.fixture(scope="module")
def events():
    return simulate_translation(MOTION, 0.5, 0.9, CAMERA, seed=11).events


@pytest.fixture(scope="module")
def usual(events):
    """The share of windows with a heading, by the thresholds as they are."""
    found = estimate_headings(events, CAMERA).found
    assert found > 0.6  # the wall before the camera is nearly flat: a turn explains some windows
    return found


def require_good(estimate, usual):
    off = np.degrees(angle_between(estimate.headings.v, unit(MOTION)))
    assert np.median(off) < 0.6
    assert off.max() < 1.5
    assert estimate.found > 0.8 * usual


@pytest.mark.parametrize("factor", [0.5, 2])
@pytest.mark.parametrize("name", NAMES)
def test_half_or_double_of_a_threshold_gives_the_same_heading(
    name, factor, events, usual, monkeypatch
):
    module, _, short = name.rpartition(".")
    value = getattr(import_module(module), short)
    changed = type(value)(value * factor)
    monkeypatch.setattr(name, min(changed, 0.95) if short in SHARES else changed)
    require_good(estimate_headings(events, CAMERA), usual)


@pytest.mark.parametrize("factor", [0.5, 2])
@pytest.mark.parametrize("name", ["rate", "max_baseline", "threshold", "min_inliers", "enough_sd"])
def test_half_or_double_of_an_option_gives_the_same_heading(name, factor, events, usual):
    changed = type(getattr(HeadingOptions, name))(getattr(HeadingOptions, name) * factor)
    require_good(estimate_headings(events, CAMERA, **{name: changed}), usual)

"""Every public name from before the folders is still found under its old path, with a warning."""

import importlib
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import data_tools
import evcalib
from data_tools._moved import MOVED as MOVED_DATA_TOOLS
from evcalib._moved import LEFT, MOVED
from evcalib.joint import Systematic

OLD = [line.split() for line in Path(__file__).with_name("old_paths.txt").read_text().splitlines()]


@pytest.fixture(autouse=True)
def _forget():
    """Let each test import old paths as if for the first time."""
    yield
    for name in (*MOVED, *MOVED_DATA_TOOLS):
        module = sys.modules.pop(name, None)
        parent, _, last = name.rpartition(".")
        if module is not None and getattr(sys.modules.get(parent), last, None) is module:
            delattr(sys.modules[parent], last)


@pytest.mark.parametrize(("path", "names"), [(path, names) for path, *names in OLD])
def test_old_names_are_found(path, names):
    if path in MOVED or path in MOVED_DATA_TOOLS:
        with pytest.warns(DeprecationWarning, match=" has moved: import from "):
            module = importlib.import_module(path)
        assert [name for name in names if not hasattr(module, name)] == []
        return
    module = importlib.import_module(path)
    for name in names:
        if name not in dir(module):
            with pytest.warns(DeprecationWarning, match=f"{path}.{name} is public no more"):
                getattr(module, name)


def test_every_old_module_is_in_the_list():
    listed = {path for path, *_ in OLD}
    assert {*MOVED, *MOVED_DATA_TOOLS, *LEFT} - listed == set()


def test_the_old_and_the_new_are_one_thing():
    with pytest.warns(DeprecationWarning, match=r"import from evcalib\.alignment"):
        from evcalib.results import Calibration
    assert Calibration is evcalib.Calibration


def test_functions_that_became_methods_work_as_they_did():
    from data_tools.simulation.drives import s_curve
    from data_tools.simulation.streams import simulate
    from evcalib.alignment import StreamPair
    from evcalib.kinematics.velocity_track import velocity_track

    made = simulate(s_curve(10.0), np.random.default_rng(0))
    track, offsets = velocity_track(made.velocities), np.array([-0.1, 0.1])
    pair = StreamPair.of(made.headings, track)
    with pytest.warns(DeprecationWarning, match="has moved"):
        from evcalib.offset import covered_at_all, no_overlap, weights
    with pytest.warns(DeprecationWarning, match="has moved"):
        from evcalib.track import intervals
    with pytest.warns(DeprecationWarning, match="has moved"):
        from evcalib.baselines.rival import paired
    np.testing.assert_array_equal(weights(made.headings), pair.weight)
    np.testing.assert_array_equal(intervals(made.headings)[0], pair.columns.start)
    part = covered_at_all(made.headings, track, offsets)
    np.testing.assert_array_equal(part.t, pair.covered_at_all(offsets).headings.t)
    assert no_overlap(made.headings, track, "here") == pair.no_overlap("here")
    np.testing.assert_array_equal(paired(made.headings, track, 0.1)[1], pair.covered(0.1)[1])


def test_unknown_names_are_still_unknown():
    with pytest.warns(DeprecationWarning, match="has moved"):
        old = importlib.import_module("evcalib.offset")
    with pytest.raises(AttributeError, match=r"'evcalib\.offset' has no attribute 'nothing'"):
        old.nothing  # noqa: B018
    with pytest.raises(AttributeError, match=r"'evcalib\.joint' has no attribute 'nothing'"):
        evcalib.joint.nothing  # noqa: B018
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("data_tools.nothing")


@pytest.mark.parametrize(
    "use",
    [
        lambda: Systematic(spin_sd=0.3).yaw_rate_sd,
        lambda: replace(Systematic(), spin_sd=0.3).yaw_rate_sd,
        lambda: Systematic(yaw_rate_sd=0.3).spin_sd,
    ],
)
def test_a_field_is_found_by_its_old_name(use):
    with pytest.warns(DeprecationWarning, match="spin_sd is called yaw_rate_sd now"):
        assert use() == 0.3


def test_the_warning_names_the_line_of_the_user(tmp_path):
    script = tmp_path / "mine.py"
    script.write_text("from evcalib.offset import find_offset\n")
    words = [sys.executable, "-W", "always", str(script)]
    told = subprocess.run(words, capture_output=True, text=True, check=True).stderr
    assert "mine.py:1: DeprecationWarning: evcalib.offset has moved" in told


def test_topics_come_by_themselves():
    code = "import evcalib; evcalib.kinematics.Swerve; assert 'kinematics' in dir(evcalib)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    assert data_tools.__doc__

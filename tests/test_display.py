"""How results print: short, with units, true to the numbers, harmless in a browser."""

import subprocess
import sys
from dataclasses import dataclass, replace
from html.parser import HTMLParser
from importlib.resources import files

import numpy as np
import pytest
from made_runs import bare_run, made_run
from scipy.spatial.transform import Rotation

import evcalib
from data_tools.studies._engine.result import StudyResult
from evcalib import Events, HeadingSeries
from evcalib.baselines import RivalInput, calibrate_with
from evcalib.display import Shown, visible
from evcalib.pipeline import RefinedCalibration


@dataclass(frozen=True, eq=False)
class Parent(Shown):
    """Something measured.

    Attributes
    ----------
    speed, top : float
        Mean and largest speed [m/s].
    mixed : float
        Of the rotation [rad] and of the offset [s].
    t : ndarray, shape (n,)
        Times [s].
    """

    speed: float
    top: float
    mixed: float
    t: np.ndarray


@dataclass(frozen=True, eq=False)
class Child(Parent):
    """The same with a name.

    Attributes
    ----------
    name : str
        Of any origin.
    few : ndarray, shape (3,)
        A place [m].
    flags : ndarray, shape (n,)
        Whether to.
    parts : tuple
        Of any number.
    table : dict
        Of arrays.
    nothing : float, optional
        Not given.
    """

    name: str = ""
    few: np.ndarray | None = None
    flags: np.ndarray | None = None
    parts: tuple = ()
    table: dict | None = None
    nothing: float | None = None


def child(**changes):
    given = Child(
        0.5,
        1234.0,
        2.0,
        np.array([3.0, np.nan, -1.0, 7.25, 5.0]),
        few=np.array([1.0, 2.5, -3.0]),
        flags=np.arange(6) > 3,
        parts=(1, 2, 3, 4, "five"),
        table={"a": np.zeros((2, 3), dtype=int), "b": np.array(["x", "y", "z"] * 2)},
    )
    return replace(given, **changes)


def test_every_kind_of_field_in_its_own_words():
    assert repr(child(name="two\nlines")).split("\n") == [
        "Child",
        "  speed 0.5 m/s, top 1234 m/s, mixed 2",
        "  t shape (5,), -1 to 7.25 s, 1 not finite",
        "  name two lines",
        "  few (1, 2.5, -3) m",
        "  flags shape (6,), 2 true",
        "  parts 5 of int or str",
        "  table a: shape (2, 3), 0 to 0; b: shape (6,) of <U1",
        "  without nothing",
    ]


def results():
    run = made_run()
    rival = calibrate_with("vc", RivalInput(run.estimate.headings, run.velocities))
    parts = run.calibration, run.estimate, run.velocities, run.estimate.headings, run.truth
    yield from (run, bare_run(run), made_run("straight").calibration, rival, *parts)
    yield from (run.calibration.curve, run.calibration.residuals, run.calibration.diagnostics)
    yield from (run.estimate.snapshot, run.estimate.event_rate)
    yield Events.empty(4, 3)
    yield HeadingSeries([], np.empty((0, 3)))
    table = {f"column {k}": np.arange(1000.0) for k in range(40)}
    yield StudyResult("paper", 1000, 0, (), table, "some/where.csv")


def test_results_print_in_a_few_lines():
    for result in results():
        lines = repr(result).splitlines()
        assert lines[0].startswith(type(result).__name__)
        assert len(lines) < 15, repr(result)
        assert max(map(len, lines)) <= 90
        assert "array(" not in repr(result)


def test_a_calibration_says_first_what_was_asked():
    found = made_run().calibration
    title, offset, rotation, mounting, headings, verdict = repr(found).splitlines()
    low, high = found.offset_interval
    assert title == "Calibration"
    assert offset.split()[2:6] == [f"{found.offset:+.4f}", "s", "+-", f"{found.offset_sd:.4f}"]
    assert offset.endswith(f"95 % from {low:+.4f} to {high:+.4f} s")
    angles = Rotation.from_matrix(found.R_body_cam).as_euler("ZYX", degrees=True)[::-1]
    assert "roll {:+.2f}, pitch {:+.2f}, yaw {:+.2f} deg".format(*angles) in rotation
    assert f"below {np.degrees(found.rotation_radius):.2f} deg (95 %)" in rotation
    assert "from straight ahead" in mounting
    assert f"{len(found.residuals.t)} used" in headings
    assert verdict == f"  verdict {found.verdict.summary}"


def test_what_is_not_determined_does_not_look_as_if_it_were():
    _, offset, rotation, *_ = repr(made_run("straight").calibration).splitlines()
    assert "not determined: plausible from -1.0000 to +1.0000 s" in offset
    assert "+-" not in offset
    assert rotation.endswith("not determined")


def test_a_rival_states_no_error_bar_and_its_own_fields_come_last():
    run = made_run()
    found = calibrate_with("vc", RivalInput(run.estimate.headings, run.velocities))
    lines = repr(found).splitlines()
    assert lines[1] == f"  time offset {found.offset:+.4f} s"
    assert lines[2].endswith(" deg")
    assert lines[-1] == "  method vc"


def test_doubts_are_told():
    found = made_run().calibration
    verdict = replace(found.verdict, doubts=("The clocks drift apart.", "The lens is off."))
    shown = repr(RefinedCalibration.after(replace(found, verdict=verdict)))
    assert "doubts The clocks drift apart. The lens is off." in shown


class Table(HTMLParser):
    def __init__(self, source):
        super().__init__()
        self.tags, self.said = [], []
        self.feed(source)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)

    def handle_data(self, data):
        self.said.append(data)


NASTY = "<script>alert('1')</script> &amp; \x1b[2J\u202e"


def test_jupyter_gets_a_table_in_which_text_stays_text():
    shown = child(name=NASTY, table={NASTY: 1})._repr_html_()
    table = Table(shown)
    assert set(table.tags) == {"table", "caption", "tr", "th", "td"}
    assert table.tags.count("tr") == 10
    assert {"Child", "few", "(1, 2.5, -3) m", "0.5 m/s"} <= set(table.said)
    assert shown.count("&lt;script&gt;alert(&#x27;1&#x27;)&lt;/script&gt; &amp;amp;") == 2
    assert not set("\x1b\u202e") & set(shown)
    assert not set("\x1b\u202e") & set(repr(child(name=NASTY)))


def test_what_moves_the_cursor_is_marked_and_all_else_kept():
    assert visible("a\tb\nä 漢\x00\x9b\u200f\ud800") == "a\tb\nä 漢" + 4 * "\ufffd"


def test_modules_and_panels_are_listed_and_there_when_asked_for():
    code = (
        "import sys, evcalib\n"
        "assert 'kinematics' in dir(evcalib) and 'evcalib.kinematics' not in sys.modules\n"
        "assert evcalib.kinematics.Swerve and 'matplotlib' not in sys.modules\n"
        "names = dir(evcalib.widgets)\n"
        "assert 'Cockpit' in names and 'cockpit' in names and 'ipywidgets' not in sys.modules\n"
        "assert evcalib.widgets.Cockpit.__module__ == 'evcalib.widgets.cockpit'\n"
        "assert 'rotation' in dir(evcalib.plots) and evcalib.plots.rotation.draw_losses\n"
        "assert evcalib.plots.draw_motion is evcalib.plots.kinematics.draw_motion\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("package", ["widgets", "plots"])
def test_what_a_package_lists_is_all_that_stands_in_it(package):
    module = getattr(evcalib, package)
    sources = [file for file in files(module).iterdir() if file.suffix == ".py"]
    topics = {file.stem for file in sources if not file.stem.startswith("_")}
    assert topics <= set(dir(module))
    assert set(module.__all__) <= set(dir(module))
    for name in dir(module):
        assert getattr(module, name).__name__.split(".")[-1] == name
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = module.nothing

"""A wrong type at a front door: what is wanted, what came, and what makes it."""

import numpy as np
import pytest

import evcalib
from evcalib import Camera, Events, HeadingSeries, InputError, VelocitySeries, checks
from evcalib.alignment.offset import find_offset
from evcalib.alignment.rotation import estimate_rotation
from evcalib.kinematics import body_velocities
from evcalib.plots.alignment import alignment_figures
from evcalib.report import report_figures, report_html
from evcalib.surfaces import tos
from evcalib.widgets import (
    Cockpit,
    DriveDesigner,
    HeadingPanel,
    OffsetPanel,
    RivalPanel,
    RotationPanel,
    SurfacePanel,
)

T = np.arange(0.0, 2.0, 0.1)
V = np.tile([1.0, 0.0, 0.0], (T.size, 1))
HEADINGS, VELOCITIES = HeadingSeries(T, V), VelocitySeries(T, V)
CAMERA = Camera(24, 18, 20.0, 20.0, 12.0, 9.0)

CALLS = {
    r"headings must be HeadingSeries, not ndarray; .*estimate_headings": lambda: evcalib.align(
        V, VELOCITIES
    ),
    r"headings must be HeadingSeries, not VelocitySeries": lambda: evcalib.align(
        VELOCITIES, HEADINGS
    ),
    r"velocities must be VelocitySeries, not ndarray; .*body_velocities": lambda: evcalib.align(
        HEADINGS, V
    ),
    r"headings must be HeadingSeries, not tuple": lambda: find_offset((T, V), VELOCITIES),
    r"track must be VelocityTrack, not VelocitySeries; .*velocity_track\(velocities\)": (
        lambda: find_offset(HEADINGS, VELOCITIES)
    ),
    r"headings must be numbers": lambda: estimate_rotation(HEADINGS, V),
    r"camera must be Camera, not tuple; .*evcalib\.Camera\(": lambda: evcalib.estimate_headings(
        Events.empty(4, 3), (24, 18)
    ),
    r"are needed, not int": lambda: evcalib.estimate_headings(3, CAMERA),
    r"events must be Events, not ndarray": lambda: evcalib.estimate_headings([V], CAMERA),
    r"events must be Events, not ndarray; .*from_arrays": lambda: tos(V),
    r"wheel_log must be WheelLog, not ndarray": lambda: body_velocities(V, None),
    r"calibration must be Calibration, not tuple": lambda: alignment_figures((0.1, np.eye(3))),
    r"run must be CalibrationRun, not HeadingSeries; .*calibrate": lambda: report_html(HEADINGS),
    r"run must be CalibrationRun, not dict": lambda: report_figures({}),
    r"camera fx must be a positive number of pixels, not 'f'": lambda: Camera(4, 3, "f", 1, 1, 1),
    r"camera width must be a positive number of pixels, not None": (
        lambda: Camera(None, 3, 1, 1, 1, 1)
    ),
    r"event column x must have shape": lambda: Events.from_arrays(None, [0], [0], [0], 4, 3),
    r"event column y must hold integers": lambda: Events.from_arrays([0], ["a"], [0], [0], 4, 3),
    r"heading v must have shape \(20, 3\)": lambda: HeadingSeries(T, None),
    r"velocity v must be numbers": lambda: VelocitySeries(T, "fast"),
    r"recordings must be Mapping, not ndarray; .*names to recordings": lambda: Cockpit(V),
    r"recording 'a' must be SolvedStreams, not ndarray; .*calibration": lambda: Cockpit({"a": V}),
    r"motions must be Mapping, not list": lambda: DriveDesigner(["arc"]),
    r"recordings must be Mapping, not list": lambda: HeadingPanel([1]),
    r"recordings must be Mapping, not Events": lambda: SurfacePanel(Events.empty(4, 3)),
    r"motions must be Iterable, not int; .*names of motions": lambda: OffsetPanel(None, 3),
    r"kinds must be Iterable, not float": lambda: RotationPanel(None, 0.5),
    r"motions must be Iterable, not NoneType": lambda: RivalPanel(None, None),
}


@pytest.mark.parametrize("told", list(CALLS))
def test_a_wrong_type_gets_a_message(told):
    with pytest.raises(InputError, match=told):
        CALLS[told]()


def test_what_the_messages_call_exists():
    for name, how in checks.MADE_BY.items():
        path = how.split("(")[0].split(".")
        thing = evcalib
        for word in path[1:]:
            thing = getattr(thing, word)
        assert callable(thing), name


def test_old_names_in_the_panels_work_for_a_while():
    from evcalib.widgets import cockpit, heading, surfaces

    for module, new in ((cockpit, "SolvedStreams"), (heading, "KnownMotion")):
        with pytest.warns(DeprecationWarning, match=f"Recording is called {new} now"):
            assert module.Recording is getattr(module, new)
    with pytest.warns(DeprecationWarning, match="EventsAndFrames"):
        _ = surfaces.Recording
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = cockpit.nothing

"""Every panel, at the ends of all its ranges and in many orders: no error, nothing broken shown."""

import importlib
import inspect
import pkgutil
from types import SimpleNamespace

import cv2
import ipywidgets as widgets
import numpy as np
import pytest
from widget_sweep import controls, name, shown, sweep

import evcalib.widgets
from data_tools.simulation.drives import PLANS, arc, fingers, s_curve, straight
from data_tools.simulation.streams import Noise, simulate
from data_tools.studies.baseline_runs import reckoned_poses
from evcalib.alignment import align
from evcalib.camera import Camera
from evcalib.events import Events
from evcalib.geometry import unit
from evcalib.kinematics import Swerve, Wheel
from evcalib.plots import style
from evcalib.widgets._parts import Panel
from evcalib.widgets.cockpit import Cockpit, SolvedStreams
from evcalib.widgets.designer import DriveDesigner
from evcalib.widgets.heading import HeadingPanel
from evcalib.widgets.kinematics import SwervePanel
from evcalib.widgets.offset import OffsetPanel
from evcalib.widgets.rivals import RivalPanel
from evcalib.widgets.rotation import RotationPanel
from evcalib.widgets.surfaces import SurfacePanel
from evcalib.widgets.turning import TurningPanel

DRIVES = {
    "arc": arc(6.0, radius=2.0),
    "S-curve": s_curve(6.0, period=3.0),
    "straight": straight(6.0),
}
OFFSET = 0.2


def drive(kind, noise, drift=0.01):
    return simulate(
        DRIVES[kind],
        np.random.default_rng(4),
        offset=OFFSET,
        heading_rate=10.0,
        heading_noise=Noise(sigma=noise),
        velocity_noise=Noise(sigma=drift, rho=0.98),
    )


def trial(kind, noise, drift):
    s = drive(kind, noise, drift)
    speed = s.drive.speed(s.headings.t + OFFSET)
    given = reckoned_poses(s.headings, s.velocities, speed)
    path = np.cumsum(s.drive.velocity(s.velocities.t), axis=0)
    return SimpleNamespace(given=given, R_body_cam=s.R_body_cam, offset=OFFSET, path=path)


def pairs(kind, share):
    noise = Noise(sigma=0.05, outliers=share, cluster=kind == "cluster")
    s = simulate(DRIVES["S-curve"], np.random.default_rng(5), heading_noise=noise)
    d = unit(s.drive.velocity(s.headings.t))
    return SimpleNamespace(e=s.headings.v, d=d, R_body_cam=s.R_body_cam)


def recording(drive):
    s = simulate(drive, np.random.default_rng(7), offset=OFFSET, heading_noise=Noise(sigma=0.02))
    return SolvedStreams(s.headings, s.velocities, align(s.headings, s.velocities), s)


def noise_events(seed, direction):
    rng = np.random.default_rng(seed)
    n = 20_000
    x, y, p = rng.integers(0, 80, n), rng.integers(0, 60, n), rng.integers(0, 2, n)
    t = np.sort(rng.integers(0, 800_000, n))
    return SimpleNamespace(
        events=Events.from_arrays(x, y, t, p, 80, 60),
        camera=Camera(80, 60, 70.0, 70.0, 39.5, 29.5),
        direction=np.array(direction),
        frames=rng.integers(0, 255, (3, 60, 80)).astype(np.uint8),
    )


def corner_wheels():
    places = {"fl": (0.3, 0.25), "fr": (0.3, -0.25), "rl": (-0.3, 0.25), "rr": (-0.3, -0.25)}
    return Swerve(tuple(Wheel(wheel, *place) for wheel, place in places.items()))


def moving():
    return {
        "ahead": noise_events(1, [0.0, 0.0, 1.0]),
        "right": noise_events(2, [1.0, 0.0, 0.0]),
    }


PANELS = {
    SurfacePanel: lambda: SurfacePanel(moving()),
    HeadingPanel: lambda: HeadingPanel(moving()),
    SwervePanel: lambda: SwervePanel(corner_wheels()),
    OffsetPanel: lambda: OffsetPanel(drive, list(DRIVES)),
    RotationPanel: lambda: RotationPanel(pairs, ("uniform", "cluster")),
    DriveDesigner: lambda: DriveDesigner(PLANS),
    Cockpit: lambda: Cockpit(
        {"curve": recording(DRIVES["S-curve"]), "fingers": recording(fingers(out=1.5))}
    ),
    RivalPanel: lambda: RivalPanel(trial, list(DRIVES), ("ours", "vc", "hand_eye")),
    TurningPanel: lambda: TurningPanel(PLANS),
}


@pytest.fixture
def notebook():
    """Set the style that each notebook uses, in which warnings are errors as everywhere here."""
    with style.context():
        yield


@pytest.mark.usefixtures("notebook")
@pytest.mark.parametrize("kind", PANELS, ids=lambda kind: kind.__name__)
def test_no_place_and_no_order_breaks_a_panel(kind):
    panel = PANELS[kind]()
    first, start = shown(panel), values(panel)
    assert sweep(panel, steps=16, seed=1) > 8
    if kind is Cockpit:  # it stays with its recording
        panel.recording.index = 0
    next(part for part in controls(panel) if name(part) == "reset").click()
    assert values(panel) == start
    assert shown(panel) == first


def values(panel):
    """Return where the controls stand, but not the play buttons: the browser moves those."""
    return [
        part.value
        for part in controls(panel)
        if not isinstance(part, widgets.Play | widgets.Button)
    ]


def test_every_panel_of_the_library_is_swept():
    found = set()
    for module in pkgutil.iter_modules(evcalib.widgets.__path__, "evcalib.widgets."):
        inside = vars(importlib.import_module(module.name)).values()
        found |= {c for c in inside if inspect.isclass(c) and issubclass(c, widgets.Box)}
    assert found - {Panel} - {c for c in found if c.__module__.startswith("ipywidgets")} == set(
        PANELS
    )


def broken(fails):
    """Return a small panel, and what makes it fail."""
    a, b = (widgets.IntSlider(max=10, description=letter) for letter in "ab")
    button = widgets.Button(description="press")
    picture, text = widgets.Image(), widgets.HTML("words")
    output = widgets.interactive_output(
        lambda a: 1 / (a - 5 if fails == "interact" else 1), {"a": a}
    )
    fine, blank = (
        cv2.imencode(".png", image)[1].tobytes() for image in (np.eye(9) * 99, np.eye(9) * 0)
    )
    picture.value = fine

    def moved(change):
        together = a.value == 10 and b.value == 0
        if fails == "together" and together:
            raise ZeroDivisionError("together")
        if fails == "blank" and together:
            picture.value = blank
        text.value = "nan deg" if fails == "text" and together else "words"

    def pressed(button):
        if fails == "button":
            raise KeyError("pressed")

    a.observe(moved, "value")
    b.observe(moved, "value")
    button.on_click(pressed)
    return widgets.VBox([a, b, button, picture, text, output])


@pytest.mark.parametrize(
    ("fails", "words"),
    [("together", "ZeroDivisionError"), ("button", "KeyError"), ("interact", "ZeroDivisionError"),
     ("blank", "a blank picture"), ("text", "nan in 'nan deg'")],
)  # fmt: skip
def test_the_sweep_sees_what_is_broken(fails, words):
    with pytest.raises(AssertionError, match=words):
        sweep(broken(fails), steps=40)


def test_the_sweep_passes_what_is_sound():
    assert sweep(broken(None), steps=40) == 1

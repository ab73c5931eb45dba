"""Choose a motion and what spoils it, and see every method cope with the same streams."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterable, Sequence
from typing import Protocol

import ipywidgets as widgets
import numpy as np

from evcalib.alignment import Calibration
from evcalib.arrays import Floats
from evcalib.baselines import METHODS, RivalInput, calibrate_with
from evcalib.errors import EvcalibError
from evcalib.geometry import rotation_angle
from evcalib.plots import style
from evcalib.plots.rivals import draw_rivals
from evcalib.widgets._parts import (
    Panel,
    bare_figure,
    choices,
    encode,
    pixels,
    slider,
    whole_slider,
    wipe,
)

MIN_NOISE, MAX_NOISE = 0.02, 0.3
"""Range of the noise slider: standard deviation of the headings per axis [rad]."""
MAX_DRIFT = 20
"""Range of the drift slider: slow error of the odometry, as a share of its speed [%]."""


class Trial(Protocol):
    """Streams and trajectories of one drive, with what is true of them."""

    @property
    def given(self) -> RivalInput: ...  # noqa: D102

    @property
    def R_body_cam(self) -> Floats: ...  # noqa: D102

    @property
    def offset(self) -> float: ...  # noqa: D102

    @property
    def path(self) -> Floats: ...  # noqa: D102


class RivalPanel(Panel):
    """Motion, noise, drift and method against the errors of all methods.

    The sliders act when they are released, since each move runs every method again.

    Parameters
    ----------
    make : callable
        Makes a trial: ``make(kind, noise, drift)``, noise in rad, drift as a share of the speed.
    kinds : sequence of str
        Motions to choose from.
    methods : sequence of str
        Keys of :data:`evcalib.baselines.METHODS`.
    """

    def __init__(
        self,
        make: Callable[[str, float, float], Trial],
        kinds: Sequence[str],
        methods: Sequence[str] = tuple(METHODS),
    ) -> None:
        kinds, methods = choices(kinds, "motion", Iterable), choices(methods, "method", Iterable)
        super().__init__()
        self._make = make
        self._methods = tuple(methods)
        self.motion = widgets.Dropdown(options=kinds, description="motion")
        self.method = widgets.Dropdown(options=methods, description="method")
        self.noise = slider("noise [rad]", MIN_NOISE, MAX_NOISE, 0.02, 0.1, ".2f")
        self.drift = whole_slider("drift [%]", 0, MAX_DRIFT, 2, 2)
        self.noise.continuous_update = self.drift.continuous_update = False
        self.picture, self.numbers = widgets.Image(format="png"), widgets.HTML()
        self._figure = bare_figure(
            (9.4, 3.7), left=0.06, right=0.985, bottom=0.13, top=0.91, wspace=0.5
        )
        with style.context():
            self._axes = self._figure.subplots(1, 2, width_ratios=(5, 4))
        self._of: tuple[str, float, int] | None = None
        first = widgets.HBox([self.motion, self.method, self.reset])
        second = widgets.HBox([self.noise, self.drift])
        controls = (self.motion, self.method, self.noise, self.drift)
        self._start(controls, [first, second, self.picture, self.numbers])

    def _drive(self) -> None:
        """Make new streams and run every method on them."""
        self._of = self.motion.value, self.noise.value, self.drift.value
        self.trial = self._make(self.motion.value, self.noise.value, self.drift.value / 100)
        self.found: dict[str, Calibration] = {}
        self.failures: dict[str, str] = {}
        for name in self._methods:
            try:
                self.found[name] = calibrate_with(name, self.trial.given)
            except EvcalibError as error:
                self.failures[name] = str(error)

    def _draw(self) -> None:
        if self._of != (self.motion.value, self.noise.value, self.drift.value):
            self.numbers.value = "computing ..."
            self._drive()
        self.picture.value = self.draw()
        self.numbers.value = self.table()

    def errors(self) -> dict[str, float]:
        """Return the rotation error of each method [deg]; NaN where it failed."""
        true = self.trial.R_body_cam
        return {
            name: float(np.degrees(rotation_angle(self.found[name].R_body_cam, true)))
            if name in self.found
            else np.nan
            for name in self._methods
        }

    def draw(self) -> bytes:
        """Return the paths as the chosen method places them, and all errors, as a PNG picture."""
        chosen = self.method.value
        wipe(self._axes)
        with style.context():
            draw_rivals(
                self._axes,
                self.trial.given,
                self.errors(),
                chosen,
                self.found.get(chosen),
                true=self.trial.path,
            )
        return encode(pixels(self._figure))

    def table(self) -> str:
        """Return errors and what each method states about them as HTML, the chosen one in bold."""
        rows = [_row("th", ["", "rotation [deg]", "offset [ms]", "states"])]
        for name, error in self.errors().items():
            if name in self.found:
                found = self.found[name]
                off = 1000 * (found.offset - self.trial.offset)
                cells = [name, f"{error:.2f}", f"{off:+.0f}", _stated(found)]
            else:
                cells = [name, "-", "-", self.failures[name]]
            cells = [html.escape(cell) for cell in cells]
            rows.append(_row("td", cells, bold=name == self.method.value))
        return f"errors: <table style='line-height:1.2'>{''.join(rows)}</table>"


def _stated(found: Calibration) -> str:
    """Return a method's own words about its uncertainty."""
    if not np.isfinite(found.rotation_sd):
        return "nothing"
    rotation = f"rotation sd {np.degrees(found.rotation_sd):.2f} deg"
    if not found.rotation_observable:
        rotation = "rotation not determined"
    if not found.offset_observable:
        return f"{rotation}, offset not determined"
    return f"{rotation}, offset sd {1000 * found.offset_sd:.0f} ms"


def _row(kind: str, cells: Sequence[str], *, bold: bool = False) -> str:
    words = [f"<b>{cell}</b>" if bold else cell for cell in cells]
    aligns = ("left", "right", "right", "left")
    return (
        "<tr>"
        + "".join(
            f"<{kind} style='padding:1px 10px; text-align:{align}'>{word}</{kind}>"
            for word, align in zip(words, aligns, strict=True)
        )
        + "</tr>"
    )

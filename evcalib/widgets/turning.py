"""Choose how a vehicle turns, and see what that tells of the camera on it."""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping

import ipywidgets as widgets
import numpy as np

from evcalib.design import Prediction, Viewing, predict
from evcalib.errors import InputError
from evcalib.geometry import LOOKS_FORWARD
from evcalib.plots import style
from evcalib.plots.turning import draw_turning, relative_errors, turning_axes
from evcalib.series import VelocitySeries
from evcalib.widgets._parts import Panel, bare_figure, choices, encode, pixels, slider, wipe
from evcalib.widgets.designer import Course, planned, said

HEIGHT = 0.3
"""At which the camera is drawn [m]; no motion shows it."""

TIMES = 5.0
"""The ellipse of the position is drawn so many times as large: then one of 1 cm can be seen, and
one of 20 cm fills the floor."""


class TurningPanel(Panel):
    """Pick a motion and a place of the camera, and see each unknown's error bar grow or shrink.

    Rings mark the bars of the motion that was held last, at first those of the first one.

    Parameters
    ----------
    motions : mapping of str to callable
        Makes a drive: ``make(swing_deg, period, speed, duration)``, in degrees, seconds and metres.
    """

    def __init__(self, motions: Mapping[str, Callable[..., Course]]) -> None:
        super().__init__()
        choices(motions, "motion")
        self._motions = dict(motions)
        self.motion = widgets.ToggleButtons(
            options=list(self._motions), style={"button_width": "115px"}
        )
        self.swing = slider("swing [deg]", 0.0, 120.0, 5.0, 45.0)
        self.period = slider("period [s]", 3.0, 15.0, 0.5, 9.0, ".1f")
        self.speed = slider("speed [m/s]", 0.1, 1.5, 0.1, 0.5, ".1f")
        self.duration = slider("duration [s]", 6.0, 40.0, 2.0, 16.0)
        self.x = slider("camera x [m]", -0.4, 0.4, 0.05, 0.25, ".2f")
        self.y = slider("camera y [m]", -0.4, 0.4, 0.05, -0.2, ".2f")
        self.hold = widgets.Button(description="hold", icon="thumb-tack", layout={"width": "90px"})
        self.hold.on_click(lambda button: self._keep())
        self.picture, self.numbers = widgets.Image(format="png"), widgets.HTML()
        self._rings: dict[str, float] | None = None
        margins = {"left": 0.075, "right": 0.985, "bottom": 0.155, "top": 0.97, "wspace": 0.22}
        self._figure = bare_figure((9.6, 3.2), **margins)
        with style.context():
            self._axes = turning_axes(self._figure)
        controls = (
            self.motion, self.swing, self.period, self.speed, self.duration, self.x, self.y
        )  # fmt: skip
        rows = [
            self.motion,
            widgets.HBox([self.swing, self.period, self.speed]),
            widgets.HBox([self.duration, self.x, self.y]),
            self.picture,
            widgets.HBox([self.hold, self.reset]),
            self.numbers,
        ]
        self._start(controls, rows)

    def drive(self) -> VelocitySeries:
        """Return the drive as the controls have it."""
        make = self._motions[self.motion.value]
        return planned(
            make(self.swing.value, self.period.value, self.speed.value, self.duration.value)
        )

    def prediction(self, drive: VelocitySeries) -> Prediction:
        """Return what a drive will tell of a camera where the sliders have it."""
        return predict(drive, viewing=Viewing(position=(self.x.value, self.y.value)))

    def restart(self) -> None:
        """Set all controls, and the rings, to what they were at first."""
        self._rings = None
        super().restart()

    def _keep(self) -> None:
        """Let the rings mark the bars as they are."""
        self._rings = None
        self._changed()

    def _draw(self) -> None:
        try:
            drive = self.drive()
            self._found = self.prediction(drive)
        except InputError as error:
            self.numbers.value = f"{html.escape(str(error))} The picture is older."
            return
        if self._rings is None:
            self._rings = relative_errors(self._found)
        wipe(self._axes)
        place = np.array([self.x.value, self.y.value, HEIGHT])
        with style.context():
            draw_turning(
                self._axes,
                drive,
                self._found,
                LOOKS_FORWARD,
                place,
                times=TIMES,
                before=self._rings,
            )
        self.picture.value = encode(pixels(self._figure))
        found = self._found
        sure = found.offset_determined and found.rotation_determined and found.position_determined
        self.numbers.value = said(found, sure=sure)

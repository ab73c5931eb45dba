"""Design a drive, and see what it will tell, before anyone drives it."""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping
from typing import Protocol

import ipywidgets as widgets
import numpy as np

from evcalib.design import Prediction, Viewing, predict, self_likeness
from evcalib.errors import InputError
from evcalib.plots import style
from evcalib.plots.design import draw_design
from evcalib.series import VelocitySeries

VIEWING = Viewing()

RATE = 50.0
"""Samples per second of a planned drive."""


class Course(Protocol):
    """A drive that is exact at any time (as of `data_tools.motion`)."""

    duration: float

    def velocity(self, t: np.ndarray) -> np.ndarray: ...  # noqa: D102


class DriveDesigner(widgets.VBox):
    """Motion, swing, period, speed and duration against the precision that they allow.

    Parameters
    ----------
    motions : mapping of str to callable
        Makes a drive: ``make(swing_deg, period, speed, duration)``, in degrees, seconds and metres.
    viewing : Viewing
        The camera and what it sees.
    """

    def __init__(
        self, motions: Mapping[str, Callable[..., Course]], viewing: Viewing = VIEWING
    ) -> None:
        if not motions:
            raise InputError("at least one motion is needed")
        self._motions, self._viewing = dict(motions), viewing
        self.motion = widgets.Dropdown(options=list(self._motions), description="motion")
        self.swing = _slider("swing [deg]", 0.0, 120.0, 5.0, 45.0, ".0f")
        self.period = _slider("period [s]", 1.0, 12.0, 0.5, 6.0, ".1f")
        self.speed = _slider("speed [m/s]", 0.1, 2.0, 0.1, 0.5, ".1f")
        self.duration = _slider("duration [s]", 4.0, 40.0, 2.0, 16.0, ".0f")
        self.search = _slider("search [s]", 0.1, 2.0, 0.1, 1.0, ".1f")
        self.reset = widgets.Button(description="reset")
        self.picture = widgets.Image(format="png")
        self.numbers = widgets.HTML()
        self._sliders = (self.swing, self.period, self.speed, self.duration, self.search)
        self._start = [slider.value for slider in self._sliders]
        self._held = False
        for control in (self.motion, *self._sliders):
            control.observe(lambda change: self._draw(), names="value")
        self.reset.on_click(lambda button: self._reset())
        rows = [
            widgets.HBox([self.motion, self.swing, self.period]),
            widgets.HBox([self.speed, self.duration, self.search, self.reset]),
        ]
        super().__init__([*rows, self.picture, self.numbers])
        self._draw()

    def drive(self) -> VelocitySeries:
        """Return the drive as the controls have it."""
        make = self._motions[self.motion.value]
        course = make(self.swing.value, self.period.value, self.speed.value, self.duration.value)
        t = np.arange(0.0, course.duration, 1.0 / RATE)
        return VelocitySeries(t, course.velocity(t))

    def predictions(self, drive: VelocitySeries) -> tuple[Prediction, Prediction]:
        """Return what the drive allows: with its speeds, and from directions alone."""
        options = {"viewing": self._viewing, "max_offset": self.search.value}
        return predict(drive, **options), predict(drive, speed=False, **options)

    def draw(self, drive: VelocitySeries, prediction: Prediction) -> bytes:
        """Return the picture of the drive as a PNG file."""
        figure = style.new_figure((9.4, 3.2))
        with style.context():
            alone = self_likeness(drive, prediction.shifts, speed=False)
            draw_design(figure, drive, prediction, alone)
        return style.png(figure)

    def table(self, full: Prediction, alone: Prediction) -> str:
        """Return both predictions and the verdict as HTML."""
        head = "".join(f"<th style='{_CELL}'>{name}</th>" for name in ("", "offset", *_AXES))
        body = ""
        for name, found in (("with speeds", full), ("directions alone", alone)):
            cells = [name, _milliseconds(found), *(_degrees(x) for x in found.rotation_sd)]
            body += "<tr>" + "".join(f"<td style='{_CELL}'>{cell}</td>" for cell in cells) + "</tr>"
        words = html.escape(" ".join((full.summary, *full.advice)))
        return f"<table><tr>{head}</tr>{body}</table><b>Verdict.</b> {words}"

    def _reset(self) -> None:
        self._held = True
        for slider, value in zip(self._sliders, self._start, strict=True):
            slider.value = value
        self._held = False
        self._draw()

    def _draw(self) -> None:
        if self._held:
            return
        drive = self.drive()
        full, alone = self.predictions(drive)
        self.picture.value = self.draw(drive, full)
        self.numbers.value = self.table(full, alone)


_CELL = "padding:2px 10px; text-align:right"
_AXES = ("roll (X)", "pitch (Y)", "yaw (Z)")


def _milliseconds(found: Prediction) -> str:
    if not found.offset_determined:
        return "repeats" if found.repeats else "not shown"
    return f"{1e3 * found.offset_sd:.1f} ms"


def _degrees(sd: float) -> str:
    return f"{np.degrees(sd):.2f} deg" if np.degrees(sd) < 90 else "unknown"


def _slider(
    name: str, low: float, high: float, step: float, value: float, digits: str
) -> widgets.FloatSlider:
    return widgets.FloatSlider(
        min=low, max=high, step=step, value=value, description=name, readout_format=digits
    )

"""Design a drive, and see what it will tell, before anyone drives it."""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping
from typing import Protocol

import cv2
import ipywidgets as widgets
import numpy as np

from evcalib.arrays import Floats
from evcalib.design import Prediction, Viewing, predict
from evcalib.design.waypoints import drive_through, read_way_points
from evcalib.errors import InputError
from evcalib.plots import style
from evcalib.plots.design import course, design_axes, draw_design
from evcalib.series import VelocitySeries
from evcalib.widgets._parts import (
    Panel,
    Picture,
    bare_figure,
    bgr,
    choices,
    encode,
    pixels,
    player,
    slider,
    whole_slider,
    wipe,
)

VIEWING = Viewing()

RATE = 50.0
"""Samples per second of a planned drive."""

OWN = "way points"
"""The motion that the user draws."""

FIRST_POINTS = "0 0\n1.2 0.6\n1.8 -0.6\n3 0.2\n2.4 1.4"
"""Way points to start from: forward and to the left [m]."""

PAD = {
    "↖": (1, 1), "↑": (1, 0), "↗": (1, -1),
    "←": (0, 1), "undo": (0, 0), "→": (0, -1),
    "↙": (-1, 1), "↓": (-1, 0), "↘": (-1, -1),
}  # fmt: skip
"""Buttons as they lie, with the way that each of them adds: forward and to the left."""


class Course(Protocol):
    """A drive that is exact at any time (as of `data_tools.simulation.streams`)."""

    duration: float
    yaw_rate: Callable[[np.ndarray], np.ndarray]

    def velocity(self, t: np.ndarray) -> np.ndarray: ...  # noqa: D102


def planned(plan: Course) -> VelocitySeries:
    """Return a planned drive as its wheels would be logged."""
    t = np.arange(0.0, plan.duration, 1.0 / RATE)
    return VelocitySeries(t, plan.velocity(t), plan.yaw_rate(t))


def said(prediction: Prediction, *, sure: bool) -> str:
    """Return what a drive will tell, and what to change, as HTML."""
    color = style.INLIER if sure else style.OUTLIER
    advice = html.escape(" ".join(prediction.advice))
    return (
        f"<div style='border-left:6px solid {color}; padding:4px 14px; line-height:1.5'>"
        f"<b style='font-size:115%'>{html.escape(prediction.summary)}</b><br>{advice}</div>"
    )


class DriveDesigner(Panel):
    """Pick a motion or draw one, and see the precision that it allows.

    Parameters
    ----------
    motions : mapping of str to callable
        Makes a drive: ``make(swing_deg, period, speed, duration)``, in degrees, seconds and metres.
    viewing : Viewing
        The camera and what it sees, at first.
    """

    def __init__(
        self, motions: Mapping[str, Callable[..., Course]], viewing: Viewing = VIEWING
    ) -> None:
        super().__init__()
        choices(motions, "motion")
        self._motions = dict(motions)
        self.motion = widgets.ToggleButtons(
            options=[*self._motions, OWN], style={"button_width": "105px"}
        )
        self.swing = slider("swing [deg]", 0.0, 120.0, 5.0, 45.0)
        self.period = slider("period [s]", 1.0, 12.0, 0.5, 6.0, ".1f")
        self.speed = slider("speed [m/s]", 0.1, 2.0, 0.1, 0.5, ".1f")
        self.duration = slider("duration [s]", 4.0, 40.0, 2.0, 16.0)
        self.search = slider("search ± [s]", 0.1, 2.0, 0.1, 1.0, ".1f")
        self.focal = slider("focal [px/rad]", 50.0, 1000.0, 10.0, viewing.focal)
        self.corners = slider("corners", 2.0, 100.0, 1.0, viewing.corners)
        self.distance = slider("distance [m]", 0.5, 10.0, 0.1, viewing.distance, ".1f")
        self.noise = slider("noise [px]", 0.05, 2.0, 0.05, viewing.noise, ".2f")
        self.points = widgets.Textarea(FIRST_POINTS, layout={"width": "190px", "height": "106px"})
        self.leg = slider("leg [m]", 0.2, 3.0, 0.1, 0.6, ".1f")
        self.time = whole_slider("time [%]", 0, 100, 1, 0)
        self.picture = widgets.Image(format="png")
        self.numbers = widgets.HTML()
        self._sliders = (self.swing, self.period, self.speed, self.duration, self.search)
        self._camera = (self.focal, self.corners, self.distance, self.noise)
        self._tools = widgets.HBox([self._pad(), self._text()])
        margins = {"left": 0.07, "right": 0.985, "bottom": 0.165, "top": 0.96, "wspace": 0.36}
        self._figure = bare_figure((9.6, 3.1), **margins)
        with style.context():
            self._axes = design_axes(self._figure)
        controls = (self.motion, *self._sliders, *self._camera, self.points, self.leg)
        self._start(controls, self._rows(), marks=[self.time])

    def drive(self) -> VelocitySeries:
        """Return the drive as the controls have it."""
        if self.motion.value == OWN:
            return drive_through(read_way_points(self.points.value), speed=self.speed.value)
        make = self._motions[self.motion.value]
        return planned(
            make(self.swing.value, self.period.value, self.speed.value, self.duration.value)
        )

    def viewing(self) -> Viewing:
        """Return the camera and what it sees as the sliders have it."""
        return Viewing(
            focal=self.focal.value,
            noise=self.noise.value,
            corners=self.corners.value,
            distance=self.distance.value,
        )

    def predictions(self, drive: VelocitySeries) -> tuple[Prediction, Prediction]:
        """Return what the drive allows: with its speeds, and from directions alone."""
        viewing, reach = self.viewing(), self.search.value
        full = predict(drive, viewing=viewing, max_offset=reach)
        return full, predict(drive, viewing=viewing, max_offset=reach, speed=False)

    def draw(self, drive: VelocitySeries, full: Prediction, alone: Prediction) -> Picture:
        """Return the picture of the drive, and keep where its moments lie in it."""
        wipe(self._axes)
        with style.context():
            draw_design(self._axes, drive, full, alone.likeness)
            if self.motion.value == OWN:
                forward, left = self._next_points().T
                self._axes[0].plot(left, forward, "o", ms=4, mfc="none", color=style.MUTED)
        picture = pixels(self._figure)
        at, direction, speed, _ = self._axes
        places = at.transData.transform(course(drive)[:, ::-1])
        across = direction.transData.transform(np.column_stack((drive.t, drive.t)))[:, 0]
        ends = [axes.get_window_extent().intervaly for axes in (direction, speed)]
        self._track = len(picture) - 1 - places[:, 1], places[:, 0]
        self._across, self._ends = across, [len(picture) - 1 - end for end in ends]
        return picture

    def with_moment(self, picture: Picture) -> Picture:
        """Return the picture with the vehicle where it is at the time of the slider."""
        row = round(0.01 * self.time.value * (self._across.size - 1))
        shown, color, scale = picture.copy(), bgr(style.MEASURED), 16
        y, x = (scale * along[row] for along in self._track)
        here = (round(x), round(y))
        cv2.circle(shown, here, 7 * scale, color, -1, cv2.LINE_AA, 4)
        cv2.circle(shown, here, 7 * scale, (255, 255, 255), 1, cv2.LINE_AA, 4)
        across = round(self._across[row])
        for end in self._ends:
            cv2.line(shown, (across, round(end[0])), (across, round(end[1])), color, 2)
        return shown

    def table(self, full: Prediction, alone: Prediction) -> str:
        """Return the verdict, and both predictions, as HTML."""
        verdict = said(full, sure=full.offset_determined and full.rotation_determined)
        head = "".join(f"<th style='{_CELL}'>{name}</th>" for name in _HEAD)
        body = ""
        for name, found in (("with speeds", full), ("directions alone", alone)):
            cells = [_milliseconds(found), *(_degrees(x) for x in found.rotation_sd)]
            cells += [_centimetres(sd) for sd in found.position_sd]
            row = "".join(f"<td style='{_CELL}'>{cell}</td>" for cell in (name, *cells))
            body += f"<tr>{row}</tr>"
        title = (
            "Predicted standard deviation of the offset, of the rotation about each axis, and of"
        )
        title += " the camera's position:"
        return f"{verdict}{title}<table><tr>{head}</tr>{body}</table>"

    def _pad(self) -> widgets.GridBox:
        self.pad = {}
        for name, way in PAD.items():
            self.pad[name] = widgets.Button(
                description=name, layout={"width": "48px", "height": "32px", "margin": "1px"}
            )
            self.pad[name].on_click(lambda button, way=way: self._step(way))
        columns = "50px 50px 50px"
        return widgets.GridBox(
            list(self.pad.values()), layout={"grid_template_columns": columns, "width": "160px"}
        )

    def _text(self) -> widgets.HBox:
        note = widgets.HTML(
            "<div style='line-height:1.4; width:420px'>Press the arrows to add a leg (it ends at"
            " one of the grey rings), or edit the way points as text: forward and to the left in"
            " metres, one per line. The same point twice is a pause of a second.</div>"
        )
        return widgets.HBox([self.points, widgets.VBox([note, self.leg])])

    def _rows(self) -> list[widgets.Widget]:
        camera = widgets.Accordion(
            [widgets.VBox([widgets.HBox(self._camera[:2]), widgets.HBox(self._camera[2:])])],
            titles=("What the camera sees",),
            selected_index=None,
        )
        return [
            self.motion,
            self._tools,
            widgets.HBox([self.swing, self.period, self.speed]),
            widgets.HBox([self.duration, self.search]),
            self.picture,
            widgets.HBox([player(self.time, 100), self.time, self.reset]),
            self.numbers,
            camera,
        ]

    def _step(self, way: tuple[int, int]) -> None:
        """Add a leg to the way points, or take the last one away."""
        try:
            points = read_way_points(self.points.value)
        except InputError as error:
            self.numbers.value = html.escape(str(error))
            return
        if not any(way):
            points = points[:-1]
        else:
            last = points[-1] if len(points) else np.zeros(2)
            leg = self.leg.value / np.hypot(*way) * np.array(way)
            points = np.vstack([points.reshape(-1, 2), last + leg])
        self.points.value = "\n".join(f"{x:.4g} {y:.4g}" for x, y in np.round(points, 2) + 0.0)

    def _next_points(self) -> Floats:
        """Return where the arrows of the pad lead to, seen from the start of the drive."""
        points = read_way_points(self.points.value)
        ways = np.array([way for way in PAD.values() if any(way)], dtype=np.float64)
        legs = self.leg.value * ways / np.linalg.norm(ways, axis=1, keepdims=True)
        return np.asarray(points[-1] - points[0] + legs)

    def _draw(self) -> None:
        own = self.motion.value == OWN
        self._tools.layout.display = "" if own else "none"
        for control in (self.swing, self.period, self.duration):
            control.layout.display = "none" if own else ""
        try:
            drive = self.drive()
            full, alone = self.predictions(drive)
        except InputError as error:
            self.numbers.value = f"{html.escape(str(error))} The picture is older."
            return
        self._bare = self.draw(drive, full, alone)
        self.numbers.value = self.table(full, alone)
        self._mark()

    def _mark(self) -> None:
        self.picture.value = encode(self.with_moment(self._bare))


_CELL = "padding:2px 12px; text-align:right"
_HEAD = ("", "offset", "roll (X)", "pitch (Y)", "yaw (Z)", "x", "y")


def _milliseconds(found: Prediction) -> str:
    if not found.offset_determined:
        return "repeats" if found.repeats else "not shown"
    return f"{1e3 * found.offset_sd:.2f} ms"


def _centimetres(sd: float) -> str:
    return f"{100 * sd:.2f} cm" if sd < 0.5 else "unknown"


def _degrees(sd: float) -> str:
    return f"{np.degrees(sd):.3f} deg" if np.degrees(sd) < 90 else "unknown"

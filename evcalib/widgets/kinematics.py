"""Steer and drive the wheels by hand, and see what the body does."""

from __future__ import annotations

from dataclasses import replace

import ipywidgets as widgets
import numpy as np

from evcalib.kinematics import BodyTwist, Swerve, WheelStates
from evcalib.plots import style
from evcalib.plots.kinematics import SECONDS, draw_motion, draw_travel, explain_motion
from evcalib.widgets._parts import (
    Panel,
    bare_figure,
    encode,
    pixels,
    player,
    slider,
    whole_slider,
    wipe,
)

MOTIONS = {
    "forward": (0.8, 0.0, 0.0),
    "sideways": (0.0, 0.8, 0.0),
    "spin on the spot": (0.0, 0.0, 1.5),
    "curve to the left": (0.8, 0.0, 1.0),
}
"""Motions to start from: v_x, v_y [m/s] and yaw rate [rad/s]."""
MAX_SPEED = 1.5
"""Range of the speed sliders [m/s]."""
LASTS_MS = 3000
"""The vehicle is shown to go for so long."""
_COLUMNS = ("", "v_x [m/s]", "v_y [m/s]", "yaw rate [rad/s]", "slip [m/s]")


def table(vehicle: Swerve, states: WheelStates) -> str:
    """Return what both methods make of the wheel states, as an HTML table."""
    rows = {
        "least squares": replace(vehicle, method="least_squares").twist(states),
        "paper's average": replace(vehicle, method="average").twist(states),
    }
    head = "".join(f"<th style='padding:2px 10px'>{name}</th>" for name in _COLUMNS)
    body = "".join(_row(name, twist) for name, twist in rows.items())
    return f"<table style='line-height:1.6'><tr>{head}</tr>{body}</table>"


def _row(name: str, twist: BodyTwist) -> str:
    values = (*twist.v[0], twist.yaw_rate[0], twist.slip[0])
    # adding zero after rounding turns -0.00 into 0.00
    cells = "".join(f"<td style='text-align:right'>{round(x, 2) + 0.0:.2f}</td>" for x in values)
    return f"<tr><td>{name}</td>{cells}</tr>"


class SwervePanel(Panel):
    """Two sliders per wheel, the vehicle with its motion, where it goes, and the numbers.

    Parameters
    ----------
    vehicle : Swerve
        The vehicle to drive.
    """

    def __init__(self, vehicle: Swerve) -> None:
        super().__init__()
        self.vehicle = vehicle
        self.speed = {
            name: slider(f"{name} speed", -MAX_SPEED, MAX_SPEED, 0.05, 0.0, ".2f")
            for name in vehicle.names
        }
        self.steer = {
            name: slider(f"{name} steer", -180.0, 180.0, 5.0, 0.0) for name in vehicle.names
        }
        self.motion = widgets.ToggleButtons(options=list(MOTIONS), style={"button_width": "130px"})
        self.time = whole_slider("time [ms]", 0, LASTS_MS, 100, 1000)
        self.picture = widgets.Image(format="png")
        self.numbers = widgets.HTML()
        margins = {"left": 0.075, "right": 0.985, "bottom": 0.19, "top": 0.94, "wspace": 0.2}
        self._figure = bare_figure((9.6, 4.9), **margins)
        with style.context():
            self._axes = self._figure.subplots(1, 2)
            explain_motion(self._figure)
        self.motion.observe(lambda change: self.start_from(change["new"]), names="value")
        self._set(self.motion.value)
        units = widgets.HTML("speed in m/s, steer in degrees, counter-clockwise from forward")
        wheels = [widgets.VBox([self.speed[n], self.steer[n]]) for n in vehicle.names]
        pairs = [widgets.HBox(wheels[k : k + 2]) for k in range(0, len(wheels), 2)]
        last = widgets.HBox([self.time, player(self.time, 150), self.reset])
        controls = (self.motion, *self.speed.values(), *self.steer.values(), self.time)
        self._start(controls, [self.motion, units, *pairs, self.picture, last, self.numbers])

    def states(self) -> WheelStates:
        """Return the wheel states that the sliders stand for, one row."""
        speed = [slider.value for slider in self.speed.values()]
        steer = [slider.value for slider in self.steer.values()]
        return WheelStates(np.array([speed]), np.radians([steer]))

    def start_from(self, motion: str) -> None:
        """Set all sliders to one of `MOTIONS`, as nearly as their steps allow."""
        held = self._held
        self._held = True
        self._set(motion)
        self._held = held
        self._changed()

    def draw(self, states: WheelStates) -> bytes:
        """Return the vehicle, its motion and its travel as a PNG picture."""
        reach = float(np.abs(self.vehicle.positions).max()) + 1.4 * SECONDS * MAX_SPEED
        wipe(self._axes)
        left, right = self._axes
        lasts, now = 1e-3 * LASTS_MS, 1e-3 * self.time.value
        with style.context():
            draw_motion(left, self.vehicle, states, reach=reach)
            draw_travel(right, self.vehicle, states, seconds=lasts, now=now)
            left.set_title("now")
            right.set_title(f"its way in {lasts:.0f} s")
        return encode(pixels(self._figure))

    def _set(self, motion: str) -> None:
        vx, vy, yaw_rate = MOTIONS[motion]
        states = self.vehicle.wheel_states([[vx, vy]], [yaw_rate])
        assert states.steer is not None
        for i, name in enumerate(self.vehicle.names):
            self.speed[name].value = float(states.speed[0, i])
            self.steer[name].value = float(np.degrees(states.steer[0, i]))

    def _draw(self) -> None:
        states = self.states()
        self.picture.value = self.draw(states)
        self.numbers.value = table(self.vehicle, states)

"""Steer and drive the wheels by hand, and see what the body does."""

from __future__ import annotations

from dataclasses import replace

import ipywidgets as widgets
import numpy as np

from evcalib.kinematics import BodyTwist, Swerve, WheelStates
from evcalib.plots import draw_motion, explain_motion, style
from evcalib.plots.kinematics import SECONDS

MOTIONS = {
    "forward": (0.8, 0.0, 0.0),
    "sideways": (0.0, 0.8, 0.0),
    "spin on the spot": (0.0, 0.0, 1.5),
    "curve to the left": (0.8, 0.0, 1.0),
}
"""Motions to start from: v_x, v_y [m/s] and yaw rate [rad/s]."""
MAX_SPEED = 1.5
"""Range of the speed sliders [m/s]."""
_COLUMNS = ("", "v_x [m/s]", "v_y [m/s]", "yaw rate [rad/s]", "slip [m/s]")


def draw_states(vehicle: Swerve, states: WheelStates) -> bytes:
    """Return the vehicle and its motion as a PNG picture."""
    reach = float(np.abs(vehicle.positions).max()) + 1.4 * SECONDS * MAX_SPEED
    with style.context():
        figure = style.new_figure((4.6, 5.2))
        draw_motion(figure.add_subplot(), vehicle, states, reach=reach)
        explain_motion(figure)
        return style.png(figure)


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


class SwervePanel(widgets.VBox):
    """Two sliders per wheel, the vehicle drawn with its motion, and the numbers.

    Parameters
    ----------
    vehicle : Swerve
        The vehicle to drive.
    """

    def __init__(self, vehicle: Swerve) -> None:
        self.vehicle = vehicle
        self.speed = {name: _slider(f"{name} speed", MAX_SPEED, 0.05) for name in vehicle.names}
        self.steer = {name: _slider(f"{name} steer", 180.0, 5.0) for name in vehicle.names}
        self.motion = widgets.Dropdown(options=list(MOTIONS), description="start from")
        self.picture = widgets.Image(format="png")
        self.numbers = widgets.HTML()
        self._quiet = False
        self.motion.observe(lambda change: self.start_from(change["new"]), names="value")
        for slider in (*self.speed.values(), *self.steer.values()):
            slider.observe(lambda change: self._draw(), names="value")
        units = widgets.HTML("speed in m/s, steer in degrees, counter-clockwise from forward")
        pairs = [widgets.VBox([self.speed[n], self.steer[n]]) for n in vehicle.names]
        controls = widgets.VBox([self.motion, units, *pairs])
        super().__init__([widgets.HBox([controls, self.picture]), self.numbers])
        self.start_from(self.motion.value)

    def states(self) -> WheelStates:
        """Return the wheel states that the sliders stand for, one row."""
        speed = [slider.value for slider in self.speed.values()]
        steer = [slider.value for slider in self.steer.values()]
        return WheelStates(np.array([speed]), np.radians([steer]))

    def start_from(self, motion: str) -> None:
        """Set all sliders to one of `MOTIONS`, as nearly as their steps allow."""
        vx, vy, yaw_rate = MOTIONS[motion]
        states = self.vehicle.wheel_states([[vx, vy]], [yaw_rate])
        assert states.steer is not None
        self._quiet = True
        for i, name in enumerate(self.vehicle.names):
            self.speed[name].value = float(states.speed[0, i])
            self.steer[name].value = float(np.degrees(states.steer[0, i]))
        self._quiet = False
        self._draw()

    def _draw(self) -> None:
        if self._quiet:
            return
        states = self.states()
        self.picture.value = draw_states(self.vehicle, states)
        self.numbers.value = table(self.vehicle, states)


def _slider(name: str, limit: float, step: float) -> widgets.FloatSlider:
    digits = ".2f" if step < 1 else ".0f"
    return widgets.FloatSlider(
        min=-limit, max=limit, step=step, description=name, readout_format=digits
    )

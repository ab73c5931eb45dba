"""Calibrate by hand: an offset and three mounting angles, then let the library solve it."""

from __future__ import annotations

import ipywidgets as widgets
import numpy as np
from numpy.typing import NDArray

from evcalib.calibration import align
from evcalib.geometry import (
    LOOKS_FORWARD,
    angle_between,
    matrix_to_rpy,
    rotation_angle,
    rpy_to_matrix,
)
from evcalib.offset import find_offset
from evcalib.plots import style
from evcalib.plots.full import draw_cockpit, paired
from evcalib.results import Calibration
from evcalib.series import HeadingSeries, VelocitySeries
from evcalib.track import velocity_track


class Cockpit(widgets.VBox):
    """Sliders for offset, roll, pitch and yaw over the two streams of a recording.

    The angles are those of the camera's mounting: zero for one that looks straight ahead.

    Parameters
    ----------
    headings, velocities
        The two streams.
    calibration : Calibration, optional
        What *solve* goes to; by default what `evcalib.align` finds.
    max_offset : float
        Range of the offset [s].
    """

    def __init__(
        self,
        headings: HeadingSeries,
        velocities: VelocitySeries,
        calibration: Calibration | None = None,
        *,
        max_offset: float = 1.0,
    ) -> None:
        self._headings, self._velocities = headings.usable(), velocities
        self._track = velocity_track(velocities)
        self._calibration, self._max_offset = calibration, max_offset
        self.curve = find_offset(self._headings, self._track, max_offset=max_offset)
        self.offset = _slider("offset [s]", max_offset, 0.005, ".3f")
        self.roll = _slider("roll [deg]", 180.0, 1.0, ".0f")
        self.pitch = _slider("pitch [deg]", 90.0, 1.0, ".0f")
        self.yaw = _slider("yaw [deg]", 180.0, 1.0, ".0f")
        self.solve = widgets.Button(description="solve", button_style="primary")
        self.reset = widgets.Button(description="reset")
        self.picture = widgets.Image(format="png")
        self.numbers = widgets.HTML()
        self.solved = False
        self._sliders = (self.offset, self.roll, self.pitch, self.yaw)
        self._held = False
        for slider in self._sliders:
            slider.observe(lambda change: self._draw(), names="value")
        self.solve.on_click(lambda button: self._solve())
        self.reset.on_click(lambda button: self._reset())
        rows = [
            widgets.HBox([self.offset, self.solve, self.reset]),
            widgets.HBox([self.roll, self.pitch, self.yaw]),
        ]
        super().__init__([*rows, self.picture, self.numbers])
        self._draw()

    @property
    def R_body_cam(self) -> NDArray[np.float64]:
        """The rotation that the sliders stand for."""
        angles = np.radians([self.roll.value, self.pitch.value, self.yaw.value])
        return np.asarray(rpy_to_matrix(angles) @ LOOKS_FORWARD)

    @property
    def calibration(self) -> Calibration:
        """What the library finds."""
        if self._calibration is None:
            self._calibration = align(self._headings, self._velocities, max_offset=self._max_offset)
        return self._calibration

    def residual(self) -> float:
        """Return the median angle between the streams [deg]; NaN where they do not overlap."""
        _, body, camera = paired(self._headings, self._track, self.offset.value, self.R_body_cam)
        if not len(body):
            return float("nan")
        return float(np.degrees(np.median(angle_between(camera, body))))

    def draw(self) -> bytes:
        """Return directions, score and residuals as a PNG picture."""
        figure = style.new_figure((9.4, 4.2))
        with style.context():
            draw_cockpit(
                figure,
                self._headings,
                self._track,
                self.offset.value,
                self.R_body_cam,
                self.curve,
                solved=self.calibration.offset if self.solved else None,
            )
        return style.png(figure)

    def words(self) -> str:
        """Return the residual, and after *solve* how far the sliders are from it, as HTML."""
        residual = self.residual()
        if np.isnan(residual):
            text = "the odometry does not cover the headings at this offset"
        else:
            text = f"median residual {residual:.2f} deg"
        if not self.solved:
            return text
        found = self.calibration
        late = 1e3 * (self.offset.value - found.offset)
        turn = np.degrees(rotation_angle(self.R_body_cam, found.R_body_cam))
        return (
            f"{text}; the sliders are {late:+.0f} ms and {turn:.1f} deg from the solution,"
            f" {found.offset:.4f} s. {found.verdict.summary}"
        )

    def _solve(self) -> None:
        self.solved = True
        found = self.calibration
        angles = np.degrees(matrix_to_rpy(found.R_body_cam @ LOOKS_FORWARD.T))
        self._set((found.offset, *angles))

    def _reset(self) -> None:
        self.solved = False
        self._set((0.0, 0.0, 0.0, 0.0))

    def _set(self, values: tuple[float, ...]) -> None:
        """Move all sliders, and draw once."""
        self._held = True
        for slider, value in zip(self._sliders, values, strict=True):
            at = slider.step * round(float(value) / slider.step)
            slider.value = min(max(at, slider.min), slider.max)
        self._held = False
        self._draw()

    def _draw(self) -> None:
        if self._held:
            return
        self.picture.value = self.draw()
        self.numbers.value = self.words()


def _slider(name: str, reach: float, step: float, digits: str) -> widgets.FloatSlider:
    return widgets.FloatSlider(
        min=-reach, max=reach, step=step, value=0.0, description=name, readout_format=digits
    )

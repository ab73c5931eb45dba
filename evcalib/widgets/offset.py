"""Find the offset by hand, then compare with the curve, the truth and the verdict."""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence
from typing import Protocol

import ipywidgets as widgets
import numpy as np

from evcalib.calibration import Calibration, align
from evcalib.offset import OffsetCurve, find_offset
from evcalib.plots import style
from evcalib.plots.offset import draw_streams, draw_tried
from evcalib.refinement import inliers_at
from evcalib.series import HeadingSeries, VelocitySeries
from evcalib.track import velocity_track

MAX_OFFSET = 1.0
"""Range of the slider and of the search [s]."""
MAX_NOISE = 0.3
"""Range of the noise slider: standard deviation of the headings per axis [rad]."""


class Streams(Protocol):
    """Two streams of one drive with the true offset (as of `data_tools.motion.simulate`)."""

    @property
    def headings(self) -> HeadingSeries: ...  # noqa: D102

    @property
    def velocities(self) -> VelocitySeries: ...  # noqa: D102

    @property
    def offset(self) -> float: ...  # noqa: D102


class OffsetPanel(widgets.VBox):
    """An offset slider over two streams, beside the scores of the offsets tried so far.

    Parameters
    ----------
    drive : callable
        Makes the streams of a motion: ``drive(kind, noise)``, noise in rad per axis.
    kinds : sequence of str
        Motions to choose from.
    """

    def __init__(self, drive: Callable[[str, float], Streams], kinds: Sequence[str]) -> None:
        self._make = drive
        self.motion = widgets.Dropdown(options=list(kinds), description="motion")
        self.noise = _slider("noise [rad]", 0.0, MAX_NOISE, 0.05, 0.05)
        self.offset = _slider("offset [s]", -MAX_OFFSET, MAX_OFFSET, 0.01, 0.0)
        self.compare = widgets.Checkbox(description="compare", indent=False)
        self.picture = widgets.Image(format="png")
        self.numbers = widgets.HTML()
        for control in (self.motion, self.noise):
            control.observe(lambda change: self._drive(), names="value")
        for control in (self.offset, self.compare):
            control.observe(lambda change: self._draw(), names="value")
        first = widgets.HBox([self.motion, self.noise])
        second = widgets.HBox([self.offset, self.compare])
        super().__init__([first, second, self.picture, self.numbers])
        self._drive()

    def _drive(self) -> None:
        """Make new streams; what was tried on the old ones says nothing about them."""
        self.streams = self._make(self.motion.value, self.noise.value)
        self._track = velocity_track(self.streams.velocities)
        self.curve: OffsetCurve = find_offset(
            self.streams.headings, self._track, max_offset=MAX_OFFSET
        )
        self.tried: list[int] = []
        self._calibration: Calibration | None = None
        if self.compare.value:
            self.compare.value = False  # its observer draws
        else:
            self._draw()

    @property
    def calibration(self) -> Calibration:
        """What `align` makes of the streams."""
        if self._calibration is None:
            self._calibration = align(
                self.streams.headings, self.streams.velocities, max_offset=MAX_OFFSET
            )
        return self._calibration

    def _draw(self) -> None:
        index = int(np.argmin(np.abs(self.curve.offsets - self.offset.value)))
        self.tried.append(index)
        self.picture.value = self.draw()
        self.numbers.value = self.compared() if self.compare.value else self.so_far()

    def draw(self) -> bytes:
        """Return the two panels as a PNG picture."""
        streams, offset = self.streams, float(self.curve.offsets[self.tried[-1]])
        R = inliers_at(streams.headings, self._track, offset).R_body_cam
        tried = np.array(self.tried)
        figure = style.new_figure((9.4, 3.4))
        with style.context():
            left, right = figure.subplots(1, 2, width_ratios=(3, 2))
            draw_streams(left, streams.headings, self._track, offset, R)
            draw_tried(right, self.curve, tried, reveal=self.compare.value, true=streams.offset)
            figure.legend(*left.get_legend_handles_labels(), loc="outside upper left", ncols=2)
        return style.png(figure)

    def so_far(self) -> str:
        """Return the score at the slider and the best one tried, as HTML."""
        here, best = self.tried[-1], max(self.tried, key=lambda i: self.curve.score[i])
        return (
            f"score {self.curve.score[here]:.3f} at {self.curve.offsets[here]:.2f} s;"
            f" best so far {self.curve.score[best]:.3f} at {self.curve.offsets[best]:.2f} s"
        )

    def compared(self) -> str:
        """Return the offset by hand against peak and truth, and the verdict, as HTML."""
        by_hand, true = float(self.curve.offsets[self.tried[-1]]), self.streams.offset
        verdict = self.calibration.verdict
        words = html.escape(" ".join((verdict.summary, *verdict.reasons)))
        return (
            f"by hand {1000 * (by_hand - true):+.0f} ms from the truth,"
            f" peak of the curve {1000 * (self.curve.offset - true):+.0f} ms.<br>"
            f"Verdict of align: {words}"
        )


def _slider(name: str, low: float, high: float, step: float, value: float) -> widgets.FloatSlider:
    return widgets.FloatSlider(
        min=low, max=high, step=step, value=value, description=name, readout_format=".2f"
    )

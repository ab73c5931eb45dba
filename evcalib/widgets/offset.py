"""Find the offset by hand, then compare with the curve, the truth and the verdict."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterable, Sequence
from typing import Protocol

import ipywidgets as widgets
import numpy as np

from evcalib.alignment import Calibration, align
from evcalib.alignment.offset import OffsetCurve, find_offset
from evcalib.alignment.offset_refinement import inliers_at
from evcalib.kinematics.velocity_track import velocity_track
from evcalib.plots import style
from evcalib.plots.offset import draw_search
from evcalib.series import HeadingSeries, VelocitySeries
from evcalib.widgets._parts import Panel, bare_figure, choices, encode, pixels, slider, wipe

MAX_OFFSET = 1.0
"""Range of the slider and of the search [s]."""
MAX_NOISE = 0.3
"""Range of the noise slider: standard deviation of the headings per axis [rad]."""
STRIDE = 5
"""Candidates from one place of the play button to the next."""


class Streams(Protocol):
    """Two streams of one drive with the true offset (`data_tools.simulation.streams.simulate`)."""

    @property
    def headings(self) -> HeadingSeries: ...  # noqa: D102

    @property
    def velocities(self) -> VelocitySeries: ...  # noqa: D102

    @property
    def offset(self) -> float: ...  # noqa: D102


class OffsetPanel(Panel):
    """An offset slider over two streams, beside the scores of the offsets tried so far.

    Parameters
    ----------
    drive : callable
        Makes the streams of a motion: ``drive(kind, noise)``, noise in rad per axis.
    kinds : sequence of str
        Motions to choose from.
    """

    def __init__(self, drive: Callable[[str, float], Streams], kinds: Sequence[str]) -> None:
        names = choices(kinds, "motion", Iterable)
        super().__init__()
        self._make = drive
        self.motion = widgets.Dropdown(options=names, description="motion")
        self.noise = slider("noise [rad]", 0.0, MAX_NOISE, 0.05, 0.05, ".2f")
        self.noise.continuous_update = False
        self.offset = slider("offset [s]", -MAX_OFFSET, MAX_OFFSET, 0.01, 0.0, ".2f")
        self.play = widgets.Play(min=-1, value=-1, interval=200, show_repeat=False)
        self.compare = widgets.Checkbox(
            description="compare", indent=False, layout={"margin": "2px 0 0 24px"}
        )
        self.picture, self.numbers = widgets.Image(format="png"), widgets.HTML()
        self._figure = bare_figure((9.4, 3.3), left=0.07, right=0.985, bottom=0.145, top=0.9)
        with style.context():
            self._axes = self._figure.subplots(1, 2, width_ratios=(3, 2))
        self._of: tuple[str, float] | None = None
        self._calibration: Calibration | None = None
        self.play.observe(lambda change: self._step(change["new"]), names="value")
        rows = [[self.motion, self.noise, self.reset], [self.offset, self.play, self.compare]]
        boxes = [widgets.HBox(row) for row in rows]
        controls = (self.motion, self.noise, self.offset, self.compare)
        self._start(controls, [*boxes, self.picture, self.numbers])

    @property
    def calibration(self) -> Calibration:
        """What `align` makes of the streams."""
        if self._calibration is None:
            self._calibration = align(
                self.streams.headings, self.streams.velocities, max_offset=MAX_OFFSET
            )
        return self._calibration

    def restart(self) -> None:
        """Take all controls back, and forget what was tried."""
        self._of = None
        self.play.playing, self.play.value = False, self.play.min
        super().restart()

    def _drive(self) -> None:
        """Make new streams; what was tried on the old ones says nothing about them."""
        self._of = self.motion.value, self.noise.value
        self.streams = self._make(*self._of)
        self._track = velocity_track(self.streams.velocities)
        self.curve: OffsetCurve = find_offset(
            self.streams.headings, self._track, max_offset=MAX_OFFSET
        )
        self.play.max = (self.curve.offsets.size - 1) // STRIDE
        self.tried: list[int] = []
        self._calibration = None
        held, self._held = self._held, True
        self.compare.value = False
        self._held = held

    def _step(self, place: int) -> None:
        """Go to a place of the play button, which rests before the first one."""
        if place >= 0:
            self.offset.value = float(self.curve.offsets[place * STRIDE])

    def _draw(self) -> None:
        if self._of != (self.motion.value, self.noise.value):
            self._drive()
        self.tried.append(int(np.argmin(np.abs(self.curve.offsets - self.offset.value))))
        self.picture.value = self.draw()
        self.numbers.value = self.compared() if self.compare.value else self.so_far()

    def draw(self) -> bytes:
        """Return the two panels as a PNG picture."""
        headings, reveal = self.streams.headings, self.compare.value
        R = inliers_at(headings, self._track, self._here).R_body_cam
        wipe(self._axes)
        with style.context():
            draw_search(
                self._axes,
                headings,
                self._track,
                R,
                self.curve,
                self.tried,
                reveal=reveal,
                true=self.streams.offset,
            )
        return encode(pixels(self._figure))

    @property
    def _here(self) -> float:
        return float(self.curve.offsets[self.tried[-1]])

    def so_far(self) -> str:
        """Return the score at the slider and the best one tried, as HTML."""
        score = self.curve.score
        here, best = self.tried[-1], max(self.tried, key=lambda i: np.nan_to_num(score[i]))
        return (
            f"score {score[here]:.3f} at {self.curve.offsets[here]:.2f} s;"
            f" best so far {score[best]:.3f} at {self.curve.offsets[best]:.2f} s"
        )

    def compared(self) -> str:
        """Return the offset by hand against peak and truth, and the verdict, as HTML."""
        by_hand, true = self._here, self.streams.offset
        verdict = self.calibration.verdict
        words = html.escape(" ".join((verdict.summary, *verdict.reasons)))
        return (
            f"by hand {1000 * (by_hand - true):+.0f} ms from the truth,"
            f" peak of the curve {1000 * (self.curve.offset - true):+.0f} ms.<br>"
            f"<b>Verdict of align.</b> {words}"
        )

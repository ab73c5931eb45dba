"""Calibrate by hand: an offset and three mounting angles, then let the library solve it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import ipywidgets as widgets
import numpy as np

from evcalib import checks
from evcalib._moved import renamed
from evcalib.alignment import Calibration, StreamPair
from evcalib.alignment import offset as search
from evcalib.arrays import Floats
from evcalib.geometry import (
    LOOKS_FORWARD,
    angle_between,
    matrix_to_rpy,
    rotation_angle,
    rotation_vector,
    rotation_vector_to_matrix,
    rpy_to_matrix,
)
from evcalib.kinematics.velocity_track import VelocityTrack, velocity_track
from evcalib.plots import style
from evcalib.plots.full import cockpit_axes, draw_cockpit
from evcalib.plots.offset import paired
from evcalib.series import HeadingSeries, VelocitySeries
from evcalib.widgets._parts import Panel, bare_figure, choices, encode, pixels, slider, wipe

MAX_OFFSET = 1.0
"""Range of the offset [s]."""
STEPS = 20
"""Pictures between the place of the hand and the solution."""
TRAIL = 300
"""So many places that were tried stay in the picture."""


MADE_WITH = "SolvedStreams(headings, velocities, calibration)"


class Answer(Protocol):
    """An offset [s] and a rotation, such as the truth of a simulated recording."""

    @property
    def offset(self) -> float: ...  # noqa: D102

    @property
    def R_body_cam(self) -> Floats: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class SolvedStreams:
    """Two streams of one recording with what the library makes of them.

    Attributes
    ----------
    headings, velocities
        The two streams.
    calibration : Calibration
        What *solve* goes to.
    truth : Answer, optional
        What is true, where it is known.
    """

    headings: HeadingSeries
    velocities: VelocitySeries
    calibration: Calibration
    truth: Answer | None = None


class Scorer:
    """The robust score of any offset and rotation, as the search has it for the best rotation.

    It is Eq. 3 of notebook 4 without its maximum: what
    :func:`evcalib.alignment.offset.find_offset` gives at an offset is the largest that any rotation
    can reach there.
    """

    def __init__(self, headings: HeadingSeries, track: VelocityTrack, reach: float) -> None:
        ends = np.array([-reach, 0.0, reach])
        self._pair = StreamPair.of(headings, track).covered_at_all(ends)

    def __call__(self, offset: float, R_body_cam: Floats) -> float:
        """Return the score; 0 where the odometry covers nothing."""
        body, known = self._pair.directions(offset)
        residual = 1.0 - np.sum(body * (self._pair.headings.v @ R_body_cam.T), axis=1)
        kept = np.maximum(0.0, 1.0 - residual / search.WIDE_LOSS_SCALES[-1]) ** 3
        weight = self._pair.weight * known
        return float(weight @ kept / max(weight.sum(), 1e-300))


class Cockpit(Panel):
    """Sliders for offset, roll, pitch and yaw over the two streams of a recording.

    The angles are those of the camera's mounting: zero for one that looks straight ahead.

    Parameters
    ----------
    recordings : mapping of str to SolvedStreams
        What to choose from.
    max_offset : float
        Range of the offset [s].
    """

    def __init__(
        self, recordings: Mapping[str, SolvedStreams], *, max_offset: float = MAX_OFFSET
    ) -> None:
        names = choices(recordings, "recording")
        for name, recording in recordings.items():
            checks.instance(recording, f"recording {name!r}", SolvedStreams, how=MADE_WITH)
        super().__init__()
        self._recordings, self._max_offset = dict(recordings), max_offset
        self.recording = widgets.Dropdown(options=names, description="recording")
        self.offset = slider("offset [s]", -max_offset, max_offset, 0.005, 0.0, ".3f")
        self.roll = slider("roll [deg]", -180.0, 180.0, 0.5, 0.0, ".1f")
        self.pitch = slider("pitch [deg]", -90.0, 90.0, 0.5, 0.0, ".1f")
        self.yaw = slider("yaw [deg]", -180.0, 180.0, 0.5, 0.0, ".1f")
        self.solve = widgets.Button(description="solve", button_style="primary", icon="magic")
        self.replay = widgets.Play(max=STEPS, interval=150, disabled=True, show_repeat=False)
        self.gauge = widgets.FloatProgress(max=1.0, description="score", bar_style="info")
        self.picture, self.numbers = widgets.Image(format="png"), widgets.HTML()
        self._sliders = (self.offset, self.roll, self.pitch, self.yaw)
        for control in (*self._sliders, self.gauge):
            control.layout.width, control.style.description_width = "840px", "95px"
        self._figure = bare_figure((9.4, 4.5))
        with style.context():
            self._axes = cockpit_axes(self._figure)
        self._loaded = ""
        self.solve.on_click(lambda button: self._solve())
        self.replay.observe(lambda change: self._between(change["new"] / STEPS), names="value")
        buttons = widgets.HBox([self.recording, self.solve, self.replay, self.reset])
        children = [buttons, *self._sliders, self.gauge, self.picture, self.numbers]
        self._start((self.recording, *self._sliders), children)

    @property
    def R_body_cam(self) -> Floats:
        """The rotation that the sliders stand for."""
        return _mounted(self._place())

    @property
    def solved(self) -> bool:
        """Whether the solution is shown."""
        return self.hand is not None

    def residual(self) -> float:
        """Return the median angle between the streams [deg]; NaN where they do not overlap."""
        return self._residual_at(self._place())

    def score(self) -> float:
        """Return the robust score of the sliders' place, at most 1."""
        return self._scorer(self.offset.value, self.R_body_cam)

    def restart(self) -> None:
        """Take all sliders back to zero, and forget the solution and what was tried."""
        self._loaded = ""
        self._changed()

    def _load(self) -> None:
        """Take up the recording that is chosen, with the sliders at zero."""
        self._loaded = self.recording.value
        self._given = self._recordings[self._loaded]
        self._headings = self._given.headings.usable()
        self._track = velocity_track(self._given.velocities)
        self._scorer = Scorer(self._headings, self._track, self._max_offset)
        self.curve = search.find_offset(self._headings, self._track, max_offset=self._max_offset)
        self.hand: Floats | None = None
        self.tried: list[tuple[float, float]] = []
        self.replay.playing, self.replay.disabled = False, True
        self._move(np.zeros(4))

    def _place(self) -> Floats:
        """Return offset [s], roll, pitch and yaw [deg] of the sliders."""
        return np.array([control.value for control in self._sliders])

    def _solution(self) -> Floats:
        return _placed(self._given.calibration)

    def _solve(self) -> None:
        place, solution = self._place(), self._solution()
        if self.hand is None or not np.allclose(place, solution):
            self.hand = place
        self.replay.disabled = False
        if self.replay.value == STEPS:
            self._between(1.0)
        else:
            self.replay.value = STEPS

    def _between(self, share: float) -> None:
        """Go so far from the place of the hand to the solution, and turn about one axis."""
        if self.hand is None:
            return
        solution = self._solution()
        place = self.hand + share * (solution - self.hand)
        start, end = _mounted(self.hand), _mounted(solution)
        turned = start @ rotation_vector_to_matrix(share * rotation_vector(start.T @ end))
        place[1:] = np.degrees(matrix_to_rpy(turned @ LOOKS_FORWARD.T))
        with self._at_once():
            self._move(solution if share >= 1.0 else place)

    def _move(self, place: Floats) -> None:
        """Set all sliders, as far as they reach, while changes are held."""
        held, self._held = self._held, True
        for control, value in zip(self._sliders, place.tolist(), strict=True):
            control.value = min(max(value, control.min), control.max)
        self._held = held

    def _draw(self) -> None:
        if self.recording.value != self._loaded:
            self._load()
        score = self.score()
        self.tried = [*self.tried[-TRAIL:], (self.offset.value, score)]
        self.gauge.value = score
        best = float(np.nanmax(self.curve.score))
        self.gauge.bar_style = "success" if score > 0.98 * best else "info"
        self.picture.value = self.draw()
        self.numbers.value = self.words()

    def draw(self) -> bytes:
        """Return directions, score and residuals as a PNG picture."""
        wipe(self._axes)
        with style.context():
            draw_cockpit(
                self._axes,
                self._headings,
                self._track,
                self.R_body_cam,
                self.curve,
                self.tried,
                solved=self._given.calibration.offset if self.solved else None,
            )
        return encode(pixels(self._figure))

    def words(self) -> str:
        """Return score and residual, and after *solve* how far the hand was off, as HTML."""
        residual, best = self.residual(), float(np.nanmax(self.curve.score))
        if np.isnan(residual):
            text = "the odometry does not cover the headings at this offset"
        else:
            text = f"median residual <b>{residual:.2f} deg</b>"
        text = f"score <b>{self.score():.3f}</b> of at most {best:.3f}; {text}."
        return text if self.hand is None else f"{text}{self._comparison(self.hand)}"

    def _comparison(self, hand: Floats) -> str:
        found, solution = self._given.calibration, self._solution()
        late = 1e3 * (hand[0] - found.offset)
        turn = np.degrees(rotation_angle(_mounted(hand), found.R_body_cam))
        rows = [_row("th", "", "offset [s]", "roll, pitch, yaw [deg]", "median residual [deg]")]
        rows += [self._line("by hand", hand), self._line("solved", solution)]
        if self._given.truth is not None:
            rows.append(self._line("true", _placed(self._given.truth)))
        return (
            f"<table>{''.join(rows)}</table>Your hand was <b>{late:+.0f} ms</b> and"
            f" <b>{turn:.1f} deg</b> from the solution. {found.verdict.summary}"
        )

    def _line(self, name: str, place: Floats) -> str:
        angles = ", ".join(f"{angle:.1f}" for angle in place[1:] + 0.0)
        return _row("td", name, f"{place[0]:.3f}", angles, f"{self._residual_at(place):.2f}")

    def _residual_at(self, place: Floats) -> float:
        _, body, camera = paired(self._headings, self._track, float(place[0]), _mounted(place))
        return float(np.degrees(np.median(angle_between(camera, body)))) if len(body) else np.nan


def _mounted(place: Floats) -> Floats:
    """Return the rotation of a place of the sliders."""
    return np.asarray(rpy_to_matrix(np.radians(place[1:])) @ LOOKS_FORWARD)


def _placed(answer: Answer) -> Floats:
    """Return the place of the sliders that stands for an answer."""
    angles = np.degrees(matrix_to_rpy(answer.R_body_cam @ LOOKS_FORWARD.T))
    return np.array([answer.offset, *angles])


def _row(kind: str, *cells: str) -> str:
    look = "style='padding:1px 12px; text-align:right'"
    return "<tr>" + "".join(f"<{kind} {look}>{cell}</{kind}>" for cell in cells) + "</tr>"


__getattr__ = renamed(__name__)

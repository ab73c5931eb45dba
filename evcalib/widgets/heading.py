"""Choose two times, and see matches, epipolar lines and the heading that they give."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import ipywidgets as widgets
import numpy as np
from numpy.typing import NDArray

from evcalib._translation import Translation
from evcalib.camera import Camera
from evcalib.epipolar import five_point, two_point
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.features import Keypoints
from evcalib.geometry import angle_between
from evcalib.plots import style
from evcalib.plots.heading import draw_epipolar, draw_focus, draw_matches, draw_offsets
from evcalib.two_views import Pairs, keypoints_at, matched

STEP_MS = 25
"""Time between keyframes."""
LONGEST_MS = 500
"""Longest baseline."""
THRESHOLD_PX = 1.5
"""Largest epipolar residual of an inlier."""
REACH_PX = 60.0
"""Largest displacement of a match."""
SOLVERS = {"two points": two_point, "five points": five_point}


class Recording(Protocol):
    """A straight motion with known heading (as of `data_tools.samples`)."""

    @property
    def events(self) -> Events: ...  # noqa: D102

    @property
    def camera(self) -> Camera: ...  # noqa: D102

    @property
    def direction(self) -> NDArray[np.float64]: ...  # noqa: D102


class HeadingPanel(widgets.VBox):
    """Sliders for the middle of a pair of keyframes and for the time between them.

    Parameters
    ----------
    recordings : mapping of str to Recording
        Recordings to choose from.
    """

    def __init__(self, recordings: Mapping[str, Recording]) -> None:
        if not recordings:
            raise InputError("at least one recording is needed")
        self.recordings = dict(recordings)
        self._keypoints: dict[str, list[Keypoints]] = {}
        self.recording = widgets.Dropdown(options=list(recordings), description="motion")
        ends = [int(1e-3 * r.events.t[-1]) // STEP_MS for r in self.recordings.values()]
        last = STEP_MS * (min(ends) - 1)
        self.middle = _slider("time [ms]", 2 * STEP_MS, last, STEP_MS * (last // (2 * STEP_MS)))
        self.baseline = _slider("baseline [ms]", 4 * STEP_MS, LONGEST_MS, 200)
        self.baseline.step = 2 * STEP_MS
        self.solver = widgets.Dropdown(options=list(SOLVERS), description="solver")
        self.pool = widgets.Checkbox(description="pool shorter baselines too", indent=False)
        self.picture = widgets.Image(format="png")
        self.numbers = widgets.HTML()
        controls = (self.recording, self.middle, self.baseline, self.solver, self.pool)
        for control in controls:
            control.observe(lambda change: self._draw(), names="value")
        rows = [widgets.HBox(controls[:3]), widgets.HBox(controls[3:])]
        super().__init__([*rows, self.picture, self.numbers])
        self._draw()

    def pairs(self) -> Pairs | None:
        """Return the matches that the sliders stand for; None if a keyframe is not there."""
        name = self.recording.value
        camera, keypoints = self.recordings[name].camera, self._keypoints_of(name)
        centre, half = self.middle.value // STEP_MS, self.baseline.value // (2 * STEP_MS)
        spans = range(2, half + 1) if self.pool.value else (half,)
        ends = [(centre - span, centre + span) for span in spans]
        parts = [
            matched(camera, keypoints[a - 1], keypoints[b - 1], reach=REACH_PX)
            for a, b in ends
            if a >= 1 and b <= len(keypoints)
        ]
        return Pairs.pooled(parts) if parts else None

    def solve(self, pairs: Pairs) -> Translation | None:
        """Return what the chosen solver makes of matches."""
        camera = self.recordings[self.recording.value].camera
        solver = SOLVERS[self.solver.value]
        threshold = THRESHOLD_PX / camera.focal
        return solver(pairs.r1, pairs.r2, threshold=threshold, groups=pairs.groups)

    def draw(self, pairs: Pairs, found: Translation | None) -> bytes:
        """Return matches and heading as a PNG picture."""
        recording = self.recordings[self.recording.value]
        camera, truth = recording.camera, recording.direction
        figure = style.new_figure((9.0, 3.9))
        with style.context():
            left, right = figure.subplots(1, 2, width_ratios=(3, 2))
            draw_matches(left, camera, pairs, None if found is None else found.inliers)
            draw_focus(left, camera, truth, true=True, name="true focus")
            if found is not None:
                some = np.flatnonzero(found.inliers)[:: max(1, int(found.inliers.sum()) // 25)]
                draw_epipolar(left, camera, found.direction, pairs.xy1[some])
                draw_focus(left, camera, found.direction, name="focus found")
            v, sd = ([], []) if found is None else ([found.direction], [found.sd])
            draw_offsets(right, np.reshape(v, (-1, 3)), truth, sd, reach=10.0)
            handles = dict(zip(*left.get_legend_handles_labels()[::-1], strict=True))
            figure.legend(handles.values(), handles.keys(), loc="outside lower left", ncols=4)
        return style.png(figure)

    def report(self, pairs: Pairs, found: Translation | None) -> str:
        """Return the numbers behind the picture."""
        moved = float(np.median(np.hypot(*(pairs.xy2 - pairs.xy1).T))) if len(pairs) else 0.0
        start = f"{len(pairs)} matches, which moved by {moved:.1f} px (median). "
        if found is None:
            return start + "No direction found."
        truth = self.recordings[self.recording.value].direction
        off = float(np.degrees(angle_between(found.direction, truth)))
        return start + (
            f"{int(found.inliers.sum())} inliers. Error {off:.1f} deg,"
            f" standard deviation as stated {np.degrees(found.sd):.1f} deg per axis."
        )

    def _keypoints_of(self, name: str) -> list[Keypoints]:
        if name not in self._keypoints:
            events = self.recordings[name].events
            t_us = range(1000 * STEP_MS, int(events.t[-1]) + 1, 1000 * STEP_MS)
            self._keypoints[name] = keypoints_at(events, t_us)
        return self._keypoints[name]

    def _draw(self) -> None:
        pairs = self.pairs()
        if pairs is None:
            self.numbers.value = "The baseline reaches beyond the recording: the picture is older."
            return
        found = self.solve(pairs)
        self.picture.value = self.draw(pairs, found)
        self.numbers.value = self.report(pairs, found)


def _slider(name: str, low: int, high: int, value: int) -> widgets.IntSlider:
    return widgets.IntSlider(min=low, max=high, step=STEP_MS, value=value, description=name)

"""Choose two times, and see matches, epipolar lines and the heading that they give."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import ipywidgets as widgets
import numpy as np
from numpy.typing import NDArray

from evcalib._moved import renamed
from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.events import Events
from evcalib.features import Keypoints
from evcalib.geometry import angle_between
from evcalib.heading import Matches, Translation
from evcalib.heading.epipolar import five_point, two_point
from evcalib.heading.two_views import keypoints_at, matched
from evcalib.plots import style
from evcalib.plots.heading import draw_backdrop, draw_heading, draw_offsets
from evcalib.surfaces.quality import surface_images
from evcalib.widgets._parts import (
    Panel,
    bare_figure,
    choices,
    encode,
    pixels,
    player,
    whole_slider,
    wipe,
)

STEP_MS = 25
"""Time between keyframes."""
LONGEST_MS = 500
"""Longest baseline."""
THRESHOLD_PX = 1.5
"""Largest epipolar residual of an inlier."""
REACH_PX = 60.0
"""Largest displacement of a match."""
SOLVERS = {"two points": two_point, "five points": five_point}


class KnownMotion(Protocol):
    """A straight motion with known heading (as of `data_tools.course.samples`)."""

    @property
    def events(self) -> Events: ...  # noqa: D102

    @property
    def camera(self) -> Camera: ...  # noqa: D102

    @property
    def direction(self) -> Floats: ...  # noqa: D102


class HeadingPanel(Panel):
    """Sliders for the middle of a pair of keyframes and for the time between them.

    Parameters
    ----------
    recordings : mapping of str to KnownMotion
        Recordings to choose from.
    """

    def __init__(self, recordings: Mapping[str, KnownMotion]) -> None:
        super().__init__()
        names = choices(recordings, "recording")
        self.recordings = dict(recordings)
        self._keypoints: dict[str, list[Keypoints]] = {}
        look = {"button_width": "105px", "description_width": "95px"}
        self.recording = widgets.ToggleButtons(options=names, description="motion", style=look)
        self.solver = widgets.ToggleButtons(options=list(SOLVERS), description="solver", style=look)
        ends = [int(1e-3 * r.events.t[-1]) // STEP_MS for r in self.recordings.values()]
        last = STEP_MS * (min(ends) - 1)
        middle = STEP_MS * (last // (2 * STEP_MS))
        self.middle = whole_slider("time [ms]", 2 * STEP_MS, last, STEP_MS, middle)
        self.baseline = whole_slider("baseline [ms]", 4 * STEP_MS, LONGEST_MS, 2 * STEP_MS, 200)
        self.pool = widgets.Checkbox(description="pool shorter baselines too", indent=False)
        self.picture = widgets.Image(format="png")
        self.numbers = widgets.HTML()
        self.recording.layout.margin = "2px 40px 2px 2px"
        margins = {"left": 0.06, "right": 0.985, "bottom": 0.22, "top": 0.97, "wspace": 0.2}
        self._figure = bare_figure((9.6, 4.4), **margins)
        with style.context():
            self._axes = self._figure.subplots(1, 2, width_ratios=(3, 2))
        rows = [
            widgets.HBox([self.recording, self.solver]),
            widgets.HBox([self.middle, player(self.middle, 300), self.reset]),
            widgets.HBox([self.baseline, self.pool]),
        ]
        controls = (self.recording, self.solver, self.middle, self.baseline, self.pool)
        self._start(controls, [*rows, self.picture, self.numbers])

    def pairs(self) -> Matches | None:
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
        return Matches.pooled(parts) if parts else None

    def solve(self, pairs: Matches) -> Translation | None:
        """Return what the chosen solver makes of matches."""
        camera = self.recordings[self.recording.value].camera
        solver = SOLVERS[self.solver.value]
        threshold = THRESHOLD_PX / camera.focal
        return solver(pairs.r1, pairs.r2, threshold=threshold, groups=pairs.groups)

    def draw(self, pairs: Matches, found: Translation | None) -> bytes:
        """Return matches and heading as a PNG picture."""
        recording = self.recordings[self.recording.value]
        wipe(self._axes)
        for legend in list(self._figure.legends):
            legend.remove()
        with style.context():
            left, right = self._axes
            draw_backdrop(left, self.surface())
            draw_heading(left, recording.camera, pairs, found, recording.direction)
            v, sd = ([], []) if found is None else ([found.direction], [found.sd])
            draw_offsets(right, np.reshape(v, (-1, 3)), recording.direction, sd, reach=10.0)
            names = dict(zip(*left.get_legend_handles_labels()[::-1], strict=True))
            self._figure.legend(names.values(), names.keys(), loc="lower left", ncols=4)
        return encode(pixels(self._figure))

    def surface(self) -> NDArray[np.uint8]:
        """Return TOS AND TS at the later of the two times."""
        events = self.recordings[self.recording.value].events
        later = 1000 * (self.middle.value + self.baseline.value // 2)
        return surface_images("tos_ts", events, [later])[0]

    def report(self, pairs: Matches, found: Translation | None) -> str:
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


__getattr__ = renamed(__name__)

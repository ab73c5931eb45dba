"""Keyframes of an event stream: corners, surface, keypoints and bearings at a steady rate."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.features import (
    EventImage,
    EventImager,
    KeypointFinder,
    Keypoints,
    brief_pattern,
    match,
)
from evcalib.features.corners import DETECTORS
from evcalib.filters import Denoiser, Noise
from evcalib.heading._options import LOCALISATIONS, HeadingOptions
from evcalib.kernels.heading.bearings import interpolate
from evcalib.surfaces import SURFACES

TELLS_NOISE = 10_000
"""Pixels of the least sensor whose noise is told from texture: one of 96 x 72 px sees texture in
all its parts and passes for 3 Hz of noise, by whose filter its offset was 20 ms off; one of 128 x
128 passes for 1.6 at most."""

REACH_PX = 4
"""Radius of a keypoint [px]; corner events are gathered while the corner moves that far.  This, the
bounds below and `REACH` are choices; `tests/test_heading_thresholds.py` shows what half and
double of them do to a heading: nothing that matters."""

SHORTEST, LONGEST = 0.03, 0.12
"""Bounds of the time over which corner events are gathered [s].  Longer gathers more corners of
slow motion, and lets fewer pairs of keyframes be matched, as these share no events."""

REACH = 0.25
"""Matches are sought over displacements of up to this part of the sensor's width: less finds no
fast corners, more lets more false matches in."""

GRID_PX = 2
"""Bearings are bilinear between pixels this far apart, which costs less than 0.01 px."""


@dataclass(frozen=True)
class Counts:
    """What became of a stream.

    Attributes
    ----------
    events, corners, keyframes : int
        Taken in; found among the events; made of them.
    keypoints : int
        Described, over all keyframes.
    clipped : int
        Of these so near the border that their patch leaves the image.
    weak, surplus, unseen : int
        Keypoints left out: of too few corner events, beyond the most that a keyframe holds, and
        without bearing (outside the lens's image).
    """

    events: int = 0
    corners: int = 0
    keyframes: int = 0
    keypoints: int = 0
    clipped: int = 0
    weak: int = 0
    surplus: int = 0
    unseen: int = 0


class Numbered(Protocol):
    """What windows and matches ask of a keyframe: its number, the time in steps."""

    @property
    def number(self) -> int: ...


@dataclass(frozen=True, eq=False)
class Keyframe:
    """Keypoints at one time.

    Attributes
    ----------
    number : int
        The time in steps.
    t, since : float
        Time, and that from which on corner events were gathered [s].
    keypoints : Keypoints
        What was found.
    bearings : ndarray, shape (n, 3)
        Unit bearings of the keypoints.
    flow : float
        Typical speed of the corners of late [px/s]; 0 if unknown.
    surface : ndarray, shape (height, width)
        What the keypoints are described on.
    image : EventImage or None
        What displacements are measured on; None where the corners themselves are taken, or the
        stream is too young.
    table : BearingTable
        Bearings of any pixel.
    """

    number: int
    t: float
    since: float
    keypoints: Keypoints
    bearings: Floats
    flow: float
    surface: NDArray
    image: EventImage | None
    table: BearingTable


class BearingTable:
    """Bearings of a camera, computed once on a grid."""

    def __init__(self, camera: Camera, step: int = GRID_PX) -> None:
        columns, rows = -(-(camera.width - 1) // step) + 1, -(-(camera.height - 1) // step) + 1
        columns, rows = max(columns, 2), max(rows, 2)
        x, y = np.meshgrid(step * np.arange(columns), step * np.arange(rows))
        grid = camera.bearings(np.column_stack((x.ravel(), y.ravel())))
        self.grid = grid.reshape(rows, columns, 3)
        self.step = step

    def __call__(self, xy: Floats) -> Floats:
        """Return unit bearings at pixels of the sensor, shape (n, 2)."""
        out = np.empty((len(xy), 3))
        interpolate(self.grid, self.step, np.ascontiguousarray(xy), out)
        return out


class KeyframeMaker:
    """Makes a keyframe at every multiple of the step that the stream passes."""

    def __init__(self, camera: Camera, options: HeadingOptions) -> None:
        width, height = camera.width, camera.height
        self.counts = Counts()
        self.step, self._step_us = options.step, options.step_us
        self._camera = camera
        self._bearings = BearingTable(camera)
        told = width * height >= TELLS_NOISE
        self._denoiser = Denoiser(width, height) if options.denoise and told else None
        self._detector = DETECTORS[options.detector](width, height)
        self._surface = SURFACES[options.surface](width, height, polarity="merged")
        self._finder = KeypointFinder(
            width, height, reach=REACH_PX, pattern=brief_pattern(seed=options.seed)
        )
        last = LOCALISATIONS[options.localisation]
        self._imager = None if last is None else EventImager(width, height, last=last)
        self._corners: deque[Events] = deque()
        self._recent: deque[Keyframe] = deque(maxlen=3)
        self._flows: deque[float] = deque(maxlen=5)
        self._next = -1
        self._start_us = self._end_us = 0

    @property
    def duration(self) -> float:
        """Time from the first to the last event [s]."""
        return 1e-6 * (self._end_us - self._start_us)

    @property
    def noise(self) -> Noise | None:
        """What was left out as the sensor's own; None where nothing was to be."""
        return None if self._denoiser is None else self._denoiser.noise

    @property
    def passed(self) -> int:
        """Multiples of the step that the stream has passed, silence included."""
        return self._end_us // self._step_us - self._start_us // self._step_us

    def update(self, events: Events) -> Iterator[Keyframe]:
        """Take in the next events and yield the keyframes that they complete."""
        if not isinstance(events, Events):
            raise InputError(f"events must be Events, not {type(events).__name__}")
        self._camera.require_size(events.width, events.height)
        if not len(events):
            return
        if self._next < 0:
            self._start_us = int(events.t[0])
            self._next = self._start_us // self._step_us + 1
        while len(events):
            end = self._next * self._step_us
            head = events.between(0, end)
            self._take(head)
            events = events[len(head) :]
            if len(events):
                yield self._make()
                self._skip(int(events.t[0]))

    def _take(self, events: Events) -> None:
        if not len(events):
            return
        self._end_us = int(events.t[-1])
        self._count(events=len(events))
        if self._denoiser is not None:
            events = self._denoiser.kept(events)
        if not len(events):
            return
        flags = self._detector.update(events)
        self._surface.update(events)
        if self._imager is not None:
            self._imager.update(events)
        corners = events[flags]
        if len(corners):
            self._corners.append(corners)
        self._count(corners=len(corners))

    def _skip(self, t_us: int) -> None:
        """Leave out the keyframes of a silence in which all corners were forgotten."""
        ahead = t_us // self._step_us + 1
        silent = int(1e6 * LONGEST) // self._step_us + 2
        if ahead - self._next > silent:
            self._next = ahead
            self._recent.clear()
            self._flows.clear()

    def _make(self) -> Keyframe:
        t_us = self._next * self._step_us
        flow = float(np.median(self._flows)) if self._flows else 0.0
        since_us = t_us - int(1e6 * _gathering_time(flow))
        corners = self._gather(since_us, t_us)
        surface = self._surface.render(t_us)
        keypoints = self._finder.find(surface, corners)
        bearings = self._bearings(keypoints.xy)
        seen = np.isfinite(bearings[:, 0])
        if not seen.all():
            keypoints, bearings = keypoints.select(seen), bearings[seen]
        self._count(
            keyframes=1,
            keypoints=len(keypoints),
            weak=keypoints.weak,
            clipped=keypoints.clipped,
            surplus=keypoints.surplus,
            unseen=int((~seen).sum()),
        )
        keyframe = Keyframe(
            number=self._next,
            t=1e-6 * t_us,
            since=1e-6 * since_us,
            keypoints=keypoints,
            bearings=bearings,
            flow=flow,
            surface=surface,
            image=None if self._imager is None else self._imager.draw(t_us, flow),
            table=self._bearings,
        )
        self._recent.append(keyframe)
        self._measure_flow()
        self._next += 1
        return replace(keyframe, flow=float(np.median(self._flows)) if self._flows else 0.0)

    def _gather(self, since_us: int, t_us: int) -> Events:
        """Return the corner events between two times and forget those of long ago."""
        oldest = t_us - int(1e6 * LONGEST)
        while self._corners and self._corners[0].t[-1] < oldest:
            self._corners.popleft()
        if not self._corners:
            return Events.empty(self._camera.width, self._camera.height)
        return Events.concatenate(list(self._corners)).between(since_us, t_us)

    def _measure_flow(self) -> None:
        """Note the median speed of the matches with the keyframe two before."""
        if len(self._recent) < 3:
            return
        before, after = self._recent[0], self._recent[-1]
        pairs = match(before.keypoints, after.keypoints, reach=REACH * self._camera.width)
        if len(pairs) >= 10:
            i, j = pairs.T
            shift = np.linalg.norm(after.keypoints.xy[j] - before.keypoints.xy[i], axis=1)
            self._flows.append(float(np.median(shift)) / (after.t - before.t))

    def _count(self, **more: int) -> None:
        counts = self.counts
        self.counts = replace(counts, **{k: getattr(counts, k) + v for k, v in more.items()})


def _gathering_time(flow: float) -> float:
    """Return the time [s] in which a corner moves by the radius of a keypoint."""
    if flow <= 0:
        return 0.5 * LONGEST
    return min(max(REACH_PX / flow, SHORTEST), LONGEST)

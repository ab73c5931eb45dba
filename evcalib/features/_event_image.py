"""Images of signed events, and displacements between two of them that do not lag.

A keypoint made of corner events leads or trails the true corner, by how its events were chosen and
averaged.  A displacement measured between two images of all events, each over a time in which the
scene moves little and stamped with the middle of that time, has no such choice in it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from evcalib.arrays import Floats
from evcalib.display import Shown
from evcalib.events import Events
from evcalib.kernels.events import EventColumns
from evcalib.kernels.features import event_image as kernels

WAY_PX = 1.5
"""The typical corner moves this far [px] while events are added up: less leaves few events, more
blurs the edges.  This and what follows are choices, save `LAST`, none of them fitted; half or
double of each moves a heading by less than half a degree (`tests/test_heading_thresholds.py`)."""

AHEAD = 0.5
"""Part of that time in which it is still seen what follows an event at its pixel."""

LONGEST, UNKNOWN = 0.12, 0.06
"""Most time over which events are added up, and that for an unknown flow [s]."""

SIGMA_PX = 0.8
"""Smoothing of the images [px]: less than this is not sampled well."""

LAST = 0.5
"""Weight of an event that the other polarity follows at its pixel: see `EventImager` for why, and
`python -m data_tools.studies.lag` for the lag that is left."""

RADIUS, STEPS, FARTHEST, LEAST = 7, 10, 2.5, 0.6
"""Patch radius [px], most iterations, farthest from the guess [px], least correlation."""


@dataclass(frozen=True, eq=False)
class EventImage(Shown):
    """Signed events of a short time, smoothed.

    Attributes
    ----------
    values : ndarray of float32, shape (height, width)
        Sum of the polarities at each pixel.
    start, end : float
        The time over which they were added up [s].
    """

    values: NDArray[np.float32]
    start: float
    end: float

    @property
    def t(self) -> float:
        """Middle of the time [s]: at steady motion the edges were then where they are drawn."""
        return 0.5 * (self.start + self.end)


class EventImager:
    """Draws event images of a stream that comes in pieces.

    A pixel reports a change when it has happened, never before, so each event is late by up to a
    threshold of intensity.  A pixel that saw the same motion backwards would report each step of
    an edge one threshold earlier: not its last step.  Counting the last event before a change of
    polarity half, the mean of both, takes the lag out, as measured for thresholds of 0.1 to 0.4
    (`data_tools.studies.lag`).

    Parameters
    ----------
    width, height : int
        Sensor size [px].
    last : float
        Weight of those events: 0.5, or 1 to leave the lag in.
    """

    def __init__(self, width: int, height: int, *, last: float = LAST) -> None:
        self._shape = (height, width)
        self._last = last
        self._pieces: deque[Events] = deque()
        self._since = 0

    def update(self, events: Events) -> None:
        """Take in the next events of the stream."""
        if not len(events):
            return
        oldest = int(events.t[-1]) - round(1e6 * (1.0 + AHEAD) * LONGEST)
        while self._pieces and self._pieces[0].t[-1] < oldest:
            self._since = int(self._pieces.popleft().t[-1]) + 1
        if not self._since and not self._pieces:
            self._since = int(events.t[0])
        self._pieces.append(events)

    def draw(self, t_us: int, flow: float) -> EventImage | None:
        """Return the latest image that can be drawn at a time.

        Parameters
        ----------
        t_us : int
            The time [us]; all events before it were taken in.
        flow : float
            Typical speed of the scene [px/s]; 0 if unknown.

        Returns
        -------
        EventImage or None
            None if the stream started later than the image would.
        """
        way = 1e6 * (min(WAY_PX / flow, LONGEST) if flow > 0 else UNKNOWN)
        end = t_us - round(AHEAD * way)
        start = end - max(round(way), 1)
        if start < self._since or not self._pieces:
            return None
        events = Events.concatenate(list(self._pieces)).between(start, t_us)
        image = np.zeros(self._shape, dtype=np.float32)
        following = np.zeros(self._shape, dtype=np.int8)
        kernels.draw(EventColumns.of(events), start, end, self._last, following, image)
        smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), SIGMA_PX), dtype=np.float32)
        return EventImage(smooth, 1e-6 * start, 1e-6 * end)


def align_patches(
    first: EventImage, second: EventImage, centres: Floats, guesses: Floats
) -> Floats:
    """Find the displacement of patches between two images.

    Each patch of the first image is shifted over the second until the squares of their difference
    are least, up to a common factor (Baker & Matthews, "Lucas-Kanade 20 years on", IJCV 56(3),
    2004: the inverse compositional algorithm).  The displacement is that of the centroid of the
    patch's squared slopes, to which it belongs if the patch also grows or turns.

    Parameters
    ----------
    first, second : EventImage
        Of two times.
    centres : ndarray, shape (n, 2)
        Middles of the patches in the first [px], rounded to whole pixels.
    guesses : ndarray, shape (n, 2)
        Where they are about in the second [px].

    Returns
    -------
    ndarray, shape (n, 4)
        x, y in the first and in the second image; NaN where there is no sure answer: the patch
        leaves an image, has structure in one direction only, has changed, or lies far from the
        guess.
    """
    out = np.empty((len(centres), 4))
    limits = kernels.PatchLimits(STEPS, FARTHEST, LEAST)
    images = [np.ascontiguousarray(image.values) for image in (first, second)]
    whole = np.rint(centres).astype(np.int64)
    kernels.patch_aligner(RADIUS)(*images, whole, guesses, limits, out)
    return out

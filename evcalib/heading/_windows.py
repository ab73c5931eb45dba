"""Keyframes in, headings out: matches pooled over windows, one direction fitted to each."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from evcalib.heading._correspondences import NO_HEADING, CorrespondenceKeeper
from evcalib.heading._keyframes import Counts, Numbered
from evcalib.heading._matches import KeyframeMatches
from evcalib.heading._options import HeadingOptions
from evcalib.heading._result import Found, Gap, HeadingEstimate, collected
from evcalib.heading._stabilised import at_middle, covered, stabilised
from evcalib.heading._threads import Submit, at_once
from evcalib.heading._window_fit import NO_ATTITUDE, NOT_NEWER, TOO_FEW, Fit, fit
from evcalib.imu import Attitude

K = TypeVar("K", bound=Numbered)

AHEAD = 4
"""Windows that may be worked on at once: enough for some threads, few enough to stop at once."""


class _Pooled(NamedTuple):
    """The matches of a window as seen, those to keep, turned back by a gyro, and the fit."""

    matches: KeyframeMatches
    kept: KeyframeMatches
    fit: Fit | str


class _Window(NamedTuple, Generic[K]):
    """A window whose fit is under way."""

    centre: int
    keyframes: Sequence[K]
    pooled: Future[_Pooled | str]


class HeadingWindows(Generic[K]):
    """One heading per window around each keyframe, from a stream of keyframes.

    Parameters
    ----------
    options : HeadingOptions
        Of these the solver's, and how far apart keyframes are and may be matched.
    focal : float
        Focal length of the camera [px].
    match : callable
        Matches of two keyframes, the earlier first; None without any.
    size : tuple of int, optional
        Width and height of the sensor [px]; without it matches may all be in one place.
    attitude : Attitude, optional
        How the camera turns: matches are then turned back, those that are kept to their first time.
    on_heading : callable
        Called with the keyframes at hand, the matches of the window and its fit.
    submit : callable
        Starts a call, of matching or fitting, and returns its future.  What it starts depends on
        nothing else, and windows are finished in order: the result is the same however it runs.
    """

    def __init__(
        self,
        options: HeadingOptions,
        focal: float,
        match: Callable[[K, K], KeyframeMatches | None],
        *,
        size: tuple[int, int] | None = None,
        attitude: Attitude | None = None,
        on_heading: Callable[[Sequence[K], KeyframeMatches, Fit], object] = lambda *_: None,
        submit: Submit = at_once,
    ) -> None:
        self._options, self._focal, self._size = options, focal, size
        self._submit, self._attitude = submit, attitude
        self._match, self._on_heading = match, on_heading
        self._lag = options.steps // 2 + 1
        self._keyframes: deque[K] = deque(maxlen=2 * self._lag + 1)
        self._next = 0
        self._pairs: dict[int, list[Future[KeyframeMatches | None]]] = {}
        self._under_way: deque[_Window[K]] = deque()
        self._kept = CorrespondenceKeeper() if options.keep_correspondences else None
        self._found: list[Found] = []
        self._gaps: list[Gap] = []

    def add(self, keyframe: K) -> None:
        """Take in the next keyframe."""
        if self._keyframes and keyframe.number != self._keyframes[-1].number + 1:
            self.drain()
        if not self._keyframes:
            self._next = keyframe.number
        self._keyframes.append(keyframe)
        if keyframe.number - self._next >= self._lag:
            self._close()

    def drain(self) -> None:
        """Close the windows that wait for keyframes that will not come."""
        while self._keyframes and self._next <= self._keyframes[-1].number:
            self._close()
        while self._under_way:
            self._finish(self._under_way.popleft())
        self._keyframes.clear()
        self._pairs.clear()

    def result(self, counts: Counts) -> HeadingEstimate:
        """Return the headings of all keyframes taken in, and what became of the stream."""
        self.drain()
        return collected(self._found, self._gaps, counts, self._kept)

    def _close(self) -> None:
        """Fit the window around keyframe `_next`: pairs whose middles lie within a step of it."""
        centre = self._next
        self._next += 1
        # Keyframe numbers of a pair add up to twice its middle.
        middles = range(2 * centre - 2, 2 * centre + 3)
        known = self._pairs
        self._pairs = {k: known[k] if k in known else self._matches(k) for k in middles}
        parts = [pair for k in middles for pair in self._pairs[k]]
        pooled = self._submit(self._pooled, parts)
        self._under_way.append(_Window(centre, tuple(self._keyframes), pooled))
        if len(self._under_way) > AHEAD:
            self._finish(self._under_way.popleft())

    def _pooled(self, parts: Sequence[Future[KeyframeMatches | None]]) -> _Pooled | str:
        """Pool the matches of all pairs and fit them; without matches say why."""
        found = [matches for part in parts if (matches := part.result()) is not None]
        if not found:
            return TOO_FEW
        matches = KeyframeMatches.pooled(found)
        kept = straight = matches
        if self._attitude is not None:
            matches = covered(matches, self._attitude)
            if not len(matches):
                return NO_ATTITUDE
            kept = stabilised(matches, self._attitude, self._focal)
            straight = at_middle(kept, self._attitude)
        return _Pooled(matches, kept, fit(straight, self._options, self._focal, self._size))

    def _finish(self, window: _Window[K]) -> None:
        """Keep what was found in a window."""
        centre, pooled = window.centre, window.pooled.result()
        if isinstance(pooled, str):
            self._gaps.append(Gap(centre * self._options.step, pooled))
            return
        matches, kept, found = pooled
        if isinstance(found, Fit) and self._found and found.t <= self._found[-1].t:
            found = NOT_NEWER
        if self._kept is not None:
            # Each pair belongs to the window whose middle is nearest, or just before.
            own = matches.middle // 2 == centre
            none = np.zeros(int(own.sum()), dtype=np.bool_)
            if isinstance(found, str):
                self._kept.add(kept[own], none, NO_HEADING)
            else:
                self._kept.add(kept[own], found.agreeing[own], len(self._found))
        if isinstance(found, str):
            self._gaps.append(Gap(centre * self._options.step, found))
            return
        self._on_heading(window.keyframes, matches, found)
        self._found.append(Found.of(found))

    def _matches(self, middle: int) -> list[Future[KeyframeMatches | None]]:
        """Match all keyframe pairs whose numbers add up to `middle`, within the baselines."""
        first = self._keyframes[0].number
        found = []
        for span in range(1 + (middle + 1) % 2, self._options.steps + 1, 2):
            low, high = (middle - span) // 2 - first, (middle + span) // 2 - first
            if low < 0 or high >= len(self._keyframes):
                break
            found.append(self._submit(self._match, self._keyframes[low], self._keyframes[high]))
        return found

"""Keypoints from corner events, their descriptors on a surface, and matches."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from evcalib.arrays import Flags, Floats, Integers
from evcalib.display import Shown
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.kernels.events import EventColumns
from evcalib.kernels.features import keypoints as kernels


@dataclass(frozen=True, eq=False)
class Keypoints(Shown):
    """Corners at one time, with their descriptors, and how many were left out and why.

    Attributes
    ----------
    xy : ndarray, shape (n, 2)
        Mean position of each keypoint's corner events [px].
    t : ndarray, shape (n,)
        Mean time of these events [s]: when the corner was at `xy`.
    p : ndarray of bool, shape (n,)
        Their polarity.  Rows are sorted by it, then by y.
    support : ndarray of int64, shape (n,)
        Their number.
    bits : ndarray of uint64, shape (n, m)
        BRIEF descriptors of 64 m bits.
    weak, surplus : int
        Keypoints left out for too few events, and because there were more than the most.
    clipped : int
        Keypoints whose patch leaves the image.  They are described all the same, as if the
        surface were empty outside: near the border is where directions are told apart best.
    """

    xy: Floats
    t: Floats
    p: Flags
    support: Integers
    bits: NDArray[np.uint64]
    weak: int = 0
    surplus: int = 0
    clipped: int = 0

    def __len__(self) -> int:
        return int(self.t.size)

    def select(self, mask: Flags) -> Keypoints:
        """Return the rows where `mask` (shape (n,)) is True; the counts stay."""
        rows = {name: getattr(self, name)[mask] for name in ("xy", "t", "p", "support", "bits")}
        return replace(self, **rows)


def brief_pattern(side: int = 25, tests: int = 256, seed: int = 0) -> Integers:
    """Return the pixel pairs that BRIEF compares.

    Each coordinate is drawn from a normal distribution with a standard deviation of a fifth of
    the side (the best of the five patterns of Calonder et al., "BRIEF: binary robust independent
    elementary features", ECCV 2010), rounded, and clipped to the patch.

    Parameters
    ----------
    side : int
        Side of the patch [px], odd.
    tests : int
        Number of pairs, a multiple of 64.
    seed : int
        Of ``numpy.random.default_rng``.

    Returns
    -------
    ndarray of int64, shape (tests, 4)
        Columns dx, dy of the first pixel, dx, dy of the second [px].
    """
    if side < 3 or side % 2 == 0:
        raise InputError(f"the side of a BRIEF patch must be odd and at least 3, not {side}")
    if tests < 64 or tests % 64:
        raise InputError(f"the number of BRIEF tests must be a multiple of 64, not {tests}")
    drawn = np.random.default_rng(seed).normal(0.0, side / 5, (tests, 4))
    return np.clip(np.rint(drawn), -(side // 2), side // 2).astype(np.int64)


class KeypointFinder:
    """Turns corner events and a surface into keypoints.

    The newest corner event founds a keypoint, which takes in all corner events of its polarity
    within `reach`; the next one that is left founds another, and so on.  A keypoint is where and
    when its events were on average, so its place and its time belong together at any speed.

    Parameters
    ----------
    width, height : int
        Sensor size [px].
    reach : int
        Radius of a keypoint [px].
    support : int
        Fewest events of a keypoint; a lone corner event is often noise.
    most : int
        Most keypoints; those of most events stay, the newer ones of equals.
    smooth : int
        Side of the box that smooths the surface [px], odd.
    pattern : ndarray of int64, shape (64 m, 4), optional
        From `brief_pattern`.
    """

    def __init__(
        self,
        width: int,
        height: int,
        *,
        reach: int = 4,
        support: int = 2,
        most: int = 500,
        smooth: int = 5,
        pattern: Integers | None = None,
    ) -> None:
        for name, value in (("reach", reach), ("support", support), ("most", most)):
            if int(value) != value or value < 1:
                raise InputError(f"{name} must be a whole number of at least 1, not {value!r}")
        if smooth < 1 or smooth % 2 == 0:
            raise InputError(f"smooth must be odd, not {smooth!r}")
        self.shape = (height, width)
        self._pattern = brief_pattern() if pattern is None else pattern
        if self._pattern.ndim != 2 or self._pattern.shape[1] != 4 or len(self._pattern) % 64:
            raise InputError(f"pattern must have shape (64 m, 4), not {self._pattern.shape}")
        self._margin = int(np.abs(self._pattern).max())
        self._support, self._most, self._smooth = support, most, smooth
        square = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1).T
        self._disc = square[(square**2).sum(axis=1) <= reach**2]
        self._owner = np.full((2, height, width), -1)
        self._first = 0

    def find(self, surface: NDArray, corners: Events) -> Keypoints:
        """Return the keypoints of corner events, described on a surface.

        Parameters
        ----------
        surface : ndarray, shape (height, width)
            The image at the time of the keyframe.
        corners : Events
            Recent corner events.
        """
        if surface.shape != self.shape or corners.shape != self.shape:
            raise InputError(
                f"the finder was made for {self.shape}; the surface has {surface.shape},"
                f" the corners {corners.shape}"
            )
        sums = np.empty((len(corners), 5))
        columns = EventColumns.of(corners)
        count = kernels.gather_corners(columns, self._owner, self._first, self._disc, sums)
        self._first += count
        sums = sums[:count]
        strong = sums[sums[:, 3] >= self._support]
        most = np.argsort(-strong[:, 3], kind="stable")[: self._most]
        kept = strong[most]
        kept = kept[np.lexsort((kept[:, 1] / kept[:, 3], kept[:, 4]))]
        xy = kept[:, :2] / kept[:, 3:4]
        centres = np.rint(xy).astype(np.int64)
        limit = np.array(self.shape[::-1]) - self._margin
        inside = ((centres >= self._margin) & (centres < limit)).all(axis=1)
        return Keypoints(
            xy=xy,
            t=1e-6 * kept[:, 2] / kept[:, 3],
            p=kept[:, 4] > 0,
            support=kept[:, 3].astype(np.int64),
            bits=self._describe(surface, centres),
            weak=len(sums) - len(strong),
            surplus=len(strong) - len(kept),
            clipped=int((~inside).sum()),
        )

    def _describe(self, surface: NDArray, centres: Integers) -> NDArray[np.uint64]:
        """Return BRIEF descriptors; outside the image the surface is empty."""
        bits = np.empty((len(centres), len(self._pattern) // 64), dtype=np.uint64)
        if len(centres):
            image = np.ascontiguousarray(surface, dtype=np.float32)
            smooth = cv2.blur(image, (self._smooth, self._smooth))
            around = cv2.copyMakeBorder(smooth, *4 * (self._margin,), cv2.BORDER_CONSTANT)
            kernels.brief(around, centres + self._margin, self._pattern, bits)
        return bits


def match(
    first: Keypoints, second: Keypoints, *, reach: float = np.inf, farthest: int = 64
) -> Integers:
    """Match keypoints of the same polarity by mutually nearest descriptors.

    The result of OpenCV's brute-force matcher with cross-check for each polarity, in a
    seventh of its time; and keypoints out of reach are not compared at all.

    Parameters
    ----------
    first, second : Keypoints
        Of two times.
    reach : float
        Largest displacement [px].
    farthest : int
        Largest Hamming distance.

    Returns
    -------
    ndarray of int64, shape (m, 2)
        Rows of `first` and of `second`.
    """
    if first.bits.shape[1] != second.bits.shape[1]:
        raise InputError("keypoints with descriptors of different lengths cannot be matched")
    if not reach > 0:
        raise InputError(f"reach must be a positive number of pixels, not {reach!r}")
    points = [kernels.Points(np.ascontiguousarray(k.xy), k.p) for k in (first, second)]
    matcher = kernels.matcher(first.bits.shape[1])
    return matcher(first.bits, second.bits, *points, float(reach), int(farthest))

"""What the body turns by beyond the odometry: roll, pitch and yaw, linear between knots in time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from evcalib.arrays import Floats, Integers
from evcalib.joint.tracks import STRETCH, Tracks

MOST_KNOTS = 20_000
"""Most knots: a bound on memory (100 MB); the knots of drives of a quarter of an hour and more are
further apart."""

MEMORY = np.array([0.1, 0.1, 100.0])
"""Time constants [s] after which roll, pitch and yaw have forgotten what they were.  Choices: a
body swings back to level within a tenth of a second or so, an integrated yaw rate never does."""

LEVEL = np.radians(0.03)
"""Standard deviation of roll and pitch [rad] of a body that does not tilt.  A choice: 0.1 px at a
focal length of 200 px, where corners show no tilt; where they show more, they are believed."""

SHAKEN = np.radians(0.3)
"""Standard deviation of roll and pitch [rad] to begin with.  A choice: half a pixel to a pixel, so
that the first fit follows a body that shakes; it goes down to what corners show."""

MOST = np.radians(5.0)
"""Largest standard deviation of a knot's change [rad]: a bound."""

PROBES, CHANGE = 8, 4.0
"""Random vectors for the trace of an inverse (Hutchinson 1990), of 3 % noise with some hundred
knots; and the largest factor by which a variance changes from pass to pass.  Choices."""


@dataclass(frozen=True)
class Knots:
    """Times of knots on the camera clock: the first [s], their spacing [s] and count."""

    start: float
    spacing: float
    count: int

    @classmethod
    def over(cls, tracks: Tracks) -> Knots:
        start, end = float(tracks.start[0]), float(tracks.end.max())
        # The clock may be found to drift: a little more at the end.
        length = 1.01 * (end - start)
        spacing = max(STRETCH, length / MOST_KNOTS)
        return cls(start, spacing, int(length / spacing) + 3)

    @property
    def times(self) -> Floats:
        """Times of the knots, from the first [s]."""
        return np.arange(self.count, dtype=np.float64) * self.spacing

    def of(self, t: Floats) -> Integers:
        """Return the knot at or before each time."""
        return np.clip(((t - self.start) / self.spacing).astype(np.int64), 0, self.count - 2)

    def span(self, tracks: Tracks) -> int:
        """Return the most knots from the first to the last observation of a track."""
        return int((self.of(tracks.end) - self.of(tracks.start)).max())


@dataclass(frozen=True, eq=False)
class Factor:
    """A banded matrix, factored."""

    lower: Floats

    def solve(self, right: Floats) -> Floats:
        """Return the solutions for the columns."""
        return np.asarray(cho_solve_banded((self.lower, True), right, check_finite=False))


@dataclass(frozen=True, eq=False)
class Turning:
    """Knots, and what is known of them: each is the one before, less what is forgotten, plus noise.

    `least` (3,) is the standard deviation of that noise [rad] that is expected of roll, pitch and
    yaw, `widest` (3,) what a fit begins with; what the tracks show lies above the one.
    """

    knots: Knots
    least: Floats
    widest: Floats

    @classmethod
    def over(cls, tracks: Tracks, yaw_rate_sd: float, span: float, level: float = LEVEL) -> Turning:
        """Return knots over all tracks, for a yaw rate that is off so much [rad/s] over a span."""
        knots = Knots.over(tracks)
        least = np.array([level, level, 0.0]) * np.sqrt(1 - np.exp(-2 * knots.spacing / MEMORY))
        least[2] = yaw_rate_sd * np.sqrt(span * knots.spacing)
        return cls(knots, least, np.maximum(least, least * [SHAKEN / LEVEL, SHAKEN / LEVEL, 1.0]))

    def rest(self) -> Floats:
        """Return knots without any turning."""
        return np.zeros((self.knots.count, 3))

    @cached_property
    def _kept(self) -> Floats:
        return np.exp(-self.knots.spacing / MEMORY)

    @cached_property
    def _probes(self) -> Floats:
        rng = np.random.default_rng(0)
        return rng.choice([-1.0, 1.0], (self.knots.count, PROBES))

    def noise_of(self, values: Floats) -> Floats:
        """Return by how much each knot differs from what the one before makes of it."""
        noise = values.copy()
        noise[1:] -= self._kept * values[:-1]
        noise[0] *= np.sqrt(1 - self._kept**2)
        return noise

    def _back(self, noise: Floats) -> Floats:
        """Return the transpose of `noise_of`."""
        values = noise.copy()
        values[0] *= np.sqrt(1 - self._kept**2)
        values[:-1] -= self._kept * noise[1:]
        return values

    def pull(self, values: Floats, spread: Floats, noise: float) -> Floats:
        """Return the gradient (knots, 3) of what is known of the knots, times noise squared."""
        return self._back(self.noise_of(values)) * (noise / spread) ** 2

    def factor(self, band: Floats, spread: Floats, noise: float) -> Factor:
        """Return the information of the knots (rows of the upper band), with what is known."""
        lower = band.T.copy()
        weight = (noise / spread) ** 2
        middle = np.tile(weight * (1 + self._kept**2), (self.knots.count, 1))
        middle[0] = middle[-1] = weight
        lower[0] += middle.ravel()
        lower[3, :-3] -= np.tile(weight * self._kept, self.knots.count - 1)
        return Factor(cholesky_banded(lower, lower=True, check_finite=False))

    def shown(self, values: Floats, spread: Floats, factor: Factor, noise: float) -> Floats:
        """Return the standard deviation of a knot's change that the tracks show (MacKay 1992)."""
        n = self.knots.count
        seen = np.sum(self.noise_of(values) ** 2, axis=0)
        probes = np.zeros((n, 3, 3, PROBES))
        for k in range(3):
            probes[:, k, k] = self._probes
        kept = self._kept[:, None, None]
        right = probes.copy()
        right[0] *= np.sqrt(1 - kept**2)
        right[:-1] -= kept * probes[1:]
        x = factor.solve(right.reshape(3 * n, -1)).reshape(n, 3, 3, PROBES)
        out = x.copy()
        out[1:] -= kept * x[:-1]
        out[0] *= np.sqrt(1 - kept**2)
        trace = np.einsum("nkkp,nkkp->k", probes, out) / PROBES
        told = np.maximum(n - trace * (noise / spread) ** 2, 1e-3)
        variance = np.clip(seen / told, spread**2 / CHANGE, spread**2 * CHANGE)
        return np.clip(np.sqrt(variance), self.least, max(MOST, self.least.max()))

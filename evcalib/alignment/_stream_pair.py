"""Headings and odometry of one drive, prepared once and asked for anything at any offset."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from evcalib.arrays import Flags, Floats, Integers
from evcalib.errors import InputError
from evcalib.kernels.alignment import offset as kernel
from evcalib.kinematics.velocity_track import VelocityTrack
from evcalib.series import HeadingSeries, clocks_apart

MIN_PAIRS = 6
"""Fewest headings that a calibration can rest on: each has two degrees of freedom, of four unknowns
and a noise to be told from them."""

MIN_OVERLAP = 0.5
"""Candidates with less than this share of the best overlap are not compared.  A choice: with the
half of the headings that is left, noise is 1.4 times as large."""

MIN_SIGMA = 1e-5
"""Directions [rad] are never taken to be more exact than this: rounding of a unit vector's squared
difference, 1e-16, is far below its square."""


def enough(headings: HeadingSeries) -> HeadingSeries:
    """Return the usable headings.

    Parameters
    ----------
    headings : HeadingSeries
        Directions of the camera's motion.

    Returns
    -------
    HeadingSeries
        Those that are valid and carry weight.

    Raises
    ------
    InputError
        If there are fewer than `MIN_PAIRS`.
    """
    headings = headings.usable()
    if len(headings) < MIN_PAIRS:
        raise InputError(
            f"headings: {len(headings)} usable row(s), at least {MIN_PAIRS} are needed"
        )
    return headings


@dataclass(frozen=True, eq=False)
class StreamPair:
    """The usable headings and the odometry of one drive; make it by `StreamPair.of`.

    Attributes
    ----------
    headings : HeadingSeries
        Usable headings.
    track : VelocityTrack
        Velocities of the body.
    columns : Headings
        The headings as the kernels take them, with weights of 1 on average.
    """

    headings: HeadingSeries
    track: VelocityTrack
    columns: kernel.Headings

    @classmethod
    def of(cls, headings: HeadingSeries, track: VelocityTrack) -> StreamPair:
        """Prepare two streams.

        Parameters
        ----------
        headings : HeadingSeries
            Directions of the camera's motion; unusable rows are left out.
        track : VelocityTrack
            Velocities of the body.

        Returns
        -------
        StreamPair
            The pair.
        """
        headings = headings.usable()
        start = headings.t if headings.t_start is None else headings.t_start
        end = headings.t if headings.t_end is None else headings.t_end
        e = np.ascontiguousarray(headings.v.T)
        columns = kernel.Headings(start, end, e, _weights(headings))
        return cls(headings, track, columns)

    def __len__(self) -> int:
        """Return the number of headings."""
        return len(self.headings)

    @property
    def weight(self) -> Floats:
        """Weight of each heading, 1 on average."""
        return self.columns.weight

    def select(self, rows: Flags) -> StreamPair:
        """Return the pair of some of the headings, with weights of their own."""
        return StreamPair.of(self.headings.select(rows), self.track)

    def drawn(self, times: Integers) -> StreamPair:
        """Return the pair with each heading counted so many times in what the kernels take."""
        kept, all_ = times > 0, self.columns
        e, weight = np.ascontiguousarray(all_.e[:, kept]), (all_.weight * times)[kept]
        return replace(self, columns=kernel.Headings(all_.start[kept], all_.end[kept], e, weight))

    def along(self, track: VelocityTrack) -> StreamPair:
        """Return the same headings beside another odometry."""
        return replace(self, track=track)

    def span(self, offset: float) -> tuple[float, float]:
        """Return the part of the odometry [s] that the headings ask for at an offset."""
        start, end = self.columns.start, self.columns.end
        return float(start.min()) + offset, float(end.max()) + offset

    def directions(self, offset: float) -> tuple[Floats, Flags]:
        """Return body directions (n, 3) at an offset [s], and where the odometry tells one (n,)."""
        d = self.track.directions(self.columns.start, self.columns.end, offset)
        return d, np.any(d != 0, axis=1)

    def covered(self, offset: float) -> tuple[StreamPair, Floats]:
        """Return the pair of the headings that are covered at an offset [s], and their directions.

        Raises
        ------
        InputError
            If there are fewer than `MIN_PAIRS`.
        """
        d, known = self.directions(offset)
        if not known.any():
            raise InputError(self.no_overlap(f"at an offset of {offset:g} s; check the clocks"))
        if known.sum() < MIN_PAIRS:
            raise InputError(
                f"only {int(known.sum())} of {known.size} headings are covered by odometry that"
                f" moves and has no gap, at an offset of {offset:g} s; {MIN_PAIRS} are needed"
            )
        return self.select(known), d[known]

    def covered_at_all(self, offsets: Floats) -> StreamPair:
        """Return the pair of the headings that are covered at all offsets, if they are enough.

        Scores are means over headings: where outliers come and go at the ends with the offset, the
        mean moves without any change in agreement, which costs up to half of the precision
        (measured).
        """
        covered = np.ones(len(self), dtype=bool)
        for offset in offsets:
            covered &= self.directions(float(offset))[1]
        enough = self.weight[covered].sum() >= MIN_OVERLAP * self.weight.sum()
        return self.select(covered) if enough else self

    def profile(self, offsets: Floats, loss_scales: Floats) -> tuple[Floats, Floats, Floats]:
        """Return scores (m,), weights of what is covered (m,) and best rotations (m, 3, 3)."""
        track = self.track
        found = kernel.profile(self.columns, offsets, track.arrays, track.limits, loss_scales)
        scores, totals, rotations = found
        return scores, totals, rotations

    def no_overlap(self, where: str) -> str:
        """Say how far apart two streams are that do not overlap, and `where` it was asked."""
        t, on = self.headings.t, self.track.t
        if t.size == 0:
            return "headings: no usable row is left"
        return (
            f"headings ({t[0]:.3f} to {t[-1]:.3f} s) and velocities ({on[0]:.3f} to {on[-1]:.3f}"
            f" s, where moving and without gaps) do not overlap {where}"
            f"{clocks_apart((t[0], t[-1]), (on[0], on[-1]))}"
        )


def _weights(headings: HeadingSeries) -> Floats:
    """Return the weight of each heading, 1 on average: as given, else from its sd, else 1.

    The scatter that all headings share is taken to be as large as the median standard deviation.
    """
    if headings.weight is not None:
        w = headings.weight / max(headings.weight.max(initial=0.0), 1e-300)
    elif headings.sd is not None and headings.sd.any():
        sd = np.clip(headings.sd, MIN_SIGMA, np.pi)
        w = 1.0 / (sd**2 + np.median(sd) ** 2)
    else:
        return np.ones(len(headings))
    return w * (len(headings) / max(w.sum(), 1e-300))

"""What a recording holds, found by reading it once: what ``evcalib info`` prints."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from data_tools.recordings import _stages as stages
from data_tools.recordings._imu import samples_of
from evcalib import checks
from evcalib.arrays import Integers
from evcalib.errors import InputError

if TYPE_CHECKING:
    from data_tools.recordings._recording import Recording

RATE_WINDOW_US = 10_000
"""Window of the peak rate [us]; windows start at whole multiples of it."""


@dataclass(frozen=True)
class RecordingInfo:
    """What a recording holds.

    Attributes
    ----------
    path, format : str
        The file and the name of its format.
    width, height : int
        Sensor size [px].
    count : int
        Number of events that can be used.
    on_share : float
        Share of ON events among them.
    first_us, last_us : int
        Earliest and latest time [us] on the recording's own clock.
    origin_us : int
        What reading it subtracts from times [us].
    duration : float
        From the earliest to the latest event [s].
    rate_mean, rate_peak : float
        Events per second, over all and in the fullest window of 10 ms.
    gap_limit : float
        Times without events that are longer [s] are counted as gaps.
    gaps : int
        Number of gaps.
    longest_gap, longest_gap_start : float
        Longest time without an event [s], and where it starts [s], after `first_us`.
    late : int
        Events before the latest of those that precede them in the file.
    largest_step_back : float
        How late the latest of them is [s].
    losses : dict of str to int
        What could not be used: reason and count.
    notes : tuple of str
        What was taken for granted.
    imu : str
        What the recording holds of an IMU; nothing where it holds none.
    """

    path: str
    format: str
    width: int
    height: int
    count: int
    on_share: float
    first_us: int
    last_us: int
    origin_us: int
    duration: float
    rate_mean: float
    rate_peak: float
    gap_limit: float
    gaps: int
    longest_gap: float
    longest_gap_start: float
    late: int
    largest_step_back: float
    losses: dict[str, int]
    notes: tuple[str, ...]
    imu: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as a dict that JSON takes."""
        return asdict(self) | {"notes": list(self.notes)}

    def text(self) -> str:
        """Return the same for people, one line each."""
        rows = [
            ("recording", f"{self.path} ({self.format})"),
            ("sensor", f"{self.width}x{self.height} px"),
            ("events", f"{self.count} ({100 * self.on_share:.1f} % ON)"),
            ("duration", f"{self.duration:.6f} s, from {self.first_us} to {self.last_us} us"),
            (
                "rate",
                f"{self.rate_mean / 1e6:.3f} million/s, at most {self.rate_peak / 1e6:.3f} in"
                f" {RATE_WINDOW_US // 1000} ms",
            ),
            (
                "gaps",
                f"{self.gaps} of over {self.gap_limit:g} s; the longest {self.longest_gap:.6f} s,"
                f" {self.longest_gap_start:.3f} s after the first event",
            ),
            ("order", self._order()),
        ]
        if self.imu:
            rows.append(("IMU", self.imu))
        if self.origin_us:
            rows.append(("origin", f"{self.origin_us} us are subtracted from times"))
        rows += [("not used", f"{count} {reason}") for reason, count in self.losses.items()]
        rows += [("note", note) for note in self.notes]
        return "\n".join(f"{name:10} {value}" for name, value in rows)

    def _order(self) -> str:
        if not self.late:
            return "times ascend"
        return f"{self.late} events are late, by up to {1e3 * self.largest_step_back:.3f} ms"


def describe(recording: Recording, *, gap_limit: float = 0.1) -> RecordingInfo:
    """Read a recording once, in bounded memory, and say what it holds.

    Times out of order are counted, whatever the recording was opened to do about them.

    Parameters
    ----------
    recording : Recording
        From `open_recording`.
    gap_limit : float
        Times without events longer than this [s] count as gaps.

    Returns
    -------
    RecordingInfo
        Counts, rates, gaps, disorder and losses.

    Raises
    ------
    InputError
        At damage that cannot be passed over.
    """
    limit = checks.positive(gap_limit, "gap_limit", "seconds")
    late, gaps, rate = stages.Disorder(), _Gaps(limit), _Rate()
    count = on = 0
    first, last = 1 << 62, -(1 << 62)
    for piece in recording.columns():
        count += piece.t.size
        on += int(np.count_nonzero(piece.p))
        first, last = min(first, int(piece.t.min())), max(last, int(piece.t.max()))
        lag = late.lag(piece.t)
        gaps.add(piece.t if lag is None else piece.t + lag)
        rate.add(piece.t)
    duration = (last - first) / 1e6
    mean = count / duration if duration else 0.0
    return RecordingInfo(
        path=str(recording.path),
        format=recording.format,
        width=recording.width,
        height=recording.height,
        count=count,
        on_share=on / count if count else 0.0,
        first_us=first,
        last_us=last,
        origin_us=recording.origin_us,
        duration=duration,
        rate_mean=mean,
        rate_peak=max(mean, rate.most * 1e6 / RATE_WINDOW_US),
        gap_limit=limit,
        gaps=gaps.count,
        longest_gap=gaps.longest_us / 1e6,
        longest_gap_start=(gaps.start_us - first) / 1e6 if gaps.longest_us else 0.0,
        late=late.count,
        largest_step_back=late.largest_us / 1e6,
        losses={reason: n for reason, n in recording.losses.items() if n},
        notes=tuple(recording.notes),
        imu=_imu(recording),
    )


def _imu(recording: Recording) -> str:
    """Return what there is of an IMU, in words; what is wrong with it, where it cannot be read."""
    try:
        samples = samples_of(recording.path, format=recording.format)
    except InputError as error:
        return f"not read: {error}"
    if samples is None or samples.t_ns.size < 2:
        return ""
    seconds = (samples.t_ns[-1] - samples.t_ns[0]) / 1e9
    rate = samples.t_ns.size / seconds if seconds > 0 else 0.0
    turning = float(np.degrees(np.sqrt(np.nanmean(np.sum(samples.rate**2, axis=1)))))
    both = "rates and accelerations" if samples.acceleration is not None else "rates"
    return (
        f"{samples.t_ns.size} samples of {both} in {seconds:.3f} s ({rate:.0f}/s); turns by"
        f" {turning:.2f} deg/s (rms); {'; '.join(samples.notes)}"
    )


class _Gaps:
    """Steps between ascending times, from piece to piece."""

    def __init__(self, limit: float) -> None:
        self.count = self.longest_us = self.start_us = 0
        self._limit_us = limit * 1e6
        self._last: int | None = None

    def add(self, t: Integers) -> None:
        before = np.concatenate([[t[0] if self._last is None else self._last], t[:-1]])
        steps = t - before
        self.count += int(np.count_nonzero(steps > self._limit_us))
        row = int(np.argmax(steps))
        if steps[row] > self.longest_us:
            self.longest_us, self.start_us = int(steps[row]), int(before[row])
        self._last = int(t[-1])


class _Rate:
    """Most events in a window.  Of the windows only the last ones stay open for late events."""

    OPEN = 100

    def __init__(self) -> None:
        self.most = 0
        self._counts: Counter[int] = Counter()

    def add(self, t: Integers) -> None:
        windows = t // RATE_WINDOW_US
        starts = np.concatenate([[0], np.flatnonzero(windows[1:] != windows[:-1]) + 1])
        lengths = np.diff(starts, append=t.size)
        for window, length in zip(windows[starts].tolist(), lengths.tolist(), strict=True):
            self._counts[window] += length
        self.most = max(self.most, *self._counts.values())
        oldest = max(self._counts) - self.OPEN
        self._counts = Counter({k: n for k, n in self._counts.items() if k >= oldest})

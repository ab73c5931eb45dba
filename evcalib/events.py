"""The event stream: four columns and a sensor size, checked once at the front door."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evcalib import _event_columns as take
from evcalib import checks
from evcalib._event_columns import MAX_TIME_US
from evcalib.arrays import Flags, Integers
from evcalib.display import Shown
from evcalib.errors import InputError

_FIELDS = {
    "x": ("x",),
    "y": ("y",),
    "t": ("t", "ts", "timestamp", "timestamps"),
    "p": ("p", "pol", "polarity", "on"),
}


@dataclass(frozen=True, eq=False)
class Events(Shown):
    """Events of one camera in the order of their times.

    Building it checks everything once; slices are views that are not checked again.  The columns
    are read-only, so that they stay what was checked.  Arrays that already have the right type
    are not copied: do not change them afterwards.

    Attributes
    ----------
    x, y : ndarray of uint16, shape (n,)
        Column and row [px], below `width` and `height`.
    t : ndarray of int64, shape (n,)
        Time [us], not negative, ascending; equal times may follow each other.
    p : ndarray of bool, shape (n,)
        Polarity, True = ON (brighter).  Given as booleans, as {0, 1} or as {-1, 1}.
    width, height : int
        Sensor size [px].

    Raises
    ------
    InputError
        If lengths differ, a column is not of integers, a pixel is outside the sensor, a time is
        negative, of Unix-time size or before its predecessor, or polarity codings are mixed.

    Examples
    --------
    >>> events = Events(x=[3, 3, 4], y=[0, 1, 1], t=[0, 10, 10], p=[1, 0, 1], width=5, height=2)
    >>> len(events), len(events[1:]), events.shape
    (3, 2, (2, 5))
    """

    x: NDArray[np.uint16]
    y: NDArray[np.uint16]
    t: Integers
    p: Flags
    width: int
    height: int

    def __post_init__(self) -> None:
        width, height = checks.side(self.width, "width"), checks.side(self.height, "height")
        t = take.times_us(self.t)
        columns = {
            "x": take.pixels(self.x, "x", width, "width"),
            "y": take.pixels(self.y, "y", height, "height"),
            "p": take.polarity(self.p),
            "t": t,
        }
        for name, column in columns.items():
            if column.size != t.size:
                raise InputError(
                    f"event columns differ in length: {name} has {column.size}, t has {t.size}"
                )
        _fill(self, width=width, height=height, **columns)

    @classmethod
    def from_arrays(
        cls,
        x: ArrayLike,
        y: ArrayLike,
        t: ArrayLike,
        p: ArrayLike,
        width: int,
        height: int,
        *,
        time_unit: str = "us",
        origin_us: int = 0,
    ) -> Events:
        """Build events from four columns.

        Parameters
        ----------
        x, y, t, p : array_like, shape (n,)
            The columns; see the class.
        width, height : int
            Sensor size [px].
        time_unit : {"us", "s", "ms", "ns"}
            Unit of `t`.  Microseconds must be integers.  Other units are converted, rounded to
            the nearest microsecond; seconds and milliseconds may then be floats.
        origin_us : int
            Subtracted from every time [us], e.g. to bring Unix time down.  Subtract the same
            from the stream that the events will be aligned with.

        Raises
        ------
        InputError
            As the class; and if times are floats without a `time_unit` that says what they are.
        """
        stamps = take.to_us(t, checks.one_of(time_unit, "time_unit", ("us", "s", "ms", "ns")))
        if origin_us:
            stamps = take.minus(stamps, origin_us)
        return cls(x, y, stamps, p, width, height)  # type: ignore[arg-type]

    @classmethod
    def from_structured(
        cls,
        array: NDArray[np.void],
        width: int,
        height: int,
        *,
        time_unit: str = "us",
        origin_us: int = 0,
    ) -> Events:
        """Build events from a structured array with fields x, y, t and p.

        Time may also be named ``ts``, ``timestamp`` or ``timestamps``; polarity ``pol``,
        ``polarity`` or ``on``.  The other parameters are those of `from_arrays`.
        """
        names = getattr(array, "dtype", np.dtype(float)).names
        if names is None:
            raise InputError("a structured array with fields x, y, t, p is needed; see from_arrays")
        columns = (array[_field(names, key)] for key in "xytp")
        x, y, t, p = columns
        return cls.from_arrays(x, y, t, p, width, height, time_unit=time_unit, origin_us=origin_us)

    @classmethod
    def empty(cls, width: int, height: int) -> Events:
        """Return a stream without events."""
        none = np.empty(0, dtype=np.uint16)
        return cls(none, none, none, none, width, height)  # type: ignore[arg-type]

    @classmethod
    def concatenate(cls, parts: Sequence[Events]) -> Events:
        """Join streams of one sensor that follow each other in time."""
        if not parts:
            raise InputError("there is nothing to concatenate: at least one stream is needed")
        shape = parts[0].shape
        for k, part in enumerate(parts):
            if part.shape != shape:
                raise InputError(f"stream {k} has shape {part.shape}, stream 0 has {shape}")
        full = [part for part in parts if len(part)]
        for before, after in pairwise(full):
            if after.t[0] < before.t[-1]:
                raise InputError(
                    f"a stream that starts at {after.t[0]} us follows one that ends at"
                    f" {before.t[-1]} us; put the streams in order of time"
                )
        columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in "xytp"}
        return _fill(object.__new__(cls), width=shape[1], height=shape[0], **columns)

    def __len__(self) -> int:
        return int(self.t.size)

    @overload
    def __getitem__(self, rows: slice) -> Events: ...
    @overload
    def __getitem__(self, rows: Flags) -> Events: ...

    def __getitem__(self, rows: slice | Flags) -> Events:
        """Return the events of a forward slice (views) or of a boolean mask (copies)."""
        if isinstance(rows, slice):
            if rows.step not in (None, 1):
                raise InputError("a slice of events must have step 1; use a boolean mask instead")
        else:
            rows = np.asarray(rows)
            if rows.dtype != np.bool_ or rows.shape != self.t.shape:
                raise InputError(f"events take a slice or a mask of {len(self)} booleans")
        columns = {name: getattr(self, name)[rows] for name in "xytp"}
        return _fill(object.__new__(Events), width=self.width, height=self.height, **columns)

    @property
    def shape(self) -> tuple[int, int]:
        """Image shape (height, width)."""
        return self.height, self.width

    @property
    def duration(self) -> float:
        """Time from the first to the last event [s]; 0 without events."""
        return float(self.t[-1] - self.t[0]) / 1e6 if len(self) else 0.0

    def between(self, t0_us: int, t1_us: int) -> Events:
        """Return the events with t0_us <= t < t1_us (whole microseconds), as views."""
        bounds = checks.whole_us(t0_us, "t0_us"), checks.whole_us(t1_us, "t1_us")
        limits = [min(max(bound, -1), MAX_TIME_US + 1) for bound in bounds]
        start, stop = np.searchsorted(self.t, limits)
        return self[int(start) : int(stop)]


def require_next(events: Events, shape: tuple[int, int], now_us: int, what: str) -> None:
    """Require the next events of a stream that `what` takes in pieces.

    Parameters
    ----------
    events : Events
        The piece.
    shape : tuple of int
        Height and width of the sensor [px].
    now_us : int
        Time of the last event taken in [us].
    what : str
        Who takes them, for the message.

    Raises
    ------
    InputError
        If the sensor size differs or time goes back.
    """
    checks.instance(events, "events", Events)
    if events.shape != shape:
        raise InputError(f"the {what} was made for {shape}, the events have {events.shape}")
    if len(events) and events.t[0] < now_us:
        raise InputError(
            f"events start at {events.t[0]} us, before the {now_us} us already taken in"
        )


def _fill(events: Events, **values: object) -> Events:
    """Set the attributes of a frozen instance; arrays become read-only views."""
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            value = value.view()
            value.flags.writeable = False
        object.__setattr__(events, name, value)
    return events


def _field(names: tuple[str, ...], key: str) -> str:
    for name in _FIELDS[key]:
        if name in names:
            return name
    raise InputError(f"the array has no field {' or '.join(_FIELDS[key])}, only {', '.join(names)}")

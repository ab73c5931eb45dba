"""Recordings of events in any format that is known: one way to open, one kind of pieces out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from data_tools.recordings import _stages as stages
from data_tools.recordings._clock import Turns, doubt, parts, without_glitches
from data_tools.recordings.formats import UNITS, Columns, Format, Options, Size, Source, find
from evcalib import checks
from evcalib._event_columns import MAX_TIME_US
from evcalib.checks import side, whole_us
from evcalib.errors import InputError
from evcalib.events import Events


def open_recording(
    path: str | Path,
    *,
    format: str | None = None,
    size: Size | None = None,
    time_unit: str | None = None,
    origin_us: int | None = None,
    disorder: str = "refuse",
    stream: str | None = None,
) -> Recording:
    """Open a recording of events.

    Parameters
    ----------
    path : path
        A file, or the folder of a ROS 2 bag.
    format : str, optional
        Its format, one of `data_tools.recordings.formats.known()`; by default found from the
        content.
    size : (int, int), optional
        Sensor width and height [px], needed only where the file does not tell it.
    time_unit : {"s", "ms", "us", "ns"}, optional
        Unit of times, needed only where the format leaves it open, and refused where the file
        declares another.
    origin_us : int, optional
        Subtracted from all times [us].  By default 0, unless the times are of Unix size (over
        three years): then the first time, rounded down to a whole second.
    disorder : {"refuse", "sort", "drop"}
        What to do with events before their predecessors: refuse the recording; put them in order,
        if they are at most 50 ms late; or leave them out.  What was done is in the recording's
        `losses` and `notes`.  Whichever it is, a few events after which the clock is again where it
        was before them are left out, and a clock of 32 bits that starts again goes on.
    stream : str, optional
        Which of several streams, where the file has more than one: the name in a zip, the topic
        of a bag, the camera or group.

    Returns
    -------
    Recording
        Its first events have been read, nothing is kept open.

    Raises
    ------
    InputError
        If the file cannot be read, is in no known format, is damaged before its first events,
        holds none, contradicts `size` or `time_unit`, or its times with decimals can hardly be
        seconds and no unit is given.
    """
    path = Path(path)
    if time_unit is not None:
        checks.one_of(time_unit, "time_unit", UNITS)
    if size is not None:
        size = side(size[0], "width"), side(size[1], "height")
    checks.one_of(disorder, "disorder", ("refuse", "sort", "drop"))
    options = Options(format, size, time_unit, stream, disorder)
    return Recording(path, find(path, format), options, origin_us)


class Recording:
    """Events of a file, read anew at each iteration in pieces of up to a million; never empty.

    Built by `open_recording`.

    Attributes
    ----------
    path : Path
        Where it stands.
    format : str
        Name of its format.
    width, height : int
        Sensor size [px].
    origin_us : int
        What was subtracted from all times [us]; do the same to the stream to align with.
    losses : mapping of str to int
        What the latest iteration, so far, left out or could not use: reason and count.
    notes : list of str
        What was taken for granted, and whether the latest iteration put events in order.
    """

    path: Path
    losses: Mapping[str, int]
    notes: list[str]

    def __init__(self, path: Path, module: Format, options: Options, origin_us: int | None) -> None:
        self._module, self._options = module, options
        self._source = module.open(path, options)
        self.path, self.format = path, self._source.format
        self.width, self.height = self._source.width, self._source.height
        if options.time_unit is not None and self._source.fixed not in (None, options.time_unit):
            raise InputError(
                f"{path}: the format {self.format} keeps times in {self._source.fixed}, not in"
                f" {options.time_unit}: leave time_unit (--time-unit) out"
            )
        first = next(self.columns(), None)
        if first is None:
            lost = ", ".join(f"{count} {reason}" for reason, count in self.losses.items() if count)
            raise InputError(f"{path} holds no events" + (f" ({lost})" if lost else ""))
        if self._source.guessed is not None:
            why = doubt(self._source.guessed, first.t)
            if why is not None and self._source.guessed == "s":
                raise InputError(f"{path}: {why}")
            if why is not None:
                # Whole numbers are microseconds by the rule of their format: a question is enough.
                self._source = replace(self._source, notes=(*self._source.notes, why))
                self.notes.append(why)
        if origin_us is None:
            self.origin_us = _origin(int(first.t.min()))
        else:
            self.origin_us = whole_us(origin_us, "origin_us")

    def __repr__(self) -> str:
        return f"<{self.format} recording {self.path}, {self.width}x{self.height} px>"

    @property
    def shape(self) -> tuple[int, int]:
        """Image shape (height, width)."""
        return self.height, self.width

    def __iter__(self) -> Iterator[Events]:
        """Yield the events in order of time.

        Raises
        ------
        InputError
            At damage that cannot be passed over, times out of order (see `disorder`), or at the
            end, if the file grew or shrank meanwhile.
        """
        size = self._size()
        self.losses = losses = Counter[str]()
        late = stages.Disorder()
        for piece in self._ordered(losses, late):
            yield self._events(piece)
        if self._size() != size:
            raise InputError(
                f"{self.path} changed while it was read, from {size} to {self._size()} bytes;"
                " read it when it is complete"
            )
        if late.count and self._options.disorder == "sort":
            self.notes.append(
                f"{late.count} late events were put in order, by up to {late.largest_us} us"
            )

    def note(self, text: str) -> None:
        """Add to the notes, for good, what the user should know."""
        self._source = replace(self._source, notes=(*self._source.notes, text))
        self.notes.append(text)

    def columns(self) -> Iterator[Columns]:
        """Yield the events as the file has them: times not shifted, perhaps out of order.

        Counts in `losses` like an iteration.  For those who examine a recording.
        """
        self.losses = losses = Counter[str]()
        return self._naming(self._within(self._source, losses))

    def _size(self) -> int | None:
        return self.path.stat().st_size if self.path.is_file() else None

    def _ordered(self, losses: Counter[str], late: stages.Disorder) -> Iterator[Columns]:
        pieces = self._within(self._source, losses)
        match self._options.disorder:
            case "sort":
                pieces = stages.gathered(stages.in_order(pieces, late))
            case "drop":
                pieces = stages.gathered(stages.dropped(pieces, late, losses))
            case _:
                pieces = stages.refused(pieces, late)
        return self._naming(pieces)

    def _within(self, source: Source, losses: Counter[str]) -> Iterator[Columns]:
        """Yield the events that can be used, and note at the end what was mended in their times."""
        self.notes = list(source.notes)
        turns, first, last = Turns(), None, 0
        pieces = stages.inside(
            stages.gathered(source.pieces(losses)), self.width, self.height, losses
        )
        for piece in without_glitches(turns.mended(parts(pieces)), losses):
            first = int(piece.t[0]) if first is None else first
            last = int(piece.t[-1])
            yield piece
        if source.turn_us and first is not None:
            turns.count += last // source.turn_us - first // source.turn_us
        if turns.count:
            self.notes.append(
                f"the recording's clock of 32 bits started again ({turns.count} x); the times were"
                " mended to go on"
            )

    def _naming(self, pieces: Iterator[Columns]) -> Iterator[Columns]:
        """Pass pieces on; an error says which recording."""
        try:
            yield from pieces
        except InputError as error:
            if str(self.path) in str(error):
                raise
            raise InputError(f"{self.path}: {error}") from None

    def _events(self, piece: Columns) -> Events:
        t = piece.t - self.origin_us if self.origin_us else piece.t
        if t[0] < 0:
            raise InputError(
                f"{self.path} has an event at {piece.t[0]} us, before origin_us = {self.origin_us}"
            )
        if t[-1] > MAX_TIME_US:
            raise InputError(
                f"{self.path} has an event at {piece.t[-1]} us, over three years after origin_us ="
                f" {self.origin_us}: is the time unit right?"
            )
        return Events(piece.x, piece.y, t, piece.p, self.width, self.height)


def _origin(first_us: int) -> int:
    return first_us // 1_000_000 * 1_000_000 if first_us > MAX_TIME_US else 0

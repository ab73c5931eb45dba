"""One module per format of recordings, and what such a module must have.

A format module defines

- ``NAMES``: the names of its formats, as `Recording.format` and messages show them;
- ``matches(path, head) -> bool``: whether the content is of this format.  ``head`` is the first
  `HEAD_BYTES` bytes; it is empty for a folder.  Must not raise, and be sure: only one may match;
- ``open(path, options) -> Source``: reads headers, checks them, and says how to get the events;
- ``imu(path, options) -> Samples | None``, where the format may hold an IMU: its samples.

and is listed in `MODULES`.  Everything that is the same for all formats (pixels outside the
sensor, order in time, origin of times, size of pieces) is left to `data_tools.recordings`.
"""

from __future__ import annotations

import codecs
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from data_tools.files.pipes import refuse_pipe
from evcalib.arrays import Flags, Floats, Integers
from evcalib.checks import side
from evcalib.errors import InputError

MODULES = (
    *("aedat2", "aedat3", "aedat4", "es", "text", "csv", "npz", "npy", "mat", "hdf5"),
    *("prophesee_raw", "prophesee_dat", "rosbag"),
)
"""Modules of this package that are formats."""

HEAD_BYTES = 4096

UNITS = ("s", "ms", "us", "ns")
"""Units of time that files may declare and callers may say."""

Size = tuple[int, int]


class SizeUnknown(InputError):
    """Neither the recording nor the caller tells the sensor size."""


class Columns(NamedTuple):
    """Events as a file has them: not checked, not shifted, perhaps out of order.

    `x`, `y` are unsigned integers [px], `t` is int64 [us] from whatever origin, `p` is bool.
    """

    x: NDArray[np.unsignedinteger]
    y: NDArray[np.unsignedinteger]
    t: Integers
    p: Flags

    def rows(self, which: slice | NDArray) -> Columns:
        """Return the events of a slice, a mask or an order."""
        return Columns(self.x[which], self.y[which], self.t[which], self.p[which])

    @classmethod
    def joined(cls, parts: Sequence[Columns]) -> Columns:
        """Return the events of all parts, one after the other."""
        x, y, t, p = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        return cls(x, y, t, p)


@dataclass(frozen=True)
class Options:
    """What the caller says about a recording; see :func:`data_tools.recordings.open_recording`.

    Order in time is not the business of a format: none refuses a step back.
    """

    format: str | None = None
    size: Size | None = None
    time_unit: str | None = None
    stream: str | None = None
    disorder: str = "refuse"

    def unit(self, declared: str | None) -> str | None:
        """Return the unit of times: what the file declares, else what the caller says, else None.

        Raises
        ------
        InputError
            If the file declares no known unit, or another than the caller says.
        """
        if declared is not None and declared not in UNITS:
            raise InputError(
                f"its time_unit is {declared[:20]!r}, which is none of {', '.join(UNITS)}"
            )
        if declared is not None and self.time_unit not in (None, declared):
            raise InputError(
                f"its times are in {declared}, as it says itself, not in {self.time_unit}: leave"
                " time_unit (--time-unit) out"
            )
        return declared or self.time_unit

    def sensor(self, path: Path, declared: Size | None) -> Size:
        """Return (width, height), declared by the file or given by the caller, not both unlike."""
        if declared is None and self.size is None:
            raise SizeUnknown(
                f"{path} does not tell the sensor size; give width and height (--size)"
            )
        if declared is not None and self.size is not None and declared != self.size:
            raise InputError(
                f"{path} is of a sensor of {declared[0]}x{declared[1]} px,"
                f" not of {self.size[0]}x{self.size[1]}: is it the right recording?"
            )
        size = declared or self.size
        assert size is not None
        try:
            return side(size[0], "width"), side(size[1], "height")
        except InputError as error:
            raise InputError(f"{path}: {error}") from None


@dataclass(frozen=True)
class Source:
    """An opened recording: its headers, and how to get its events.

    Attributes
    ----------
    format : str
        One of the module's ``NAMES``.
    width, height : int
        Sensor size [px].
    pieces : callable
        Called with a Counter, iterates over all events from the start, in pieces of at most some
        million events and of any smaller size (empty too).  What cannot be used is counted in
        the Counter under a reason in words, like ``"bytes of a cut-off last packet"``.
    notes : tuple of str
        What the reader took for granted and the user should know.
    guessed : str, optional
        Unit of times that the reader took for granted, where neither the file nor the caller tells
        it; whether it is plausible is asked of the first events.
    fixed : str, optional
        Unit in which the format keeps all times; a caller who says another is refused.
    turn_us : int
        What the reader has added [us] at each turn of the format's own clock; 0 if that is part of
        every such file, and so not worth a word.
    """

    format: str
    width: int
    height: int
    pieces: Callable[[Counter[str]], Iterator[Columns]]
    notes: tuple[str, ...] = ()
    guessed: str | None = None
    fixed: str | None = None
    turn_us: int = 0


@dataclass(frozen=True, eq=False)
class Samples:
    """What an IMU recorded, in the order of the file: not checked, perhaps with NaN.

    Attributes
    ----------
    t_ns : ndarray of int64, shape (n,)
        Times [ns] on the clock of the events.
    rate : ndarray, shape (n, 3)
        Angular velocity [rad/s].
    acceleration : ndarray, shape (n, 3), optional
        Specific force [m/s^2].
    notes : tuple of str
        What was taken for granted.
    """

    t_ns: Integers
    rate: Floats
    acceleration: Floats | None
    notes: tuple[str, ...] = ()


class Format(Protocol):
    """What a format module looks like."""

    NAMES: tuple[str, ...]

    def matches(self, path: Path, head: bytes) -> bool:
        """Tell whether the content is of this format."""

    def open(self, path: Path, options: Options) -> Source:
        """Read and check the headers."""


def _formats() -> list[Format]:
    modules = (import_module(f"{__name__}.{name}") for name in MODULES)
    return list(modules)


def known() -> tuple[str, ...]:
    """Return the names of all formats."""
    return tuple(name for module in _formats() for name in module.NAMES)


def find(path: Path, name: str | None) -> Format:
    """Return the format of a file: the one named, or the one that its content fits.

    Raises
    ------
    InputError
        If the file cannot be read, or no format fits it.
    """
    refuse_pipe(path)
    if name is not None:
        for module in _formats():
            if name in module.NAMES:
                return module
        raise InputError(f"the format must be one of {', '.join(known())}, not {name!r}")
    head = _head(path)
    for module in _formats():
        if module.matches(path, head):
            return module
    if head[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        raise InputError(f"{path} is text in UTF-16; save it as UTF-8, or as plain text")
    first = head.lstrip(codecs.BOM_UTF8).decode("utf-8", "replace").strip().split("\n")[0].strip()
    if first.isprintable() and "\ufffd" not in first and len(re.split(r"[,;|\s]+", first)) > 3:
        raise InputError(
            f"{path} is in no format that is known; if it is a table of events, its first line must"
            " name the columns x, y, t and p, with commas, semicolons, tabs or blanks between"
            f" them, not {first[:80]!r}"
        )
    what = "is empty" if path.is_file() and not head else "is in no format that is known"
    raise InputError(f"{path} {what}; known are {', '.join(known())}")


def _head(path: Path) -> bytes:
    try:
        if path.is_dir():
            return b""
        with path.open("rb") as file:
            return file.read(HEAD_BYTES)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None

"""Recordings written anew: HDF5 in our own layout, NumPy archives, CSV, text.

The layout ``evcalib-events``, version 1, is an HDF5 file with the group ``events``:

========  =======  =====================================================
dataset   type     content (one value per event, in the order of time)
========  =======  =====================================================
``x``     uint16   column [px], from 0
``y``     uint16   row [px], from 0
``t``     int64    time [us] since ``origin_us``, ascending, not negative
``p``     uint8    polarity: 1 = ON (brighter), 0 = OFF
========  =======  =====================================================

and these attributes of the group:

==================  ==========================================================
attribute           content
==================  ==========================================================
``format``          ``"evcalib-events"``
``version``         1
``width, height``   sensor size [px]
``time_unit``       ``"us"``
``origin_us``       add it to ``t`` for the times of the original recording [us]
``count``           number of events
``source``          name of the file that was converted
==================  ==========================================================

All datasets are in chunks of 65,536 values, with the byte shuffle and gzip that every HDF5 library
has.  Readers of DSEC's layout (``events/x``...) read it too.  The other targets hold the original
times, in whole microseconds (``.txt``: in seconds with six decimals, ``t x y p``), and tell the
sensor's size (``.txt``: in a comment).
"""

from __future__ import annotations

import gzip
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any, Protocol

import h5py
import numpy as np
from numpy.typing import NDArray

from data_tools.files.atomic import replacing
from data_tools.recordings.formats.events_text import MARK
from data_tools.recordings.formats.hdf5 import LAYOUT, VERSION
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.filters import Denoiser, Noise

_CHUNK = 1 << 16
_TYPES = {"x": np.uint16, "y": np.uint16, "t": np.int64, "p": np.uint8}


class EventSource(Protocol):
    """Events and what there is to say of them: a `Recording`, or anything like one."""

    @property
    def path(self) -> Path:
        """Where they come from."""

    @property
    def width(self) -> int:
        """Columns of the sensor [px]."""

    @property
    def height(self) -> int:
        """Rows of the sensor [px]."""

    @property
    def origin_us(self) -> int:
        """Subtracted from the original times [us]."""

    def __iter__(self) -> Iterator[Events]:
        """Yield pieces in order of time."""


class Denoised:
    """A recording without what the sensor makes of itself; see `evcalib.filters.Denoiser`.

    Parameters
    ----------
    recording : Recording
        What `open_recording` returned, or anything like it.
    """

    def __init__(self, recording: EventSource) -> None:
        self.path, self.origin_us = recording.path, recording.origin_us
        self.width, self.height = recording.width, recording.height
        self.noise = Noise()
        self._recording = recording

    def __iter__(self) -> Iterator[Events]:
        """Yield pieces in order of time; afterwards `noise` says what was left out."""
        denoiser = Denoiser(self.width, self.height)
        for piece in self._recording:
            kept = denoiser.kept(piece)
            if len(kept):
                yield kept
        self.noise = denoiser.noise


def convert(recording: EventSource, target: str | Path) -> int:
    """Write a recording to another file, in bounded memory.

    The file grows beside its final name and gets it when it is complete (`replacing`).

    Parameters
    ----------
    recording : Recording
        What `open_recording` returned, or anything like it, such as `Denoised`.
    target : path
        The file; its suffix says the format: ``.h5`` or ``.hdf5`` (our own layout), ``.npz``,
        ``.csv`` or ``.txt``, these two also with ``.gz``.  A file of that name is replaced.

    Returns
    -------
    int
        Number of events written; what the recording lost on the way is in its `losses`.

    Raises
    ------
    InputError
        If the suffix is unknown, the target is the recording itself or cannot be written, or the
        recording turns out to be damaged.  Then, and after Ctrl-C, nothing is left behind.
    """
    target = Path(target)
    write = _writer(target)
    if target.is_dir():
        raise InputError(f"cannot write {target}: it is a folder")
    if target.exists() and recording.path.exists() and target.samefile(recording.path):
        raise InputError(f"{target} is the recording itself: give the copy another name")
    try:
        with replacing(target) as part:
            count = write(recording, part)
    except (OSError, RuntimeError) as error:
        # h5py reports a full disk as a RuntimeError when it closes the file.
        why = getattr(error, "strerror", None) or error
        raise InputError(f"cannot write {target}: {why}") from None
    return count


def _writer(target: Path) -> Callable[[EventSource, Path], int]:
    suffixes = [suffix.lower() for suffix in target.suffixes[-2:]]
    packed = suffixes[-1:] == [".gz"]
    suffix = "".join(suffixes[-2:-1] if packed else suffixes[-1:])
    if not packed and suffix in (".h5", ".hdf5"):
        return _write_hdf5
    if not packed and suffix == ".npz":
        return _write_npz
    if suffix in (".csv", ".txt"):
        lines = _csv_lines if suffix == ".csv" else _txt_lines
        return lambda recording, part: _write_lines(recording, part, lines, packed)
    raise InputError(
        f"cannot tell the format from the name {target.name}: end it in .h5, .npz, .csv or .txt"
        " (.csv.gz and .txt.gz too)"
    )


def _write_hdf5(recording: EventSource, part: Path) -> int:
    with h5py.File(part, "w") as file:
        group = file.create_group("events")
        columns = {
            name: group.create_dataset(
                name, (0,), dtype, maxshape=(None,), chunks=(_CHUNK,), compression=4, shuffle=True
            )
            for name, dtype in _TYPES.items()
        }
        count = 0
        for piece in recording:
            for name, column in columns.items():
                column.resize((count + len(piece),))
                column[count:] = getattr(piece, name)
            count += len(piece)
        group.attrs.update(
            {
                "format": LAYOUT,
                "version": VERSION,
                "width": recording.width,
                "height": recording.height,
                "time_unit": "us",
                "origin_us": recording.origin_us,
                "count": count,
                "source": recording.path.name,
            }
        )
    return count


def _write_npz(recording: EventSource, part: Path) -> int:
    """Write each column aside, then all of them into the archive: their length comes first."""
    with ExitStack() as stack:
        columns = {
            name: stack.enter_context(tempfile.TemporaryFile(dir=part.parent)) for name in _TYPES
        }
        count = 0
        for piece in recording:
            for name, dtype in _TYPES.items():
                values = getattr(piece, name).astype(dtype)
                columns[name].write(_absolute(values, name, recording).data)
            count += len(piece)
        with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED, compresslevel=4) as archive:
            for name, dtype in _TYPES.items():
                columns[name].seek(0)
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    _write_header(member, (count,), np.dtype(dtype))
                    shutil.copyfileobj(columns[name], member, 1 << 20)
            facts = {"width": recording.width, "height": recording.height, "time_unit": "us"}
            for name, value in facts.items():
                with archive.open(f"{name}.npy", "w") as member:
                    np.lib.format.write_array(member, np.array(value), allow_pickle=False)
    return count


def _write_header(member: IO[bytes], shape: tuple[int, ...], dtype: np.dtype) -> None:
    head = {
        "descr": np.lib.format.dtype_to_descr(dtype),
        "fortran_order": False,
        "shape": shape,
    }
    np.lib.format.write_array_header_1_0(member, head)


def _absolute(values: NDArray[Any], name: str, recording: EventSource) -> NDArray[Any]:
    return values + recording.origin_us if name == "t" else values


Lines = Callable[[EventSource, Events], Iterator[str]]


def _write_lines(recording: EventSource, part: Path, lines: Lines, packed: bool) -> int:
    count = 0
    with _text_file(part, packed) as text:
        text.write(
            f"{MARK} version={VERSION} width={recording.width} height={recording.height}"
            f" time_unit={'us' if lines is _csv_lines else 's'}\n"
        )
        if lines is _csv_lines:
            text.write("t,x,y,p\n")
        for piece in recording:
            text.writelines(lines(recording, piece))
            count += len(piece)
    return count


def _text_file(part: Path, packed: bool) -> IO[str]:
    if packed:
        return gzip.open(part, "wt", compresslevel=4, encoding="ascii", newline="\n")
    return part.open("w", encoding="ascii", newline="\n")


def _csv_lines(recording: EventSource, piece: Events) -> Iterator[str]:
    rows = zip(*_rows(recording, piece), strict=True)
    return (f"{t},{x},{y},{p}\n" for t, x, y, p in rows)


def _txt_lines(recording: EventSource, piece: Events) -> Iterator[str]:
    rows = zip(*_rows(recording, piece), strict=True)
    return (f"{t // 1_000_000}.{t % 1_000_000:06d} {x} {y} {p}\n" for t, x, y, p in rows)


def _rows(recording: EventSource, piece: Events) -> list[list[int]]:
    t = piece.t + recording.origin_us
    if t[0] < 0:
        raise InputError("the original times are negative, which text cannot hold; convert to .h5")
    return [t.tolist(), piece.x.tolist(), piece.y.tolist(), piece.p.astype(np.uint8).tolist()]

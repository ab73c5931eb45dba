"""HDF5: our own layout, DSEC and its relatives, Prophesee's, and MVSEC's.

``evcalib``
    What `data_tools.recordings.convert` writes; described there.
``dsec``
    A group with the datasets ``x``, ``y``, ``t``, ``p`` [us] (``events`` in DSEC, for which
    ``t_offset`` is added to the times; ``prophesee/left`` in M3ED).  ``ms_to_idx`` is not needed.
``prophesee-hdf5``
    ``CD/events``, a compound of x, y, p, t [us]; sensor size in the file's ``geometry``.
``mvsec``
    ``davis/left/events``, n x 4 floats x, y, t [s], p.

``hdf5-table``
    Any dataset of n x 4 (or 4 x n) numbers, where nothing else holds events; its columns are told
    apart by what they hold.

An IMU is a group with the rates ``omega`` (n x 3, rad/s) and their times ``ts`` [us], and perhaps
``accel`` (M3ED), or ``davis/left/imu``, n x 6 of accelerations and rates with the times ``imu_ts``
[s] (MVSEC).

MATLAB's files of version 7.3 are HDF5 too; their columns may be 1 x n.  Where several groups hold
events, `stream` names one.  A file that declares far more data than it can hold is refused.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from data_tools.recordings.formats import Columns, Options, Samples, Size, Source
from data_tools.recordings.formats._columns import Converter, find_columns
from data_tools.recordings.formats._hdf5_checks import check_columns
from data_tools.recordings.formats._tables import FROM_ONE, SAMPLE, column_order
from evcalib.errors import InputError

NAMES = ("evcalib", "dsec", "prophesee-hdf5", "mvsec", "hdf5-table")

SIGNATURE = b"\x89HDF\r\n\x1a\n"
LAYOUT = "evcalib-events"
VERSION = 1

_DAMAGE = (
    OSError,
    RuntimeError,
    ValueError,
    TypeError,
    LookupError,
    ArithmeticError,
    AttributeError,
    NotImplementedError,
)

_IN_USE = ("unable to lock file", "already open for write", "already open for SWMR")
"""What HDF5 says of a file that is sound, but locked or marked as being written."""

_MVSEC = re.compile(r"(^|/)davis/(left|right)/events$")
"""Only there are times known to be seconds; other tables may have any unit and order."""

_TOLD = ("width", "height", "geometry", "time_unit", "version", "origin_us", "count")
_ROWS = 1 << 19
_CACHE = 1 << 26


@dataclass(frozen=True)
class _Stream:
    """Where the events stand in a file: a group of columns, or one dataset of rows."""

    format: str
    name: str
    fields: dict[str, str] | None = None

    @property
    def table(self) -> bool:
        """Whether events are rows of four numbers."""
        return self.format in ("mvsec", "hdf5-table")


def matches(path: Path, head: bytes) -> bool:
    """Tell whether the file is HDF5."""
    return SIGNATURE in (head[:8], head[512:520])


def open(path: Path, options: Options) -> Source:
    """Open an HDF5 file; `options.stream` is the group (or dataset) of events."""
    with _file(path) as file:
        streams = _streams(file)
        stream, notes = _chosen(path, streams, options)
        columns, attributes = _columns(file, stream), _attributes(file, stream)
        rows = _rows(columns, stream)
        if stream.format == "evcalib" and _integer(attributes.get("count", rows)) != rows:
            raise InputError(f"{path} holds {rows} events, but says {attributes['count']}")
        check_columns(path, columns)
        size = options.sensor(path, _declared_size(attributes))
        shift = _shift(file, stream, attributes)
        unit = _unit(attributes, options, stream)
        order = {key: k for k, key in enumerate("xytp")}
        if stream.format == "hdf5-table":
            order, note = column_order(_part(columns[0], 0, min(rows, SAMPLE), True))
            notes = (*notes, note)
        if file.userblock_size:
            notes = (*notes, FROM_ONE)

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        convert = Converter(*unit)
        with _file(path) as file:
            columns = _columns(file, stream)
            step = _step(columns, stream.table)
            for start in range(0, rows, step):
                raw = _read(columns, stream, order, start, min(start + step, rows))
                piece = convert(*raw)
                yield piece._replace(t=piece.t + shift) if shift else piece

    guessed = None if unit[1] else unit[0]
    return Source(stream.format, *size, pieces, notes, guessed)


def imu(path: Path, options: Options) -> Samples | None:
    """Return the samples of an IMU, of the group `options.stream` or the only one; None without."""
    with _file(path) as file:
        found: list[str] = []
        file.visititems(lambda name, item: found.append(name) if _is_imu(name, item) else None)
        if options.stream is not None:
            found = [name for name in found if name == options.stream.strip("/")]
        elif _LEFT in found:
            found = [_LEFT]
        if len(found) > 1:
            raise InputError(f"{path} has IMUs in {', '.join(found)}; say which (--imu-stream)")
        if not found:
            return None
        item, name = file[found[0]], found[0]
        if isinstance(item, h5py.Group):
            columns = [item[key] for key in ("ts", "omega", "accel") if _is_column(item, key)]
            per_second = 1e6
        else:
            columns, per_second = [file[f"{name}_ts"], item], 1.0
        check_columns(path, columns)
        t, *values = (np.asarray(column[()], dtype=np.float64) for column in columns)
    t = t.ravel()
    if any(part.ndim != 2 or part.shape[0] != t.size or part.shape[1] < 3 for part in values):
        shapes = " and ".join("x".join(map(str, part.shape)) for part in values)
        raise InputError(f"{path}: {name} has values of {shapes} for {t.size} times")
    seconds = t / per_second
    if not (np.isfinite(seconds) & (np.abs(seconds) < _LATEST)).all():
        raise InputError(f"{path}: {name} has times that are none [s]: {seconds.max():g}")
    rate, force = values[0], values[1] if len(values) > 1 else None
    if per_second == 1.0:
        rate, force = values[0][:, 3:6], values[0][:, :3]
    taken = f"IMU: {name}, in its own axes, rates taken to be in rad/s"
    return Samples(np.rint(1e9 * seconds).astype(np.int64), rate, force, (taken,))


_LATEST = 9e9
"""Times above this [s] do not fit 64 bits of nanoseconds."""
_LEFT = "davis/left/imu"
_MVSEC_IMU = re.compile(r"(^|/)davis/(left|right)/imu$")


def _is_imu(name: str, item: Any) -> bool:
    """Tell whether an item is a group of rates and times, or MVSEC's table."""
    if isinstance(item, h5py.Group):
        if not (_is_column(item, "omega") and _is_column(item, "ts")):
            return False
        rate = item["omega"]
        return bool(rate.ndim == 2 and rate.shape[1] == 3)
    table = isinstance(item, h5py.Dataset) and _MVSEC_IMU.search(name) is not None
    return bool(table and item.ndim == 2 and item.shape[1] >= 6 and f"{name}_ts" in item.file)


@contextmanager
def _file(path: Path) -> Iterator[h5py.File]:
    """Open a file; whatever HDF5 says of damage becomes an InputError."""
    try:
        with h5py.File(path, "r", rdcc_nbytes=_CACHE) as file:
            yield file
    except InputError as error:
        raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from None
    except _DAMAGE as error:
        why = " ".join(str(error).split())[:500]
        if any(word in why for word in _IN_USE):
            raise InputError(
                f"{path} is in use by another program, or was not closed after writing, or its"
                " folder has no locks: close the other program; for a folder without locks set"
                " HDF5_USE_FILE_LOCKING=FALSE; for a file that was never closed: h5clear -s FILE"
            ) from None
        raise InputError(f"{path} is damaged or cut off, says HDF5: {why}") from None


def _streams(file: h5py.File) -> list[_Stream]:
    """Return all places in the file that hold events."""
    found: list[_Stream] = []

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Group):
            stream = _grouped(name, item)
        elif isinstance(item, h5py.Dataset):
            stream = _rows_of(name, item)
        else:
            stream = None
        if stream is not None:
            found.append(stream)

    visit("", file)
    file.visititems(visit)
    named = [stream for stream in found if stream.format != "hdf5-table"]
    return named or found


def _grouped(name: str, group: h5py.Group) -> _Stream | None:
    names = [key for key in group if _is_column(group, key)]
    fields = find_columns(names)
    if fields is None:
        return None
    own = _text(group.attrs.get("format", "")) == LAYOUT
    return _Stream("evcalib" if own else "dsec", name, fields)


def _is_column(group: h5py.Group, key: str) -> bool:
    """Tell whether a link is to a dataset of this file; those to other files are not followed."""
    link = group.get(key, getlink=True)
    return not isinstance(link, h5py.ExternalLink) and isinstance(group.get(key), h5py.Dataset)


def _rows_of(name: str, dataset: h5py.Dataset) -> _Stream | None:
    names = dataset.dtype.names
    if names is not None:
        fields = find_columns(names)
        return None if fields is None else _Stream("prophesee-hdf5", name, fields)
    table = dataset.ndim == 2 and 4 in dataset.shape and dataset.dtype.kind in "biuf"
    if not table:
        return None
    mvsec = _MVSEC.search(name) and dataset.dtype.kind == "f" and dataset.shape[1] == 4
    return _Stream("mvsec" if mvsec else "hdf5-table", name)


def _chosen(
    path: Path, streams: list[_Stream], options: Options
) -> tuple[_Stream, tuple[str, ...]]:
    names = [stream.name or "/" for stream in streams]
    if options.format is not None:
        streams = [stream for stream in streams if stream.format == options.format]
    if options.stream is not None:
        wanted = options.stream.strip("/")
        streams = [s for s in streams if wanted in (s.name, s.name.rpartition("/")[0])]
    if not streams:
        there = f"only {', '.join(names)}" if names else "none (columns x, y, t, p are needed)"
        raise InputError(f"{path} has no such events: {there}")
    if len(streams) == 1:
        return streams[0], ()
    left = [stream for stream in streams if stream.name == "davis/left/events"]
    if left:
        return left[0], ("the events of the left camera were read: davis/left/events",)
    raise InputError(f"{path} has events of {', '.join(names)}; say which with stream (--stream)")


def _columns(file: h5py.File, stream: _Stream) -> list[h5py.Dataset]:
    """Return the datasets: x, y, t, p in this order, or the one of whole rows."""
    item = file[stream.name or "/"]
    if isinstance(item, h5py.Dataset):
        return [item]
    assert stream.fields is not None
    return [item[stream.fields[key]] for key in "xytp"]


def _rows(columns: list[h5py.Dataset], stream: _Stream) -> int:
    if stream.table:
        return int(columns[0].shape[_long(columns[0], True)])
    vectors = [c.ndim == 1 or (c.ndim == 2 and 1 in c.shape) for c in columns]
    lengths = [c.size if vector else -1 for c, vector in zip(columns, vectors, strict=True)]
    if len(set(lengths)) > 1 or lengths[0] < 0:
        shapes = ", ".join(f"{c.name} {c.shape}" for c in columns)
        raise InputError(f"the columns of events differ in length: {shapes}")
    return lengths[0]


def _long(column: h5py.Dataset, table: bool) -> int:
    """Return the axis along which events follow one another: in rows of four, or in a vector."""
    side = 4 if table else 1
    return int(column.ndim == 2 and column.shape[0] == side and column.shape[1] != side)


def _part(column: h5py.Dataset, start: int, stop: int, table: bool) -> NDArray:
    """Return some events of a dataset: rows of four, or a vector."""
    block = column[:, start:stop].T if _long(column, table) else column[start:stop]
    return block if table or column.ndim == 1 else block.ravel()


def _read(
    columns: list[h5py.Dataset], stream: _Stream, order: dict[str, int], start: int, stop: int
) -> list[NDArray]:
    try:
        blocks = [_part(column, start, stop, stream.table) for column in columns]
    except (OSError, RuntimeError) as error:
        raise InputError(
            f"events {start} to {stop} of {stream.name} cannot be read (damaged?): {error}"
        ) from None
    if stream.table:
        return [np.ascontiguousarray(blocks[0][:, order[key]]) for key in "xytp"]
    if len(blocks) == 1:
        assert stream.fields is not None
        return [np.ascontiguousarray(blocks[0][stream.fields[key]]) for key in "xytp"]
    return blocks


def _step(columns: list[h5py.Dataset], table: bool) -> int:
    """Return how many rows to read at a time: whole chunks of the largest kind."""
    chunk = max((c.chunks[_long(c, table)] for c in columns if c.chunks), default=_ROWS)
    return int(chunk * max(1, _ROWS // chunk))


def _attributes(file: h5py.File, stream: _Stream) -> dict[str, Any]:
    """Return what is said of the events by the file, the groups above them, and themselves."""
    found: dict[str, Any] = {}
    parts = stream.name.split("/") if stream.name else []
    for k in range(len(parts) + 1):
        attributes = file["/".join(parts[:k]) or "/"].attrs
        found.update({name: attributes[name] for name in _TOLD if name in attributes})
    version = _integer(found.get("version", 0)) if stream.format == "evcalib" else 0
    if version > VERSION:
        raise InputError(f"the layout is of version {version}, this evcalib reads up to {VERSION}")
    return found


def _declared_size(attributes: dict[str, Any]) -> Size | None:
    if "width" in attributes and "height" in attributes:
        return _integer(attributes["width"]), _integer(attributes["height"])
    width, _, height = _text(attributes.get("geometry", "")).partition("x")
    if width.isdigit() and height.isdigit():
        return int(width), int(height)
    return None


def _unit(
    attributes: dict[str, Any], options: Options, stream: _Stream
) -> tuple[str | None, str | None]:
    """Return the units of whole and of fractional times; MVSEC's are seconds by its layout."""
    declared = _text(attributes.get("time_unit", "")) or None
    if declared is None and stream.format == "mvsec":
        declared = "s"
    unit = options.unit(declared)
    return unit or "us", unit


def _shift(file: h5py.File, stream: _Stream, attributes: dict[str, Any]) -> int:
    """Return what to add to all times [us]: DSEC's t_offset, or the origin that we subtracted."""
    if stream.format == "evcalib":
        return _integer(attributes.get("origin_us", 0))
    group = stream.name.rpartition("/")[0]
    for name in (f"{stream.name}/t_offset", f"{group}/t_offset"):
        if stream.format == "dsec" and name in file and file[name].shape in ((), (1,)):
            return _integer(file[name][()])
    return 0


def _integer(value: Any) -> int:
    return int(np.ravel(value)[0])


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)

"""WPILib's data logs (.wpilog): entries of a robot, each a stream of values over time.

After a head of 12 bytes and a text come records: a byte that tells how wide the next three numbers
are, the entry's number, the size of the payload, the time [us], the payload.  Entry 0 announces the
others by name and type.  (WPILib, "Data Log File Format", version 1.0.)
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_tools.files.pipes import refuse_pipe
from evcalib.arrays import Floats, Integers
from evcalib.errors import InputError

MAGIC = b"WPILOG"
LARGEST = 1 << 30
"""Bytes of a log, which is read as a whole."""
DEEPEST = 8
"""Levels of structs within structs."""

_SCHEMAS = "/.schema/struct:"
_NUMBERS = {
    **{"bool": "?", "char": "S1", "float": "<f4", "float32": "<f4", "double": "<f8"},
    "float64": "<f8",
    **{f"{sign}int{8 * n}": f"<{kind}{n}" for sign, kind in (("", "i"), ("u", "u"))
       for n in (1, 2, 4, 8)},
}  # fmt: skip
_KNOWN = {
    "Rotation2d": "double value",
    "SwerveModuleState": "double speed;Rotation2d angle",
    "SwerveModulePosition": "double distance;Rotation2d angle",
    "ChassisSpeeds": "double vx;double vy;double omega",
}
"""Structs as WPILib lays them out, for logs that do not hold their schemas."""
_FIELD = re.compile(r"(\w+)\s+(\w+)")


@dataclass
class Entry:
    """A stream of values.

    Attributes
    ----------
    name, type : str
        As the log announces them.
    t_us : list of int
        Times [us].
    payloads : list of bytes
        Values as they are written.
    """

    name: str
    type: str
    t_us: list[int] = field(default_factory=list)
    payloads: list[bytes] = field(default_factory=list)


@dataclass(frozen=True)
class DataLog:
    """A log: its entries by name, and how many bytes of a last record were cut off."""

    path: Path
    entries: dict[str, Entry]
    cut_off: int

    def values(self, entry: Entry) -> tuple[Integers, NDArray[np.void]]:
        """Return times [us] and structs of an entry of ``struct:NAME`` or ``struct:NAME[]``.

        Returns
        -------
        t_us : ndarray, shape (n,)
            Times.
        values : ndarray, shape (n, m)
            Structs, with fields such as ``angle.value``; as many in each row.

        Raises
        ------
        InputError
            If the layout is not known, or sizes do not fit it.
        """
        name = entry.type.removeprefix("struct:").removesuffix("[]")
        dtype = np.dtype(self._fields(name))
        sizes = {len(payload) for payload in entry.payloads}
        if len(sizes) != 1 or any(size < 1 or size % dtype.itemsize for size in sizes):
            told = ", ".join(map(str, sorted(sizes)[:4])) or "no"
            raise InputError(
                f"{self.path}: values of {entry.name} ({entry.type}, {dtype.itemsize} bytes each)"
                f" have {told} bytes: they must be alike and whole"
            )
        rows = np.frombuffer(b"".join(entry.payloads), dtype).reshape(len(entry.payloads), -1)
        return np.array(entry.t_us, dtype=np.int64), rows

    def _fields(self, name: str, depth: int = 0) -> list[tuple[str, str]]:
        told = self.entries.get(_SCHEMAS + name)
        text = _KNOWN.get(name)
        if told is not None and told.payloads:
            text = told.payloads[-1].decode("utf-8", "replace")
        if text is None or depth > DEEPEST:
            raise InputError(f"{self.path} has no schema of the struct {name}")
        fields: list[tuple[str, str]] = []
        for part in filter(None, (part.strip() for part in text.split(";"))):
            match = _FIELD.fullmatch(part)
            if match is None:
                raise InputError(f"{self.path}: the schema of {name} has {part!r}, not a number")
            if match[1] in _NUMBERS:
                fields.append((match[2], _NUMBERS[match[1]]))
            else:
                inner = self._fields(match[1], depth + 1)
                fields += [(f"{match[2]}.{sub}", form) for sub, form in inner]
        return fields


def is_wpilog(head: bytes) -> bool:
    """Tell whether the first bytes of a file are those of a log."""
    return head.startswith(MAGIC)


def read_wpilog(path: str | Path, types: tuple[str, ...]) -> DataLog:
    """Read the entries of some types, and all schemas.

    Parameters
    ----------
    path : path
        The log.
    types : tuple of str
        Such as ``struct:ChassisSpeeds``; other entries are named, and have no values.

    Raises
    ------
    InputError
        If it cannot be read, or a record is damaged.
    """
    path = Path(path)
    refuse_pipe(path)
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST + 1)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    if len(data) > LARGEST:
        raise InputError(f"{path} is over {LARGEST} bytes, too long to be read as a whole; cut it")
    entries: dict[int, Entry | None] = {}
    named: dict[str, Entry] = {}
    end = 0
    try:
        for at, number, t_us, payload, end in _records(data):  # noqa: B007
            if number == 0:
                _control(payload, entries, named, types)
            elif number not in entries:
                raise InputError(f"it is of entry {number}, which was not announced")
            elif (entry := entries[number]) is not None:
                entry.t_us.append(t_us)
                entry.payloads.append(payload)
    except (InputError, struct.error, UnicodeDecodeError) as error:
        raise InputError(f"{path} is damaged in the record at byte {at}: {error}") from None
    if not end:
        raise InputError(f"{path} is no WPILib log of version 1, or ends within its head")
    return DataLog(path, named, len(data) - end)


def _records(data: bytes) -> Iterator[tuple[int, int, int, bytes, int]]:
    """Yield place, entry, time [us], payload and end of each whole record."""
    if len(data) < 12 or data[7] != 1:
        return
    at = 12 + int.from_bytes(data[8:12], "little")
    while at < len(data):
        widths = data[at]
        a = at + 2 + (widths & 3)
        b = a + 1 + (widths >> 2 & 3)
        c = b + 1 + (widths >> 4 & 7)
        size = int.from_bytes(data[a:b], "little")
        if c + size > len(data):
            return
        number = int.from_bytes(data[at + 1 : a], "little")
        yield at, number, int.from_bytes(data[b:c], "little"), data[c : c + size], c + size
        at = c + size


def _control(
    payload: bytes,
    entries: dict[int, Entry | None],
    named: dict[str, Entry],
    types: tuple[str, ...],
) -> None:
    """Take in the start or the end of an entry; metadata are passed over."""
    kind, number = struct.unpack_from("<BI", payload)
    if kind == 1:
        entries.pop(number, None)
    if kind != 0:
        return
    texts, at = [], 5
    for _ in range(3):
        (size,) = struct.unpack_from("<I", payload, at)
        texts.append(payload[at + 4 : at + 4 + size].decode())
        at += 4 + size
    if at != len(payload):
        raise InputError("the announcement of an entry is damaged")
    name, type = texts[:2]
    entry = named.setdefault(name, Entry(name, type))
    wanted = type in types or name.startswith(_SCHEMAS)
    entries[number] = entry if wanted and entry.type == type else None


def last_known(t_us: Integers, values: Floats, longest: float) -> tuple[Integers, Floats, int]:
    """Return rows in which a value stands as long as no other is written.

    Logs of robots write what changes.  Where nothing was written for more than three usual steps,
    rows of the usual step hold the last values, up to the next row.

    Parameters
    ----------
    t_us : ndarray, shape (n,)
        Times [us], increasing.
    values : ndarray, shape (n, m)
        Values.
    longest : float
        Gaps [s] that are longer stay.

    Returns
    -------
    (t_us, values, int)
        The rows, and how many of them were put in.
    """
    step = np.diff(t_us)
    usual = max(int(np.median(step)), 1)
    gaps = np.flatnonzero((step > 3 * usual) & (step <= longest * 1e6))
    counts = (step[gaps] - 1) // usual
    if not counts.sum():
        return t_us, values, 0
    rows = np.repeat(gaps, counts)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + 1
    t_all = np.concatenate([t_us, t_us[rows] + within * usual])
    order = np.argsort(t_all, kind="stable")
    return t_all[order], np.concatenate([values, values[rows]])[order], int(counts.sum())

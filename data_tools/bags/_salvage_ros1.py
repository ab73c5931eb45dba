"""Read a ROS 1 bag without its index: record by record, as far as the file goes.

A bag (format 2.0) is a row of records, ``length header length data``, the header being fields
``length name=value``.  A recorder that is killed leaves no index at the end; the chunks before
the cut are whole.
"""

from __future__ import annotations

import io
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from data_tools.files.unpack import unpack

_MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7


@dataclass(frozen=True)
class Connection:
    """One publisher of a topic, with the definition of its messages."""

    number: int
    topic: str
    type: str
    definition: str


def is_unindexed(path: Path) -> bool:
    """Tell whether a bag has no index: none was written, or the file ends before it."""
    with path.open("rb") as file:
        file.seek(len(_MAGIC))
        record = _record(file)
    if record is None:
        return True
    (position,) = struct.unpack("<Q", record[0].get(b"index_pos", b"").ljust(8, b"\0")[:8])
    return position == 0 or position >= path.stat().st_size


def connections(path: Path) -> Iterator[Connection]:
    """Yield the connections of the part that can be read."""
    for header, data in _contents(path, Counter()):
        if _op(header) == _CONNECTION:
            yield _connection(header, data)


def messages(path: Path, topic: str, losses: Counter[str]) -> Iterator[bytes]:
    """Yield the serialised messages of a topic; what the cut cost is added to `losses`."""
    numbers = set()
    for header, data in _contents(path, losses):
        if _op(header) == _CONNECTION:
            connection = _connection(header, data)
            if connection.topic == topic:
                numbers.add(connection.number)
        elif _op(header) == _MESSAGE and _number(header) in numbers:
            yield data


def _contents(path: Path, losses: Counter[str]) -> Iterator[tuple[dict[bytes, bytes], bytes]]:
    """Yield the connections and messages, in chunks or not, as far as the file is whole."""
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(len(_MAGIC))
        while True:
            start = file.tell()
            record = _record(file)
            if record is None:
                break
            header, data = record
            if _op(header) == _CHUNK:
                yield from _unpacked(header, data)
            elif _op(header) in (_CONNECTION, _MESSAGE):
                yield header, data
    losses["bytes of a cut-off last record"] += size - start


def _unpacked(
    header: dict[bytes, bytes], data: bytes
) -> Iterator[tuple[dict[bytes, bytes], bytes]]:
    compression = header.get(b"compression", b"none").decode("ascii", "replace")
    stream = io.BytesIO(unpack(data, compression))
    while (record := _record(stream)) is not None:
        yield record


def _record(file: BinaryIO) -> tuple[dict[bytes, bytes], bytes] | None:
    """Return header and data of the next record, or None at the end or at the cut."""
    header = _sized(file)
    data = None if header is None else _sized(file)
    if header is None or data is None:
        return None
    return _fields(header), data


def _fields(header: bytes) -> dict[bytes, bytes]:
    fields, place = {}, 0
    while place + 4 <= len(header):
        (length,) = struct.unpack_from("<I", header, place)
        name, _, value = header[place + 4 : place + 4 + length].partition(b"=")
        fields[name] = value
        place += 4 + length
    return fields


def _sized(file: BinaryIO) -> bytes | None:
    head = file.read(4)
    if len(head) < 4:
        return None
    (length,) = struct.unpack("<I", head)
    place = file.tell()
    if length > file.seek(0, io.SEEK_END) - place:
        return None
    file.seek(place)
    return file.read(length)


def _op(header: dict[bytes, bytes]) -> int:
    return header.get(b"op", b"\0")[0]


def _number(header: dict[bytes, bytes]) -> int:
    return int.from_bytes(header[b"conn"], "little")


def _connection(header: dict[bytes, bytes], data: bytes) -> Connection:
    inner = _fields(data)
    package, _, name = inner[b"type"].decode().rpartition("/")
    return Connection(
        _number(header),
        header[b"topic"].decode(),
        f"{package}/msg/{name}",
        inner[b"message_definition"].decode(),
    )

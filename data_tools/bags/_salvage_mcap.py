"""Read an MCAP file without its end: record by record, as far as the file goes.

A file is a row of records, ``opcode (1 byte), length (8), content``, between two marks.  A
recorder that is killed leaves neither index nor end mark; the records before the cut are whole.
(MCAP specification, version 0.)
"""

from __future__ import annotations

import io
import struct
from binascii import crc32
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from data_tools.bags._salvage_ros1 import Connection
from data_tools.files.unpack import unpack
from evcalib.errors import InputError

_MAGIC = b"\x89MCAP0\r\n"
_END, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 2, 3, 4, 5, 6
_MESSAGE_HEAD = 22
_CHUNK_HEAD = 28
_FOOTER = 20

Record = tuple[int, bytes]


def is_unindexed(path: Path) -> bool:
    """Tell whether the file lacks the mark at its end, or the place of an index before it."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - len(_MAGIC) - _FOOTER))
        footer, mark = file.read(_FOOTER), file.read()
        return mark != _MAGIC or not any(footer[:8])


def connections(path: Path) -> Iterator[Connection]:
    """Yield the channels of the part that can be read."""
    schemas: dict[int, tuple[str, str]] = {}
    for kind, content in _contents(path, Counter()):
        if kind == _SCHEMA:
            number, name, definition = _schema(content)
            schemas[number] = name, definition
        elif kind == _CHANNEL:
            number, schema, topic = _channel(content)
            type, definition = schemas.get(schema, ("", ""))
            yield Connection(number, topic, type, definition)


def messages(path: Path, topic: str, losses: Counter[str]) -> Iterator[bytes]:
    """Yield the serialised messages of a topic; what the cut cost is added to `losses`."""
    numbers = set()
    for kind, content in _contents(path, losses):
        if kind == _CHANNEL:
            number, _, name = _channel(content)
            if name == topic:
                numbers.add(number)
        elif kind == _MESSAGE and struct.unpack_from("<H", content)[0] in numbers:
            yield content[_MESSAGE_HEAD:]


def _contents(path: Path, losses: Counter[str]) -> Iterator[Record]:
    """Yield the records, in chunks or not, as far as the file is whole."""
    with path.open("rb") as file:
        file.seek(len(_MAGIC))
        whole = file.tell()
        while (record := _record(file)) is not None:
            whole = file.tell()
            if record[0] == _END:
                return
            if record[0] == _CHUNK:
                stream = io.BytesIO(_unpacked(record[1]))
                while (inner := _record(stream)) is not None:
                    yield inner
            else:
                yield record
    losses["bytes of a cut-off last record"] += path.stat().st_size - whole


def _record(file: BinaryIO) -> Record | None:
    """Return kind and content of the next record, or None at the end or at the cut."""
    head = file.read(9)
    if len(head) < 9:
        return None
    kind, length = struct.unpack("<BQ", head)
    place = file.tell()
    if length > file.seek(0, io.SEEK_END) - place:
        return None
    file.seek(place)
    return kind, file.read(length)


def _unpacked(content: bytes) -> bytes:
    (size, checksum) = struct.unpack_from("<QI", content, 16)
    compression, place = _string(content, _CHUNK_HEAD)
    data = unpack(content[place + 8 :], compression or "none", size)
    if checksum and crc32(data) != checksum:
        raise InputError("a chunk is damaged: it does not fit its checksum")
    return data


def _schema(content: bytes) -> tuple[int, str, str]:
    (number,) = struct.unpack_from("<H", content)
    name, place = _string(content, 2)
    encoding, place = _string(content, place)
    definition, _ = _string(content, place)
    return number, name, definition if encoding == "ros2msg" else ""


def _channel(content: bytes) -> tuple[int, int, str]:
    number, schema = struct.unpack_from("<HH", content)
    return number, schema, _string(content, 4)[0]


def _string(content: bytes, place: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", content, place)
    end = place + 4 + length
    return content[place + 4 : end].decode(), end

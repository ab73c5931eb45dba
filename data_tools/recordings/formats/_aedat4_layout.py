"""The parts of an AEDAT 4 file: header, packets, and the table of them at the end.

The header, each packet's content and the table are FlatBuffers: a root offset, then tables whose
fields are found through a list of offsets.  Every offset is checked before it is followed.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from data_tools.files.unpack import unpack
from evcalib.arrays import Floats, Integers
from evcalib.errors import InputError

MAGIC = b"#!AER-DAT4.0\r\n"
LARGEST_HEADER = 1 << 24
LARGEST_PACKET = 1 << 28
"""Bytes of a packet, unpacked; an event takes 16."""

_COMPRESSION = {0: "none", 1: "lz4", 2: "lz4", 3: "zstd", 4: "zstd"}
_EVENT = np.dtype(
    {
        "names": ["t", "x", "y", "on"],
        "formats": ["<i8", "<u2", "<u2", "u1"],
        "offsets": [0, 8, 10, 12],
        "itemsize": 16,
    }
)


@dataclass(frozen=True)
class Packet:
    """Where a packet's content stands in the file [bytes], and to which stream it belongs."""

    stream: int
    start: int
    size: int


@dataclass(frozen=True)
class Told:
    """What the table says of a packet: its place, number of elements, first and last time [us]."""

    start: int
    size: int
    count: int
    first_us: int
    last_us: int


@dataclass(frozen=True)
class Layout:
    """A file without its content.

    Attributes
    ----------
    compression : str
        That of all packets, as :func:`data_tools.files.unpack.unpack` names it.
    sensors : dict
        Sensor (width, height) [px] of each stream of events, by its number.
    imus : tuple of int
        Numbers of the streams of IMU samples.
    packets : list of Packet
        All whole packets, in the order of the file.
    told : list of Told or None
        The table, if there is one: one entry for each packet.
    cut_off : int
        Bytes after the last whole packet that belong to another.
    """

    compression: str
    sensors: dict[int, tuple[int, int]]
    imus: tuple[int, ...]
    packets: list[Packet]
    told: list[Told] | None
    cut_off: int


def read_layout(path: Path) -> Layout:
    """Walk over the packets: 8 bytes (stream, size), then so many bytes, up to the table.

    A recorder that was stopped hard leaves no table; the packets then go on to the end.

    Raises
    ------
    InputError
        If the header or a size is damaged, or a packet is of no stream or not in the table.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(len(MAGIC) + 4)
            length = int.from_bytes(head[len(MAGIC) :], "little") if len(head) == 18 else size
            if 18 + length > min(size, LARGEST_HEADER):
                raise InputError(f"{path} ends within its header, or the header is damaged")
            header = file.read(length)
            try:
                compression, table, streams, imus = _header(header)
            except (InputError, struct.error, ValueError, ElementTree.ParseError) as error:
                raise InputError(f"{path} is damaged in its header: {error}") from None
            told = _table(file, table, size, compression) if 18 + length <= table < size else None
            end = size if told is None else table
            packets, at = _walk(file, (18 + length, table, end), set(streams), path)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    if told is not None and not _agree(packets, told):
        raise InputError(f"{path} is damaged: its packets are not those of its table")
    sensors = {number: sensor for number, sensor in streams.items() if sensor is not None}
    cut_off = 0 if at == table else end - at
    return Layout(compression, sensors, imus, packets, told, cut_off)


def read_events(content: bytes) -> NDArray[np.void]:
    """Return the events (t, x, y, on) of a packet's unpacked content.

    Raises
    ------
    InputError
        If it is no packet of events, or shorter than it says.
    """
    try:
        if int.from_bytes(content[:4], "little") != len(content) - 4 or content[8:12] != b"EVTS":
            raise InputError("it holds no packet of events")
        start, count = _vector(content, _fields(content, 4)[0])
        events = np.frombuffer(content, _EVENT, count, start) if count else np.empty(0, _EVENT)
    except (struct.error, ValueError, IndexError) as error:
        raise InputError(f"its events are cut off: {error}") from None
    if events.size and events["on"].max() > 1:
        raise InputError("a polarity is neither 0 nor 1")
    return events


def read_imu(content: bytes) -> tuple[Integers, Floats]:
    """Return times [us] and accelerations [g], rates [deg/s] (n, 6) of a packet of IMU samples.

    Each sample is a table of its own: time, temperature, three accelerations, three rates, and a
    magnetometer.  What a writer leaves out of a table is 0.

    Raises
    ------
    InputError
        If it is no packet of IMU samples, or shorter than it says.
    """
    try:
        if int.from_bytes(content[:4], "little") != len(content) - 4 or content[8:12] != b"IMUS":
            raise InputError("it holds no packet of IMU samples")
        start, count = _vector(content, _fields(content, 4)[0])
        if start + 4 * count > len(content):
            raise InputError("its IMU samples are cut off")
        t, values = np.zeros(count, dtype=np.int64), np.zeros((count, 6))
        for k in range(count):
            time, _, *others = _fields(content, start + 4 * k, 8)
            t[k] = _number(content, time, "<q") if time else 0
            values[k] = [struct.unpack_from("<f", content, at)[0] if at else 0.0 for at in others]
    except (struct.error, ValueError, IndexError) as error:
        raise InputError(f"its IMU samples are cut off: {error}") from None
    return t, values


def _walk(
    file: BinaryIO, bounds: tuple[int, int, int], streams: set[int], path: Path
) -> tuple[list[Packet], int]:
    """Return the packets from the start to the table or the end, and where the last whole ends."""
    packets: list[Packet] = []
    at, table, end = bounds
    while at + 8 <= end and at != table:
        file.seek(at)
        stream, size = struct.unpack("<iI", file.read(8))
        after = at + 8 + size
        if after > end:
            break
        if stream not in streams or size > LARGEST_PACKET:
            what = f"{size} bytes of stream {stream}"
            raise InputError(f"{path} is damaged: packet {len(packets)} has {what}")
        packets.append(Packet(stream, at + 8, size))
        at = after
    return packets, at


def _agree(packets: list[Packet], told: list[Told]) -> bool:
    """Tell whether a table is of these packets; writers count to their content or their start."""
    content = {t.start - p.start for p, t in zip(packets, told, strict=False)}
    sizes = [p.size for p in packets] == [t.size for t in told]
    return sizes and content <= {0, -8} and len(content) < 2


def _header(data: bytes) -> tuple[str, int, dict[int, tuple[int, int] | None], tuple[int, ...]]:
    """Return compression, position of the table, the streams (None: no events), and the IMUs."""
    compression, table, node = _fields(data, 0, 3)
    code = _number(data, compression, "<i") if compression else 0
    if code not in _COMPRESSION:
        raise InputError(f"compression {code} is not known")
    position = _number(data, table, "<q") if table else -1
    start, length = _vector(data, node)
    text = data[start : start + length]
    if len(text) < length:
        raise InputError("the description of its streams is cut off")
    if b"<!" in text:
        raise InputError("the description of its streams has entities or comments")
    streams: dict[int, tuple[int, int] | None] = {}
    imus = []
    for stream in ElementTree.fromstring(text).findall("node[@name='outInfo']/node"):
        number = int(stream.get("name", ""))
        streams[number] = _sensor(stream)
        if stream.findtext("attr[@key='typeIdentifier']") == "IMUS":
            imus.append(number)
    return _COMPRESSION[code], position, streams, tuple(imus)


def _sensor(stream: ElementTree.Element) -> tuple[int, int] | None:
    if stream.findtext("attr[@key='typeIdentifier']") != "EVTS":
        return None
    sides = [stream.findtext(f"node[@name='info']/attr[@key='{key}']") for key in _SIDES]
    if None in sides:
        raise InputError("a stream of events has no size")
    width, height = (int(side) for side in sides if side is not None)
    if not (0 < width <= 1 << 15 and 0 < height <= 1 << 15):
        raise InputError(f"a sensor cannot have {width}x{height} px")
    return width, height


_SIDES = ("sizeX", "sizeY")


def _table(file: BinaryIO, at: int, size: int, compression: str) -> list[Told] | None:
    """Return the table of packets, or None where there is none: its place may be damaged too."""
    file.seek(at)
    try:
        data = unpack(file.read(size - at), compression, LARGEST_PACKET)
        if data[8:12] != b"FTAB":
            return None
        start, count = _vector(data, _fields(data, 4)[0])
        if start + 4 * count > len(data):
            return None
        return [_told(data, start + 4 * k) for k in range(count)]
    except (InputError, struct.error, ValueError, IndexError):
        return None


def _told(data: bytes, at: int) -> Told:
    offset, packet, *others = _fields(data, at, 5)
    count, first, last = (_number(data, field, "<q") if field else 0 for field in others)
    start = _number(data, offset, "<q") if offset else 0
    return Told(start, _number(data, packet + 4, "<i"), count, first, last)


def _fields(data: bytes, at: int, count: int = 1) -> list[int]:
    """Return where the first fields stand of the table to which an offset leads; 0 = left out."""
    table = at + _number(data, at, "<I")
    places = table - _number(data, table, "<i")
    held = max(0, min(count, (_number(data, places, "<H") - 4) // 2))
    found = struct.unpack_from(f"<{held}H", data, places + 4)
    return [table + offset if offset else 0 for offset in found] + [0] * (count - held)


def _vector(data: bytes, at: int) -> tuple[int, int]:
    """Return where the elements stand of the vector to which an offset leads, and how many."""
    if not at:
        return 0, 0
    place = at + _number(data, at, "<I")
    return place + 4, _number(data, place, "<I")


def _number(data: bytes, at: int, form: str) -> int:
    if at < 0:
        raise InputError(f"an offset leads to byte {at}")
    return int(struct.unpack_from(form, data, at)[0])

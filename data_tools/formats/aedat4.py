"""AEDAT 4 (iniVation's DV), read by the library `aedat`.

The library stops with an error at a file that was cut off, so this module first walks over the
headers of packets, which costs next to nothing, and asks for no more packets than are whole.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from data_tools.formats import Columns, Options, Source
from evcalib.errors import InputError

NAMES = ("aedat4",)

_MAGIC = b"#!AER-DAT4.0\r\n"
_LARGEST_HEADER = 1 << 24
_LARGEST_PACKET = 1 << 30


def matches(path: Path, head: bytes) -> bool:
    """Tell whether the file starts with the format's line."""
    return head.startswith(_MAGIC)


def open(path: Path, options: Options) -> Source:
    """Open a file; `options.stream` is the number of the event stream, where it has several."""
    layout = _layout(path)
    streams = {
        number: stream
        for number, stream in _decoder(path).id_to_stream().items()
        if stream["type"] == "events"
    }
    number = _chosen(path, sorted(streams), options)
    declared = (int(streams[number]["width"]), int(streams[number]["height"]))
    width, height = options.sensor(path, declared)

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        if layout.cut_off:
            losses["bytes of a cut-off last packet"] += layout.cut_off
        for packet in _packets(path, layout.packets):
            if packet["stream_id"] == number and "events" in packet:
                events = packet["events"]
                yield Columns(events["x"], events["y"], events["t"].astype(np.int64), events["on"])

    return Source("aedat4", width, height, pieces)


@dataclass(frozen=True)
class _Layout:
    """How many packets of a file are whole, and how many bytes follow them that are not."""

    packets: int
    cut_off: int


def _layout(path: Path) -> _Layout:
    """Walk over the packets: 8 bytes (stream, size), then so many bytes, up to the table of data.

    A recorder that was stopped hard leaves no table; the packets then go on to the end.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(len(_MAGIC) + 4)
            length = struct.unpack_from("<I", head, len(_MAGIC))[0] if len(head) == 18 else size
            if 18 + length > min(size, _LARGEST_HEADER):
                raise InputError(f"{path} ends within its header, or the header is damaged")
            at = 18 + length
            table = _table_position(file.read(length))
            end = table if at <= table <= size else size
            packets = 0
            while at + 8 <= end:
                file.seek(at + 4)
                after = at + 8 + struct.unpack("<I", file.read(4))[0]
                if after > end:
                    break
                if after - at > _LARGEST_PACKET:
                    raise InputError(f"{path} is damaged: packet {packets} has {after - at} bytes")
                at, packets = after, packets + 1
            return _Layout(packets, end - at)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None


def _table_position(header: bytes) -> int:
    """Return the second field of the FlatBuffer that the header is; -1 if it is not there."""
    try:
        root = struct.unpack_from("<I", header)[0]
        fields = root - struct.unpack_from("<i", header, root)[0]
        if fields < 0 or struct.unpack_from("<H", header, fields)[0] < 8:
            return -1
        offset = struct.unpack_from("<H", header, fields + 6)[0]
        return int(struct.unpack_from("<q", header, root + offset)[0]) if offset else -1
    except struct.error:
        return -1


def _chosen(path: Path, numbers: list[int], options: Options) -> int:
    if not numbers:
        raise InputError(f"{path} has no stream of events")
    told = ", ".join(map(str, numbers))
    if options.stream is not None:
        if options.stream not in map(str, numbers):
            raise InputError(f"{path} has no stream of events {options.stream}, only {told}")
        return int(options.stream)
    if len(numbers) > 1:
        raise InputError(f"{path} has several streams of events: say which, stream = one of {told}")
    return numbers[0]


def _library() -> ModuleType:
    try:
        import aedat
    except ImportError:
        raise InputError(
            'AEDAT 4 needs the library aedat: pip install "evcalib[formats]"'
        ) from None
    return aedat


def _decoder(path: Path) -> Any:
    library = _library()
    try:
        return library.Decoder(path)
    except BaseException as error:
        raise _in_words(error, path, "its header") from None


def _packets(path: Path, count: int) -> Iterator[dict[str, Any]]:
    decoder = iter(_decoder(path))
    for number in range(count):
        try:
            packet = next(decoder)
        except StopIteration:
            raise InputError(
                f"{path} is damaged: of its {count} packets only {number} can be read"
            ) from None
        except BaseException as error:
            raise _in_words(error, path, f"packet {number}") from None
        yield packet


def _in_words(error: BaseException, path: Path, where: str) -> BaseException:
    """Return an InputError for damage; a panic of the library is a BaseException of its own kind.

    Anything else, like an interrupt, stays what it is.
    """
    if isinstance(error, Exception) or type(error).__name__ == "PanicException":
        return InputError(f"{path} is damaged in {where}: {error}")
    return error

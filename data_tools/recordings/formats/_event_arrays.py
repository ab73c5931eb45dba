"""Messages that list their events one by one: ``dvs_msgs`` and ``prophesee_event_msgs``.

Both define ``header, height, width, events`` with ``x, y`` (uint16), ``ts`` (time), ``polarity``
(bool) for each event.  Built as Python objects, a million events take two to three seconds; as
arrays over the serialised bytes they take milliseconds.  The layouts are those of ROS 1 (packed)
and of CDR (ROS 2: fields aligned to their size, counted from the end of the 4-byte preamble).
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools.bags import Bag, Topic
from data_tools.recordings.formats import Columns, Size
from evcalib.errors import InputError

TYPES = ("dvs_msgs/msg/EventArray", "prophesee_event_msgs/msg/EventArray")

_EVENT_FIELDS = ("x", "uint16"), ("y", "uint16"), ("ts", "time"), ("polarity", "bool")


def check_layout(bag: Bag, topic: Topic) -> tuple[str, str]:
    """Return the order of height and width, and refuse definitions other than the known ones."""
    array = {name: _kind(node) for name, node in bag.fields(topic).items()}
    package = topic.type.split("/")[0]
    event = {k: _kind(v) for k, v in bag.fields(topic, f"{package}/msg/Event").items()}
    names = list(array)
    sizes_fit = set(names[1:3]) == {"height", "width"} and all(
        array[name] in ("uint32", "int32") for name in names[1:3]
    )
    if (
        tuple(event.items()) != _EVENT_FIELDS
        or not sizes_fit
        or names
        != [
            "header",
            *names[1:3],
            "events",
        ]
    ):
        raise InputError(
            f"{topic.name} is of another {topic.type} than the known one: {array}, events {event}"
        )
    return names[1], names[2]


def read_array(raw: bytes, ros: int, order: tuple[str, str]) -> tuple[Size, Columns]:
    """Return sensor size and events of a message; times are ROS times [us], rounded.

    Raises
    ------
    InputError
        If the message ends before its last event.
    """
    try:
        values, count, start, big = _head(raw, ros)
        sizes = dict(zip(order, values, strict=True))
        columns = _packed(raw, start, count) if ros == 1 else _cdr(raw, start, count, big)
    except (struct.error, ValueError, IndexError) as error:
        raise InputError(f"a message of events is cut off: {error}") from None
    return (sizes["width"], sizes["height"]), columns


def _kind(node: tuple[Any, Any]) -> str:
    """Return the type of a field in a word; lists of what events hold are left to the caller."""
    kind, what = node
    if kind.name == "BASE":
        return str(what[0])
    return {"builtin_interfaces/msg/Time": "time"}.get(what, kind.name.lower())


def _head(raw: bytes, ros: int) -> tuple[tuple[int, int], int, int, bool]:
    """Return the two sizes, the number of events, where they start, and the byte order."""
    if ros == 1:
        (length,) = struct.unpack_from("<I", raw, 12)
        first, second, count = struct.unpack_from("<III", raw, 16 + length)
        return (first, second), count, 28 + length, False
    big = raw[1] in (0, 2)
    sign = ">" if big else "<"
    (length,) = struct.unpack_from(f"{sign}I", raw, 12)
    place = 4 + _aligned(12 + length, 4)
    first, second, count = struct.unpack_from(f"{sign}III", raw, place)
    return (first, second), count, place + 12, big


def _aligned(place: int, size: int) -> int:
    return -(-place // size) * size


def _packed(raw: bytes, start: int, count: int) -> Columns:
    record = np.dtype([("x", "<u2"), ("y", "<u2"), ("s", "<u4"), ("ns", "<u4"), ("p", "u1")])
    return _columns(np.frombuffer(raw, record, count, start))


def _cdr(raw: bytes, start: int, count: int, big: bool) -> Columns:
    """Read aligned events: the first one begins at a multiple of 4, all others 2 bytes after one.

    So each takes 16 bytes, if the first is taken to begin 2 bytes earlier, except that its x and y
    then stand 2 bytes later than those of the others.
    """
    sign = ">" if big else "<"
    record = np.dtype(
        {
            "names": ["x", "y", "s", "ns", "p"],
            "formats": [f"{sign}u2", f"{sign}u2", f"{sign}i4", f"{sign}u4", "u1"],
            "offsets": [0, 2, 6, 10, 14],
            "itemsize": 16,
        }
    )
    if not count:
        return _columns(np.empty(0, record))
    begin = start - 2
    end = begin + 16 * count
    if len(raw) < end - 1:
        raise ValueError(f"{count} events need {end - 1} bytes, not {len(raw)}")
    body = raw[begin:end].ljust(16 * count, b"\0")
    columns = _columns(np.frombuffer(body, record, count))
    columns.x[0], columns.y[0] = struct.unpack_from(f"{sign}HH", raw, start)
    return columns


def _columns(events: NDArray[np.void]) -> Columns:
    micros = (events["ns"].astype(np.int64) + 500) // 1000
    return Columns(
        events["x"].astype(np.uint16),
        events["y"].astype(np.uint16),
        events["s"].astype(np.int64) * 1_000_000 + micros,
        events["p"] != 0,
    )

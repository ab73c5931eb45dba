"""ROS 1 and ROS 2 bags without ROS: topics, raw messages, and what is left of a cut-off bag.

The reading is done by the library ``rosbags`` (extra ``formats``).  A ROS 1 bag or an MCAP file
without an index, as a recorder leaves it that was cut off, is read as far as its last whole record.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

from data_tools.bags import _guard, _salvage_mcap, _salvage_ros1
from evcalib.errors import InputError

MAGIC = {b"#ROSBAG V2.0\n": ".bag", b"\x89MCAP0\r\n": ".mcap", b"SQLite format 3\x00": ".db3"}
"""First bytes of the three kinds of files, and the suffix that each must have."""

_SALVAGE = {".bag": _salvage_ros1, ".mcap": _salvage_mcap}

_EVENT = "uint16 x\nuint16 y\nbuiltin_interfaces/Time ts\nbool polarity\n"
_ARRAY = "std_msgs/Header header\nuint32 height\nuint32 width\nEvent[] events\n"
_PACKET = (
    "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\n"
    "string encoding\nbool is_bigendian\nuint8[] events\n"
)
DEFINITIONS = {
    "dvs_msgs/msg/Event": _EVENT,
    "dvs_msgs/msg/EventArray": _ARRAY,
    "prophesee_event_msgs/msg/Event": _EVENT,
    "prophesee_event_msgs/msg/EventArray": _ARRAY,
    "event_camera_msgs/msg/EventPacket": _PACKET,
    "event_array_msgs/msg/EventArray": _PACKET,
}
"""The message types of event cameras; ROS 2 bags need not define what they hold."""


@dataclass(frozen=True)
class Topic:
    """A topic of a bag.

    Attributes
    ----------
    name : str
        Its name.
    type : str
        Message type, ``package/msg/Type``.
    count : int, optional
        Number of messages, where it is known.
    """

    name: str
    type: str
    count: int | None = None


@dataclass
class Bag:
    """An opened bag, made by `open_bag`.

    Attributes
    ----------
    path : Path
        The file or folder.
    ros : int
        1 or 2: how messages are serialised.
    topics : tuple of Topic
        What it holds.
    losses : Counter
        Reason and count of what could not be read; filled while messages are read.
    """

    path: Path
    ros: int
    topics: tuple[Topic, ...]
    losses: Counter[str]
    _raw: Callable[[str], Iterator[bytes]]
    _definitions: dict[str, str | None]
    _stores: dict[str, Any] = field(default_factory=dict)

    def messages(self, topic: Topic) -> Iterator[bytes]:
        """Yield the messages of a topic as they are serialised, in the order of recording."""
        with _errors(self.path):
            yield from self._raw(topic.name)

    def decode(self, topic: Topic, raw: bytes) -> Any:
        """Return a message as an object with the fields of its definition."""
        store = self._store(topic.type)
        read = store.deserialize_ros1 if self.ros == 1 else store.deserialize_cdr
        with _errors(self.path):
            return read(raw, topic.type)

    def fields(self, topic: Topic, type: str | None = None) -> dict[str, Any]:
        """Return the fields of the topic's message type, or of another that it contains."""
        definitions = self._store(topic.type).fielddefs
        return dict(definitions.get(type or topic.type, ([], []))[1])

    def check_known(self, topic: Topic) -> None:
        """Refuse a topic whose type the bag defines otherwise than `DEFINITIONS`.

        Raises
        ------
        InputError
            If it is another, so that its messages would be taken for what they are not.
        """
        found = self.fields(topic)
        if found != _known_fields(topic.type):
            raise InputError(
                f"{self.path}: {topic.name} is of another {topic.type} than the known one, with"
                f" {', '.join(found)}: is the bag damaged?"
            )

    @contextmanager
    def reading(self, topic: Topic) -> Iterator[None]:
        """Turn what goes wrong with messages that lack fields or hold others into an InputError."""
        try:
            yield
        except InputError:
            raise
        except (AttributeError, TypeError, ValueError, LookupError, OverflowError) as error:
            raise InputError(
                f"{self.path}: a message of {topic.name} is no {topic.type}: {error}"
            ) from None

    def choose(self, types: tuple[str, ...], name: str | None, what: str) -> Topic:
        """Return the topic that is named, or the only one of the given message types."""
        fitting = [topic for topic in self.topics if topic.type in types]
        if name is not None:
            for topic in fitting:
                if topic.name.strip("/") == name.strip("/"):
                    return topic
        if len(fitting) == 1 and name is None:
            return fitting[0]
        if name is None and fitting:
            names = ", ".join(topic.name for topic in fitting)
            raise InputError(f"{self.path} has several topics of {what}: {names}; say which")
        there = ", ".join(f"{topic.name} ({topic.type})" for topic in self.topics) or "nothing"
        asked = f"no topic {name} of {what}" if name else f"no topic of {what}"
        raise InputError(f"{self.path} has {asked}; it holds {there}")

    def _store(self, type: str) -> Any:
        if type not in self._stores:
            with _errors(self.path):
                self._stores[type] = _typestore(type, self._definitions.get(type))
        return self._stores[type]


def is_bag(path: Path, head: bytes) -> bool:
    """Tell whether a file, by its first bytes, or a folder is a bag.

    Parameters
    ----------
    path : Path
        File or folder.
    head : bytes
        First bytes of the file; none of a folder.

    Returns
    -------
    bool
        Whether it is.
    """
    if any(head.startswith(magic) for magic in MAGIC):
        return True
    if head:
        return False
    try:
        with (path / "metadata.yaml").open("rb") as file:
            return b"rosbag2_bagfile_information" in file.read(4096)
    except OSError:
        return False


@contextmanager
def open_bag(path: str | Path) -> Iterator[Bag]:
    """Open a bag for reading.

    Parameters
    ----------
    path : path
        A ROS 1 bag (``.bag``), a ROS 2 bag file (``.mcap``, ``.db3``) or its folder.

    Yields
    ------
    Bag
        Usable until the context ends.

    Raises
    ------
    InputError
        If ``rosbags`` is not installed, or the file is no bag or damaged.
    """
    path = Path(path)
    try:
        import rosbags.interfaces  # noqa: F401
    except ImportError:
        raise InputError('bags need the package rosbags: pip install "evcalib[formats]"') from None
    suffix = _suffix(path)
    ros = 1 if suffix == ".bag" else 2
    salvage = _SALVAGE.get(suffix)
    with ExitStack() as stack:
        with _errors(path):
            if salvage is not None and salvage.is_unindexed(path):
                bag = _salvaged(path, salvage, ros)
            else:
                bag = _indexed(path, ros, stack)
        yield bag


def _indexed(path: Path, ros: int, stack: ExitStack) -> Bag:
    """Open a bag with `rosbags`; the reader is closed with the stack."""
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    _guard.check_files(path)
    reader: Any = Reader1(path) if ros == 1 else Reader2(path)
    reader.open()
    stack.callback(reader.close)
    _guard.bound_chunks(reader)
    connections = list(reader.connections)
    definitions = {
        c.msgtype: c.msgdef.data if c.msgdef.format == MessageDefinitionFormat.MSG else None
        for c in connections
    }
    losses: Counter[str] = Counter()

    def raw(name: str) -> Iterator[bytes]:
        wanted = [c for c in connections if c.topic == name]
        missing = sum(c.msgcount for c in wanted)
        for _, _, data in reader.messages(connections=wanted):
            missing -= 1
            yield data
        if missing > 0:
            losses["messages that the bag counts but does not hold"] = missing

    return Bag(path, ros, _topics(connections), losses, raw, definitions)


def _topics(connections: list[Any]) -> tuple[Topic, ...]:
    counts: Counter[tuple[str, str]] = Counter()
    for connection in connections:
        counts[connection.topic, connection.msgtype] += connection.msgcount
    return tuple(Topic(*key, count) for key, count in counts.items())


def _salvaged(path: Path, salvage: ModuleType, ros: int) -> Bag:
    found = {(c.topic, c.type): c for c in salvage.connections(path)}
    if not found:
        raise InputError(f"{path} is cut off before its first messages; record it again")
    losses: Counter[str] = Counter()
    return Bag(
        path,
        ros,
        tuple(Topic(*key) for key in found),
        losses,
        lambda name: salvage.messages(path, name, losses),
        {c.type: c.definition or None for c in found.values()},
    )


def _suffix(path: Path) -> str:
    """Return the kind of a bag, seen from its content; its name must agree, or `rosbags` balks."""
    if path.is_dir():
        return ""
    try:
        with path.open("rb") as file:
            head = file.read(32)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    for magic, suffix in MAGIC.items():
        if head.startswith(magic):
            if suffix != ".bag" and path.suffix != suffix:
                raise InputError(f"{path} is a ROS 2 bag, whose name must end in {suffix}")
            return suffix
    raise InputError(f"{path} is no ROS 1 bag (version 2.0), nor a ROS 2 bag (mcap, sqlite3)")


def _typestore(type: str, definition: str | None) -> Any:
    """Return a store that knows one type: from the bag's own definition, else from ours."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if definition is not None:
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(definition, type))
        return store
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    return store


@lru_cache
def _known_fields(type: str) -> dict[str, Any]:
    return dict(_typestore(type, None).fielddefs[type][1])


@contextmanager
def _errors(path: Path) -> Iterator[None]:
    """Turn whatever `rosbags` says of a damaged bag into an InputError."""
    try:
        yield
    except InputError as error:
        raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from None
    except PermissionError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except Exception as error:  # a damaged file makes the library fail in ways beyond counting
        why = " ".join(str(error).split())[:500] or type(error).__name__
        raise InputError(
            f"{path} is damaged or cut off: {why}; `rosbag reindex` (ROS 1), `mcap recover` or"
            " sqlite3's .recover (ROS 2) may save a part"
        ) from None

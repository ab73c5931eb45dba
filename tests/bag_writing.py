"""Bags for tests, written by the `rosbags` library: an independent serialiser."""

from pathlib import Path

import numpy as np
import pytest

rosbags = pytest.importorskip("rosbags.typesys", reason="needs the extra formats")

from rosbags.rosbag1 import Writer as Writer1  # noqa: E402
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin  # noqa: E402
from rosbags.rosbag2 import Writer as Writer2  # noqa: E402
from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: E402

EVENT = "uint16 x\nuint16 y\ntime ts\nbool polarity"
ARRAY = "std_msgs/Header header\nuint32 height\nuint32 width\nEvent[] events"
PACKET = """std_msgs/Header header
uint32 height
uint32 width
uint64 seq
uint64 time_base
string encoding
bool is_bigendian
uint8[] events"""

KINDS = ("ros1", "ros1-bz2", "ros1-lz4", "sqlite3", "mcap")
DVS, PROPHESEE = "dvs_msgs/msg/EventArray", "prophesee_event_msgs/msg/EventArray"
PACKETS = "event_camera_msgs/msg/EventPacket"


def typestore(kind: str):
    """Return a store of message types, with those of event cameras."""
    ros1 = kind.startswith("ros1")
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    for package in ("dvs_msgs", "prophesee_event_msgs"):
        event = EVENT if ros1 else EVENT.replace("time ts", "builtin_interfaces/Time ts")
        store.register(get_types_from_msg(event, f"{package}/msg/Event"))
        store.register(get_types_from_msg(ARRAY, f"{package}/msg/EventArray"))
    store.register(get_types_from_msg(PACKET, PACKETS))
    return store


class Maker:
    """Makes messages of one kind of bag."""

    def __init__(self, kind: str) -> None:
        self.kind, self.store = kind, typestore(kind)

    def make(self, type: str, **fields):
        return self.store.types[type](**fields)

    def stamp(self, ns: int):
        sec, nanosec = divmod(int(ns), 1_000_000_000)
        return self.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)

    def header(self, ns: int, frame: str = "cam"):
        seq = {"seq": 7} if self.kind.startswith("ros1") else {}
        return self.make("std_msgs/msg/Header", **seq, stamp=self.stamp(ns), frame_id=frame)

    def imu(self, ns: int, rate, force=(0.0, -9.8, 0.0), frame="camera_imu", absent=False):
        """Return a message of an IMU; `absent`: it says that it measures no rates."""
        vector = "geometry_msgs/msg/Vector3"
        w, a = (self.make(vector, x=x, y=y, z=z) for x, y, z in np.array([rate, force], float))
        covariance = np.zeros(9)
        return self.make(
            "sensor_msgs/msg/Imu",
            header=self.header(ns, frame),
            orientation=self.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=covariance,
            angular_velocity=w,
            angular_velocity_covariance=covariance - (np.arange(9) == 0) * absent,
            linear_acceleration=a,
            linear_acceleration_covariance=covariance,
        )

    def array(self, type: str, events, width: int, height: int, frame: str = "cam"):
        """Return a message of rows (x, y, t in ns, p)."""
        one = type.replace("EventArray", "Event")
        rows = [self.make(one, x=x, y=y, ts=self.stamp(t), polarity=p) for x, y, t, p in events]
        head = self.header(events[0][2] if events else 1, frame)
        return self.make(type, header=head, height=height, width=width, events=rows)

    def packet(self, ns: int, seq: int, encoding: str, data: np.ndarray, **fields):
        return self.make(
            PACKETS,
            header=self.header(ns),
            height=fields.get("height", 480),
            width=fields.get("width", 640),
            seq=seq,
            time_base=fields.get("time_base", 0),
            encoding=encoding,
            is_bigendian=fields.get("is_bigendian", False),
            events=np.frombuffer(data.tobytes(), np.uint8),
        )

    def twist(self, v, yaw_rate):
        vector = "geometry_msgs/msg/Vector3"
        return self.make(
            "geometry_msgs/msg/Twist",
            linear=self.make(vector, x=v[0], y=v[1], z=v[2]),
            angular=self.make(vector, x=0.0, y=0.0, z=yaw_rate),
        )

    def twist_stamped(self, ns, v, yaw_rate):
        return self.make(
            "geometry_msgs/msg/TwistStamped",
            header=self.header(ns, "base_link"),
            twist=self.twist(v, yaw_rate),
        )

    def odometry(self, ns, v, yaw_rate):
        point = self.make("geometry_msgs/msg/Point", x=9.0, y=8.0, z=7.0)
        turn = self.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        pose = self.make("geometry_msgs/msg/Pose", position=point, orientation=turn)
        return self.make(
            "nav_msgs/msg/Odometry",
            header=self.header(ns, "odom"),
            child_frame_id="base_link",
            pose=self.make(
                "geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)
            ),
            twist=self.make(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=self.twist(v, yaw_rate),
                covariance=np.zeros(36),
            ),
        )

    def joints(self, ns, names, position, velocity):
        return self.make(
            "sensor_msgs/msg/JointState",
            header=self.header(ns),
            name=list(names),
            position=np.array(position, dtype=np.float64),
            velocity=np.array(velocity, dtype=np.float64),
            effort=np.zeros(0),
        )

    def write(self, folder: Path, topics, chunk: int | None = None) -> Path:
        """Write a bag of (topic, [(time in ns, message)...]) and return its path."""
        ros1 = self.kind.startswith("ros1")
        path = folder / ("bag.bag" if ros1 else "bag")
        if ros1:
            writer = Writer1(path)
            if "-" in self.kind:
                form = self.kind.split("-")[1].upper()
                writer.set_compression(Writer1.CompressionFormat[form])
            writer.chunk_threshold = chunk or writer.chunk_threshold
        else:
            storage, *packed = self.kind.split("-")
            writer = Writer2(path, version=9, storage_plugin=StoragePlugin[storage.upper()])
            if packed:
                writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        write = self.store.serialize_ros1 if ros1 else self.store.serialize_cdr
        with writer:
            for topic, rows in topics:
                type = rows[0][1].__msgtype__
                connection = writer.add_connection(topic, type, typestore=self.store)
                for t, message in rows:
                    writer.write(connection, int(t), write(message, type))
                    if chunk and "mcap" in self.kind and writer.storage.chunk.bio.tell() > chunk:
                        writer.storage.close_chunk()
        return path

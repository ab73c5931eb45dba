"""Files cut off at many places: the first events and a reported loss, or a clear refusal.

Where the format does not say how much there should be, a cut between two of its records leaves a
whole shorter file, and cannot be seen: lines of text, words of EVT, records of DAT and AEDAT 2,
packets of AEDAT 3 and 4, events of Event Stream, and records of bags without an index.
All other cuts must show.
"""

import struct

import numpy as np
import pytest
from fuzz import seeds
from fuzz.targets import TARGETS, attempt, read_events

EVENTS = [
    *("text", "text-gzip", "text-zip", "csv", "npz", "npy", "mat", "hdf5", "evt2", "evt3", "dat"),
    *("aedat2", "aedat3", "aedat4", "es", "rosbag1", "rosbag2-sqlite3", "rosbag2-mcap"),
]
OTHERS = [name for name in TARGETS if name not in (*EVENTS, "rosbag2-metadata")]
NEVER_READ = ("text-gzip", "text-zip", "npz", "npy", "mat", "hdf5", "rosbag2-sqlite3")
SLOW = {"npz": 80, "hdf5": 25, "rosbag1": 40, "rosbag2-sqlite3": 25, "rosbag2-mcap": 40}
SLOW |= {"bag-joints": 40, "bag-twists": 40, "imu-bag": 40, "imu-hdf5": 25}


def inputs(name):
    if "bag" in name:
        pytest.importorskip("rosbags")
    if name == "aedat4":
        pytest.importorskip("lz4")
    return TARGETS[name].make()


def places(name, content):
    """Return all offsets of the first kilobyte, then some; fewer where a reader takes long."""
    rng = np.random.default_rng(len(content))
    if name in SLOW:
        first = rng.integers(0, min(len(content), 2048), SLOW[name] // 2)
        return sorted({*first.tolist(), *rng.integers(0, len(content), SLOW[name] // 2).tolist()})
    return [*range(min(len(content), 1024)), *range(1024, len(content), 83)]


def ends_of_records(name, content):
    """Return where a cut leaves a whole file: after which bytes a record ends."""
    if name in ("evt2", "evt3", "dat"):
        size = {"evt2": 4, "evt3": 2, "dat": 8}[name]
        ends = content.index(b"% end\n") + 6 if name == "evt3" else content.rindex(b"\n% ") + 3
        start = ends if name == "evt3" else content.index(b"\n", ends) + 1
        return set(range(start + 2 * (name == "dat"), len(content), size))
    if name in ("text", "csv"):  # the polarity is the last value: with it an event is whole
        ends = {at + 1 for at, byte in enumerate(content) if byte == 10}
        return ends | {end - 1 for end in ends}
    if name == "aedat2":
        return set(range(content.index(b"Header\r\n") + 8, len(content), 8))
    if name == "aedat3":
        start = content.index(b"END-HEADER\r\n") + 12
        return set(range(start, len(content), 28 + 8 * 50))
    if name == "es":
        return set(ends_of_bytes(content))
    if name == "aedat4":
        return set(ends_of_packets(content))
    if name in ("rosbag1", "rosbag2-mcap"):
        return set(walked(content, name == "rosbag1"))
    return set()


def ends_of_bytes(content):
    """Yield where an event of Event Stream ends, or a byte between two of them."""
    at, least = 20, 0xFC if content[15] == 2 else 0xFE
    while at < len(content):
        at += 1 if content[at] >= least else 5
        yield at


def walked(content, ros1):
    at = 13 if ros1 else 8
    while at < len(content):
        if ros1:
            (length,) = struct.unpack_from("<I", content, at)
            at += 8 + length + struct.unpack_from("<I", content, at + 4 + length)[0]
        else:
            at += 9 + struct.unpack_from("<Q", content, at + 1)[0]
            if at + 8 >= len(content):
                return
        yield at


def same_start(found, whole):
    return all(np.array_equal(a, b[: a.size]) for a, b in zip(found, whole, strict=True))


@pytest.mark.parametrize("name", EVENTS)
def test_cut_events_are_a_start_with_a_loss_or_refused(tmp_path, name):
    target = TARGETS[name]
    path = tmp_path / f"input{target.suffix}"
    read = 0
    for content in inputs(name):
        path.write_bytes(content)
        whole, _ = target.read(path)
        unseen = ends_of_records(name, content)
        for cut in places(name, content):
            path.write_bytes(content[:cut])
            if (result := attempt(target.read, path)) is None:
                continue
            found, losses = result
            read += 1
            assert same_start(found, whole), cut
            assert found[0].size == whole[0].size or sum(losses.values()) or cut in unseen, cut
    assert name in NEVER_READ or read >= 3


def test_cut_packets_of_aedat4_are_left_out_and_counted(tmp_path, data):
    content = seeds.aedat4(data / "formats" / "davis346.aedat4", 300_000)
    path = tmp_path / "input.aedat4"
    path.write_bytes(content)
    whole, _ = read_events(path)
    rng = np.random.default_rng(5)
    ends = list(ends_of_packets(content))
    read = 0
    for cut in [*range(0, 3126, 40), *rng.integers(3126, len(content), 150).tolist()]:
        path.write_bytes(content[:cut])
        if (result := attempt(read_events, path)) is None:
            continue
        found, losses = result
        read += 1
        assert same_start(found, whole)
        assert sum(losses.values()) == cut - max(end for end in ends if end <= cut)
    assert read > 50


def ends_of_packets(content):
    at = 18 + struct.unpack_from("<I", content, 14)[0]
    yield at
    while at + 8 < len(content):
        at += 8 + struct.unpack_from("<I", content, at + 4)[0]
        yield at


BINARY = ("wpilog",)


@pytest.mark.parametrize("name", OTHERS)
def test_other_cut_files_are_read_in_part_or_refused(tmp_path, name):
    """Numbers are never shortened: a text that ends within one is refused."""
    target = TARGETS[name]
    path = tmp_path / f"input{target.suffix}"
    for content in inputs(name):
        for cut in places(name, content):
            path.write_bytes(content[:cut])
            if attempt(target.read, path) is not None:
                binary = name in BINARY or "bag" in name or name.startswith("imu-aedat")
                assert binary or not content[cut - 1 : cut].isdigit()


@pytest.mark.parametrize(
    ("name", "rows"),
    [
        ("wheel-log", lambda log: np.column_stack([log.t, log.states.speed, log.states.steer])),
        ("velocities", lambda found: np.column_stack([found.t, found.v, found.yaw_rate])),
        ("headings", lambda found: np.column_stack([found.t, found.v, found.weight])),
        ("tum", lambda poses: np.column_stack([poses.t, poses.position])),
    ],
)
def test_cut_tables_are_a_start_of_the_whole(tmp_path, name, rows):
    target = TARGETS[name]
    content = target.make()[0]
    path = tmp_path / f"input{target.suffix}"
    path.write_bytes(content)
    whole = rows(target.read(path))
    for cut in range(1, len(content), 3):
        path.write_bytes(content[:cut])
        if (result := attempt(target.read, path)) is not None:
            found = rows(result)
            np.testing.assert_array_equal(found, whole[: len(found)])

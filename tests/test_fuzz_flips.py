"""Single flipped bits: a clear refusal, or events that keep their contract; noticed by checksums.

What has a checksum (gzip, zip, npz, HDF5's gzip, the chunks of bags in bz2) gives the same events
or is refused.  The others cannot tell a changed number from a true one.  There only the contract
of `fuzz.targets` holds: pixels within the sensor, times ascending; events left out are counted.
In EVT 2, EVT 3, AEDAT 2, AEDAT 3 and Event Stream a flipped type of a word or of a packet adds or
drops events unseen: nothing counts them.
"""

import numpy as np
import pytest
from fuzz import seeds
from fuzz.targets import TARGETS, attempt, read_events

from evcalib.errors import InputError

EVENTS = ("text", "text-gzip", "text-zip", "csv", "npz", "hdf5", "evt2", "evt3", "dat", "aedat4")
EVENTS += ("aedat2", "aedat3", "es", "npy", "mat")
BAGS = ("rosbag1", "rosbag2-sqlite3", "rosbag2-mcap", "rosbag2-metadata")
OTHERS = [name for name in TARGETS if name not in (*EVENTS, *BAGS)]
SLOW = {"npz": 120, "hdf5": 25, "rosbag1": 30, "rosbag2-sqlite3": 15, "rosbag2-mcap": 30}
SLOW |= {"rosbag2-metadata": 30, "bag-joints": 40, "bag-twists": 40, "imu-bag": 40, "imu-hdf5": 25}
CHECKED = ("text-gzip", "text-zip", "npz")
UNCOUNTED = ("evt2", "evt3", "aedat2", "aedat3", "es")


def inputs(name):
    if "bag" in name:
        pytest.importorskip("rosbags")
    if name == "aedat4":
        pytest.importorskip("lz4")
    return TARGETS[name].make()


def flipped(content, count, seed=0, first=4096):
    """Yield the content with one bit changed, at `count` places of the first kilobytes."""
    rng = np.random.default_rng(seed)
    for bit in rng.integers(0, 8 * min(len(content), first), count).tolist():
        changed = bytearray(content)
        changed[bit // 8] ^= 1 << bit % 8
        yield bit, bytes(changed)


@pytest.mark.parametrize("name", [*EVENTS, *BAGS])
def test_events_with_a_flipped_bit(tmp_path, name):
    target = TARGETS[name]
    path = tmp_path / f"input{target.suffix}"
    for number, content in enumerate(inputs(name)):
        path.write_bytes(content)
        whole, _ = target.read(path)
        noticed = 0
        first = len(content) if "bag" in name else 4096
        for bit, changed in flipped(content, SLOW.get(name, 400), number, first):
            path.write_bytes(changed)
            if (result := attempt(target.read, path)) is None:
                noticed += 1
                continue
            found, losses = result
            noticed += bool(losses)
            if name in CHECKED:
                assert all(map(np.array_equal, found, whole)), bit
            if (
                name not in UNCOUNTED
                and b"EventPacket" not in content
                and found[0].size != whole[0].size
            ):
                assert losses, bit
        assert noticed


def test_flipped_bits_of_real_files(tmp_path, data):
    """Cuts of real recordings: 60 places each."""
    for name in ("evt2.raw", "evt3.raw", "gen4.dat"):
        content = (data / "formats" / name).read_bytes()[:20_000]
        for _, changed in flipped(content, 60, first=20_000):
            path = tmp_path / name
            path.write_bytes(changed)
            attempt(read_events, path)


def test_flipped_bits_of_aedat4_never_lose_events_unseen(tmp_path, data):
    whole_file = (data / "formats" / "davis346.aedat4").read_bytes()
    content = seeds.aedat4(data / "formats" / "davis346.aedat4", 20_000)
    path = tmp_path / "input.aedat4"
    path.write_bytes(content)
    whole, _ = read_events(path)
    for bit, changed in flipped(content, 500, first=len(content)):
        path.write_bytes(changed)
        if (result := attempt(read_events, path)) is not None:
            found, losses = result
            assert found[0].size == whole[0].size or losses, bit
    noticed = 0
    for _, changed in flipped(whole_file, 6, seed=1, first=3126):
        path.write_bytes(changed)
        if (result := attempt(read_events, path)) is None:
            noticed += 1
        else:
            assert result[0][0].size == 78_830 or result[1]
    assert noticed


@pytest.mark.parametrize("name", OTHERS)
def test_other_files_with_a_flipped_bit(tmp_path, name):
    target = TARGETS[name]
    path = tmp_path / f"input{target.suffix}"
    refused = 0
    for content in inputs(name):
        for _, changed in flipped(content, SLOW.get(name, 300)):
            path.write_bytes(changed)
            refused += attempt(target.read, path) is None
    assert refused


@pytest.mark.parametrize("name", ["text", "csv", "tum"])
def test_a_line_that_a_flipped_bit_made_a_comment_is_not_lost_unseen(tmp_path, name):
    """A 3 with one bit changed is a #: found when this was written, and events went missing."""
    target = TARGETS[name]
    lines = {
        "text": "1.5 1 2 1\n3.5 1 2 1\n4.5 1 2 1\n",
        "csv": "x,y,t,p\n1,2,1.5,1\n3,2,2.5,1\n5,2,3.5,1\n",
        "tum": "1 0 0 0 0 0 0 1\n3 0 0 0 0 0 0 1\n4 0 0 0 0 0 0 1\n",
    }[name]
    path = tmp_path / f"input{target.suffix}"
    path.write_text(lines.replace("\n3", "\n#"))
    if name == "tum":
        with pytest.raises(InputError, match="line 2: a comment that looks like a damaged row"):
            target.read(path)
        return
    found, losses = read_events(path, size=(64, 48))
    assert found[0].size == 2
    assert losses == {"comments between events": 1}

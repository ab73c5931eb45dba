"""Files that claim or unpack to more than they should, run code, or crash a library: refused.

Bounds of size are lowered here, so that the bombs are small; `grown` sees what memory they took.
"""

import ast
import bz2
import gzip
import sqlite3
import struct
import tracemalloc
import zipfile
import zlib
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest
from fuzz import seeds
from fuzz.targets import JOINTS, TARGETS, TWO_WHEELS, read_events

from data_tools.bags import open_bag
from data_tools.files import text as text_files
from data_tools.files import unpack
from data_tools.logs.cameras import _content as camera_content
from data_tools.logs.series_files import read_paired_rows
from data_tools.logs.velocity_sources import read_body_velocities
from data_tools.recordings.formats import _aedat4_layout, _hdf5_checks
from evcalib.errors import InputError

YAML_READERS = (
    "column-map",
    "kalibr",
    "camera-yaml",
    "vehicle",
    "calibration",
    "kalibr-export",
    "batch-list",
)
LAUGHS = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{b}: &{b} [{','.join(9 * [f'*{a}'])}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)


@contextmanager
def grown(most):
    """Fail if Python and NumPy came to hold more than so many bytes at once."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < most
    finally:
        tracemalloc.stop()


@pytest.fixture
def small_bounds(monkeypatch):
    monkeypatch.setattr(unpack, "HARMLESS", 1 << 20)
    monkeypatch.setattr(unpack, "MOST", 1 << 20)


@pytest.fixture
def write(tmp_path):
    def write(content, suffix):
        path = tmp_path / f"input{suffix}"
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


@pytest.mark.parametrize("name", [*YAML_READERS, "rosbag2-metadata"])
@pytest.mark.parametrize(
    ("text", "message"),
    [
        (LAUGHS, "aliases"),
        ("a: &a {<<: *a}\n", "aliases"),
        ("[" * 200_000, "nested too deeply"),
        ("{a: " * 200_000, "nested too deeply"),
        ("- " * 200_000 + "\n", "nested too deeply"),
        ("a: " + "1:" * 200_000 + "1\n", "digits"),
        ("a: 0x" + "f" * 5000 + "\n", "digits"),
        ("a: !!python/object/apply:os.system [exit]\n", "is not YAML"),
        ("a: !!python/name:os.system\n", "is not YAML"),
        ("? [a, b]\n: c\n", "no word"),
    ],
    ids=lambda value: value[:12] if len(value) < 40 else None,
)
def test_yaml_that_unfolds_crashes_or_runs_code_is_refused(write, name, text, message):
    """PyYAML's C loader, which the list of a batch was read with, crashed at deep nesting."""
    if "bag" in name:
        pytest.importorskip("rosbags")
        mark = "rosbag2_bagfile_information: "
        text = f"{mark}{text}" if text[0] in "[{" else f"{mark}1\n{text}"
        message = "is not YAML" if text.endswith("- \n") else message
    target = TARGETS[name]
    with grown(30e6), pytest.raises(InputError, match=message) as refusal:
        target.read(write(text, target.suffix))
    assert len(str(refusal.value)) < 2000


def test_too_much_yaml_is_refused(write, monkeypatch):
    monkeypatch.setattr(text_files, "LARGEST_YAML", 1000)
    with pytest.raises(InputError, match="is over 1000 bytes"):
        text_files.read_yaml(write("# " + 2000 * "x", ".yaml"))
    monkeypatch.setattr(text_files, "MOST_VALUES", 100)
    with pytest.raises(InputError, match="over 100 values"):
        text_files.read_yaml(write("[" + "1," * 100 + "]", ".yaml"))


def test_no_module_loads_pickles_or_runs_text():
    """By their calls: YAML is loaded in one place, NumPy's archives without pickles."""
    calls = []
    for folder in ("data_tools", "evcalib"):
        for path in sorted((Path(__file__).parents[1] / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Import | ast.ImportFrom):
                    calls += [("import", path.name, alias.name) for alias in node.names]
                if isinstance(node, ast.Call):
                    keywords = {k.arg: ast.unparse(k.value) for k in node.keywords}
                    calls.append((ast.unparse(node.func), path.name, keywords))
    loads = [path for name, path, _ in calls if name.split(".")[0] == "yaml" and "load" in name]
    assert loads == ["text.py"]
    for name, path, what in calls:
        assert name not in ("eval", "exec", "compile", "os.system", "pickle.load", "joblib.load")
        assert name != "import" or what not in ("pickle", "joblib", "dill", "marshal", "shelve")
        if name in ("np.load", "numpy.load", "np.lib.format.read_array"):
            assert what.get("allow_pickle") == "False", path


class Payload:
    ran = False

    def __reduce__(self):
        return setattr, (Payload, "ran", True)


@pytest.mark.parametrize("name", ["x", "best_set", "width"])
def test_pickles_are_never_loaded(tmp_path, name):
    path = tmp_path / "input.npz"
    plain = dict(zip("xytp", seeds.columns(), strict=True)) | {"width": 64, "height": 48}
    np.savez(path, **plain | {name: np.array([Payload()], dtype=object)})
    reader = read_paired_rows if name == "best_set" else read_events
    with pytest.raises(InputError, match="Python objects"):
        reader(path)
    assert not Payload.ran


@pytest.mark.parametrize("suffix", [".txt.gz", ".csv.gz", ".zip"])
@pytest.mark.parametrize("filling", [b"\n", b"#\n", b"1.0 1 1 1\n"])
def test_packed_texts_that_unpack_without_end_are_refused(write, small_bounds, suffix, filling):
    head = b"x,y,t,p\n1,1,0.5,1\n" if "csv" in suffix else b"0.5 1 1 1\n"
    filling = filling.replace(b"1.0 1 1 1", b"1,1,1.0,1") if "csv" in suffix else filling
    text = head + filling * ((4 << 20) // len(filling))
    packed = gzip.compress(text) if "gz" in suffix else seeds.zipped([("events.txt", text)])
    path = write(packed, suffix)
    del text
    with grown(40e6), pytest.raises(InputError, match=r"unpack to|is in no format"):
        read_events(path, size=(64, 48))


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_members_whose_method_has_no_bound_are_refused(write, method):
    path = write(seeds.zipped([("events.txt", seeds.text())], method), ".zip")
    with pytest.raises(InputError, match="only deflate is read"):
        read_events(path, size=(64, 48))
    with pytest.raises(InputError, match="only deflate is read"):
        read_events(write(seeds.npz(method), ".npz"))


def claim(values, shape):
    """Return a .npy file whose header declares another shape than its array has."""
    content = seeds.array(values)
    true = str(np.asarray(values).shape).encode()
    return content.replace(true + b", }" + b" " * (len(shape) - len(true)), shape + b", }")


@pytest.mark.parametrize("shape", [b"(1000000000000,)", b"(-1,)", b"(99999999999999999999,)"])
def test_archives_that_claim_more_than_they_hold_are_refused(write, shape):
    named = dict(zip("xytp", seeds.columns(), strict=True))
    members = [(f"{name}.npy", claim(values, shape)) for name, values in named.items()]
    assert shape in members[0][1]
    with grown(20e6), pytest.raises(InputError, match=r"declares|header"):
        read_events(write(seeds.zipped(members), ".npz"), size=(64, 48))
    rows = claim(np.zeros((3, 8)), shape)
    with grown(20e6), pytest.raises(InputError, match=r"declares|header"):
        read_paired_rows(write(seeds.zipped([("best_set.npy", rows)]), ".npz"))


def test_archives_that_hold_more_than_they_claim_are_refused(write):
    longer = seeds.array(np.zeros(3, np.uint16)) + b"more"
    members = [(f"{name}.npy", longer) for name in "xytp"]
    with pytest.raises(InputError, match="goes on after its declared length"):
        read_events(write(seeds.zipped(members), ".npz"), size=(64, 48))


def hdf5(path, **datasets):
    x, y, t, p = seeds.columns()
    with h5py.File(path, "w") as file:
        group = file.create_group("events")
        for name, values in zip("xytp", (x, y, t, p), strict=True):
            make = datasets.get(name, lambda g, n, v=values: g.create_dataset(n, data=v))
            make(group, name)
    return path


def test_hdf5_that_claims_more_than_it_holds_is_refused(tmp_path):
    def huge(group, name):
        group.create_dataset(name, (10**12,), "u2", chunks=(1 << 20,), compression="gzip")

    path = hdf5(tmp_path / "input.h5", **dict.fromkeys("xytp", huge))
    with grown(20e6), pytest.raises(InputError, match="declares 8000000000000 bytes"):
        read_events(path, size=(64, 48))


@pytest.mark.parametrize("chunks", [None, (64,)])
def test_values_that_were_never_written_to_hdf5_are_no_zeros(tmp_path, chunks):
    def unwritten(group, name):
        group.create_dataset(name, (seeds.COUNT,), "u2", chunks=chunks)

    path = hdf5(tmp_path / "input.h5", x=unwritten)
    with pytest.raises(InputError, match="/events/x lacks values"):
        read_events(path, size=(64, 48))


def test_a_chunk_that_hdf5_lacks_is_noticed(tmp_path):
    def partial(group, name):
        data = group.create_dataset(name, (seeds.COUNT,), "u2", chunks=(50,))
        data[:200] = 1
        data[250:] = 1

    path = hdf5(tmp_path / "input.h5", y=partial)
    with pytest.raises(InputError, match="of its 6 chunks 5 are sound"):
        read_events(path, size=(64, 48))


def test_hdf5_chunks_that_unpack_to_more_than_a_chunk_are_refused(tmp_path):
    def bomb(group, name):
        data = group.create_dataset(name, (seeds.COUNT,), "u2", chunks=(300,), compression="gzip")
        data.id.write_direct_chunk((0,), zlib.compress(bytes(20 << 20)))

    path = hdf5(tmp_path / "input.h5", x=bomb)
    with pytest.raises(InputError, match="of its 1 chunks 0 are sound"):
        read_events(path, size=(64, 48))


def test_large_hdf5_chunks_and_rows_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(_hdf5_checks, "MAX_CHUNK_ROWS", 100)

    def chunked(group, name):
        group.create_dataset(name, data=np.zeros(seeds.COUNT, "u2"), chunks=(seeds.COUNT,))

    with pytest.raises(InputError, match="is in chunks of 600 bytes"):
        read_events(hdf5(tmp_path / "input.h5", x=chunked), size=(64, 48))


def test_hdf5_that_leads_to_other_files_or_objects_is_refused(tmp_path):
    """A link to another file is not followed, and a view of one gives zeros where it is gone."""
    secret = hdf5(tmp_path / "other.h5")
    with h5py.File(tmp_path / "input.h5", "w") as file:
        file["events"] = h5py.ExternalLink(secret, "/events")
    with pytest.raises(InputError, match="no such events: none"):
        read_events(tmp_path / "input.h5", size=(64, 48))
    with h5py.File(tmp_path / "input.h5", "w") as file:
        for name in "xytp":
            file[f"events/{name}"] = h5py.ExternalLink(secret, f"/events/{name}")
    with pytest.raises(InputError, match="no such events: none"):
        read_events(tmp_path / "input.h5", size=(64, 48))

    def view(group, name):
        layout = h5py.VirtualLayout((seeds.COUNT,), "u2")
        layout[:] = h5py.VirtualSource(secret, "events/x", shape=(seeds.COUNT,))
        group.create_virtual_dataset(name, layout)

    def elsewhere(group, name):
        (tmp_path / "raw").write_bytes(bytes(2 * seeds.COUNT))
        place = [(str(tmp_path / "raw"), 0, 2 * seeds.COUNT)]
        group.create_dataset(name, (seeds.COUNT,), "u2", external=place)

    def references(group, name):
        group.create_dataset(name, data=[group.ref] * seeds.COUNT, dtype=h5py.ref_dtype)

    def texts(group, name):
        group.create_dataset(name, data=["1"] * seeds.COUNT, dtype=h5py.string_dtype())

    cases = (view, "other files"), (elsewhere, "other files"), (references, "must hold numbers")
    for make, message in (*cases, (texts, "must hold numbers")):
        path = hdf5(tmp_path / "input.h5", x=make)
        with pytest.raises(InputError, match=message):
            read_events(path, size=(64, 48))


@pytest.mark.parametrize("kind", ["lz4", "zstd"])
def test_packets_of_aedat4_that_unpack_without_end_are_refused(write, monkeypatch, kind):
    pytest.importorskip("lz4")
    monkeypatch.setattr(_aedat4_layout, "LARGEST_PACKET", 1 << 17)
    monkeypatch.setattr("data_tools.recordings.formats.aedat4.LARGEST_PACKET", 1 << 17)
    pack = None if kind == "lz4" else pytest.importorskip("backports.zstd").compress
    content = seeds.aedat4_made(
        pack, 1 if kind == "lz4" else 3, change=lambda c: c + bytes(1 << 24)
    )
    path = write(content, ".aedat4")
    with grown(40e6), pytest.raises(InputError, match=r"packet 0: .* unpack to more than 131072"):
        read_events(path)


def test_packets_of_aedat4_must_be_as_its_table_says(write):
    pytest.importorskip("lz4")
    fewer = seeds.aedat4_made(change=lambda c: c.replace(struct.pack("<I", 50), b"\x31\0\0\0", 1))
    with pytest.raises(InputError, match="holds 49 events, not 50 as the table says"):
        read_events(write(fewer, ".aedat4"))
    many = seeds.aedat4_made(
        change=lambda c: c.replace(struct.pack("<I", 50), b"\xff\xff\xff\x7f", 1)
    )
    with grown(20e6), pytest.raises(InputError, match="its events are cut off"):
        read_events(write(many, ".aedat4"))


@pytest.mark.parametrize("kind", ["ros1-bz2", "ros1-lz4"])
@pytest.mark.parametrize("indexed", [True, False])
def test_chunks_of_bags_that_unpack_without_end_are_refused(tmp_path, small_bounds, kind, indexed):
    pytest.importorskip("rosbags")
    from bag_writing import Maker

    make = Maker(kind)
    row = make.packet(seeds.START_NS, 0, "evt3", np.zeros(4 << 20, np.uint8))
    path = make.write(tmp_path, [("/events", [(seeds.START_NS, row)])])
    if not indexed:
        path.write_bytes(path.read_bytes()[:-600])
    with pytest.raises(InputError, match="unpack to more than 1048576 bytes"):
        read_events(path)


def test_pieces_are_unpacked_to_their_bound_only():
    zeros = bytes(1 << 22)
    packed = {"bz2": bz2.compress(zeros), "lz4": pytest.importorskip("lz4.frame").compress(zeros)}
    packed["zstd"] = pytest.importorskip("backports.zstd").compress(zeros)
    assert unpack.zstd_size(packed["zstd"][:18]) == 1 << 22
    assert unpack.zstd_size(b"other") is None
    for kind, data in packed.items():
        assert unpack.unpack(data, kind) == zeros
        for spoiled, message in (
            (data[:-2], "cut off|damaged"),
            (data + b"x", "damaged or cut off"),
            (b"x" + data, "damaged"),
        ):
            with pytest.raises(InputError, match=message):
                unpack.unpack(spoiled, kind)
        with grown(3e6), pytest.raises(InputError, match="more than 1000000 bytes"):
            unpack.unpack(data, kind, 1_000_000)
    with pytest.raises(InputError, match="not known"):
        unpack.unpack(b"", "rar")


def test_sizes_that_bags_claim_are_not_allocated(tmp_path, write):
    """Without an index a bag is read record by record; a record cannot be larger than the file."""
    pytest.importorskip("rosbags")
    for kind, suffix, at in (("ros1", ".bag", 4110), ("mcap", ".mcap", 9)):
        content = bytearray(seeds.bag(kind))
        content = content[: len(content) - 300]
        content[at : at + 4] = b"\xff\xff\xff\x7f"
        with grown(20e6), pytest.raises(InputError):
            read_events(write(bytes(content), suffix))


def test_messages_that_a_bag_counts_but_lacks_are_a_loss(tmp_path):
    pytest.importorskip("rosbags")
    path = tmp_path / "input.db3"
    path.write_bytes(seeds.bag("sqlite3"))
    whole, _ = read_events(path)
    metadata, name, database = seeds.bag_folder()
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_bytes(
        metadata.replace(b"message_count: 1", b"message_count: 3")
    )
    (tmp_path / "bag" / name).write_bytes(database)
    found, losses = read_events(tmp_path / "bag")
    assert found[0].size == 20
    assert losses == {"messages that the bag counts but does not hold": 2}
    with sqlite3.connect(tmp_path / "bag" / name) as changed:
        changed.execute("DELETE FROM messages")
    with pytest.raises(InputError, match=r"holds no events|holds no messages"):
        read_events(tmp_path / "bag")


def test_a_database_whose_messages_are_an_endless_query_is_refused(tmp_path):
    pytest.importorskip("rosbags")
    path = tmp_path / "input.db3"
    path.write_bytes(seeds.bag("sqlite3"))
    with sqlite3.connect(path) as database:
        database.execute("ALTER TABLE messages RENAME TO old")
        database.execute(
            "CREATE VIEW messages AS WITH RECURSIVE n(k) AS"
            " (SELECT 1 UNION ALL SELECT k + 1 FROM n)"
            " SELECT k AS id, 1 AS topic_id, k AS timestamp, x'00' AS data FROM n"
        )
    database.close()
    with pytest.raises(InputError, match="holds more than tables: index, table, view"):
        read_events(path)


def test_a_definition_cannot_make_a_message_another(write):
    """Found by flips: messages without the fields of their type gave an AttributeError."""
    pytest.importorskip("rosbags")
    content = seeds.bag("ros1", "event_camera_msgs/msg/EventPacket")
    for old, new in ((b"uint8[] events", b"uint8[] evenus"), (b"uint64 seq", b"uint32 seq")):
        with pytest.raises(InputError, match="than the known one"):
            read_events(write(content.replace(old, new), ".bag"))
    joints = seeds.motion_bag("ros1", joints=True).replace(b"string[] name", b"string[] namf")
    path = write(joints, ".bag")
    with pytest.raises(InputError, match="is no sensor_msgs/msg/JointState"):
        read_body_velocities(path, vehicle=TWO_WHEELS, columns=JOINTS, wheel_radius=0.1)
    with open_bag(path) as bag:
        assert [topic.name for topic in bag.topics] == ["/motion"]


@pytest.mark.parametrize("text", ["<a>" * 200_000, "<a>" + "<b>1</b>" * 600_000 + "</a>"])
def test_xml_that_is_nested_or_long_without_end_is_refused(write, monkeypatch, text):
    monkeypatch.setattr(camera_content, "LARGEST", 1 << 24)
    with grown(60e6), pytest.raises(InputError, match=r"nested too deeply|given twice"):
        TARGETS["camera-xml"].read(write(text, ".xml"))


def test_entities_of_xml_are_not_read(write):
    laughs = "".join(f'<!ENTITY {b} "{9 * f"&{a};"}">' for a, b in zip("abcd", "bcde", strict=True))
    text = f'<!DOCTYPE x [<!ENTITY a "ha">{laughs}]><x><image_width>&e;</image_width></x>'
    with pytest.raises(InputError, match="document type"):
        TARGETS["camera-xml"].read(write(text, ".xml"))

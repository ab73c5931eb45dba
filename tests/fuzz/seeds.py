"""Small files of every kind that a reader reads, as bytes: what is cut, flipped and mutated."""

import gzip
import io
import struct
import zipfile
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import naive_formats as naive
import numpy as np
import yaml
from wpilog_writing import doubles, log

WIDTH, HEIGHT = 64, 48
COUNT = 300
START_NS = 1_675_956_550_123_456_789


def columns(count=COUNT, seed=0):
    """Return x, y, t [us], p of events that ascend in time, some at the same one."""
    rng = np.random.default_rng(seed)
    t = 5_000_000 + np.cumsum(rng.integers(0, 40, count))
    x, y = rng.integers(0, WIDTH, count), rng.integers(0, HEIGHT, count)
    return x.astype(np.uint16), y.astype(np.uint16), t, rng.integers(0, 2, count).astype(np.uint8)


def rows(count=COUNT, seed=0):
    """Return the events as tuples (t, x, y, p)."""
    x, y, t, p = columns(count, seed)
    return list(zip(t.tolist(), x.tolist(), y.tolist(), p.tolist(), strict=True))


def text(count=COUNT, seed=0):
    lines = [f"{t / 1e6:.6f} {x} {y} {p}\n" for t, x, y, p in rows(count, seed)]
    return "".join(lines).encode()


def text_gzip(count=COUNT):
    return gzip.compress(text(count), mtime=0)


def zipped(members, method=zipfile.ZIP_DEFLATED):
    """Return a zip of (name, content), without the times of day."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", method) as archive:
        for name, content in members:
            archive.writestr(zipfile.ZipInfo(name), content, method)
    return packed.getvalue()


def text_zip(count=COUNT):
    return zipped([("run/calib.txt", b"1 2 3 4\n"), ("run/events.txt", text(count))])


def csv(count=COUNT):
    head = f"# evcalib-events width={WIDTH} height={HEIGHT} time_unit=us\nx,y,t,p\n"
    return (head + "".join(f"{x},{y},{t},{p}\n" for t, x, y, p in rows(count))).encode()


def array(values):
    """Return an array as the bytes of a .npy file."""
    held = io.BytesIO()
    np.lib.format.write_array(held, np.asarray(values), allow_pickle=False)
    return held.getvalue()


def npz(method=zipfile.ZIP_DEFLATED):
    named = dict(zip("xytp", columns(), strict=True)) | {"width": WIDTH, "height": HEIGHT}
    return zipped([(f"{name}.npy", array(values)) for name, values in named.items()], method)


def npy(kind="structured"):
    """Return a .npy file: structured, or n x 4 numbers by rows, by columns, or transposed."""
    x, y, t, p = columns()
    if kind == "structured":
        table = np.zeros(x.size, [("ts", "<i8"), ("xs", "<u2"), ("ys", "<u2"), ("ps", "?")])
        table["xs"], table["ys"], table["ts"], table["ps"] = x, y, t, p
    else:
        table = np.column_stack([t, x, y, p]).astype(np.int64)
        table = np.asfortranarray(table) if kind == "columns" else table
        table = np.ascontiguousarray(table.T) if kind == "transposed" else table
    return array(table)


def mat(kind="fields", packed=True):
    """Return a .mat file of version 5: a struct, variables, or n x 4 numbers."""
    from scipy.io import savemat

    x, y, t, p = columns()
    named = {"x": x, "y": y, "ts": t, "p": p}
    table = {"rows": np.column_stack([x, y, p, t]).astype(float), "note": "by hand"}
    held = io.BytesIO()
    what = {"fields": {"TD": named}, "variables": named, "table": table}[kind]
    savemat(held, what, do_compression=packed)
    content = held.getvalue()
    return content.replace(content[:116], b"MATLAB 5.0 MAT-file, made by hand".ljust(116), 1)


def authors_npz():
    rng = np.random.default_rng(3)
    t = 100.0 + 0.05 * np.arange(40)
    angle = 0.02 * np.arange(40)
    v_o = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    v_e = np.stack([-np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    table = np.column_stack([v_e, t + rng.uniform(-0.004, 0.004, 40), v_o, t])
    return zipped([("best_set.npy", array(table))], zipfile.ZIP_STORED)


def hdf5(layout, **filters):
    """Return an HDF5 file of one of the four layouts, in chunks of 64 events."""
    x, y, t, p = columns()
    filters = filters or {"compression": "gzip", "shuffle": True}
    held = io.BytesIO()
    block = {"userblock_size": 512} if layout.startswith("matlab") else {}
    with h5py.File(held, "w", **block) as file:
        if layout in ("table", "matlab-table"):
            table = np.column_stack([t, x, y, p])
            table = table.T if layout == "matlab-table" else table
            chunks = (64, 4) if layout == "table" else (4, 64)
            file.create_dataset("data", data=table, chunks=chunks, **filters)
        elif layout == "matlab":
            for name, values in zip(("x", "y", "ts", "p"), (x, y, t, p), strict=True):
                file.create_dataset(f"TD/{name}", data=values[None], chunks=(1, 64), **filters)
        elif layout == "e2vid":
            for name, values in zip(("xs", "ys", "ts", "ps"), (x, y, t, p), strict=True):
                file.create_dataset(f"events/{name}", data=values, chunks=(64,), **filters)
        elif layout == "mvsec":
            table = np.column_stack([x, y, t / 1e6, 2.0 * p - 1])
            file.create_dataset("davis/left/events", data=table, chunks=(64, 4), **filters)
        elif layout == "prophesee-hdf5":
            kind = np.dtype([("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
            table = np.zeros(x.size, kind)
            table["x"], table["y"], table["p"], table["t"] = x, y, p, t
            file.create_dataset("CD/events", data=table, chunks=(64,), **filters)
            file.attrs["geometry"] = f"{WIDTH}x{HEIGHT}"
        else:
            group = file.create_group("events")
            for name, values in zip("xytp", (x, y, t, p), strict=True):
                group.create_dataset(name, data=values, chunks=(64,), **filters)
            if layout == "evcalib":
                told = {"format": "evcalib-events", "version": 1, "width": WIDTH, "height": HEIGHT}
                group.attrs.update(told | {"time_unit": "us", "origin_us": 0, "count": x.size})
            else:
                file["t_offset"] = 7_000_000
    return held.getvalue()


def evt2():
    return naive.HEADER_EVT2.replace(b"640x480", b"64x48") + naive.evt2_words(rows())


def evt3():
    return b"% evt 3.0\n% format EVT3;height=48;width=64\n% end\n" + naive.evt3_words(rows())


def dat():
    return b"% Version 2\n% Width 64\n% Height 48\n" + naive.dat_records(rows())


def aedat2(chip="eu.seebetter.ini.chips.davis.DAVIS240C", size=(240, 180), extra=True):
    """Return AEDAT 2.0: among the events a sample of a frame, one of the IMU and a trigger."""
    head = "#!AER-DAT2.0\r\n# This is a raw AE data file - do not edit\r\n"
    head += f"# AEChip: {chip}\r\n#End Of ASCII Header\r\n" if chip else ""
    words = []
    for t, x, y, p in rows():
        x, y = size[0] - 1 - x, size[1] - 1 - y
        words += [
            x << 1 | y << 8 | (1 - p) if size == (128, 128) else y << 22 | x << 12 | p << 11,
            t,
        ]
    others = [0x8000] if size == (128, 128) else [0x80C01005, 0x90C01800, 0x00C01400]
    for k, address in enumerate(others if extra else ()):
        words[20 * k + 2 : 20 * k + 2] = [address, words[20 * k + 1]]
    return head.encode() + struct.pack(f">{len(words)}I", *words)


def aedat3(step=50, sources=("DVS128",), kinds=(1,)):
    """Return AEDAT 3.1, in packets of some events, those of each kind in turn."""
    named = "".join(f"#Source {k}: {name}\r\n" for k, name in enumerate(sources))
    head = f"#!AER-DAT3.1\r\n#Format: RAW\r\n{named}#-Source 7: DAVIS640\r\n#!END-HEADER\r\n"
    packets = b""
    for first in range(0, COUNT, step):
        part = rows()[first : first + step]
        for source, kind in enumerate(kinds):
            count = len(part)
            packets += struct.pack("<hhiiiiii", kind, source, 8, 4, 0, count, count, count)
            packets += b"".join(
                struct.pack("<Ii", 1 | p << 1 | y << 2 | x << 17, t) for t, x, y, p in part
            )
    return head.encode() + packets


def es(kind=1, version=2):
    """Return an Event Stream file of a DVS (1) or an ATIS (2), with a reset before each tenth."""
    full, bits = (63, 2) if kind == 2 else (127, 1)
    content, now = b"", 5_000_000 - 200
    for k, (t, x, y, p) in enumerate(rows()):
        now = t - 200 if not k else now
        content += b"\xfc" * 5 if kind == 2 and k % 10 == 9 else b"\xfe" * 5 * (k % 10 == 9)
        loops, rest = divmod(t - now, full)
        content += (b"\xfd" if kind == 2 else b"\xff") * loops
        content += struct.pack("<BHH", rest << bits | p << (bits - 1), x, y)
        now = t
    return (
        b"Event Stream" + bytes([version, 0, 0, kind]) + struct.pack("<HH", WIDTH, HEIGHT) + content
    )


def bag(kind, type="dvs_msgs/msg/EventArray", chunk=2000):
    """Return the one file of a bag of events; `kind` is one of `bag_writing.KINDS`."""
    from bag_writing import Maker

    make = Maker(kind)
    stamped = [
        [(x, y, START_NS + 1000 * t, bool(p)) for t, x, y, p in rows()[k : k + 50]]
        for k in range(0, COUNT, 50)
    ]
    if type.endswith("EventArray"):
        messages = [(part[0][2], make.array(type, part, WIDTH, HEIGHT)) for part in stamped]
    else:
        messages = _packets(make)
    return _bag_file(make, "/events", messages, chunk)


def _packets(make):
    size = {"width": WIDTH, "height": HEIGHT}
    messages = []
    for number in range(6):
        part = rows()[50 * number : 50 * number + 50]
        words = np.frombuffer(naive.evt3_words(part), np.uint16)
        at = START_NS + 1000 * part[-1][0] + 700_000
        messages.append((at, make.packet(at, number, "evt3", words, **size)))
    return messages


def motion_bag(kind, joints=False):
    """Return the one file of a bag of twists or joints."""
    from bag_writing import Maker

    make = Maker(kind)
    stamps = START_NS + 20_000_000 * np.arange(30)
    if joints:
        messages = [
            (t, make.joints(int(t), ("a", "b"), (0.1, 0.2), (1.0, 2.0))) for t in stamps.tolist()
        ]
    else:
        messages = [(t, make.twist_stamped(t, (1.0, 0.1, 0.0), 0.2)) for t in stamps.tolist()]
    return _bag_file(make, "/motion", messages, 500)


def _imu_rows():
    rng = np.random.default_rng(3)
    return 2000 * np.arange(40), rng.integers(-300, 300, (40, 3)), rng.integers(-9, 9, (40, 3))


def imu_aedat2():
    """Return AEDAT 2.0 of a DAVIS: nothing but samples of its IMU."""
    head = b"#!AER-DAT2.0\r\n# AEChip: a.DAVIS240C\r\n#End Of ASCII Header\r\n"
    words = []
    for t, rate, force in zip(*_imu_rows(), strict=True):
        for code, value in enumerate((*force, 4096, *rate)):
            words += [1 << 31 | code << 28 | (int(value) & 0xFFFF) << 12 | 3 << 10, int(t)]
    return head + struct.pack(f">{len(words)}I", *words)


def imu_aedat3():
    """Return AEDAT 3.1 whose first packet of four holds events, and the others IMU samples."""
    parts, (t, rate, force) = aedat3(step=COUNT), _imu_rows()
    for first in range(0, 40, 10):
        parts += struct.pack("<hhiiiiii", 3, 0, 36, 4, 0, 10, 10, 10)
        parts += b"".join(
            struct.pack("<Ii7f", 1, t[k], *force[k], *rate[k], 20.0)
            for k in range(first, first + 10)
        )
    return parts


def imu_hdf5(mvsec=False):
    """Return HDF5 with an IMU as M3ED has it, or MVSEC."""
    (t, rate, force), held = _imu_rows(), io.BytesIO()
    with h5py.File(held, "w", libver="earliest") as file:
        if mvsec:
            file["davis/left/imu"] = np.hstack([force, rate / 100])
            file["davis/left/imu_ts"] = t / 1e6
        else:
            file["ovc/imu/ts"], file["ovc/imu/omega"], file["ovc/imu/accel"] = t, rate / 100, force
    return held.getvalue()


def imu_bag():
    """Return a bag of an IMU."""
    from bag_writing import Maker

    make, (t, rate, force) = Maker("ros1"), _imu_rows()
    stamps = START_NS + 1000 * t
    messages = [
        (s, make.imu(s, w / 100, a)) for s, w, a in zip(stamps.tolist(), rate, force, strict=True)
    ]
    return _bag_file(make, "/imu", messages, 500)


def _bag_file(make, topic, messages, chunk):
    with TemporaryDirectory() as folder:
        path = make.write(Path(folder), [(topic, messages)], chunk)
        if path.is_dir():
            (path,) = (one for one in path.iterdir() if one.suffix != ".yaml")
        return path.read_bytes()


@lru_cache
def bag_folder():
    """Return metadata.yaml and the database of a ROS 2 bag."""
    from bag_writing import Maker

    make = Maker("sqlite3")
    part = [(x, y, START_NS + 1000 * t, bool(p)) for t, x, y, p in rows(20)]
    message = make.array("dvs_msgs/msg/EventArray", part, WIDTH, HEIGHT)
    with TemporaryDirectory() as folder:
        path = make.write(Path(folder), [("/events", [(START_NS, message)])])
        (database,) = path.glob("*.db3")
        return (path / "metadata.yaml").read_bytes(), database.name, database.read_bytes()


def aedat4(recording, most=60_000):
    """Return the first packets of a real AEDAT 4 file, whole ones only."""
    whole = Path(recording).read_bytes()
    at = 18 + int.from_bytes(whole[14:18], "little")
    while at + 8 + (size := int.from_bytes(whole[at + 4 : at + 8], "little")) <= most:
        at += 8 + size
    return whole[:at]


def aedat4_made(pack=None, code=1, step=50, table=True, change=lambda content: content):
    """Return an AEDAT 4 file of all events; `change` spoils the unpacked content of packets."""
    if pack is None:
        from lz4.frame import compress as pack
    xml = (
        '<dv><node name="outInfo"><node name="0"><attr key="typeIdentifier">EVTS</attr>'
        f'<node name="info"><attr key="sizeX">{WIDTH}</attr><attr key="sizeY">{HEIGHT}</attr>'
        "</node></node></node></dv>"
    ).encode()
    start = 18 + 40 + len(xml)
    packets, told = b"", []
    for first in range(0, COUNT, step):
        part = rows()[first : first + step]
        content = pack(change(_aedat4_events(part)))
        place = (start + len(packets) + 8, 0, len(content), len(part), part[0][0], part[-1][0])
        told.append(struct.pack("<iqiiqqq", 16, *place))
        packets += struct.pack("<II", 0, len(content)) + content
    header = struct.pack(
        "<I5H2xiiqII", 16, 10, 20, 4, 8, 16, 12, code, start + len(packets), 4, len(xml)
    )
    end = pack(_aedat4_table(told)) if table else b""
    head = b"#!AER-DAT4.0\r\n" + struct.pack("<I", len(header) + len(xml))
    return head + header + xml + packets + end


def _aedat4_events(part):
    body = b"".join(struct.pack("<qHHB3x", t, x, y, p) for t, x, y, p in part)
    packet = struct.pack("<I4s3H2xiII", 16, b"EVTS", 6, 8, 4, 8, 4, len(part)) + body
    return struct.pack("<I", len(packet)) + packet


def _aedat4_table(told):
    """Return a table whose entries each stand behind their own list of offsets, of 16 bytes."""
    count, fields = len(told), struct.pack("<7H2x", 14, 44, 4, 12, 20, 28, 36)
    offsets = [4 * (count - k) + 60 * k + 16 for k in range(count)]
    vector = struct.pack("<I", count) + struct.pack(f"<{count}I", *offsets)
    body = b"".join(fields + entry for entry in told)
    packet = struct.pack("<I4s3H2xiI", 16, b"FTAB", 6, 8, 4, 8, 4) + vector + body
    return struct.pack("<I", len(packet)) + packet


def table(header, count=30, step=0.02):
    """Return a CSV of times and a few numbers with many digits."""
    rng = np.random.default_rng(4)
    names = header.split(",")
    lines = [header]
    for k in range(count):
        values = [repr(100 + step * k), *map(repr, rng.uniform(0.1, 1.0, len(names) - 1).tolist())]
        lines.append(",".join(values))
    return ("\n".join(lines) + "\n").encode()


def headings():
    lines = ["t,vx,vy,vz,t_start,t_end,weight,sd_deg,inliers,valid"]
    for k in range(30):
        t, angle = 10 + 0.05 * k, 0.03 * k
        x, z = np.sin(angle).item(), np.cos(angle).item()
        lines.append(f"{t!r},{x!r},0.0,{z!r},{t - 0.2!r},{t + 0.2!r},{0.5 + k / 60!r},1.25,40,1")
    return ("\n".join(lines) + "\n").encode()


def tum(count=30):
    lines = ["# t x y z qx qy qz qw"]
    for k in range(count):
        half = 0.01 * k
        turn = f"0.0 0.0 {np.sin(half).item()!r} {np.cos(half).item()!r}"
        lines.append(f"{5 + 0.1 * k!r} {0.05 * k!r} 0.0 1.5 {turn}")
    return ("\n".join(lines) + "\n").encode()


CALIB_TXT = b"199.0923 198.8284 32.1925 24.5083 -0.3684 0.1504 -0.0003 -0.0003 0.0125\n"

CAMCHAIN = b"""cam0:
  cam_overlaps: []
  camera_model: pinhole
  distortion_coeffs: [-0.048031, 0.011330, -0.055378, 0.021500]
  distortion_model: equidistant
  intrinsics: [199.6534, 199.6534, 32.5043, 24.4590]
  resolution: [64, 48]
  rostopic: /events
"""

CAMERA_INFO = b"""image_width: 64
image_height: 48
camera_name: davis
camera_matrix:
  rows: 3
  cols: 3
  data: [199.65, 0.0, 32.5, 0.0, 199.25, 24.5, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.37, 0.15, 0.001, -0.002, 0.03]
"""

OPENCV_YAML = b"""%YAML:1.0
---
image_width: 64
image_height: 48
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 199.65, 0., 32.5, 0., 199.25, 24.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -3.7e-01, 1.5e-01, 1.0e-03, -2.0e-03, 3.0e-02 ]
"""

CAMERA_XML = b"""<?xml version="1.0"?>
<opencv_storage>
<DAVIS_1>
  <camera_matrix type_id="opencv-matrix">
    <rows>3</rows><cols>3</cols><dt>d</dt>
    <data>199.65 0. 32.5 0. 199.25 24.5 0. 0. 1.</data></camera_matrix>
  <distortion_coefficients type_id="opencv-matrix">
    <rows>1</rows><cols>5</cols><dt>d</dt>
    <data>-0.37 0.15 0.001 -0.002 0.03</data></distortion_coefficients>
  <image_width>64</image_width><image_height>48</image_height></DAVIS_1>
<use_fisheye_model>0</use_fisheye_model>
</opencv_storage>
"""

CAMERA_JSON = b"""{"version": "2.0", "cameras": {"C0": {"name": "a", "resolution": ["64", "48"],
"principalPoint": ["32.5", "24.5"], "focalLength": ["199.65", "199.25"],
"distortionCoefficients": ["-0.37", "0.15", "0.001", "-0.002"],
"distortionModel": "radialTangential"}}}
"""

BASALT_JSON = b"""{"value0": {"intrinsics": [{"camera_type": "kb4", "intrinsics":
{"fx": 199.65, "fy": 199.25, "cx": 32.5, "cy": 24.5, "k1": -0.02, "k2": 0.01, "k3": 0.001,
"k4": 0.002}}], "resolution": [[64, 48]]}}
"""

VEHICLE = b"""type: swerve
method: average
wheels:
  fl: {x: 0.30, y: 0.25}
  fr: {x: 0.30, y: -0.25}
  rl: {x: -0.30, y: 0.25}
"""

OMNI = b"""type: omni
wheels:
  a: {x: 0.20, y: 0.0, drive_deg: 90}
  b: {x: -0.10, y: 0.17, drive_deg: 210}
  c: {x: -0.10, y: -0.17, drive_deg: 330}
"""

MECANUM = b"type: mecanum\nwheelbase: 0.505\ntrack: 0.425\n"

COLUMN_MAP = b"""wheel_radius: 0.05
t: {column: stamp, unit: ms}
speed_fl: {column: fl_rate, unit: rad/s}
speed_fr: {column: fr_rate, unit: rpm, scale: -1}
steer_fl: {column: fl_angle, unit: deg}
steer_fr: fr_angle
"""

BATCH_LIST = b"""defaults:
  camera: calib.txt
  vehicle: vehicle.yaml
recordings:
  - recording: monday/events.txt.gz
    wheels: monday/wheels.csv
    name: monday
  - recording: tuesday/events.aedat4
    velocities: tuesday/velocities.csv
    size: 346x260
    max_offset: 2.0
"""

WHEELS = "t,speed_fl,steer_fl,speed_fr,steer_fr,speed_rl,steer_rl"


def calibration():
    """Return a calibration.yaml as `evcalib` writes it, without a run."""
    content = {
        "R_body_cam": [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]],
        "offset_s": 0.1234567,
        "offset_sd_s": 0.0125,
        "offset_interval_s": [0.1, 0.15],
        "offset_observable": False,
        "rotation_sd_deg": 0.25,
        "rotation_observable": True,
        "unknown_axis": None,
        "verdict": "The rotation is determined.",
        "settings": {"offset": None, "rate": 20.0},
        "convention": "v_body = R_body_cam v_cam",
    }
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None).encode()


def wpilog() -> bytes:
    """Return a WPILib log of two swerve modules that drive forward."""
    values = [(5_000_000 + 20_000 * k, doubles([[1.0, 0.0, 1.0, 0.0]])[0]) for k in range(6)]
    return log([("/drive/measured", "struct:SwerveModuleState[]", values)])

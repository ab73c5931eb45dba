"""Every reader under one form: how it is called on a file, what it must never do, real seeds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fuzz import seeds

from data_tools.logs.camera_files import read_camera
from data_tools.logs.column_maps import column_map
from data_tools.logs.imu_files import read_imu_table
from data_tools.logs.series_files import read_headings, read_paired_streams, read_velocities
from data_tools.logs.trajectory_files import read_tum
from data_tools.logs.vehicle_files import read_vehicle
from data_tools.logs.velocity_sources import read_body_velocities
from data_tools.logs.wheel_logs import read_wheel_log
from data_tools.recordings import open_recording, read_imu
from data_tools.runs.export import read_calibration, read_export
from data_tools.studies.batch_list import read_list
from evcalib.errors import InputError
from evcalib.kinematics import Swerve, Wheel

SIZE = (seeds.WIDTH, seeds.HEIGHT)
SWERVE = Swerve(
    (Wheel("fl", 0.3, 0.25), Wheel("fr", 0.3, -0.25), Wheel("rl", -0.3, 0.25)), "least_squares"
)
TWO_WHEELS = Swerve((Wheel("fl", 0.3, 0.25), Wheel("fr", 0.3, -0.25)), "least_squares")
JOINTS = {"speed_fl": "a", "speed_fr": "b", "steer_fl": "a", "steer_fr": "b"}

Columns = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Target:
    """A reader: the ending of its files, how it reads one, and files that it reads in full.

    `read` raises InputError or returns; if what it returns is not fit to be used, it raises an
    AssertionError.
    """

    suffix: str
    read: Callable[[Path], object]
    make: Callable[[], list[bytes]]


def read_events(path: Path, **options) -> tuple[Columns, dict[str, int]]:
    """Return x, y, t [us of the file], p and the losses; whatever is returned is in order."""
    recording = open_recording(path, **options)
    pieces = list(recording)
    assert pieces, "a recording without events was opened"
    parts = ([getattr(piece, name) for piece in pieces] for name in "xytp")
    x, y, t, p = (np.concatenate(part) for part in parts)
    assert x.size == y.size == t.size == p.size > 0
    assert x.max() < recording.width <= 1 << 16
    assert y.max() < recording.height <= 1 << 16
    assert p.dtype == np.bool_
    assert t.dtype == np.int64
    assert t[0] >= 0
    assert (t[1:] >= t[:-1]).all()
    assert all(count > 0 for count in recording.losses.values() if count)
    return (x, y, t + recording.origin_us, p), dict(recording.losses)


def attempt(read: Callable[[Path], object], path: Path) -> object | None:
    """Return what a reader makes of a file, or None if it refuses it, naming it."""
    try:
        return read(path)
    except InputError as error:
        message = str(error)
    assert str(path) in message, message
    return None


def _events(**options) -> Callable[[Path], object]:
    return lambda path: read_events(path, **options)


def _finite(*arrays: np.ndarray | None) -> None:
    for array in arrays:
        assert array is None or np.isfinite(array).all()


def _wheel_log(path: Path) -> object:
    log = read_wheel_log(path, SWERVE)
    _finite(log.t, log.states.speed, log.states.steer)
    assert (np.diff(log.t) > 0).all()
    return log


def _velocities(path: Path) -> object:
    found = read_velocities(path)
    _finite(found.t, found.v, found.yaw_rate)
    assert (np.diff(found.t) > 0).all()
    return found


def _headings(path: Path) -> object:
    found = read_headings(path)
    _finite(found.t, found.v, found.weight, found.sd)
    np.testing.assert_allclose(np.linalg.norm(found.v, axis=1), 1, atol=1e-9)
    return found


def _camera(path: Path) -> object:
    camera = read_camera(path, *SIZE)
    _finite(np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion]))
    assert (camera.width, camera.height) == SIZE
    return camera


def _tum(path: Path) -> object:
    poses = read_tum(path)
    _finite(poses.t, poses.position, poses.matrices)
    return poses


def _stored(path: Path) -> object:
    found = read_calibration(path)
    np.testing.assert_allclose(found.R_body_cam @ found.R_body_cam.T, np.eye(3), atol=1e-5)
    assert np.isfinite(found.offset)
    return found


def _exported(path: Path) -> object:
    found = read_export(path, "kalibr")
    assert np.isfinite(found.offset)
    return found


def _paired(path: Path) -> object:
    found = read_paired_streams(path)
    _finite(found.headings.t, found.headings.v, found.velocities.t, found.velocities.v)
    return found


def _motion(path: Path) -> object:
    found = read_body_velocities(path)
    _finite(found.velocities.t, found.velocities.v, found.velocities.yaw_rate)
    return found


def _imu(path: Path) -> object:
    found = read_imu_table(path) if path.suffix == ".csv" else read_imu(path).imu
    _finite(found.t, found.rate, found.acceleration)
    assert (np.diff(found.t) > 0).all()
    return found


def _joints(path: Path) -> object:
    found = read_body_velocities(path, vehicle=TWO_WHEELS, columns=JOINTS, wheel_radius=0.1)
    _finite(found.velocities.t, found.velocities.v, found.velocities.yaw_rate)
    return found


def _modules(path: Path) -> object:
    source = read_body_velocities(path, vehicle=TWO_WHEELS)
    _finite(source.velocities.t, source.velocities.v, source.velocities.yaw_rate)
    return source


def _bag_folder(path: Path) -> object:
    """Read a folder whose metadata.yaml is the file."""
    _, name, database = seeds.bag_folder()
    folder = path.with_name(path.name + "-bag")
    folder.mkdir(exist_ok=True)
    (folder / name).write_bytes(database)
    (folder / "metadata.yaml").write_bytes(path.read_bytes())
    return read_events(folder)


def _hdf5() -> list[bytes]:
    layouts = ("evcalib", "dsec", "prophesee-hdf5", "mvsec", "table", "matlab", "e2vid")
    return [
        *(seeds.hdf5(layout) for layout in layouts),
        seeds.hdf5("evcalib", compression=None),
        seeds.hdf5("evcalib", fletcher32=True),
    ]


def _exports() -> list[bytes]:
    rows = "".join(f"  - [{row}]\n" for row in ("0, -1, 0, 0", "0, 0, -1, 0", "1, 0, 0, 0"))
    return [f"cam0:\n  T_cam_imu:\n{rows}  - [0, 0, 0, 1]\n  timeshift_cam_imu: 0.25\n".encode()]


PACKETS = "event_camera_msgs/msg/EventPacket"

TARGETS: dict[str, Target] = {
    "text": Target(".txt", _events(size=SIZE), lambda: [seeds.text(40)]),
    "text-gzip": Target(".txt.gz", _events(size=SIZE), lambda: [seeds.text_gzip()]),
    "text-zip": Target(".zip", _events(size=SIZE), lambda: [seeds.text_zip()]),
    "csv": Target(".csv", _events(), lambda: [seeds.csv(40)]),
    "npz": Target(".npz", _events(), lambda: [seeds.npz(), seeds.npz(0)]),
    "npy": Target(
        ".npy",
        _events(size=SIZE),
        lambda: [seeds.npy(kind) for kind in ("structured", "rows", "columns", "transposed")],
    ),
    "mat": Target(
        ".mat",
        _events(size=SIZE),
        lambda: [seeds.mat("fields"), seeds.mat("variables", False), seeds.mat("table")],
    ),
    "hdf5": Target(".h5", lambda path: _sized(path), _hdf5),
    "evt2": Target(".raw", _events(), lambda: [seeds.evt2()]),
    "evt3": Target(".raw", _events(), lambda: [seeds.evt3()]),
    "dat": Target(".dat", _events(), lambda: [seeds.dat()]),
    "aedat4": Target(
        ".aedat4",
        _events(),
        lambda: [seeds.aedat4_made(), seeds.aedat4_made(bytes, 0)],
    ),
    "aedat2": Target(
        ".aedat", _events(), lambda: [seeds.aedat2(), seeds.aedat2("DVS128", (128, 128))]
    ),
    "aedat3": Target(".aedat", _events(), lambda: [seeds.aedat3(), seeds.aedat3(kinds=(1, 2))]),
    "es": Target(".es", _events(), lambda: [seeds.es(), seeds.es(2)]),
    "rosbag1": Target(
        ".bag",
        _events(),
        lambda: [
            *(seeds.bag(kind) for kind in ("ros1", "ros1-bz2", "ros1-lz4")),
            seeds.bag("ros1", PACKETS),
        ],
    ),
    "rosbag2-sqlite3": Target(
        ".db3", _events(), lambda: [seeds.bag("sqlite3"), seeds.bag("sqlite3", PACKETS)]
    ),
    "rosbag2-mcap": Target(
        ".mcap", _events(), lambda: [seeds.bag("mcap"), seeds.bag("mcap", PACKETS)]
    ),
    "rosbag2-metadata": Target(".yaml", _bag_folder, lambda: [seeds.bag_folder()[0]]),
    "bag-twists": Target(".bag", _motion, lambda: [seeds.motion_bag("ros1")]),
    "bag-joints": Target(".mcap", _joints, lambda: [seeds.motion_bag("mcap", joints=True)]),
    "wpilog": Target(".wpilog", _modules, lambda: [seeds.wpilog()]),
    "imu-aedat2": Target(".aedat", _imu, lambda: [seeds.imu_aedat2()]),
    "imu-aedat3": Target(".aedat", _imu, lambda: [seeds.imu_aedat3()]),
    "imu-bag": Target(".bag", _imu, lambda: [seeds.imu_bag()]),
    "imu-hdf5": Target(".h5", _imu, lambda: [seeds.imu_hdf5(), seeds.imu_hdf5(mvsec=True)]),
    "imu-table": Target(".csv", _imu, lambda: [seeds.table("t,wx,wy,wz,ax,ay,az")]),
    "wheel-log": Target(".csv", _wheel_log, lambda: [seeds.table(seeds.WHEELS)]),
    "velocities": Target(".csv", _velocities, lambda: [seeds.table("t,vx,vy,vz,yaw_rate")]),
    "headings": Target(".csv", _headings, lambda: [seeds.headings()]),
    "column-map": Target(".yaml", column_map, lambda: [seeds.COLUMN_MAP]),
    "calib-txt": Target(".txt", _camera, lambda: [seeds.CALIB_TXT]),
    "kalibr": Target(".yaml", _camera, lambda: [seeds.CAMCHAIN]),
    "camera-yaml": Target(".yaml", _camera, lambda: [seeds.CAMERA_INFO, seeds.OPENCV_YAML]),
    "camera-xml": Target(".xml", _camera, lambda: [seeds.CAMERA_XML]),
    "camera-json": Target(".json", _camera, lambda: [seeds.CAMERA_JSON, seeds.BASALT_JSON]),
    "vehicle": Target(".yaml", read_vehicle, lambda: [seeds.VEHICLE, seeds.OMNI, seeds.MECANUM]),
    "calibration": Target(".yaml", _stored, lambda: [seeds.calibration()]),
    "kalibr-export": Target(".yaml", _exported, _exports),
    "batch-list": Target(".yaml", read_list, lambda: [seeds.BATCH_LIST]),
    "tum": Target(".txt", _tum, lambda: [seeds.tum()]),
    "authors-npz": Target(".npz", _paired, lambda: [seeds.authors_npz()]),
}


def _sized(path: Path) -> object:
    """Read an HDF5 file, saying the sensor's size where the file does not."""
    try:
        return read_events(path)
    except InputError as error:
        if "give width and height" not in str(error):
            raise
    return read_events(path, size=SIZE)

"""IMU samples out of recordings and tables: against other libraries, by hand, damaged."""

import struct

import h5py
import numpy as np
import pytest
from fuzz import seeds

from data_tools.logs.imu_files import read_imu_table, write_imu
from data_tools.recordings import open_recording, read_imu
from data_tools.recordings.formats import aedat2
from data_tools.runs.imu import imu_of, rotation_of
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.imu import ImuSeries, attitude_of

SCALES = "#  <entry key=\"ImuGyroScale\" value=\"GyroFullScaleDegPerSec500\"/>\r\n" \
         "#  <entry key=\"ImuAccelScale\" value=\"ImuAccelScaleG4\"/>\r\n"  # fmt: skip


def sample(t, values):
    """Return the seven records of a sample of jAER: accelerations, temperature, rates."""
    return b"".join(
        struct.pack(">II", 1 << 31 | code << 28 | (value & 0xFFFF) << 12 | 3 << 10, t & 0xFFFFFFFF)
        for code, value in enumerate(values)
    )


def event(t):
    return struct.pack(">II", 10 << 22 | 20 << 12 | 1 << 11, t & 0xFFFFFFFF)


def jaer(*records, scales=SCALES):
    head = f"#!AER-DAT2.0\r\n{scales}# AEChip: a.b.DAVIS240C\r\n".encode()
    return head + b"".join(records)


@pytest.fixture
def write(tmp_path):
    def write(content, name="recording.aedat"):
        path = tmp_path / name
        path.write_bytes(content)
        return path

    return write


@pytest.mark.parametrize("block", [8, 24, 1 << 22])
def test_jaer_by_hand(write, monkeypatch, block):
    """Full scales of 500 deg/s and 4 g; x and z of the chip point against the camera's."""
    monkeypatch.setattr(aedat2, "BLOCK_BYTES", block)
    first = (8192, -8192, 16, 0, 32767, -16384, 100)
    whole = sample(1000, first), event(1100), sample(1500, (0,) * 7), event(1600)
    found = read_imu(write(jaer(*whole)))
    np.testing.assert_array_equal(found.imu.t, [0.001, 0.0015])
    lsb = np.radians(500 / 32768)
    np.testing.assert_allclose(found.imu.rate[0], lsb * np.array([-32767, -16384, -100]))
    g = 9.80665 * 4 / 32768
    np.testing.assert_allclose(found.imu.acceleration[0], g * np.array([-8192, -8192, -16]))
    assert found.notes == ()
    assert len(next(iter(open_recording(write(jaer(*whole)))))) == 2


def test_jaer_whose_clock_starts_again_and_whose_samples_are_cut(write):
    turn = (1 << 32) - 300
    still = (0, -8192, 0, 0, 1, 2, 3)
    records = [sample(turn + 200 * k, still) for k in range(4)]
    broken = records[1][8:]  # the first of its seven records is lost
    found = read_imu(write(jaer(records[0], broken, records[2], event(turn), records[3][:-8])))
    np.testing.assert_allclose(1e6 * found.imu.t, [turn, turn + 400])


def test_jaer_without_scales_says_what_was_taken(write):
    found = read_imu(
        write(jaer(*(sample(k, (0, -4096, 0, 0, 0, 0, 33)) for k in (1, 2)), scales=""))
    )
    assert [note.split(",")[0] for note in found.notes] == [
        "the header names no full scale of the IMU: 1000 deg/s",
        "the header names no full scale of the IMU: 8 g",
    ]
    np.testing.assert_allclose(found.imu.rate[0, 2], -np.radians(33 * 1000 / 32768))
    np.testing.assert_allclose(found.imu.acceleration[0, 1], -9.80665)
    half = jaer(*(sample(k, (0, -1000, 0, 0, 0, 0, 33)) for k in (1, 2)), scales="")
    assert "measures 0.24 g" in read_imu(write(half)).notes[-1]


def test_a_real_roll_is_that_of_the_events(data):
    """A DAVIS240C rolls: keypoints turn by as much against the camera as its gyro says."""
    from evcalib.heading import HeadingEstimator
    from evcalib.heading.gyro import shared_turn

    path = data / "formats" / "davis240_imu.aedat"
    recording, imu = open_recording(path), read_imu(path).imu
    assert (len(imu), recording.width) == (7384, 240)
    assert np.linalg.norm(imu.acceleration[:100], axis=1).mean() == pytest.approx(10.0, abs=0.4)
    camera = Camera(240, 180, fx=200, fy=200, cx=120, cy=90)
    found = {}
    for name, attitude in (("raw", None), ("turned back", attitude_of(imu))):
        estimator = HeadingEstimator(camera, attitude=attitude, keep_correspondences=True)
        for piece in recording:
            estimator.update(piece)
        found[name] = estimator.finish()
    left = shared_turn(found["turned back"].correspondences, camera.focal)
    # About the optical axis nothing is left, of 29.5 deg/s; the rest is bias, usual for the chip.
    assert np.degrees(np.abs(imu.rate[:, 2].mean())) == pytest.approx(29.5, abs=0.1)
    assert np.degrees(abs(left[2])) < 1.0
    assert np.degrees(np.linalg.norm(left)) < 6.0
    assert not len(found["raw"].headings)


def test_aedat4_against_the_library(data):
    aedat = pytest.importorskip("aedat")
    path = data / "formats" / "davis346.aedat4"
    origin = 1_589_163_147_000_000
    found = read_imu(path, origin_us=origin).imu
    parts = [packet["imus"] for packet in aedat.Decoder(path) if "imus" in packet]
    theirs = np.concatenate(parts)
    assert len(found) == theirs.size == 2363
    np.testing.assert_allclose(found.t, 1e-6 * (theirs["t"].astype(np.int64) - origin), atol=1e-9)
    for k, axis in enumerate("xyz"):
        np.testing.assert_allclose(found.rate[:, k], np.radians(theirs[f"gyroscope_{axis}"]))
        force = 9.80665 * theirs[f"accelerometer_{axis}"].astype(float)
        np.testing.assert_allclose(found.acceleration[:, k], force)


def test_aedat4_of_others(data):
    pytest.importorskip("lz4")
    assert len(read_imu(data / "formats" / "dv_sample.aedat4").imu) == 3836
    assert len(read_imu(data / "formats" / "dv_2020.aedat4").imu) == 160
    assert read_imu(data / "still" / "emlb.aedat4").imu.acceleration is None
    with pytest.raises(InputError, match="holds no samples of an IMU"):
        read_imu(data / "formats" / "dv_empty_stereo.aedat4")


def test_damaged_aedat4_is_refused(data, write):
    pytest.importorskip("lz4")
    from data_tools.recordings.formats._aedat4_layout import read_imu as packet

    for content in (b"", bytes(20), b"\x10\x00\x00\x00\x08\x00\x00\x00IMUS" + b"\xff" * 8):
        with pytest.raises(InputError, match="IMU samples"):
            packet(content)
    whole = (data / "formats" / "davis346.aedat4").read_bytes()
    for cut in np.random.default_rng(0).integers(200_000, len(whole) - 70_000, 5):
        found = read_imu(write(whole[:cut], "cut.aedat4"))
        assert 50 < len(found.imu) < 2363


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap"])
def test_bags(tmp_path, kind):
    from bag_writing import Maker

    maker = Maker(kind)
    t = 1_700_000_000_000_000_000 + 5_000_000 * np.arange(40)
    t[20] = t[19]  # a repeated stamp
    rate = np.random.default_rng(0).normal(0, 0.1, (40, 3))
    rate[30] = np.nan
    path = maker.write(
        tmp_path, [("/imu", [(s, imu_message(maker, s, w)) for s, w in zip(t, rate, strict=True)])]
    )
    found = read_imu(path, origin_us=1_700_000_000_000_000)
    keep = np.setdiff1d(np.arange(40), [20, 30])
    np.testing.assert_allclose(found.imu.t, 0.005 * keep, atol=1e-9)
    np.testing.assert_array_equal(found.imu.rate, rate[keep])
    assert found.notes[0] == "IMU: topic /imu, in the axes of camera_imu"
    assert "1 IMU samples without a number" in found.notes[1]
    assert "1 rows with the time of the row before" in found.notes[2]
    with pytest.raises(InputError, match="no topic /other of an IMU"):
        read_imu(path, stream="/other")


def imu_message(maker, ns, rate, absent=False):
    vector = "geometry_msgs/msg/Vector3"
    covariance = np.zeros(9)
    return maker.make(
        "sensor_msgs/msg/Imu",
        header=maker.header(ns, "camera_imu"),
        orientation=maker.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=covariance,
        angular_velocity=maker.make(vector, x=rate[0], y=rate[1], z=rate[2]),
        angular_velocity_covariance=covariance - (np.arange(9) == 0) * absent,
        linear_acceleration=maker.make(vector, x=0.0, y=-9.8, z=0.0),
        linear_acceleration_covariance=covariance,
    )


def test_a_bag_that_measures_no_rates_is_refused(tmp_path):
    from bag_writing import Maker

    maker = Maker("ros1")
    path = maker.write(tmp_path, [("/imu", [(1, imu_message(maker, 1, [0, 0, 0], absent=True))])])
    with pytest.raises(InputError, match="measures no rates"):
        read_imu(path)


def test_a_real_bag_against_rosbags(data):
    highlevel = pytest.importorskip("rosbags.highlevel")
    path = data / "wheels" / "rl_test2.bag"
    found = read_imu(path).imu
    with highlevel.AnyReader([path]) as reader:
        theirs = [
            reader.deserialize(raw, one.msgtype).angular_velocity.z
            for one, _, raw in reader.messages()
            if one.topic == "/imu/data"
        ]
    assert len(found) + 1 >= len(theirs) == 3061
    assert np.isin(found.rate[:, 2], theirs).all()


def test_hdf5(tmp_path):
    path = tmp_path / "recording.h5"
    t, rate = np.arange(5) * 2500, np.random.default_rng(0).normal(0, 1, (5, 3))
    with h5py.File(path, "w") as file:
        file["ovc/imu/ts"], file["ovc/imu/omega"], file["ovc/imu/accel"] = t, rate, 9.8 + 0 * rate
    found = read_imu(path)
    np.testing.assert_allclose(found.imu.t, 1e-6 * t)
    np.testing.assert_array_equal(found.imu.rate, rate)
    with h5py.File(path, "a") as file:
        file["ovc2/imu/ts"], file["ovc2/imu/omega"] = t[:4], rate
    with pytest.raises(InputError, match="IMUs in ovc/imu, ovc2/imu; say which"):
        read_imu(path)
    with pytest.raises(InputError, match="5 rates and 4 times"):
        read_imu(path, stream="ovc2/imu")
    mvsec = tmp_path / "mvsec.h5"
    with h5py.File(mvsec, "w") as file:
        file["davis/left/imu"] = np.hstack([9.8 + 0 * rate, rate])
        file["davis/left/imu_ts"] = 1.5e9 + 1e-6 * t
    found = read_imu(mvsec, origin_us=1_500_000_000_000_000)
    np.testing.assert_array_equal(found.imu.rate, rate)
    np.testing.assert_allclose(found.imu.t, 1e-6 * t, atol=1e-6)


def test_tables_come_back_as_they_were_written(tmp_path):
    rng = np.random.default_rng(1)
    for force in (None, rng.normal(0, 9, (20, 3))):
        imu = ImuSeries(0.01 * np.arange(20), rng.normal(0, 0.1, (20, 3)), force)
        write_imu(tmp_path / "imu.csv", imu)
        found = read_imu_table(tmp_path / "imu.csv")
        np.testing.assert_array_equal(found.t, imu.t)
        np.testing.assert_array_equal(found.rate, imu.rate)
        assert (found.acceleration is None) == (force is None)


def test_units_of_tables(tmp_path):
    path = tmp_path / "imu.csv"
    rows = "".join(f"{k},0.1,{k % 7},30\n" for k in range(0, 1000, 10))
    path.write_text(rows)
    notes = []
    with pytest.raises(InputError, match=r"30.2 rad/s on the whole.*--imu-unit deg/s"):
        read_imu_table(path, time_unit="ms", notes=notes)
    found = read_imu_table(path, time_unit="ms", unit="deg/s", notes=notes)
    np.testing.assert_allclose(found.rate[0], np.radians([0.1, 0, 30]))
    assert "no header: columns are taken to be t, wx, wy, wz" in notes
    columns = {"t": {"column": 1, "unit": "ms"}, "wx": 2, "wy": 3}
    columns |= {"wz": {"column": 4, "unit": "deg/s"}}
    assert read_imu_table(path, columns=columns).rate[0, 2] == pytest.approx(np.radians(30))
    with pytest.raises(InputError, match="gives the unit"):
        read_imu_table(path, columns=columns, unit="deg/s")
    with pytest.raises(InputError, match="in seconds"):
        read_imu_table(path, unit="deg/s")
    path.write_text("t,gx,gy,gz\n" + rows)
    with pytest.raises(InputError, match=r"lacks the column\(s\) wx, wy, wz"):
        read_imu_table(path)
    path.write_text(
        "t,wx,wy,wz\n0,0,0,0\n0.01,0,0,0\n0.02,0,0,nan\n0.02,0,0,0\n0.015,0,0,0\n0.03,0,0,0\n"
    )
    notes = []
    assert len(read_imu_table(path, notes=notes)) == 4
    assert len(notes) == 2


def test_how_an_imu_is_turned():
    np.testing.assert_array_equal(rotation_of("-x,y,-z"), np.diag([-1.0, 1, -1]))
    np.testing.assert_array_equal(rotation_of("y, z ,x") @ [1, 2, 3], [2, 3, 1])
    np.testing.assert_array_equal(rotation_of("1,0,0,0,0,-1,0,1,0")[1], [0, 0, -1])
    assert rotation_of(None) is None
    assert rotation_of("estimate") == "estimate"
    for bad in ("-x,y,z", "x,x,z", "1,2,3", "up", "1,0,0,0,1,0,0,0,2"):
        with pytest.raises(InputError, match=r"IMU is turned|no rotation"):
            rotation_of(bad)


@pytest.fixture
def still(write):
    """Return a recording of jAER that stands still, with an IMU of 1 kHz."""
    records = []
    for k in range(400):
        records += [sample(1000 * k, (0, -8192, 0, 0, 10, 0, 0)), event(1000 * k + 500)]
    return write(jaer(*records))


def test_the_command_line(run, still, tmp_path):
    table = tmp_path / "imu.csv"
    code, out, _ = run("imu", still, "-o", table)
    assert (code, out) == (0, f"400 samples written to {table}\n")
    recording = open_recording(still)
    own = imu_of(recording, "auto").imu
    np.testing.assert_array_equal(imu_of(recording, table).imu.rate, own.rate)
    code, out, _ = run("info", still)
    assert "IMU        400 samples of rates and accelerations in 0.399 s (1003/s)" in out
    camera = tmp_path / "calib.txt"
    camera.write_text("200 200 120 90 0 0 0 0 0\n")
    headings = tmp_path / "h.csv"
    code, out, _ = run("headings", still, "--camera", camera, "-o", headings, "--imu", "auto")
    assert code == 3
    assert "too little is seen to tell its bias" in out
    code, _, err = run("headings", still, "--camera", camera, "-o", headings, "--imu-unit", "deg/s")
    assert (code, "--imu-unit needs an IMU" in err) == (2, True)
    code, _, err = run("imu", tmp_path / "h5.csv", "-o", table)
    assert code == 2


def test_options_that_do_not_fit_are_refused(still, tmp_path):
    recording = open_recording(still)
    with pytest.raises(InputError, match="has its own unit"):
        imu_of(recording, "auto", unit="deg/s")
    table = tmp_path / "imu.csv"
    write_imu(table, imu_of(recording, "auto").imu)
    with pytest.raises(InputError, match="no stream"):
        imu_of(recording, table, stream="/imu")
    plain = tmp_path / "events.aedat"
    plain.write_bytes(seeds.aedat2("DAVIS240C", (240, 180)))
    with pytest.raises(InputError, match="holds no samples"):
        imu_of(open_recording(plain), "auto")

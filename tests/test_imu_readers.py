"""IMU samples out of recordings and tables: against other libraries, by hand, damaged."""

import struct

import h5py
import numpy as np
import pytest
from fuzz import seeds

from data_tools.logs.imu_files import read_imu_table, write_imu
from data_tools.recordings import describe, open_recording, read_imu
from data_tools.recordings.formats import aedat2
from data_tools.runs.imu import imu_of, rotation_of
from evcalib.errors import InputError
from evcalib.imu import ImuSeries

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
    assert found.notes == (aedat2.AXES,)
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
    assert [note.split(",")[0] for note in found.notes[1:]] == [
        "the header names no full scale of the IMU: 1000 deg/s",
        "the header names no full scale of the IMU: 8 g",
    ]
    np.testing.assert_allclose(found.imu.rate[0, 2], -np.radians(33 * 1000 / 32768))
    np.testing.assert_allclose(found.imu.acceleration[0, 1], -9.80665)
    half = jaer(*(sample(k, (0, -1000, 0, 0, 0, 0, 33)) for k in (1, 2)), scales="")
    assert "measures 0.24 g" in read_imu(write(half)).notes[-1]


def caer(kind, overflow, *samples, bytes_each=36):
    """Return a packet of cAER: bits, time, accelerations [g], rates [deg/s], then what is left."""
    rest = bytes_each - 32
    body = b"".join(struct.pack("<Ii6f", *one) + bytes(rest) for one in samples)
    count = len(samples)
    return struct.pack("<hhiiiiii", kind, 0, bytes_each, 4, overflow, count, count, count) + body


@pytest.mark.parametrize(("kind", "size"), [(3, 36), (4, 48)])
def test_caer_by_hand(write, kind, size):
    """AEDAT 3.1: g and deg/s; x and z of the chip point against the camera's; bit 0 is valid."""
    still, last = (0, -1, 0, 0, 0, 0), 2**31 - 1000
    one, invalid = (1, last, 0.5, -1, 0.25, 90, 180, -45), (0, last + 500, *still)
    content = seeds.aedat3() + caer(kind, 0, one, invalid, bytes_each=size)
    content += caer(kind, 1, (1, 0, *still), (1, 1000, *still), bytes_each=size)
    path = write(content)
    found = read_imu(path).imu
    np.testing.assert_allclose(found.t, 1e-6 * (last + 1000.0 * np.arange(3)))
    np.testing.assert_allclose(found.rate[0], np.radians([-90, 180, 45]))
    np.testing.assert_allclose(found.acceleration[0], 9.80665 * np.array([-0.5, -1, -0.25]))
    assert sum(map(len, open_recording(path))) == seeds.COUNT
    assert "IMU" in describe(open_recording(path)).text()
    with pytest.raises(InputError, match="no header of a packet"):
        read_imu(write(seeds.aedat3() + caer(kind, 0, one, bytes_each=size + 4)))


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
        tmp_path, [("/imu", [(s, maker.imu(s, w)) for s, w in zip(t, rate, strict=True)])]
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


def test_a_bag_that_measures_no_rates_is_refused(tmp_path):
    from bag_writing import Maker

    maker = Maker("ros1")
    path = maker.write(tmp_path, [("/imu", [(1, maker.imu(1, [0, 0, 0], absent=True))])])
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
    with pytest.raises(InputError, match="5x3 for 4 times"):
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


def test_accelerations_in_place_of_rates_are_refused(tmp_path):
    """Columns of others are often t, accelerations, rates; the weight tells them."""
    rng = np.random.default_rng(2)
    t = np.arange(0, 2, 0.01)[:, None]
    rate, force = rng.normal(0, 0.1, (200, 3)), [0.2, -9.7, 0.9] + rng.normal(0, 0.3, (200, 3))
    path = tmp_path / "imu.txt"
    np.savetxt(path, np.hstack([t, force, rate]))
    for unit in (None, "rad/s", "deg/s"):
        with pytest.raises(InputError, match="look like the accelerations"):
            read_imu_table(path, unit=unit)
    columns = {"t": 1, "ax": 2, "ay": 3, "az": 4, "wx": 5, "wy": 6, "wz": 7}
    np.testing.assert_allclose(read_imu_table(path, columns=columns).rate, rate)
    np.savetxt(path, np.hstack([t, rate, force]))
    np.testing.assert_allclose(read_imu_table(path).rate, rate)


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
    assert code == 0
    assert out.splitlines() == [f"400 samples written to {table}", f"note: {aedat2.AXES}"]
    recording = open_recording(still)
    own = imu_of(recording, "auto").imu
    np.testing.assert_array_equal(imu_of(recording, table).imu.rate, own.rate)
    code, out, _ = run("info", still)
    assert "IMU        400 samples of rates and accelerations in 0.399 s (1003/s)" in out
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

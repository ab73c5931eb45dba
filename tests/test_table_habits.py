"""Names, units, dates and counts in tables of motion, as people's tools write them."""

import gzip
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest
from test_motion_tables import NAMES, TWO, T, read, text, truth

from data_tools.files import unpack
from data_tools.logs.column_maps import column_map
from data_tools.logs.series_files import read_headings, read_velocities
from data_tools.logs.trajectory_files import read_tum
from data_tools.logs.velocity_sources import read_body_velocities
from data_tools.logs.wheel_logs import read_wheel_log
from evcalib.errors import InputError
from evcalib.kinematics import Omni, OmniWheel

UNITS = {"t": "s", "x": "m", "y": "m", "z": "m"}


def unit(name):
    kind = name.split("_")[0]
    return {"speed": "m/s", "vx": "m/s", "vy": "m/s", "vz": "m/s", "steer": "rad"}.get(
        kind, {"yaw": "rad/s"}.get(kind, UNITS.get(name, ""))
    )


HEADERS = {
    "capitals": lambda names: [name.upper() for name in names],
    "time": lambda names: ["Time" if name == "t" else name for name in names],
    "timestamp": lambda names: ["timestamp" if name == "t" else name for name in names],
    "brackets": lambda names: [f"{n} [{unit(n)}]" if unit(n) else n for n in names],
    "parentheses": lambda names: [f"{n}({unit(n)})" if unit(n) else n for n in names],
}


@pytest.mark.parametrize("kind", list(NAMES))
@pytest.mark.parametrize("header", list(HEADERS))
def test_names_are_taken_however_they_are_spelt(tmp_path, kind, header):
    if kind == "headings" and header in ("brackets", "parentheses"):
        pytest.skip("headings have no unit but that of their times")
    names = HEADERS[header](NAMES[kind])
    path = tmp_path / "log.csv"
    path.write_text(text(kind).replace(",".join(NAMES[kind]), ",".join(names), 1))
    rows, notes = read(kind, path)
    np.testing.assert_allclose(rows, truth(kind), atol=1e-15)
    assert any(note.startswith(f"columns: {names[0]} is t") for note in notes)


def test_units_of_a_header_are_read(tmp_path):
    rows = truth("wheels") * (1e3, 100, 180 / np.pi, 100, 180 / np.pi)
    head = "Time [ms],speed_a (cm/s),steer_a [deg],speed_b (cm/s),steer_b [\u00b0]"
    path = tmp_path / "log.csv"
    path.write_text(head + "\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows.tolist()))
    np.testing.assert_allclose(read("wheels", path)[0], truth("wheels"), atol=1e-12)
    with pytest.raises(InputError, match=r"gives the unit of t, which --time-unit us .*contradict"):
        read_wheel_log(path, TWO, time_unit="us")
    path.write_text(path.read_text().replace("cm/s", "furlongs", 1))
    with pytest.raises(InputError, match=r"speed_a \[furlongs\], is not understood: .* in one of"):
        read("wheels", path)


@pytest.mark.parametrize("reader", [read_headings, read_tum])
def test_other_units_are_refused_where_nothing_converts_them(tmp_path, reader):
    kind = "headings" if reader is read_headings else "trajectory"
    path = tmp_path / "log.csv"
    path.write_text(text(kind).replace("t,", "t [ms],", 1))
    with pytest.raises(InputError, match="t in ms, by its header: write times in s"):
        reader(path)


def test_two_columns_of_one_name_are_refused(tmp_path):
    path = tmp_path / "v.csv"
    path.write_text("Time,timestamp,vx,vy\n0,0,1,1\n1,1,1,1\n")
    with pytest.raises(InputError, match="both Time and timestamp may be the column t"):
        read_velocities(path)
    path.write_text("t,Time,vx,vy\n0,7,1,1\n1,8,1,1\n")
    np.testing.assert_array_equal(read_velocities(path).t, [0, 1])


@pytest.mark.parametrize("kind", list(NAMES))
def test_foreign_columns_may_hold_anything(tmp_path, kind):
    """Words, empty cells and NaN in a column that nobody reads cost no row."""
    head, *lines = text(kind).splitlines()
    words = ["auto", "", "NaN", "inf", '"a;b"']
    lines = [f"{line},{words[k % 5]}" for k, line in enumerate(lines)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([head + ",mode", *lines, ""]))
    rows, notes = read(kind, path)
    np.testing.assert_allclose(rows, truth(kind), atol=1e-15)
    assert kind == "trajectory" or notes == ["column(s) passed over: mode"]


@pytest.mark.parametrize("kind", list(NAMES))
def test_dates_and_times_of_day_are_seconds(tmp_path, kind):
    path = tmp_path / "log.csv"
    start = datetime(2024, 5, 1, 12, tzinfo=UTC)
    zone = timezone(timedelta(hours=2))
    head, *lines = text(kind).splitlines()
    rest = [line.split(",", 1)[1] for line in lines]

    def written(form):
        stamps = [form(start + timedelta(seconds=round(s, 6))) for s in T.tolist()]
        path.write_text(
            "\n".join([head, *map(",".join, zip(stamps, rest, strict=True)), ""]), "utf-8"
        )
        return read(kind, path)

    for form in (
        lambda d: d.replace(tzinfo=None).isoformat(),
        lambda d: d.replace(tzinfo=None).isoformat(" "),
        lambda d: d.isoformat().replace("+00:00", "Z"),
        lambda d: d.astimezone(zone).isoformat(),
    ):
        rows, notes = written(form)
        np.testing.assert_allclose(rows[:, 0], start.timestamp() + T, atol=2e-6)
        np.testing.assert_allclose(rows[:, 1:], truth(kind)[:, 1:], atol=1e-15)
        assert any("t holds times in words, which were read as seconds since" in n for n in notes)
    rows, notes = written(lambda d: d.time().isoformat())
    np.testing.assert_allclose(rows[:, 0], 12 * 3600 + T, atol=2e-6)
    assert any("seconds of the day" in note for note in notes)
    with pytest.raises(InputError, match=r"t is '01\.05\.2024.*also dates as in 2024-05-01T12"):
        written(lambda d: d.strftime("%d.%m.%Y %H:%M:%S.%f"))


def test_dates_have_no_unit(tmp_path):
    path = tmp_path / "v.csv"
    path.write_text("t,vx,vy\n2024-05-01 12:00:00.0,1,1\n2024-05-01 12:00:00.5,1,1\n")
    with pytest.raises(InputError, match="t holds dates, which have no unit"):
        read_velocities(path, time_unit="ms")
    columns = {"t": {"column": "t", "unit": "ms"}, "vx": "vx", "vy": "vy"}
    with pytest.raises(InputError, match="t holds dates, which have no unit"):
        read_velocities(path, columns)
    np.testing.assert_allclose(np.diff(read_velocities(path).t), 0.5)


@pytest.mark.parametrize("kind", list(NAMES))
@pytest.mark.parametrize("wrap", [2**32 * 1e-6, 2**32 * 1e-3])
def test_counters_of_32_bits_that_start_anew_are_mended_in_seconds_too(tmp_path, kind, wrap):
    rows = truth(kind).copy()
    rows[:, 0] = (rows[:, 0] + wrap - 11) % wrap
    assert rows[-1, 0] < rows[0, 0]
    path = tmp_path / "log.csv"
    lines = [",".join(NAMES[kind]), *(",".join(map(repr, row)) for row in rows.tolist()), ""]
    path.write_text("\n".join(lines))
    found, notes = read(kind, path)
    np.testing.assert_allclose(np.diff(found[:, 0]), np.diff(T), atol=1e-6)
    assert any("a counter of 32 bits started anew" in note for note in notes)
    rows[rows[:, 0] < 30, 0] += 7  # set back by another time
    path.write_text("\n".join([lines[0], *(",".join(map(repr, row)) for row in rows.tolist()), ""]))
    with pytest.raises(InputError, match="the clock was set"):
        read(kind, path)


def test_a_time_in_two_columns(tmp_path):
    """As ROS messages have it; the file has no name for its columns."""
    whole = np.floor(T).astype(int)
    nano = np.rint((T - whole) * 1e9).astype(int)
    path = tmp_path / "echo.csv"
    rows = zip(whole + 1_700_000_000, nano, truth("velocities")[:, 1], strict=True)
    path.write_text("".join(f"{a},{b},odom,{float(v)!r},0\n" for a, b, v in rows))
    columns = {"t": {"column": 1, "nanosec": 2}, "vx": 4, "vy": 5}
    found = read_velocities(path, columns)
    np.testing.assert_allclose(found.t - 1.7e9, T, atol=1e-6)
    with pytest.raises(InputError, match="times are coarser than the rows"):
        read_velocities(path, columns | {"t": 1})
    with pytest.raises(InputError, match="has nanosec, which only a time in s has"):
        column_map({"vx": {"column": 4, "nanosec": 2}})
    with pytest.raises(InputError, match="nanosec must be a column's name or number"):
        column_map({"t": {"column": 4, "nanosec": None}})
    with pytest.raises(InputError, match=r"lacks the column\(s\) 9 of the column map"):
        read_velocities(path, columns | {"vy": 9})


def test_what_the_file_has_is_said_where_a_map_names_other_columns(tmp_path):
    path = tmp_path / "v.csv"
    path.write_text("t,u,v\n0,1,1\n1,1,1\n")
    with pytest.raises(InputError, match=r"lacks the column\(s\) w of the column map; it has v"):
        read_velocities(path, {"t": "t", "vx": "u", "vy": "w"})


@pytest.mark.parametrize("kind", list(NAMES))
def test_gzip_is_read_and_one_that_was_cut_is_refused(tmp_path, monkeypatch, kind):
    path = tmp_path / "log.csv.gz"
    packed = gzip.compress(text(kind).encode())
    path.write_bytes(packed)
    np.testing.assert_allclose(read(kind, path)[0], truth(kind), atol=1e-15)
    path.write_bytes(packed[:-9])
    with pytest.raises(InputError, match="is cut off: its gzip stream has no end"):
        read(kind, path)
    path.write_bytes(packed[:40] + b"\xff" * 20 + packed[60:])
    with pytest.raises(InputError, match="is damaged"):
        read(kind, path)
    monkeypatch.setattr(unpack, "HARMLESS", 1000)
    path.write_bytes(gzip.compress(b"\n" * (1 << 20)))
    with pytest.raises(InputError, match="made to fill the memory"):
        read(kind, path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"PK\x03\x04" + bytes(99), r"a workbook \(\.xlsx, \.ods\): save its sheet as CSV"),
        (b"\xd0\xcf\x11\xe0" + bytes(99), r"workbook \(\.xls\)"),
        (b"PAR1" + bytes(99), "a Parquet file: write it as CSV"),
        (b"ULog\x01\x12\x35" + bytes(99), "a PX4 log"),
        (b"\x89HDF\r\n\x1a\n" + bytes(99), "an HDF5 file"),
        (b'{"t": 0, "vx": 1}\n{"t": 1, "vx": 1}\n', "holds JSON"),
        (b'[{"t": 0, "vx": 1}]\n', "holds JSON"),
    ],
)
def test_files_of_another_kind_are_named(tmp_path, content, message):
    (tmp_path / "v.csv").write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_velocities(tmp_path / "v.csv")


# Counts of encoders.

OMNI = Omni(
    tuple(OmniWheel(n, np.cos(a), np.sin(a), a + np.pi / 2) for n, a in zip("abc", (0, 2.1, 4.2),
                                                                            strict=True))
)  # fmt: skip
CLOCK = 0.05 * np.arange(400)
SPEEDS = OMNI.wheel_states(
    np.column_stack([0.6 + 0.2 * np.sin(CLOCK), 0.3 * np.cos(CLOCK)]), 0.2 * np.sin(CLOCK)
).speed
TICKS_PER_M = 4096 / (2 * np.pi * 0.05)
COUNTS = np.rint(
    TICKS_PER_M * np.cumsum(np.vstack([np.zeros(3), 0.05 * (SPEEDS[1:] + SPEEDS[:-1]) / 2]), axis=0)
)
TICKS = {"wheel_radius": 0.05, "ticks_per_turn": 4096, "t": "t"} | {
    f"speed_{n}": {"column": f"c_{n}", "unit": "ticks"} for n in "abc"
}


def read_counts(tmp_path, counts, columns=TICKS):
    path = tmp_path / "ticks.csv"
    rows = np.column_stack([CLOCK, counts]).tolist()
    path.write_text("t,c_a,c_b,c_c\n" + "".join(",".join(map(repr, r)) + "\n" for r in rows))
    notes = []
    return read_wheel_log(path, OMNI, columns, notes=notes), notes


WHOLE = (SPEEDS[1:] + SPEEDS[:-1]) / 2


@pytest.mark.parametrize("bits", [8, 16, 24, 32])
@pytest.mark.parametrize("signed", [False, True])
def test_counters_that_start_anew_are_mended_and_told(tmp_path, bits, signed):
    """The vehicle has no wheel to spare, so nothing else would show it."""
    size = 2**bits
    few = COUNTS // 32 if bits == 8 else COUNTS
    columns = TICKS | {"ticks_per_turn": 128} if bits == 8 else TICKS
    start = (size // 2 if signed else size) - 100
    wrapped = (few + start) % size
    wrapped = np.where(wrapped >= size // 2, wrapped - size, wrapped) if signed else wrapped
    assert np.abs(np.diff(wrapped, axis=0)).max() > 0.7 * size
    log, notes = read_counts(tmp_path, wrapped, columns)
    np.testing.assert_allclose(log.states.speed, WHOLE, atol=0.06 if bits == 8 else 0.002)
    assert sum(f"starts anew after {size}, " in note for note in notes) >= 1
    told = {
        name: entry | {"wrap": size} if name.startswith("speed") else entry
        for name, entry in columns.items()
    }
    again, notes = read_counts(tmp_path, wrapped, told)
    np.testing.assert_array_equal(again.states.speed, log.states.speed)
    assert not any("starts anew" in note for note in notes)


def test_a_reset_costs_one_row_and_a_damaged_value_two(tmp_path):
    reset = COUNTS.copy()
    reset[200:] -= reset[200]
    log, notes = read_counts(tmp_path, reset)
    np.testing.assert_allclose(log.states.speed, np.delete(WHOLE, 199, axis=0), atol=0.002)
    assert any("1 steps of the count of speed_a are no motion" in note for note in notes)
    damaged = COUNTS.copy()
    damaged[100, 1] = 0
    log, notes = read_counts(tmp_path, damaged)
    np.testing.assert_allclose(log.states.speed, np.delete(WHOLE, [99, 100], axis=0), atol=0.002)
    assert any("2 steps of the count of speed_b are no motion" in note for note in notes)


def test_counts_that_jump_all_the_time_are_refused(tmp_path):
    often = COUNTS.copy()
    often[::60] += 40_000
    with pytest.raises(InputError, match=r"the count of speed_a jumps by .*\(wrap: 65536\)"):
        read_counts(tmp_path, often)


def test_a_start_and_a_burst_of_speed_are_no_spikes(tmp_path):
    speed = np.where(CLOCK < 10, 0.02, 1.5)[:, None] * np.ones(3)
    speed[(CLOCK > 4) & (CLOCK < 4.2)] = 1.5
    counts = np.rint(TICKS_PER_M * np.cumsum(0.05 * speed, axis=0))
    log, notes = read_counts(tmp_path, counts)
    assert log.t.size == CLOCK.size - 1
    assert len(notes) == 1
    slow = counts[CLOCK < 10]
    path = tmp_path / "slow.csv"
    rows = np.column_stack([CLOCK[: len(slow)], slow]).tolist()
    path.write_text("t,c_a,c_b,c_c\n" + "".join(",".join(map(repr, r)) + "\n" for r in rows))
    assert read_wheel_log(path, OMNI, TICKS).t.size == len(slow) - 1


# Units that look like motion.


def speeds(tmp_path, v, step=0.05):
    path = tmp_path / "v.csv"
    path.write_text("t,vx,vy\n" + "".join(f"{step * k},{u},0\n" for k, u in enumerate(v)))
    return read_body_velocities(path).notes


def test_speeds_that_no_vehicle_has_are_told(tmp_path):
    start = np.minimum(0.5, 0.5 * 0.05 * np.arange(200))
    assert speeds(tmp_path, start) == ()
    (told,) = speeds(tmp_path, 100 * start)  # cm/s
    assert told.startswith("its usual speed is 50 m/s, 180 km/h: are speeds in m/s?")
    (told,) = speeds(tmp_path, 60 * start)
    assert told.startswith("its speed changes by up to 15 m/s within 0.5 s, more than tyres hold")
    assert speeds(tmp_path, np.minimum(30, 9 * 0.05 * np.arange(200))) == ()  # a sports car
    assert speeds(tmp_path, [0, 40] * 3, step=4.0) == ()  # rows too rare to tell


def test_wheels_far_from_the_origin_are_told(tmp_path):
    path = tmp_path / "w.csv"
    path.write_text("t,speed_a,speed_b,speed_c\n0,1,1,1\n1,1,1,1\n")
    small, large = (
        Omni(tuple(OmniWheel(w.name, k * w.x, k * w.y, w.drive) for w in OMNI.wheels))
        for k in (2, 15)
    )
    told = "wheel a is 15 m from the origin; are lengths in metres"
    assert not any("from the origin" in n for n in read_body_velocities(path, vehicle=small).notes)
    assert any(told in n for n in read_body_velocities(path, vehicle=large).notes)


def test_a_yaw_rate_of_wheels_names_their_units(tmp_path):
    path = tmp_path / "w.csv"
    path.write_text("t,speed_a,speed_b,speed_c\n0,1,1,1\n1,60,60,60\n")
    with pytest.raises(InputError, match=r"the wheels tell a yaw rate of 60 rad/s.* speeds in m/s"):
        read_body_velocities(path, vehicle=OMNI)

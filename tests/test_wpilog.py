"""WPILib logs: swerve modules and chassis speeds, against the motion that was written."""

import struct

import numpy as np
import pytest
from wpilog_writing import SCHEMAS, doubles, log, record, start

from data_tools.files.wpilog import last_known, read_wpilog
from data_tools.logs.series_files import read_headings
from data_tools.logs.velocity_sources import read_body_velocities
from evcalib.errors import InputError
from evcalib.kinematics import Mecanum, Swerve, Wheel

WHEELS = {"fl": (0.3, 0.25), "fr": (0.3, -0.25), "rl": (-0.3, 0.25), "rr": (-0.3, -0.25)}
FOUR = Swerve(tuple(Wheel(name, *place) for name, place in WHEELS.items()))
T_US = 5_000_000_000 + 20_000 * np.arange(100)
T = T_US / 1e6
V = np.column_stack([0.8 + 0.2 * np.sin(T), 0.5 * np.cos(T)])
YAW = 0.3 * np.sin(0.7 * T)
STATE, POSITION, SPEEDS = (
    "struct:SwerveModuleState[]",
    "struct:SwerveModulePosition[]",
    "struct:ChassisSpeeds",
)


def modules(run, turn=0.0):
    """Return payloads of modules: how each runs (speed or distance), and its angle."""
    angle = FOUR.wheel_states(V, YAW).steer + turn
    return doubles(np.stack([run, angle], axis=2).reshape(len(run), -1).tolist())


SPEED = FOUR.wheel_states(V, YAW).speed
STATES = list(zip(T_US.tolist(), modules(SPEED), strict=True))
DISTANCE = np.cumsum(np.vstack([np.zeros(4), 0.02 * (SPEED[1:] + SPEED[:-1]) / 2]), axis=0)
CHASSIS = list(zip(T_US.tolist(), doubles(np.column_stack([V, YAW]).tolist()), strict=True))
OTHER = ("/drive/volts", "double[]", [(5_000_000_000, bytes(32))])


@pytest.fixture
def write(tmp_path):
    def write(content):
        (tmp_path / "robot.wpilog").write_bytes(content)
        return tmp_path / "robot.wpilog"

    return write


@pytest.mark.parametrize("first", [1, 200, 65_000])
def test_states_of_modules(write, first):
    """Entries of one, two and three bytes; times of five."""
    path = write(log([OTHER, ("/drive/measured", STATE, STATES)], first=first))
    source = read_body_velocities(path, vehicle=FOUR)
    np.testing.assert_allclose(source.velocities.t, T, atol=1e-9)
    np.testing.assert_allclose(source.velocities.v[:, :2], V, atol=1e-12)
    np.testing.assert_allclose(source.velocities.yaw_rate, YAW, atol=1e-12)
    assert source.notes[0] == f"entry /drive/measured ({STATE}), 100 values"
    assert any("modules 0 to 3 are taken for fl, fr, rl, rr" in note for note in source.notes)


def test_positions_of_modules_are_running_counts(write):
    values = list(zip(T_US.tolist(), modules(DISTANCE, turn=4 * np.pi), strict=True))
    source = read_body_velocities(write(log([("p", POSITION, values)])), vehicle=FOUR)
    middle = (T[1:] + T[:-1]) / 2
    np.testing.assert_allclose(source.velocities.t, middle, atol=1e-9)
    truth = (V[1:] + V[:-1]) / 2
    np.testing.assert_allclose(source.velocities.v[:, :2], truth, atol=1e-4)


def test_chassis_speeds_need_no_vehicle(write):
    source = read_body_velocities(write(log([("/drive/speeds", SPEEDS, CHASSIS)])))
    np.testing.assert_array_equal(source.velocities.v[:, :2], V)
    np.testing.assert_array_equal(source.velocities.yaw_rate, YAW)
    assert any("robot's own frame" in note for note in source.notes)


def test_a_column_map_says_which_module_is_which_wheel(write):
    """Modules back to front, whose angles are in turns of the other sense."""
    angle = -FOUR.wheel_states(V, YAW).steer[:, ::-1]
    rows = np.stack([SPEED[:, ::-1], angle], axis=2).reshape(100, -1)
    path = write(log([("s", STATE, list(zip(T_US.tolist(), doubles(rows.tolist()), strict=True)))]))
    columns = {f"speed_{name}": f"speed {3 - k}" for k, name in enumerate(WHEELS)}
    columns |= {
        f"steer_{name}": {"column": f"angle {3 - k}", "scale": -1} for k, name in enumerate(WHEELS)
    }
    source = read_body_velocities(path, vehicle=FOUR, columns=columns)
    np.testing.assert_allclose(source.velocities.v[:, :2], V, atol=1e-12)
    with pytest.raises(InputError, match=r"say which of speed 0, angle 0, .* they are; it names"):
        read_body_velocities(path, vehicle=FOUR, columns=columns | {"speed_fl": "speed 4"})


def test_what_does_not_change_is_held(write):
    """Written on change only: the robot drives on for a second and stands still for one."""
    keep = (np.arange(100) < 30) | (np.arange(100) >= 80)
    states = [row for row, kept in zip(STATES, keep, strict=True) if kept]
    source = read_body_velocities(write(log([("s", STATE, states)])), vehicle=FOUR)
    np.testing.assert_allclose(source.velocities.t, T, atol=1e-9)
    held = np.where(keep, np.arange(100), 29)
    np.testing.assert_allclose(source.velocities.v[:, :2], V[held], atol=1e-12)
    assert any("50 rows hold the value before" in note for note in source.notes)


def test_rows_are_held_up_to_a_length():
    t = np.array([0, 10, 20, 60, 70, 75, 1000])
    found, values, count = last_known(t, np.arange(7.0)[:, None], longest=0.0005)
    assert found.tolist() == [0, 10, 20, 30, 40, 50, 60, 70, 75, 1000]
    assert values[:, 0].tolist() == [0, 1, 2, 2, 2, 2, 3, 4, 5, 6]
    assert count == 3


def test_the_schema_of_the_log_counts(write):
    """Floats, and another field between."""
    schemas = SCHEMAS | {"SwerveModuleState": "float speed; int32 fault;Rotation2d angle"}
    angle = FOUR.wheel_states(V, YAW).steer
    payloads = [
        b"".join(struct.pack("<fid", s, 7, a) for s, a in zip(speeds, angles, strict=True))
        for speeds, angles in zip(SPEED, angle, strict=True)
    ]
    values = list(zip(T_US.tolist(), payloads, strict=True))
    source = read_body_velocities(write(log([("s", STATE, values)], schemas)), vehicle=FOUR)
    np.testing.assert_allclose(source.velocities.v[:, :2], V, atol=1e-6)


def test_logs_without_schemas_are_laid_out_as_usual(write):
    source = read_body_velocities(write(log([("s", STATE, STATES)], {})), vehicle=FOUR)
    np.testing.assert_allclose(source.velocities.v[:, :2], V, atol=1e-12)


def test_of_several_entries_one_is_named_and_a_command_is_told(write):
    entries = [("/drive/Setpoints", STATE, STATES), ("/drive/Measured", STATE, STATES)]
    path = write(log(entries))
    with pytest.raises(InputError, match=r"/drive/Setpoints, /drive/Measured; say which was meas"):
        read_body_velocities(path, vehicle=FOUR)
    assert (
        "/drive/Measured"
        in read_body_velocities(path, vehicle=FOUR, topic="drive/Measured").notes[0]
    )
    notes = read_body_velocities(path, vehicle=FOUR, topic="/drive/Setpoints").notes
    assert any("tells what was commanded" in note for note in notes)


@pytest.mark.parametrize(
    ("entries", "schemas", "options", "message"),
    [
        ([OTHER], {}, {"vehicle": FOUR}, r"no entry of struct:SwerveModuleState\[\].* double\[\]"),
        ([("s", STATE, STATES)], SCHEMAS, {}, "need their vehicle .--vehicle"),
        ([("s", STATE, STATES)], SCHEMAS, {"topic": "x", "vehicle": FOUR}, "no entry x of"),
        ([("s", STATE, STATES)], SCHEMAS, {"vehicle": Mecanum(0.6, 0.5)}, "4 modules that steer"),
        ([("s", STATE, STATES[:1])], SCHEMAS, {"vehicle": FOUR}, "1 usable values, two at least"),
        ([("s", STATE, STATES)], SCHEMAS, {"vehicle": FOUR, "time_unit": "ms"}, "takes no time"),
        ([("v", SPEEDS, CHASSIS)], SCHEMAS, {"columns": {"vx": "vx 0"}}, "take no column map"),
        (
            [("s", STATE, [(1, bytes(64)), (2, bytes(70))])],
            SCHEMAS,
            {"vehicle": FOUR},
            r"16 bytes each\) have 64, 70 bytes: they must be alike and whole",
        ),
        (
            [("s", STATE, STATES)],
            SCHEMAS | {"SwerveModuleState": "double speed;Rotation2d angle[4]"},
            {"vehicle": FOUR},
            "schema of SwerveModuleState has",
        ),
        (
            [("s", STATE, STATES)],
            SCHEMAS | {"SwerveModuleState": "double speed;SwerveModuleState angle"},
            {"vehicle": FOUR},
            "no schema of the struct",
        ),
        (
            [("v", SPEEDS, [(1, bytes(8)), (2, bytes(8))])],
            {"ChassisSpeeds": "double vx"},
            {},
            "its struct has no field 'vy 0'",
        ),
    ],
)
def test_what_cannot_be_told_is_refused(write, entries, schemas, options, message):
    path = write(log(entries, schemas))
    with pytest.raises(InputError, match=message) as refusal:
        read_body_velocities(path, **options)
    assert str(path) in str(refusal.value)


def test_a_log_that_was_cut_is_read_as_far_as_it_goes(write):
    content = log([("s", STATE, STATES)])
    source = read_body_velocities(write(content[:-10]), vehicle=FOUR)
    assert len(source.velocities) == 99
    assert any("bytes of a cut-off last record were left out" in note for note in source.notes)
    for size in range(40):
        with pytest.raises(InputError, match=r"robot\.wpilog"):
            read_body_velocities(write(content[:size]), vehicle=FOUR)


def test_damage_is_refused_with_its_place(write):
    content = log([("s", STATE, STATES)])
    with pytest.raises(InputError, match=r"damaged in the record at byte \d+: it is of entry 99"):
        read_wpilog(write(content + record(99, 6_000_000_000, b"x")), (STATE,))
    broken = start(9, "s", STATE)
    with pytest.raises(InputError, match="damaged in the record at byte"):
        read_wpilog(write(content + broken[:9] + b"\xff" + broken[10:]), (STATE,))
    with pytest.raises(InputError, match="no WPILib log of version 1"):
        read_wpilog(write(content[:7] + b"\x02" + content[8:]), (STATE,))


def test_times_that_go_back_are_treated_as_those_of_all_motion(write):
    states = [*STATES[:50], (STATES[10][0], STATES[50][1]), *STATES[51:]]
    content = log([("s", STATE, [])])
    content += b"".join(record(5, t, payload) for t, payload in states)
    source = read_body_velocities(write(content), vehicle=FOUR)
    assert len(source.velocities) == 99
    assert any("1 rows whose time is not between" in note for note in source.notes)


def test_a_log_is_no_table(write):
    with pytest.raises(InputError, match="is a WPILib log: --wheels and --velocities read one"):
        read_headings(write(log([])))


def test_the_logs_of_these_tests_are_read_by_the_library_of_wpilib(write):
    """Which reads, and has no writer in Python."""
    wpilog = pytest.importorskip("wpiutil.log", reason="needs robotpy-wpiutil")
    path = write(log([OTHER, ("/drive/measured", STATE, STATES)], first=300))
    started, found = {}, []
    for one in wpilog.DataLogReader(str(path)):  # a record lives as long as the loop is at it
        if one.isStart():
            told = one.getStartData()
            started[told.entry] = (told.name, told.type)
        elif not one.isControl() and started[one.getEntry()] == ("/drive/measured", STATE):
            found.append((one.getTimestamp(), bytes(one.getRaw())))
    assert found == STATES

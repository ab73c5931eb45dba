"""Wheel logs: written and read again, and refused with file, line and reason."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from data_tools.logs.vehicle_files import write_vehicle
from data_tools.logs.wheel_logs import read_wheel_log, velocities_from_files, write_wheel_log
from evcalib.errors import InputError
from evcalib.kinematics import Mecanum, Swerve, Wheel, WheelLog, WheelStates

TWO = Swerve((Wheel("a", 0.5, 0.0), Wheel("b", -0.5, 0.0)))
HEADER = "t,speed_a,steer_a,speed_b,steer_b\n"
GOOD = HEADER + "0.0,1.0,0.1,1.0,0.1\n0.1,1.0,0.1,1.0,0.1\n"


@pytest.fixture
def path(tmp_path):
    return tmp_path / "wheels.csv"


def test_columns_are_found_by_name_not_by_place(path):
    path.write_text("steer_b, speed_b,t,steer_a,speed_a\n4,3,0,2,1\n\n-4,-3,0.5,-2,-1\n")
    log = read_wheel_log(path, TWO)
    np.testing.assert_array_equal(log.t, [0, 0.5])
    np.testing.assert_array_equal(log.states.speed, [[1, 3], [-1, -3]])
    np.testing.assert_array_equal(log.states.steer, [[2, 4], [-2, -4]])


def test_a_vehicle_without_steering_needs_speeds_only(path):
    path.write_text("t,speed_fl,speed_fr,speed_rl,speed_rr\n0,1,2,3,4\n1,5,6,7,8\n")
    log = read_wheel_log(path, Mecanum(0.2, 0.2))
    np.testing.assert_array_equal(log.states.speed, [[1, 2, 3, 4], [5, 6, 7, 8]])
    assert log.states.steer is None


def test_spreadsheet_exports_are_read(path):
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert len(read_wheel_log(path, TWO)) == 2


@settings(deadline=None)
@given(
    arrays(float, (5, 4), elements=st.floats(-6, 6)),
    st.lists(st.floats(1e-6, 3), min_size=5, max_size=5),
)
def test_a_written_log_is_read_bit_by_bit(tmp_path_factory, values, steps):
    path = tmp_path_factory.getbasetemp() / "log_wheels.csv"
    log = WheelLog(1.7e9 + np.cumsum(steps), WheelStates(values[:, :2], values[:, 2:]))
    write_wheel_log(path, log, TWO)
    again = read_wheel_log(path, TWO)
    np.testing.assert_array_equal(again.t, log.t)
    np.testing.assert_array_equal(again.states.speed, log.states.speed)
    np.testing.assert_array_equal(again.states.steer, log.states.steer)


def replaced(old, new):
    assert GOOD.count(old) == 1
    return GOOD.replace(old, new)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty: its first line must name the columns"),
        ("\n\n", "is empty"),
        (HEADER, "has no row below its header; at least two are needed"),
        (HEADER + "0,1,0,1,0\n", "has one row below its header"),
        (GOOD + "0.2,1,0,1,-inf\n", "line 4: steer_b is '-inf', not a finite number"),
        (GOOD + "0.2,1,0,fast,0\n", "line 4: speed_b is 'fast', not a finite number"),
        (GOOD + "\n0.2,1,0,1\n", "line 5 has 4 values, but the first line has 5 columns"),
        (
            HEADER + 2 * "0.1,1,0,1,0\n",
            "line 3: of 2 rows the times of 1 are usable",
        ),
        (
            GOOD + "-0.5,1,0,1,0\n-0.4,1,0,1,0\n",
            "line 4: its time is 0.600 s before that of the row before: the clock was set",
        ),
        (replaced("t,speed_a", "t,t"), "names the column t twice"),
        (replaced("t,speed_a", "when,speed_a"), "lacks the column(s) t; columns must be t,"),
        (
            replaced("t,speed_a", "t,v_a"),
            "lacks the column(s) speed_a: nothing to say how wheel(s) a",
        ),
        (replaced("steer_b", "steer_c"), "wheel(s) b moved"),
        ("t,speed_a,steer_a\n0,1,0\n1,1,0\n", "speed_b, steer_b: nothing to say how wheel(s) b"),
        (replaced("steer_b\n", "steer_b,speed_c\n"), "line 2 has 5 values"),
        (
            "t,speed_a,steer_a,speed_b,steer_b,speed_c\n0,1,0,1,0,1\n1,1,0,1,0,1\n",
            "column(s) speed_c, which this vehicle does not",
        ),
        (GOOD + "0.2,400,0,1,0\n", "line 4: speed_a is 400 m/s, beyond 100 m/s"),
        (
            GOOD + "0.2,1,0,1,-45\n",
            "line 4: steer_b is -45 rad, beyond 6.283 rad; angles are in rad",
        ),
        (
            replaced("0.1,1.0,0.1,1.0", "20,1.0,0.1,1.0"),
            "which would be 0.02 s in ms; are the times in seconds? say their unit (--time-unit;",
        ),
    ],
)
def test_bad_logs_are_refused_with_file_line_and_reason(path, text, message):
    path.write_text(text)
    with pytest.raises(InputError, match=r"wheels\.csv") as refusal:
        read_wheel_log(path, TWO)
    assert message in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_files_that_are_no_text_or_not_there_are_refused(path, tmp_path):
    with pytest.raises(InputError, match=r"cannot read .*wheels\.csv: No such file"):
        read_wheel_log(path, TWO)
    with pytest.raises(InputError, match="cannot read"):
        read_wheel_log(tmp_path, TWO)
    path.write_bytes(b"\x89PNG\r\n\x1a\n\x00\xff\xfe")
    with pytest.raises(InputError, match="is not a CSV text file"):
        read_wheel_log(path, TWO)


@settings(deadline=None, max_examples=200)
@given(st.one_of(st.binary(), st.text(alphabet='t,speed_ab\n0123.e-"ni ').map(str.encode)))
def test_any_bytes_below_a_header_are_a_log_or_a_clear_refusal(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "any_wheels.csv"
    for head in (b"", HEADER.encode(), GOOD.encode()):
        path.write_bytes(head + content)
        try:
            log = read_wheel_log(path, TWO)
        except InputError:
            continue
        assert np.isfinite(log.states.speed).all()


def test_two_files_to_velocities(path, tmp_path):
    write_vehicle(tmp_path / "vehicle.yaml", TWO)
    log = WheelLog([0.0, 0.1, 0.2], TWO.wheel_states(np.tile([1.0, -0.5], (3, 1)), [0.0, 1.0, 0.0]))
    write_wheel_log(path, log, TWO)
    result = velocities_from_files(path, tmp_path / "vehicle.yaml", max_yaw_rate=0.5)
    np.testing.assert_allclose(result.velocities.v, [[1, -0.5, 0]] * 2, atol=1e-12)
    np.testing.assert_array_equal(result.velocities.t, [0.0, 0.2])
    assert (result.removed, result.over_slip) == (1, 0)

"""How a vehicle moved: any CSV by a column map, any bag, one front; clocks and units checked."""

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.logs.column_maps import column_map
from data_tools.logs.vehicle_files import write_vehicle
from data_tools.logs.velocity_sources import read_body_velocities
from data_tools.logs.wheel_logs import read_wheel_log
from evcalib.errors import InputError
from evcalib.kinematics import Mecanum, Swerve, Wheel

TWO = Swerve((Wheel("a", 0.5, 0.0), Wheel("b", -0.5, 0.0)))
V = np.array([[1.0, 0.5, 0.0], [1.2, 0.4, 0.0], [0.9, -0.3, 0.0], [0.2, -0.1, 0.0]])
YAW = np.array([0.0, 0.1, -0.2, 0.3])
STATES = TWO.wheel_states(V[:, :2], YAW)
T = np.array([10.0, 10.1, 10.25, 10.3])
MAP = {
    "t": {"column": "stamp", "unit": "ms"},
    "speed_a": {"column": "front rate", "unit": "rpm", "radius": 0.2},
    "speed_b": {"column": "rear", "unit": "km/h", "scale": -1},
    "steer_a": {"column": "front angle", "unit": "deg"},
    "steer_b": "rear angle",
}


def write_foreign(path, t=T, states=STATES):
    """Write a log in other units, with a column of words between."""
    columns = [
        t * 1e3,
        states.speed[:, 0] / 0.2 * 60 / (2 * np.pi),
        -3.6 * states.speed[:, 1],
        np.degrees(states.steer[:, 0]),
        states.steer[:, 1],
    ]
    lines = ["stamp,mode,front rate,rear,front angle,rear angle"]
    for row in zip(*columns, strict=True):
        lines.append(f"{float(row[0])!r},auto," + ",".join(repr(float(x)) for x in row[1:]))
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def csv(tmp_path):
    return tmp_path / "log.csv"


def test_a_foreign_log_is_read_by_its_map(csv, tmp_path):
    write_foreign(csv)
    log = read_wheel_log(csv, TWO, MAP)
    np.testing.assert_allclose(log.t, T, atol=1e-12)
    np.testing.assert_allclose(log.states.speed, STATES.speed, atol=1e-12)
    np.testing.assert_allclose(log.states.steer, STATES.steer, atol=1e-12)
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(MAP))
    write_vehicle(tmp_path / "vehicle.yaml", TWO)
    source = read_body_velocities(
        csv, vehicle=tmp_path / "vehicle.yaml", columns=tmp_path / "map.yaml", origin_us=10_000_000
    )
    np.testing.assert_allclose(source.velocities.v, V, atol=1e-12)
    np.testing.assert_allclose(source.velocities.yaw_rate, YAW, atol=1e-12)
    np.testing.assert_allclose(source.velocities.t, T - 10, atol=1e-9)
    assert source.wheels.removed == 0
    assert source.notes == (source.wheels.summary(),)


def test_one_radius_serves_all_wheels(csv):
    csv.write_text("t,l,r,x,y\n0,1,2,3,4\n1,1,2,3,4\n")
    names = dict(zip(("speed_fl", "speed_fr", "speed_rl", "speed_rr"), "lrxy", strict=True))
    columns = {"t": "t"} | {k: {"column": v, "unit": "rad/s"} for k, v in names.items()}
    for extra, radius in (({"wheel_radius": 0.1}, None), ({}, 0.1)):
        log = read_wheel_log(csv, Mecanum(0.2, 0.2), columns | extra, wheel_radius=radius)
        np.testing.assert_allclose(log.states.speed[0], [0.1, 0.2, 0.3, 0.4])
    with pytest.raises(InputError, match=r"speed_fl is in rad/s: give the wheel_radius"):
        read_wheel_log(csv, Mecanum(0.2, 0.2), columns)


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_velocities_in_any_unit_of_time(csv, unit):
    factor = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    rows = [f"{t * factor!r},{v[0]},{v[1]}" for t, v in zip(T.tolist(), V, strict=True)]
    csv.write_text("t,vx,vy\n" + "\n".join(rows) + "\n")
    source = read_body_velocities(csv, time_unit=unit)
    np.testing.assert_allclose(source.velocities.t, T, atol=1e-9)
    np.testing.assert_array_equal(source.velocities.v, V)
    assert (source.wheels, source.velocities.yaw_rate) == (None, None)


def test_mapped_velocities_and_the_yaw_limit(csv):
    rows = [
        f"{t},{v[0] * 1e3},{v[1] * 1e3},{np.degrees(w)},x"
        for t, v, w in zip(T, V, YAW, strict=True)
    ]
    csv.write_text("when,east,north,turn,word\n" + "\n".join(rows) + "\n")
    columns = {
        "t": "when",
        "vx": {"column": "east", "unit": "mm/s"},
        "vy": {"column": "north", "unit": "mm/s"},
        "yaw_rate": {"column": "turn", "unit": "deg/s"},
    }
    source = read_body_velocities(csv, columns=columns, max_yaw_rate=0.15)
    np.testing.assert_allclose(source.velocities.v, V[:2])
    np.testing.assert_allclose(source.velocities.yaw_rate, YAW[:2])
    assert source.notes == ("2 of 4 rows over the yaw-rate limit",)
    offset = columns | {"yaw_rate": {"column": "turn", "unit": "deg/s", "offset": 100}}
    with pytest.raises(InputError, match="all 4 rows turn faster than 1e-09 rad/s"):
        read_body_velocities(csv, columns=offset, max_yaw_rate=1e-9)
    with pytest.raises(InputError, match="which have no slip: max_slip needs wheels"):
        read_body_velocities(csv, columns=columns, max_slip=0.1)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"speed": "a"}, "speed is none of t, speed_WHEEL, steer_WHEEL, vx"),
        ({"t": 0}, "t must be a column's name or number, or like"),
        ({"t": {"unit": "s"}}, "t must be a column's name or number, or like"),
        ({"t": {"column": "a", "unit": "min"}}, "t (time) is in one of s, ms, us, ns, not 'min'"),
        ({"steer_a": {"column": "a", "unit": "m/s"}}, "steer_a (angle) is in one of rad, deg"),
        ({"vx": {"column": "a", "unit": "rad/s"}}, "vx (velocity) is in one of m/s"),
        ({"t": {"column": "a", "units": "s"}}, "t has no units; it has column, unit, scale"),
        ({"t": {"column": "a", "unit": ["s"]}}, "t (time) is in one of s, ms, us, ns, not ['s']"),
        ({"vx": {"column": "a", "scale": "two"}}, "scale of vx must be a finite number"),
        ({"vx": {"column": "a", "scale": 0}}, "scale of vx must not be 0"),
        ({"speed_a": {"column": "a", "unit": "rpm", "radius": -1}}, "must be a positive number"),
    ],
)
def test_maps_that_make_no_sense_are_refused(columns, message):
    with pytest.raises(InputError, match="column map: ") as refusal:
        column_map(columns)
    assert message in str(refusal.value)


def test_map_files_that_make_no_sense_are_refused(tmp_path):
    path = tmp_path / "map.yaml"
    with pytest.raises(InputError, match=r"cannot read .*map\.yaml"):
        column_map(path)
    bad = (("- a\n", "must hold lines"), ("a: [", "is not YAML"), ("t: {}", "t must"))
    for text, message in bad:
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            column_map(path)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda t: t / 1e6, "is the unit of the times right"),
        (lambda t: t * 1e3, "the median step of column t is .*; are the times in seconds"),
        (lambda t: t + [0, 0, 100, 100], r"line 4: its time is 100\.150 s after .* clock was"),
        (lambda t: t - [0, 0, 5, 5], r"line 4: its time is 4\.850 s before that of the row"),
        (lambda t: t[[0, 0, 0, 0]], r"line 3: 3 of 4 rows repeat the time of the row before"),
    ],
)
def test_wheel_clocks_that_jump_or_count_otherwise_are_refused(csv, edit, message):
    write_foreign(csv, t=edit(T))
    with pytest.raises(InputError, match=message) as refusal:
        read_body_velocities(csv, vehicle=TWO, columns=MAP)
    assert str(csv) in str(refusal.value)


def test_a_missing_column_or_file_is_named(csv):
    with pytest.raises(InputError, match="cannot read"):
        read_body_velocities(csv)
    write_foreign(csv)
    with pytest.raises(InputError, match=r"lacks the column\(s\) left of the column map"):
        read_body_velocities(csv, vehicle=TWO, columns=MAP | {"t": "left"})
    fewer = {name: entry for name, entry in MAP.items() if name != "steer_b"}
    with pytest.raises(InputError, match="nothing to say how wheel"):
        read_body_velocities(csv, vehicle=TWO, columns=fewer)
    with pytest.raises(InputError, match="is no bag: it has no topic /odom"):
        read_body_velocities(csv, topic="/odom")


WORDS = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.sampled_from(["a", "ms", "rad/s"]),
    lambda inner: (
        st.lists(inner, max_size=2)
        | st.dictionaries(st.sampled_from(["column", "unit", "scale", "radius", "t"]), inner)
    ),
    max_leaves=6,
)


@settings(deadline=None, max_examples=150)
@given(
    st.dictionaries(
        st.sampled_from(["t", "speed_a", "steer_b", "yaw_rate", "wheel_radius"]) | st.integers(),
        WORDS,
    )
)
def test_any_map_is_used_or_refused(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "any_map.yaml"
    path.write_text(yaml.safe_dump(content))
    for columns in (content, path):
        try:
            entries = column_map(columns)
        except InputError:
            continue
        assert all(
            np.isfinite(e.factor) and isinstance(e.column, str | int) for e in entries.values()
        )

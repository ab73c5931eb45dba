"""Tables of motion as people's tools write them: one truth, many habits."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.logs.series_files import read_headings, read_velocities
from data_tools.logs.trajectory_files import read_tum
from data_tools.logs.velocity_sources import read_body_velocities
from data_tools.logs.wheel_logs import read_wheel_log
from evcalib.errors import InputError
from evcalib.kinematics import Swerve, Wheel

TWO = Swerve((Wheel("a", 0.5, 0.0), Wheel("b", -0.5, 0.0)))
T = 10 + 0.05 * np.arange(40)
TRUE = np.column_stack([T, 1 + 0.1 * np.sin(T), 0.2 * np.cos(T), 1 + 0.1 * np.sin(T + 1), 0 * T])
NAMES = {
    "wheels": ("t", "speed_a", "steer_a", "speed_b", "steer_b"),
    "velocities": ("t", "vx", "vy", "vz", "yaw_rate"),
    "headings": ("t", "vx", "vy", "vz"),
    "trajectory": ("t", "x", "y", "z", "qx", "qy", "qz", "qw"),
}


def truth(kind):
    if kind == "headings":
        v = TRUE[:, 1:4] / np.linalg.norm(TRUE[:, 1:4], axis=1, keepdims=True)
        return np.column_stack([T, v])
    if kind == "trajectory":
        q = np.tile([0.0, 0.0, 0.6, 0.8], (T.size, 1))
        return np.column_stack([T, TRUE[:, 1:4], q])
    return TRUE


def text(kind, sep=",", point=".", quote="", end="\n", header=True, tail=""):
    lines = [sep.join(NAMES[kind]) + tail] if header else []
    for row in truth(kind).tolist():
        cells = (f"{quote}{value!r}{quote}".replace(".", point) for value in row)
        lines.append(sep.join(cells) + tail)
    return end.join(lines) + end


def read(kind, path):
    """Return the rows that a reader gives, and what it told."""
    notes = []
    if kind == "wheels":
        log = read_wheel_log(path, TWO, notes=notes)
        s = log.states
        return np.column_stack(
            [log.t, s.speed[:, 0], s.steer[:, 0], s.speed[:, 1], s.steer[:, 1]]
        ), (notes)
    if kind == "velocities":
        v = read_velocities(path, notes=notes)
        return np.column_stack([v.t, v.v, v.yaw_rate]), notes
    if kind == "headings":
        h = read_headings(path, notes)
        return np.column_stack([h.t, h.v]), notes
    poses = read_tum(path, notes)
    return np.column_stack([poses.t, poses.position, truth(kind)[: len(poses.t), 4:]]), notes


DIALECTS = {
    "plain": ({}, lambda t: t.encode(), None),
    "BOM": ({}, lambda t: b"\xef\xbb\xbf" + t.encode(), None),
    "CRLF": ({"end": "\r\n"}, lambda t: t.encode(), None),
    "CR": ({"end": "\r"}, lambda t: t.encode(), None),
    "semicolons": ({"sep": ";"}, lambda t: t.encode(), "separated by semicolons"),
    "tabs": ({"sep": "\t"}, lambda t: t.encode(), "separated by tabs"),
    "spaces": ({"sep": "  "}, lambda t: t.encode(), "separated by spaces"),
    "decimal commas": ({"sep": ";", "point": ","}, lambda t: t.encode(), "decimal commas: "),
    "commas and tabs": ({"sep": "\t", "point": ","}, lambda t: t.encode(), "decimal commas: "),
    "quoted commas": ({"point": ",", "quote": '"'}, lambda t: t.encode(), "decimal commas: "),
    "quotes": ({"quote": '"'}, lambda t: t.encode(), None),
    "sep line": ({"sep": ";"}, lambda t: ("sep=;\n" + t).encode(), None),
    "trailing": ({"tail": ",,"}, lambda t: t.encode(), None),
    "UTF-16": ({}, lambda t: t.encode("utf-16"), "UTF-16"),
    "UTF-16 without BOM": ({}, lambda t: t.encode("utf-16-le"), "UTF-16"),
    "Latin-1": ({}, lambda t: ("# M\xfcnchen\n" + t).encode("latin-1"), "Latin-1"),
    "comment first": ({}, lambda t: ("% robot 3\n\n" + t).encode(), None),
    "comment last": ({}, lambda t: (t + "# 40 rows").encode(), "1 comments between rows"),
}


@pytest.mark.parametrize("kind", list(NAMES))
@pytest.mark.parametrize("dialect", list(DIALECTS))
def test_every_reader_takes_every_dialect(tmp_path, kind, dialect):
    look, encode, told = DIALECTS[dialect]
    path = tmp_path / "log.csv"
    path.write_bytes(encode(text(kind, **look)))
    rows, notes = read(kind, path)
    np.testing.assert_allclose(rows, truth(kind), atol=1e-15)
    assert told is None or any(told in note for note in notes)


@pytest.mark.parametrize("kind", list(NAMES))
def test_without_a_header_columns_are_told_or_asked_for(tmp_path, kind):
    path = tmp_path / "log.csv"
    path.write_text(text(kind, header=False))
    if kind == "wheels":
        with pytest.raises(InputError, match=r"log\.csv line 1 holds numbers: .* in a column map"):
            read(kind, path)
    else:
        rows, notes = read(kind, path)
        np.testing.assert_allclose(rows, truth(kind), atol=1e-15)
        assert any("no header: columns are taken to be t, " in note for note in notes)
    path.write_text("# " + " ".join(NAMES[kind]) + "\n" + text(kind, " ", header=False))
    rows, notes = read(kind, path)
    np.testing.assert_allclose(rows, truth(kind), atol=1e-15)
    assert any("named by a comment: t, " in note for note in notes)


@pytest.mark.parametrize("kind", list(NAMES))
def test_one_glitch_loses_one_row_and_repeats_are_left_out(tmp_path, kind):
    path = tmp_path / "log.csv"
    head, *lines = text(kind).splitlines()
    glitch = lines[20].replace("11.0", "9999.0", 1)
    assert glitch != lines[20]
    path.write_text("\n".join([head, *lines[:20], glitch, *lines[21:], ""]))
    rows, notes = read(kind, path)
    np.testing.assert_array_equal(rows[:, 0], np.delete(T, 20))
    assert any("1 rows whose time is not between" in note and "line 22" in note for note in notes)
    path.write_text("\n".join([head, *lines[:20], lines[19], *lines[20:], ""]))
    rows, notes = read(kind, path)
    np.testing.assert_allclose(rows, truth(kind), atol=1e-15)
    assert any("1 rows with the time of the row before" in note for note in notes)
    path.write_text("\n".join([head, *lines[20:], *lines[:20], ""]))
    with pytest.raises(InputError, match="the clock was set"):
        read(kind, path)


@pytest.mark.parametrize("kind", list(NAMES))
def test_nan_leaves_out_its_row_and_infinity_is_refused(tmp_path, kind):
    path = tmp_path / "log.csv"
    head, *lines = text(kind).splitlines()
    damaged = lines[5].rsplit(",", 1)[0] + ",NaN"
    path.write_text("\n".join([head, *lines[:5], damaged, *lines[6:], ""]))
    rows, notes = read(kind, path)
    np.testing.assert_allclose(rows[:, 0], np.delete(T, 5))
    assert any("1 rows without a value" in note and "line 7" in note for note in notes)
    path.write_text("\n".join([head, damaged.replace("NaN", "inf"), *lines[6:], ""]))
    with pytest.raises(InputError, match=r"line 2: \w+ is 'inf', not a finite number"):
        read(kind, path)


def test_empty_cells_of_motion_hold_and_those_of_headings_do_not(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,vx,vy\n0,,1\n1,2,3\n2,,4\n3,5,\n")
    notes = []
    v = read_velocities(path, notes=notes)
    np.testing.assert_array_equal(v.v[:, :2], [[2, 3], [2, 4], [5, 4]])
    assert notes == [
        "2 rows with empty cells hold the value before",
        "1 rows without a value (empty or NaN) were left out (the first: line 2)",
    ]
    path.write_text("t,vx,vy,vz\n0,1,0,0\n1,,0,0\n2,0,1,0\n")
    assert read_headings(path).t.tolist() == [0, 2]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("t;vx;vy\n0;1,5;2.5\n1;2,5;3\n", "which of them is the decimal sign"),
        ("t,vx,vy\n0,0,1,5,2,5\n0,1,1,5,2,5\n", "line 2 has 6 values.*decimal commas"),
        ("t,vx,vy\n0,1,1\n#,1,1\n2,1,1\n", "line 3: a comment that looks like a damaged row"),
        ("t,vx,vy\n0,1,1\n1,1\n", "line 3 has 2 values, but the first line has 3"),
        ("t,vx,vy\n0,1,1\n1,1,1.000.000\n", r"line 3: vy is '1\.000\.000'"),
        ("t,vx,vy\n0,1,1\n1,1,1", "ends within a line"),
        ("sep=;\n", "is empty"),
    ],
)
def test_what_cannot_be_told_is_refused(tmp_path, content, message):
    (tmp_path / "v.csv").write_text(content)
    with pytest.raises(InputError, match=message):
        read_velocities(tmp_path / "v.csv")


def test_foreign_columns_are_passed_over_and_told(tmp_path):
    (tmp_path / "v.csv").write_text("t,vx,vy,temp_\u00b0C,note\n0,1,1,20,1\n1,1,1,20,2\n")
    notes = []
    assert len(read_velocities(tmp_path / "v.csv", notes=notes)) == 2
    assert notes == ["column(s) passed over: temp_\u00b0C, note"]


def test_a_clock_of_32_bits_that_starts_anew_is_mended(tmp_path):
    t = 2**32 - 500_000 + 50_000 * np.arange(40)
    rows = [f"{k % 2**32},1,0.5" for k in t.tolist()]
    (tmp_path / "v.csv").write_text("\n".join(["t,vx,vy", *rows, ""]))
    source = read_body_velocities(tmp_path / "v.csv", time_unit="us")
    np.testing.assert_allclose(np.diff(source.velocities.t), 0.05, atol=1e-9)
    assert "started anew after 2^32, 1 times" in source.notes[0]


@settings(deadline=None, max_examples=60)
@given(st.permutations(range(12)))
def test_times_that_are_kept_increase(tmp_path_factory, order):
    path = tmp_path_factory.getbasetemp() / "shuffled.csv"
    path.write_text("t,vx,vy\n" + "".join(f"{k},{k},0\n" for k in order))
    try:
        v = read_velocities(path)
    except InputError:
        return
    assert (np.diff(v.t) > 0).all()
    np.testing.assert_array_equal(v.t, v.v[:, 0])
    assert len(v) >= 11


def test_trajectories_are_told_by_their_names_whatever_the_order(tmp_path):
    path = tmp_path / "poses.csv"
    rows = "".join(f"{t},{t},2,3,0.8,0,0,0.6\n" for t in (0.0, 0.1, 0.2))
    path.write_text("timestamp,p_x,p_y,p_z,q_w,q_x,q_y,q_z\n" + rows)
    notes = []
    poses = read_tum(path, notes)
    np.testing.assert_allclose(poses.matrices[0][:2, :2], [[0.28, -0.96], [0.96, 0.28]], atol=1e-12)
    assert notes == [
        "columns: timestamp is t, p_x is x, p_y is y, p_z is z, q_x is qx, q_y is qy, q_z is qz,"
        " q_w is qw"
    ]
    path.write_text("t,a,b,c,d,e,f,g\n" + rows)
    with pytest.raises(InputError, match=r"lacks x, y, z, qx, qy, qz, qw of a TUM .*; it has t, a"):
        read_tum(path)


def test_a_row_that_is_cut_before_its_last_cell_is_not_held(tmp_path):
    (tmp_path / "v.csv").write_text("t,vx,vy\n0,1,1\n1,2,2\n2,3,")
    notes = []
    assert len(read_velocities(tmp_path / "v.csv", notes=notes)) == 2
    assert notes == ["the last line ends within its row, which was left out"]

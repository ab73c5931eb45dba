"""Files of headings and velocities: what is written comes back; what is wrong is named."""

import numpy as np
import pytest

from data_tools.logs.series_files import (
    read_headings,
    read_paired_rows,
    read_paired_streams,
    read_velocities,
    write_headings,
    write_velocities,
)
from evcalib.errors import InputError
from evcalib.series import HeadingSeries, VelocitySeries

T = np.array([0.1, 0.30000000000000004, 1 / 3])
V = np.array([[1.0, 0, 0], [0, 0.6, 0.8], [0, 0, -1]])


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"t_start": T - 0.05, "t_end": T + 0.05, "inliers": np.array([3.0, 4, 5])},
        {"weight": np.array([1.0, 0.5, 0]), "valid": np.array([True, False, True])},
    ],
    ids=["plain", "intervals", "weights"],
)
def test_headings_come_back_to_the_last_digit(tmp_path, options):
    wrote = HeadingSeries(T, V, **options)
    write_headings(tmp_path / "h.csv", wrote)
    read = read_headings(tmp_path / "h.csv")
    for name in ("t", "v", "t_start", "t_end", "weight", "inliers", "valid"):
        np.testing.assert_array_equal(getattr(read, name), getattr(wrote, name))


def test_standard_deviations_are_degrees_in_the_file(tmp_path):
    write_headings(tmp_path / "h.csv", HeadingSeries(T, V, sd=np.radians([1.0, 2, 3])))
    table = np.genfromtxt(tmp_path / "h.csv", delimiter=",", names=True)
    assert table["sd_deg"] == pytest.approx([1, 2, 3])
    assert read_headings(tmp_path / "h.csv").sd == pytest.approx(np.radians([1, 2, 3]))


def test_velocities_come_back_to_the_last_digit(tmp_path):
    wrote = VelocitySeries(T, 3.3 * V, yaw_rate=np.array([0.0, 0.1, -0.2]))
    write_velocities(tmp_path / "v.csv", wrote)
    read = read_velocities(tmp_path / "v.csv")
    for name in ("t", "v", "yaw_rate"):
        np.testing.assert_array_equal(getattr(read, name), getattr(wrote, name))


def test_velocities_need_no_vz_and_take_columns_in_any_order(tmp_path):
    (tmp_path / "v.csv").write_text("vy,t,vx\n2,0,1\n4,1,3\n")
    read = read_velocities(tmp_path / "v.csv")
    np.testing.assert_array_equal(read.v, [[1, 2, 0], [3, 4, 0]])
    assert read.yaw_rate is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,vx\n0,1\n1,1\n", "lacks the column.*vy"),
        ("t,vx,vy,yawrate\n0,1,1,1\n1,1,1,1\n", r"unknown column.*yawrate; is it yaw_rate\?"),
        ("t,vx,vy\n0,1,inf\n1,1,1\n", "line 2: vy is 'inf'"),
        ("t,vx,vy\n0,1,1\n0,1,1\n", "line 3: of 2 rows the times of 1 are usable"),
        ("t,vx,vy\n0,1,1\n1,1\n", "line 3 has 2 values"),
    ],
)
def test_bad_velocities_name_file_and_line(tmp_path, text, message):
    (tmp_path / "v.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_velocities(tmp_path / "v.csv")


def test_a_strange_validity_is_refused(tmp_path):
    (tmp_path / "h.csv").write_text("t,vx,vy,vz,valid\n0,1,0,0,1\n1,1,0,0,2\n")
    with pytest.raises(InputError, match="line 3: valid must be 0 or 1"):
        read_headings(tmp_path / "h.csv")


def paired(folder, rows, name="best_set"):
    np.savez(folder / "p.npz", **{name: np.asarray(rows, dtype=float)})
    return folder / "p.npz"


ROWS = [
    [0, 0, 1.0, 10.0, 0, 1, 0, 10.001],
    [0.6, 0, 0.8, 11.0, 0, 1, 0, 11.002],
    [-0.6, 0, 0.8, 11.0, 0, 1, 0, 11.002],
    [0, 0, -0.98, 9.0, 0, -1, 0, 9.001],
]


def test_paired_rows_become_two_sorted_streams(tmp_path):
    streams = read_paired_streams(paired(tmp_path, ROWS))
    np.testing.assert_array_equal(streams.headings.t, [9, 10, 11])
    np.testing.assert_allclose(streams.headings.v, [[0, 0, -1], [0, 0, 1], [0, 0, 1]], atol=1e-15)
    np.testing.assert_array_equal(streams.velocities.t, [9.001, 10.001, 11.002])
    assert streams.merged == 1


def test_real_rows_keep_their_number(data):
    rows = read_paired_rows(data / "evcalib" / "calib_data_time_3traj.npz")
    assert len(rows.t_e) == 59
    streams = read_paired_streams(data / "evcalib" / "calib_data_time_3traj.npz")
    assert (len(streams.headings), streams.merged) == (53, 6)


def test_other_archives_are_refused(tmp_path):
    with pytest.raises(InputError, match="holds other, not the authors' array best_set"):
        read_paired_rows(paired(tmp_path, ROWS, "other"))
    with pytest.raises(InputError, match=r"shape \(n, 8\)"):
        read_paired_rows(paired(tmp_path, np.ones((5, 7))))
    with pytest.raises(InputError, match="length 0"):
        read_paired_streams(paired(tmp_path, [[0.0] * 3 + row[3:] for row in ROWS]))


def test_an_archive_with_a_pickle_is_never_loaded(tmp_path):
    np.savez(tmp_path / "p.npz", best_set=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match="holds Python objects"):
        read_paired_rows(tmp_path / "p.npz")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04garbage", b"text"])
def test_files_that_are_no_archive_are_refused(tmp_path, content):
    (tmp_path / "p.npz").write_bytes(content)
    with pytest.raises(InputError, match="is damaged or cut off: File is not a zip"):
        read_paired_rows(tmp_path / "p.npz")

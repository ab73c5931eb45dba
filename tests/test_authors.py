"""The authors' released procedure: its published numbers, and its parts against plain twins."""

import naive_authors as naive
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from data_tools.logs.series_files import read_paired_rows
from evcalib.baselines.authors import SEARCH, PairedRows, with_alignment, without_alignment
from evcalib.errors import InputError
from evcalib.geometry import random_rotation, rotation_angle, rotation_vector_to_matrix, unit
from evcalib.kernels.baselines import authors as kernel

TRUTH = rotation_vector_to_matrix([-np.pi / 2, 0, 0])


def synthetic_rows(n=60, seed=0):
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(0, 10, n))
    angle = np.sin(t)
    v_o = np.stack([np.cos(angle), np.sin(angle), 0.1 * np.cos(2 * t)], axis=1)
    v_e = unit(v_o @ random_rotation(rng) + 0.05 * rng.standard_normal((n, 3)))
    return np.column_stack([v_e, t, v_o, t + 0.003])


# What the released script prints: degrees without and with alignment, offset [s].
@pytest.mark.parametrize(
    ("fingers", "plain", "aligned", "offset"), [(3, 2.03, 1.86, 0.248), (5, 1.82, 1.68, 0.002)]
)
def test_the_released_scripts_numbers_come_out(data, fingers, plain, aligned, offset):
    rows = read_paired_rows(data / "evcalib" / f"calib_data_time_{fingers}traj.npz")
    before, after = without_alignment(rows), with_alignment(rows)
    assert np.degrees(rotation_angle(before.R_body_cam, TRUTH)) == pytest.approx(plain, abs=0.01)
    assert np.degrees(rotation_angle(after.R_body_cam, TRUTH)) == pytest.approx(aligned, abs=0.01)
    assert after.offset == pytest.approx(offset, abs=1e-9)


# The gain is the removal of repeated rows, not the alignment in time.
@pytest.mark.parametrize(("fingers", "kabsch"), [(3, 1.88), (5, 1.68)])
def test_the_rows_that_are_kept_give_the_gain_without_any_alignment(data, fingers, kabsch):
    rows = read_paired_rows(data / "evcalib" / f"calib_data_time_{fingers}traj.npz")
    order = np.argsort(rows.t_e, kind="stable")
    kept = order[np.r_[False, np.diff(rows.t_e[order]) > 0]]
    R = without_alignment(PairedRows(*(a[kept] for a in (rows.v_e, rows.t_e, rows.v_o, rows.t_o))))
    assert np.degrees(rotation_angle(R.R_body_cam, TRUTH)) == pytest.approx(kabsch, abs=0.01)


@pytest.mark.parametrize("fingers", [3, 5])
def test_the_curve_is_that_of_the_plain_loop_on_the_real_data(data, fingers):
    rows = read_paired_rows(data / "evcalib" / f"calib_data_time_{fingers}traj.npz")
    found = with_alignment(rows, iterations=1)
    (t_e, v_e), (t_o, v_o) = (
        (t[np.unique(t, return_index=True)[1][1:]], v[np.unique(t, return_index=True)[1][1:]])
        for t, v in ((rows.t_e, rows.v_e), (rows.t_o, rows.v_o))
    )
    some = slice(None, None, 40)
    expected = naive.correlation_curve(t_e, v_e, t_o, v_o, SEARCH[some])
    # The ridge in the covariances is added alike; square roots of nearly singular ones differ.
    np.testing.assert_allclose(found.correlation[some], expected, atol=1e-4)


def test_the_curve_is_that_of_the_plain_loop_on_synthetic_rows():
    rows = PairedRows.from_rows(synthetic_rows())
    spline, offsets = CubicSpline(rows.t_o, rows.v_o), np.linspace(-0.5, 0.5, 41)
    args = (rows.t_e, rows.v_e, rows.t_o)
    found = kernel.correlation_curve(*args, np.ascontiguousarray(spline.c), offsets)
    expected = naive.correlation_curve(*args, rows.v_o, offsets)
    np.testing.assert_allclose(found, expected, atol=1e-3)
    assert np.argmax(found) == np.argmax(expected)


def test_rows_without_alignment_are_registered_by_least_squares():
    rows = PairedRows.from_rows(synthetic_rows())
    expected = Rotation.align_vectors(rows.v_o, rows.v_e)[0].as_matrix()
    assert rotation_angle(without_alignment(rows).R_body_cam, expected) < 1e-9


def test_weights_multiply_up_from_step_to_step():
    """The authors' slip, in plain Python: what was scaled is scaled again."""
    rows = PairedRows.from_rows(synthetic_rows(20))
    scaled, R = rows.v_e.copy(), Rotation.align_vectors(rows.v_o, rows.v_e)[0].as_matrix()
    for _ in range(3):
        scaled = [
            s / max(0.1, np.linalg.norm(s - R.T @ d)) for s, d in zip(scaled, rows.v_o, strict=True)
        ]
        R = kernel.kabsch(np.array(scaled), rows.v_o)
    found = kernel.multiplied_weights(rows.v_e, rows.v_o, 0.1, 4)
    assert rotation_angle(found, R) < 1e-12


def test_the_first_row_and_repeated_times_are_dropped_after_sorting():
    table = synthetic_rows(12)
    table[5] = table[4]
    table = table[np.random.default_rng(0).permutation(12)]
    assert with_alignment(PairedRows.from_rows(table), iterations=2).rows == 10


def test_the_search_takes_the_candidates_of_the_script():
    assert (SEARCH.size, SEARCH[0], SEARCH[1000], SEARCH[-1]) == (2000, -1.0, 0.0, 0.999)
    result = with_alignment(PairedRows.from_rows(synthetic_rows()), iterations=1)
    assert result.offset == result.offsets[np.argmax(result.correlation)]


def test_unusable_rows_are_refused():
    with pytest.raises(InputError, match=r"paired rows must have shape \(n, 8\), not \(12, 7\)"):
        PairedRows.from_rows(synthetic_rows(12)[:, :7])
    with pytest.raises(InputError, match="paired rows: at least 4 are needed, not 3"):
        PairedRows.from_rows(synthetic_rows(3))
    same = synthetic_rows(12)
    same[:, 3] = 1.0
    with pytest.raises(InputError, match="fewer than 4 distinct times"):
        with_alignment(PairedRows.from_rows(same))

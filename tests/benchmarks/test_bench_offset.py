"""The offset's search: ours at three lengths of data, the authors' against a plain loop.

Run with ``pytest tests/benchmarks/test_bench_offset.py --benchmark-only``.  The robust search
takes 201 candidates, +-1 s; the authors' curve takes their 2000.
"""

import naive_authors
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from data_tools.logs.series_files import read_paired_rows
from data_tools.simulation import drives
from data_tools.simulation.streams import Noise, simulate
from evcalib.alignment.offset import find_offset
from evcalib.baselines.authors import SEARCH, _sorted_unique
from evcalib.kernels.baselines import authors as kernel
from evcalib.kinematics.velocity_track import velocity_track


@pytest.mark.benchmark(group="robust search, 201 candidates")
@pytest.mark.parametrize("seconds", [20, 60, 300])
def test_find_offset(benchmark, seconds):
    made = simulate(
        drives.s_curve(float(seconds)),
        np.random.default_rng(0),
        offset=0.2,
        heading_noise=Noise(0.1, outliers=0.2),
        velocity_noise=Noise(0.02),
    )
    track = velocity_track(made.velocities)
    curve = benchmark(find_offset, made.headings, track, max_offset=1.0)
    assert curve.offset == pytest.approx(0.2, abs=0.04)
    benchmark.extra_info["headings"] = len(made.headings)


@pytest.mark.benchmark(group="velocity track")
@pytest.mark.parametrize("seconds", [20, 300])
def test_velocity_track(benchmark, seconds):
    noise = Noise(0.02)
    drive, rng = drives.s_curve(float(seconds)), np.random.default_rng(0)
    made = simulate(drive, rng, velocity_noise=noise)
    benchmark(velocity_track, made.velocities)


@pytest.fixture(scope="module")
def rows(data):
    rows = read_paired_rows(data / "evcalib" / "calib_data_time_5traj.npz")
    return *_sorted_unique(rows.t_e, rows.v_e), *_sorted_unique(rows.t_o, rows.v_o)


@pytest.mark.benchmark(group="authors' curve, 2000 candidates")
def test_authors_curve(benchmark, rows):
    curve = benchmark(ours, *rows)
    assert SEARCH[np.argmax(curve)] == pytest.approx(0.002)


@pytest.mark.benchmark(group="authors' curve, 2000 candidates")
def test_authors_curve_in_plain_numpy_and_scipy(benchmark, rows):
    curve = benchmark.pedantic(naive_authors.correlation_curve, (*rows, SEARCH), rounds=3)
    assert np.argmax(curve) == np.argmax(ours(*rows))


def ours(t_e, v_e, t_o, v_o):
    spline = CubicSpline(t_o, v_o)
    return kernel.correlation_curve(t_e, v_e, t_o, np.ascontiguousarray(spline.c), SEARCH)

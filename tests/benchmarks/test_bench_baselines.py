"""Every method on 20 s of data, and hand-eye's solvers beside each other on 50 poses.

Run with ``OPENBLAS_NUM_THREADS=1 pytest tests/benchmarks/test_bench_baselines.py
--benchmark-only``: on matrices this small, the threads of BLAS only wait for one another.
"""

import naive_hand_eye as naive
import numpy as np
import pytest
from trajectories import pair

from data_tools.simulation import drives
from data_tools.simulation.streams import Noise, simulate
from data_tools.studies.baseline_runs import reckoned_poses
from evcalib.baselines import METHODS, calibrate_with
from evcalib.baselines.cgoc import certify
from evcalib.baselines.hand_eye import closed_form, hand_eye, minimise, quadratic
from evcalib.geometry import rotation_angle
from evcalib.poses import motions

DRIVES = {"polyline": drives.polyline(), "arc": drives.arc()}


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("drive", DRIVES)
def test_method(benchmark, drive, name):
    benchmark.group = f"methods on a {drive}, 20 s"
    made = simulate(
        DRIVES[drive],
        np.random.default_rng(0),
        offset=0.2,
        heading_noise=Noise(0.1),
        velocity_noise=Noise(0.02),
    )
    streams = reckoned_poses(made.headings, made.velocities)
    found = benchmark(calibrate_with, name, streams)
    assert rotation_angle(found.R_body_cam, made.R_body_cam) < np.radians(30)


@pytest.fixture(scope="module")
def problem():
    camera, body, _, _ = pair(0, n=50, noise=0.1)
    pairs = motions(camera, body, camera.t, 0.0)
    return camera, body, quadratic(pairs), closed_form(pairs)


@pytest.mark.benchmark(group="hand-eye, 50 poses")
def test_certified_solve(benchmark, problem):
    """The semidefinite program, parametrised and compiled once; the target is 10 ms."""
    pytest.importorskip("cvxpy")
    _, certificate = benchmark(certify, problem[2])
    assert certificate.certified


@pytest.mark.benchmark(group="hand-eye, 50 poses")
def test_newton_from_the_closed_form(benchmark, problem):
    benchmark(minimise, problem[2], problem[3])


@pytest.mark.benchmark(group="hand-eye, 50 poses")
def test_whole_hand_eye(benchmark, problem):
    benchmark(hand_eye, *problem[:2])


@pytest.mark.benchmark(group="hand-eye, 50 poses")
def test_plain_scipy_from_one_start(benchmark, problem):
    once = {"starts": 1, "monocular": False}
    _, _, _, cost = benchmark.pedantic(naive.hand_eye, problem[:2], once, rounds=3)
    assert cost >= (1 - 1e-9) * hand_eye(*problem[:2], monocular=False).cost

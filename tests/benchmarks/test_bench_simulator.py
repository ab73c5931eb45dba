"""The simulator's schedule per tile against rendering all of the image at the fastest rate."""

import numpy as np
import pytest

from data_tools.simulation import _simulator_kernels as kernels
from data_tools.simulation.drives import s_curve
from data_tools.simulation.scenes import furnished_room
from data_tools.simulation.simulator import Simulator
from data_tools.simulation.trajectory import Trajectory
from evcalib.camera import Camera

GROUP = "1 s of a 0.5 m/s drive at 240x180, one thread"


@pytest.fixture(scope="module")
def simulator():
    path = Trajectory.of_drive(s_curve(1.0, period=4.0, speed=0.5))
    camera = Camera(240, 180, 200.0, 200.0, 119.5, 89.5)
    return Simulator(path, camera, furnished_room(path.position + [0.0, 0.0, 0.8], seed=1))


@pytest.mark.benchmark(group=GROUP)
def test_simulator(benchmark, simulator):
    simulator.run(threads=1)
    result = benchmark.pedantic(simulator.run, kwargs={"threads": 1}, rounds=3)
    assert len(result.events) > 100_000


@pytest.mark.benchmark(group=GROUP)
def test_whole_frames_as_often_as_the_fastest_tile(benchmark, simulator):
    view, scene, near = simulator._view, simulator._arrays, np.empty((99, 5))
    edges = np.array([0.0, 20_000.0])
    poses = simulator._poses(edges)
    tiles = range(len(view.bounds))
    steps = max(kernels.plan(k, *edges, 0.5, view, poses, scene, near)[0] for k in tiles)

    def render():
        for t in np.linspace(0.0, 1.0, 50 * steps):
            simulator.frame(t)

    benchmark.pedantic(render, rounds=1)

"""The whole chain against the time that its recording took, and what each stage costs.

Run with ``pytest tests/benchmarks/test_bench_pipeline.py --benchmark-only -s``; ten minutes of
events: ``python tests/benchmarks/stream_minutes.py --minutes 10``.
"""

import time

import numpy as np
import pytest

from data_tools.simulation.recorded_drive import VEHICLE, record_drive
from evcalib import calibrate
from evcalib.camera import Camera
from evcalib.kinematics import body_velocities

CAMERA = Camera(346, 260, 250.0, 250.0, 172.5, 129.5)


@pytest.fixture(scope="module")
def drive():
    made = record_drive(4, camera=CAMERA, duration=6.0)
    return made, list(made.simulator.stream()), body_velocities(made.wheels, VEHICLE)


@pytest.mark.benchmark(group="a drive of 6 s, from events to the calibration")
@pytest.mark.parametrize("refinement", ["none", "tracks"])
def test_chain(benchmark, drive, refinement):
    """As a multiple of real time, by the clock and by the CPU time of all threads."""
    made, parts, body = drive
    calibrate(parts, CAMERA, body, refinement=refinement)
    start = time.process_time()
    run = benchmark.pedantic(calibrate, (parts, CAMERA, body), {"refinement": refinement}, rounds=2)
    cpu = (time.process_time() - start) / 2
    seconds = 1e-6 * float(parts[-1].t[-1] - parts[0].t[0])
    events = sum(len(part) for part in parts)
    stages = ", ".join(f"{name} {spent:.2f} s" for name, spent in run.timings.items())
    benchmark.extra_info["CPU seconds per second of recording"] = round(cpu / seconds, 2)
    print(
        f"\n{refinement}: {events} events of {seconds:.2f} s in {cpu:.2f} CPU seconds ({stages});"
        f" {np.median(np.diff(run.estimate.headings.t)):.3f} s between headings"
    )

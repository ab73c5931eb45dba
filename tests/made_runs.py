"""Runs made by hand, for tests of what is drawn and written of them."""

from dataclasses import replace
from functools import cache

import numpy as np

from data_tools.simulation.drives import s_curve, straight
from data_tools.simulation.streams import Noise, simulate
from evcalib.alignment import align
from evcalib.heading import Counts, EventRate, Gap, HeadingEstimate, Snapshot
from evcalib.pipeline import CalibrationRun, Gating, InputFile, Truth
from evcalib.pipeline._run import package_versions


def snapshot(width=64, height=48):
    rng = np.random.default_rng(2)
    images = rng.integers(0, 256, (2, height, width)).astype(np.uint8)
    before = rng.uniform(5, 40, (20, 2))
    after = before[:12] + [3.0, 1.0]
    inlier = np.arange(12) < 9
    return Snapshot(1.0, 1.2, *images, before, after, before[:12], after, inlier, np.eye(3)[2])


@cache
def made_run(kind="s-curve"):
    drive = s_curve(10) if kind == "s-curve" else straight(10)
    noise = Noise(0.05, outliers=0.1)
    streams = simulate(
        drive, np.random.default_rng(3), offset=0.2, heading_noise=noise, velocity_noise=Noise(0.01)
    )
    n = len(streams.headings)
    estimate = HeadingEstimate(
        headings=streams.headings,
        covariance=np.tile(1e-3 * np.eye(3), (n, 1, 1)),
        gaps=(Gap(0.1, "too few corners"), Gap(0.2, "too few corners"), Gap(9.0, "odd")),
        counts=Counts(events=1234567, corners=4321, keyframes=n + 3, keypoints=999, weak=17),
        inlier_share=np.linspace(0.4, 1.0, n),
        event_rate=EventRate(np.array([0.0, 0.1, 0.2, 0.6, 0.7]), np.array([1, 5, 7, 9, 2]), 0.1),
        snapshot=snapshot(),
    )
    return CalibrationRun(
        calibration=align(streams.headings, streams.velocities),
        estimate=estimate,
        velocities=streams.velocities,
        gating=Gating(rows=503, over_slip=2, over_yaw_rate=1, removed=3),
        recording={"Sensor": "64 x 48 px"},
        losses={"bytes of a cut packet": 12, "events out of order": 0},
        settings={"surface": "tos_ts", "seed": 7},
        versions=package_versions(),
        timings={"headings": 2.5, "align": 0.25},
        command="evcalib calibrate recording.txt",
        files={"Recording": InputFile("recording.txt", 1234567, "ab" * 32)},
        truth=Truth(streams.R_body_cam, 0.2),
    )


def bare_run(run):
    """Return the run with nothing in it that can be left out."""
    estimate = replace(run.estimate, inlier_share=None, event_rate=None, snapshot=None, gaps=())
    return CalibrationRun(run.calibration, estimate, run.velocities)

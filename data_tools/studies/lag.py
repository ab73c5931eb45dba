"""How late the events' headings are: lags in pixels and in time, against the simulator's truth.

A lag of l pixels makes a point look as if it were where it was l / flow ago.  Where the motion
turns, that shows as an epipolar residual; its regression on l is the measure here.  It needs the
true motion, but no depth and no known corners.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from data_tools.simulation.drives import s_curve
from data_tools.simulation.scenes import furnished_room
from data_tools.simulation.sensor import Sensor
from data_tools.simulation.simulator import FORWARD, Simulator, Truth
from data_tools.simulation.trajectory import Trajectory
from data_tools.studies._engine.study import Cell, Row, Study
from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.geometry import angle_between, rotation_vector_to_matrix, unit
from evcalib.heading import Correspondences, HeadingEstimate, estimate_headings
from evcalib.series import HeadingSeries

CAMERA = Camera(240, 180, 200.0, 200.0, 119.5, 89.5)

LOOKS = {
    "forward": (0.0, 0.0, 0.0),
    "sideways": (0.0, 0.0, -np.pi / 2),
    "down": (0.0, np.pi / 6, 0.0),
    "tilted": (0.2, -0.25, 0.3),
}
"""Turns of a forward camera, as rotation vectors in the body frame [rad]."""

SLOWEST_PX = 4.0
"""Flows below this [px/s] say nothing about a lag in pixels.

A choice: the regression weighs by the square of 1 / flow, so that the slowest few would decide; the
median flows of the drives are 14 px/s and more (``notebooks/data/lag.csv``)."""

TUKEY = 4.685
"""Tukey's constant: 95 % efficiency where the noise is normal."""


@dataclass(frozen=True)
class Drive:
    """A simulated drive whose direction of travel swings by 50 degrees, every 6 s."""

    seed: int
    look: str = "forward"
    speed: float = 0.5
    duration: float = 12.0
    threshold: float = 0.2
    mismatch: float = 0.03
    noise_rate: float = 0.1

    def simulator(self) -> Simulator:
        """Return the simulator; camera and odometry share one clock."""
        drive = s_curve(self.duration, amplitude=np.radians(50), period=6.0, speed=self.speed)
        path = Trajectory.of_drive(drive)
        return Simulator(
            path,
            CAMERA,
            furnished_room(path.position, self.seed),
            rotation_vector_to_matrix(np.array(LOOKS[self.look])) @ FORWARD,
            sensor=Sensor(self.threshold, self.threshold, self.mismatch, 1e-4, self.noise_rate),
            seed=self.seed,
        )


DRIVES = {
    "forward, 0.25 m/s": Drive(101, "forward", speed=0.25),
    "forward, 0.5 m/s": Drive(102, "forward"),
    "forward, 1 m/s": Drive(103, "forward", speed=1.0),
    "down, 0.25 m/s": Drive(104, "down", speed=0.25),
    "down, 0.5 m/s": Drive(105, "down"),
    "down, 1 m/s": Drive(106, "down", speed=1.0),
    "down, 2 m/s": Drive(107, "down", speed=2.0, duration=9.0),
    "tilted": Drive(108, "tilted"),
    "sideways": Drive(109, "sideways"),
    "tilted, threshold 0.1": Drive(110, "tilted", threshold=0.1),
    "tilted, threshold 0.4": Drive(111, "tilted", threshold=0.4),
    "forward, noisy": Drive(112, "forward", mismatch=0.1, noise_rate=1.0),
    "tilted, noisy": Drive(113, "tilted", mismatch=0.1, noise_rate=1.0),
}
"""Speeds, looks, thresholds and noise, each in a scene of its own."""

LOCALISATIONS = ("corners", "images", "symmetric")
"""Ways to measure displacements, see :func:`evcalib.estimate_headings`."""

SCENES = 1000
"""What the seed of a drive's scene grows by from trial to trial; no two drives share one."""


@dataclass(frozen=True)
class Lag:
    """Lag of correspondences.

    Attributes
    ----------
    px, sd : float
        Lag along the flow [px], positive if points trail, and its standard deviation for
        independent correspondences.
    scatter : float
        Robust standard deviation of the epipolar residuals [px].
    flow : float
        Median flow [px/s].
    """

    px: float
    sd: float
    scatter: float
    flow: float


def study() -> Study:
    """Return the study; trial 0 has the scenes of `DRIVES`, whatever the seed of the study."""
    cells = tuple(Cell(name, asdict(drive)) for name, drive in DRIVES.items())
    return Study("lag", cells, trial, largest_piece=1)


def trial(parameters: Mapping[str, Any], seed: np.random.SeedSequence) -> list[Row]:
    """Return a row for each way to measure displacements."""
    scene = parameters["seed"] + SCENES * seed.spawn_key[1]
    simulator = Drive(**{**parameters, "seed": scene}).simulator()
    events = simulator.run(threads=1).events
    rows = []
    for name in LOCALISATIONS:
        estimate = estimate_headings(events, CAMERA, localisation=name, keep_correspondences=True)
        rows.append(summary(estimate, simulator, name))
    return rows


def correspondence_lag(
    found: Correspondences, simulator: Simulator, *, flows: tuple[float, float] = (0.0, np.inf)
) -> Lag:
    """Measure the lag of the inlier correspondences of some flows [px/s].

    Parameters
    ----------
    found : Correspondences
        Of a camera that does not turn.
    simulator : Simulator
        The truth.
    flows : (float, float)
        Bounds [px/s].

    Raises
    ------
    InputError
        If nothing is left, or the direction of motion never changed.
    """
    focal = simulator.camera.fx
    r1, r2, t1, t2 = (a[found.inlier] for a in (found.r1, found.r2, found.t1, found.t2))
    normal = np.cross(r1, r2)
    flow = focal * np.linalg.norm(normal, axis=1) / (t2 - t1)
    keep = (flow >= max(flows[0], SLOWEST_PX)) & (flow < flows[1])
    r1, r2, t1, t2, normal, flow = (a[keep] for a in (r1, r2, t1, t2, normal, flow))
    before, after = _truth(simulator, t1), _truth(simulator, t2)
    R_world_cam = before.R_world_cam[:1]
    moved = np.einsum("nji,nj->ni", R_world_cam, after.position - before.position)
    # A lag l stands for the times t - l / flow, at which the camera was elsewhere.
    change = -(after.v_cam - before.v_cam) / flow[:, None]
    scale = focal / np.hypot(*(np.linalg.norm(np.cross(moved, r), axis=1) for r in (r1, r2)))
    seen = np.isfinite(scale)
    residual, slope = (
        (scale * np.einsum("ni,ni->n", way, normal))[seen] for way in (moved, change)
    )
    if not seen.any() or not np.any(slope):
        raise InputError("a lag shows only where the direction of motion changes")
    lag, weight, scatter = 0.0, np.ones(residual.size), 0.0
    for _ in range(20):
        left = residual + slope * lag
        scatter = 1.4826 * float(np.median(np.abs(left)))
        weight = np.clip(1 - (left / (TUKEY * max(scatter, 1e-9))) ** 2, 0.0, None) ** 2
        lag = -float((weight * slope * residual).sum() / (weight * slope**2).sum())
    sd = scatter / float(np.sqrt((weight * slope**2).sum()))
    return Lag(lag, sd, scatter, float(np.median(flow)))


def heading_lag(headings: HeadingSeries, simulator: Simulator) -> float:
    """Return by how much the stamps of headings are late [s], from their mean error."""
    step, late = 0.005, 0.0

    def at(shift: float) -> Floats:
        return unit(_truth(simulator, headings.t - shift).v_cam)

    for _ in range(20):
        off = headings.v - at(late)
        slope = (at(late + step) - at(late - step)) / (2 * step)
        size = np.linalg.norm(off, axis=1)
        weight = (
            np.clip(1 - (size / (4 * 1.4826 * max(np.median(size), 1e-9))) ** 2, 0.0, None) ** 2
        )
        gain = (weight * np.einsum("ni,ni->n", slope, slope)).sum()
        late += float((weight * np.einsum("ni,ni->n", off, slope)).sum() / gain)
    return late


def summary(estimate: HeadingEstimate, simulator: Simulator, localisation: str) -> Row:
    """Return the lags and errors of an estimate with correspondences.

    ``heading_ms`` is by how much the stamps of the headings are late; the error of an offset from
    these headings is its negative.
    """
    if estimate.correspondences is None:
        raise InputError("the estimate needs its correspondences: keep_correspondences=True")
    lag = correspondence_lag(estimate.correspondences, simulator)
    truth = _truth(simulator, estimate.headings.t).v_cam
    off = np.degrees(angle_between(estimate.headings.v, unit(truth)))
    return {
        "localisation": localisation,
        "flow": lag.flow,
        "lag_px": lag.px,
        "lag_sd_px": lag.sd,
        "scatter_px": lag.scatter,
        "heading_ms": 1e3 * heading_lag(estimate.headings, simulator),
        "median_deg": float(np.median(off)),
        "p90_deg": float(np.percentile(off, 90)),
    }


def _truth(simulator: Simulator, t: Floats) -> Truth:
    ends = simulator.trajectory.t
    return simulator.truth(np.clip(t, ends[0], ends[-1]))

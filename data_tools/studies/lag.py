"""How late the events' headings are: lags in pixels and in time, against the simulator's truth.

    python -m data_tools.studies.lag notebooks/data/lag.csv      # some ten minutes

A lag of l pixels makes a point look as if it were where it was l / flow ago.  Where the motion
turns, that shows as an epipolar residual; its regression on l is the measure here.  It needs the
true motion, but no depth and no known corners.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from data_tools.simulation.drives import s_curve
from data_tools.simulation.scenes import furnished_room
from data_tools.simulation.sensor import Sensor
from data_tools.simulation.simulator import FORWARD, Simulator, Truth
from data_tools.simulation.trajectory import Trajectory
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
"""Flows below this [px/s] say nothing about a lag in pixels."""

TUKEY = 4.685
"""Tukey's constant."""


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


@dataclass(frozen=True)
class Row:
    """One line of the table: a drive, how displacements were measured, and what came out.

    `heading_ms` is by how much the stamps of the headings are late; the error of an offset from
    these headings is its negative.
    """

    localisation: str
    flow: float
    lag_px: float
    lag_sd_px: float
    scatter_px: float
    heading_ms: float
    median_deg: float
    p90_deg: float


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
    """Return the lags and errors of an estimate with correspondences."""
    if estimate.correspondences is None:
        raise InputError("the estimate needs its correspondences: keep_correspondences=True")
    lag = correspondence_lag(estimate.correspondences, simulator)
    truth = _truth(simulator, estimate.headings.t).v_cam
    off = np.degrees(angle_between(estimate.headings.v, unit(truth)))
    return Row(
        localisation=localisation,
        flow=lag.flow,
        lag_px=lag.px,
        lag_sd_px=lag.sd,
        scatter_px=lag.scatter,
        heading_ms=1e3 * heading_lag(estimate.headings, simulator),
        median_deg=float(np.median(off)),
        p90_deg=float(np.percentile(off, 90)),
    )


def study(
    drives: tuple[Drive, ...], localisations: tuple[str, ...] = ("corners", "images", "symmetric")
) -> Iterator[tuple[Drive, Row]]:
    """Yield a row for each drive and way to measure displacements."""
    for drive in drives:
        simulator = drive.simulator()
        events = simulator.run().events
        for name in localisations:
            estimate = estimate_headings(
                events, CAMERA, localisation=name, keep_correspondences=True
            )
            yield drive, summary(estimate, simulator, name)


def _truth(simulator: Simulator, t: Floats) -> Truth:
    ends = simulator.trajectory.t
    return simulator.truth(np.clip(t, ends[0], ends[-1]))


DRIVES = (
    Drive(101, "forward", speed=0.25),
    Drive(102, "forward"),
    Drive(103, "forward", speed=1.0),
    Drive(104, "down", speed=0.25),
    Drive(105, "down"),
    Drive(106, "down", speed=1.0),
    Drive(107, "down", speed=2.0, duration=9.0),
    Drive(108, "tilted"),
    Drive(109, "sideways"),
    Drive(110, "tilted", threshold=0.1),
    Drive(111, "tilted", threshold=0.4),
    Drive(112, "forward", mismatch=0.1, noise_rate=1.0),
    Drive(113, "tilted", mismatch=0.1, noise_rate=1.0),
)
"""Those of the stored table: speeds, looks, thresholds and noise, a new scene for each."""


def main() -> None:
    """Write the table."""
    if len(sys.argv) != 2:
        raise SystemExit(f"usage: python -m {__spec__.name} TABLE.csv")
    names = [f.name for kind in (Drive, Row) for f in fields(kind)]
    with Path(sys.argv[1]).open("w", newline="") as file:
        table = csv.DictWriter(file, names, lineterminator="\n")
        table.writeheader()
        for drive, row in study(DRIVES):
            values = {**asdict(drive), **asdict(row)}
            table.writerow({k: _short(v) for k, v in values.items()})
            file.flush()


def _short(value: object) -> object:
    return f"{value:.4g}" if isinstance(value, float) else value


if __name__ == "__main__":
    main()

"""Minutes of events through `evcalib.calibrate`: seconds, peak memory, and the result.

``python tests/benchmarks/stream_minutes.py --minutes 10`` simulates a drive of some seconds in
another process and streams it again and again, with times that go on, from a memory-mapped file.
It prints a line of JSON for each number of minutes.  The camera jumps back at the end of each
repetition, which spoils a few headings; the odometry is repeated likewise.

``--size hd --minutes 0.2 --bursts 50`` adds a light that flickers: in a tenth of each second, so
many million events per second all over a sensor of 1280x720.
"""

import argparse
import json
import multiprocessing
import resource
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from data_tools.simulation.recorded_drive import RecordedDrive, record_drive
from evcalib import calibrate
from evcalib.camera import Camera
from evcalib.events import Events
from evcalib.geometry import rotation_angle
from evcalib.series import VelocitySeries

SIZES = {
    "hd": (Camera(1280, 720, 900.0, 900.0, 639.5, 359.5), 4.0),
    "large": (Camera(346, 260, 250.0, 250.0, 172.5, 129.5), 8.0),
    "small": (Camera(96, 72, 80.0, 80.0, 47.5, 35.5), 5.0),
}
PIECE = 100_000


def drive_of(size: str) -> RecordedDrive:
    """Return the drive that is repeated."""
    camera, duration = SIZES[size]
    return record_drive(4, camera=camera, duration=duration)


def simulate(size: str, folder: Path) -> None:
    """Write the events of one repetition as columns."""
    parts = list(drive_of(size).simulator.stream())
    for name in ("x", "y", "t", "p"):
        np.save(folder / f"{name}.npy", np.concatenate([getattr(part, name) for part in parts]))


def repeated(folder: Path, camera: Camera, period_us: int, end_us: int):
    """Yield events over and over until the end."""
    x, y, t, p = (np.load(folder / f"{name}.npy", mmap_mode="r") for name in "xytp")
    size = camera.width, camera.height
    for start in range(0, end_us, period_us):
        last = int(np.searchsorted(t, end_us - start))
        for low in range(0, last, PIECE):
            rows = slice(low, min(low + PIECE, last))
            yield Events.from_arrays(x[rows], y[rows], t[rows] + start, p[rows], *size)


def flickering(parts: Iterable[Events], rate: float, rng: np.random.Generator):
    """Yield events with bursts of `rate` [events/s] in the first tenth of every second."""
    before = 0
    for part in parts:
        last = int(part.t[-1])
        burst = np.arange(before, last, 1e6 / rate).astype(np.int64) if rate else np.empty(0, int)
        burst = burst[burst % 1_000_000 < 100_000]
        before = last
        if not burst.size:
            yield part
            continue
        low = rng.integers(0, [[part.width], [part.height], [2]], (3, burst.size))
        x, y, p = (np.append(a, b) for a, b in zip((part.x, part.y, part.p), low, strict=True))
        order = np.argsort(t := np.append(part.t, burst), kind="stable")
        yield Events.from_arrays(x[order], y[order], t[order], p[order], part.width, part.height)


def velocities_of(drive: RecordedDrive, seconds: float) -> VelocitySeries:
    """Return the odometry over so long, repeated as the events are."""
    t = np.arange(0.0, seconds, 0.02)
    return VelocitySeries(t, drive.drive.velocity(t % drive.drive.duration))


def peak() -> float:
    """Return the most memory that the process has held [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def run(size: str, seconds: float, folder: Path, bursts: float) -> dict:
    """Stream and calibrate; return what it took."""
    drive, camera = drive_of(size), SIZES[size][0]
    period = round(1e6 * drive.drive.duration)
    count = 0

    def counted():
        nonlocal count
        pieces = repeated(folder, camera, period, round(1e6 * seconds))
        for part in flickering(pieces, bursts, np.random.default_rng(1)):
            count += len(part)
            yield part

    # Compilation is no part of it.
    warm = min(seconds, 6.0)
    first = repeated(folder, camera, period, round(1e6 * warm))
    calibrate(first, camera, velocities_of(drive, warm))
    before, started, cpu = peak(), time.perf_counter(), time.process_time()
    result = calibrate(counted(), camera, velocities_of(drive, seconds))
    found = result.calibration
    return {
        "seconds_of_stream": seconds,
        "million_events": round(count / 1e6, 1),
        "wall_s": round(time.perf_counter() - started, 1),
        "cpu_s": round(time.process_time() - cpu, 1),
        "stages_s": {name: round(value, 1) for name, value in result.timings.items()},
        "peak_mb_before": round(before),
        "peak_mb": round(peak()),
        "headings": len(result.estimate.headings),
        "correspondences": len(result.estimate.correspondences),
        "offset_error_ms": round(1e3 * (found.offset - drive.offset), 2),
        "offset_sd_ms": round(1e3 * found.offset_sd, 2),
        "rotation_error_deg": round(
            float(np.degrees(rotation_angle(found.R_body_cam, drive.R_body_cam))), 3
        ),
        "rotation_radius_deg": round(float(np.degrees(found.rotation_radius)), 3),
        "determined": bool(found.rotation_observable and found.offset_observable),
    }


def main() -> None:
    """Read the options, run, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, nargs="+", default=[10.0])
    parser.add_argument("--size", choices=tuple(SIZES), default="large")
    parser.add_argument("--bursts", type=float, default=0.0, help="million events per second")
    parser.add_argument("--events", type=Path, help="folder with x.npy ... of an earlier run")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.events or Path(temporary)
        if not (folder / "p.npy").exists():
            folder.mkdir(parents=True, exist_ok=True)
            process = multiprocessing.get_context("spawn").Process(
                target=simulate, args=(options.size, folder)
            )
            process.start()
            process.join()
        for minutes in options.minutes:
            print(
                json.dumps(run(options.size, 60 * minutes, folder, 1e6 * options.bursts)),
                flush=True,
            )


if __name__ == "__main__":
    main()

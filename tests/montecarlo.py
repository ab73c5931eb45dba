"""Monte-Carlo figures of the back end, as one table that anybody can make again.

``python tests/montecarlo.py --trials 300 --seed 1 [--case NAME]`` prints a row per case.  Every
trial draws its own drive, rotation, offset (+-0.5 s), clock phases and noise from the seed, the
case's name and the trial's number, so rows do not depend on which other cases run.
"""

from __future__ import annotations

import argparse
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from data_tools import motion
from evcalib.calibration import align
from evcalib.geometry import random_rotation, rotation_angle, unit
from evcalib.rotation import METHODS, estimate_rotation

HEADING_RATE, VELOCITY_RATE = 30.0, 50.0
ODOMETRY_NOISE = 0.02


@dataclass(frozen=True)
class Case:
    """One kind of drive under one kind of noise; 20 s, speed 1 m/s."""

    name: str
    noise: motion.Noise
    drive: Callable[[np.random.Generator], motion.Drive]
    method: str = "profile"
    given: bool = False
    max_offset: float = 1.0


@dataclass(frozen=True)
class Outcomes:
    """What a case's trials gave, an array per quantity."""

    offset_error: np.ndarray
    bound: np.ndarray
    offset_inside: np.ndarray
    offset_observable: np.ndarray
    rotation_error: np.ndarray
    rotation_inside: np.ndarray
    rotation_observable: np.ndarray

    @property
    def efficiency(self) -> float:
        """Root mean square error of the offset over the Cramer-Rao bound."""
        return float(np.sqrt(np.mean(self.offset_error**2) / np.mean(self.bound**2)))


def s_curve(degrees, period=8.0):
    """Return a drawer of S-curves that swing by +-degrees, of random heading and phase."""

    def draw(rng):
        heading, phase = rng.uniform(-np.pi, np.pi, 2)
        return motion.s_curve(
            amplitude=np.radians(degrees), period=period, heading=heading, phase=phase
        )

    return draw


def arc(rng):
    radius = rng.choice([-1, 1]) * rng.uniform(2, 10)
    return motion.arc(radius=radius, heading=rng.uniform(-np.pi, np.pi))


def straight(rng):
    return motion.straight(heading=rng.uniform(-np.pi, np.pi))


def zigzag(rng):
    return motion.zigzag(side=0.8, turn=np.pi / 3, turn_time=0.3)


def polyline(rng):
    return motion.polyline(heading=rng.uniform(-np.pi, np.pi))


def fingers(rng):
    return motion.fingers(rng.uniform(-np.pi, np.pi) + np.radians([0, 60, 120]))


def white(sigma, **more):
    return motion.Noise(sigma, **more)


CURVE, LIVELY = s_curve(45), s_curve(90, period=5.0)
"""The usual drive, and one lively enough for a few milliseconds from 40 % of the headings."""

ACCURACY = (
    *(Case(f"white {s:g}", white(s), CURVE) for s in (0.02, 0.05, 0.1, 0.2)),
    *(Case(f"ar1 {rho:g}", white(0.1, rho=rho), CURVE) for rho in (0.4, 0.8)),
    Case("outliers 20%", white(0.1, outliers=0.2), CURVE),
    Case("lively white 0.1", white(0.1), LIVELY),
    Case("lively outliers 60%", white(0.1, outliers=0.6), LIVELY),
    Case("lively flips 40%", white(0.1, flips=0.4), LIVELY),
)
OTHERS = (
    Case("trace, outliers 60%", white(0.1, outliers=0.6), LIVELY, method="trace"),
    Case("trace, flips 40%", white(0.1, flips=0.4), LIVELY, method="trace"),
    Case("polyline", white(0.1), polyline, max_offset=0.7),
    Case("arc", white(0.1), arc),
    Case("arc, offset given", white(0.1), arc, given=True),
    Case("straight", white(0.1), straight),
    Case("zigzag, period 1.6 s", white(0.1), zigzag, max_offset=1.5),
    Case("fingers", white(0.02), fingers),
    *(Case(f"s-curve {deg} deg", white(0.05), s_curve(deg)) for deg in (5, 10, 20)),
)
CASES = ACCURACY + OTHERS
"""The second group asks mostly what is flagged; it takes 60 trials at most."""


def trial(case: Case, rng: np.random.Generator) -> tuple[float, ...]:
    """Return one row of `Outcomes`."""
    offset = rng.uniform(-0.5, 0.5)
    streams = motion.simulate(
        case.drive(rng),
        rng,
        offset=offset,
        heading_rate=HEADING_RATE,
        velocity_rate=VELOCITY_RATE,
        heading_noise=case.noise,
        velocity_noise=motion.Noise(ODOMETRY_NOISE),
    )
    found = align(
        streams.headings,
        streams.velocities,
        max_offset=case.max_offset,
        offset_method=case.method,
        offset=offset if case.given else None,
    )
    low, high = found.offset_interval
    error = rotation_angle(found.R_body_cam, streams.R_body_cam)
    return (
        found.offset - offset,
        cramer_rao(streams, case.noise.sigma),
        low <= offset <= high,
        found.offset_observable,
        error,
        error <= found.rotation_radius,
        found.rotation_observable,
    )


def cramer_rao(streams: motion.SyntheticStreams, sigma: float) -> float:
    """Return the Cramer-Rao bound on the offset's standard deviation [s], for small white noise.

    Var = (sigma_e^2 / rate_e + sigma_o^2 / rate_o) / integral of (omega - mean omega)^2 dt: noise
    of either stream per unit of time, over how much the rate of turning changes.
    """
    t, half = streams.headings.t + streams.offset, 1e-4
    rate = (streams.drive.angle(t + half) - streams.drive.angle(t - half)) / (2 * half)
    information = np.sum((rate - rate.mean()) ** 2) / HEADING_RATE
    noise = sigma**2 / HEADING_RATE + ODOMETRY_NOISE**2 / VELOCITY_RATE
    return float(np.sqrt(noise / max(information, 1e-12)))


def run(case: Case | str, trials: int, seed: int) -> Outcomes:
    """Return what `trials` trials of a case give."""
    if isinstance(case, str):
        case = next(c for c in CASES if c.name == case)
    key = zlib.crc32(case.name.encode())
    rows = [trial(case, np.random.default_rng([seed, key, k])) for k in range(trials)]
    error, bound, inside, observable, turn, turn_inside, turned = np.array(rows).T
    flags = [flag.astype(bool) for flag in (inside, observable, turn_inside, turned)]
    return Outcomes(error, bound, flags[0], flags[1], turn, flags[2], flags[3])


SPOILS = (
    motion.Noise(0.1),
    motion.Noise(0.1, outliers=0.3),
    motion.Noise(0.1, outliers=0.6),
    motion.Noise(0.1, outliers=0.4, cluster=True),
)


def rotation_errors(method: str, noise: motion.Noise, trials: int, seed: int) -> np.ndarray:
    """Return rotation errors [rad] of a method on 300 planar directions of any azimuth.

    (Over so wide a spread a cluster of outliers does less harm than over a narrow one.)
    """
    errors = []
    for k in range(trials):
        rng = np.random.default_rng([seed, k])
        R, angle = random_rotation(rng), rng.uniform(-np.pi, np.pi, 300)
        d = np.stack([np.cos(angle), np.sin(angle), np.zeros(300)], axis=1)
        e = d @ R + noise.sigma * rng.standard_normal((300, 3))
        wrong = rng.random(300) < noise.outliers
        centre = 10 * rng.standard_normal(3) if noise.cluster else np.zeros(3)
        e[wrong] = (centre + rng.standard_normal((300, 3)))[wrong]
        found = estimate_rotation(unit(e), d, method=method)
        errors.append(rotation_angle(found.R_body_cam, R))
    return np.array(errors)


def _print_alignments(cases: Sequence[Case], trials: int, seed: int) -> None:
    print("td: offset [ms], R: rotation [deg], in: within the 95 % interval, seen: observable")
    print(
        f"{'case':21}{'trials':>7}{'td med':>8}{'rms':>7}{'/ bound':>8}{'max':>7}{'in':>8}"
        f"{'seen':>7}{'R med':>8}{'max':>8}{'in':>8}{'seen':>7}{'time':>7}"
    )
    for case in cases:
        start, count = time.perf_counter(), trials if case in ACCURACY else min(trials, 60)
        o = run(case, count, seed)
        td, turn = 1e3 * np.abs(o.offset_error), np.degrees(o.rotation_error)
        # The bound is for white noise and finite rates of turning, not for instant turns.
        bounded = case.noise == white(case.noise.sigma) and o.bound.max() < 1
        ratio = f"{o.efficiency:8.2f}" if bounded and o.offset_observable.all() else ""
        print(
            f"{case.name:21}{count:7}{np.median(td):8.1f}{np.sqrt(np.mean(td**2)):7.1f}{ratio:>8}"
            f"{td.max():7.1f}{o.offset_inside.mean():8.1%}{o.offset_observable.mean():7.0%}"
            f"{np.median(turn):8.2f}{turn.max():8.2f}{o.rotation_inside.mean():8.1%}"
            f"{o.rotation_observable.mean():7.0%}{time.perf_counter() - start:5.0f} s",
            flush=True,
        )


def _print_rotations(trials: int, seed: int) -> None:
    print(f"\nRotation methods: median error [deg], 300 pairs, sigma 0.1, {trials} trials")
    print(f"{'method':10}{'clean':>8}{'30 %':>8}{'60 %':>8}{'cluster 40 %':>14}")
    for method in METHODS:
        medians = [np.median(rotation_errors(method, noise, trials, seed)) for noise in SPOILS]
        print(method.ljust(10) + "{:8.2f}{:8.2f}{:8.2f}{:14.2f}".format(*np.degrees(medians)))


def main() -> None:
    parser = argparse.ArgumentParser(description="Make the Monte-Carlo figures again.")
    parser.add_argument("--trials", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--case", choices=[*(c.name for c in CASES), "rotation"], help="one only")
    options = parser.parse_args()
    cases = [c for c in CASES if options.case in (None, c.name)]
    if cases:
        _print_alignments(cases, options.trials, options.seed)
    if options.case in (None, "rotation"):
        _print_rotations(options.trials, options.seed)


if __name__ == "__main__":
    main()

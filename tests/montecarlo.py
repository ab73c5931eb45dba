"""Monte-Carlo figures of the back end, as one table that anybody can make again.

``python tests/montecarlo.py --trials 300 --seed 1 [--case NAME]`` prints a row per case.  Every
trial draws its own drive, rotation, offset (+-0.5 s), clock phases and noise from the seed, the
case's name and the trial's number, so rows do not depend on which other cases run.
"""

from __future__ import annotations

import argparse
import time
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_tools.simulation.streams import Noise
from data_tools.studies import Cell
from data_tools.studies.coverage import ACCURACY, CASES, outcome
from evcalib.alignment.rotation import METHODS, estimate_rotation
from evcalib.geometry import random_rotation, rotation_angle, unit


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


def run(case: Cell | str, trials: int, seed: int) -> Outcomes:
    """Return what `trials` trials of a case of `data_tools.studies.coverage` give."""
    if isinstance(case, str):
        case = next(c for c in CASES if c.group == case)
    key = zlib.crc32(case.group.encode())
    rows = [outcome(case.parameters, np.random.default_rng([seed, key, k])) for k in range(trials)]

    def column(name: str) -> np.ndarray:
        return np.array([row[name] for row in rows])

    return Outcomes(
        column("offset_error_s"),
        column("bound_s"),
        column("offset_inside"),
        column("offset_observable"),
        np.radians(column("rotation_deg")),
        column("rotation_inside"),
        column("rotation_observable"),
    )


SPOILS = (
    Noise(0.1),
    Noise(0.1, outliers=0.3),
    Noise(0.1, outliers=0.6),
    Noise(0.1, outliers=0.4, cluster=True),
)


def rotation_errors(method: str, noise: Noise, trials: int, seed: int) -> np.ndarray:
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


def _print_alignments(cases: Sequence[Cell], trials: int, seed: int) -> None:
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
        bounded = list(case.parameters["heading_noise"]) == ["sigma"] and o.bound.max() < 1
        ratio = f"{o.efficiency:8.2f}" if bounded and o.offset_observable.all() else ""
        print(
            f"{case.group:21}{count:7}{np.median(td):8.1f}{np.sqrt(np.mean(td**2)):7.1f}{ratio:>8}"
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
    parser.add_argument("--case", choices=[*(c.group for c in CASES), "rotation"], help="one only")
    options = parser.parse_args()
    cases = [c for c in CASES if options.case in (None, c.group)]
    if cases:
        _print_alignments(cases, options.trials, options.seed)
    if options.case in (None, "rotation"):
        _print_rotations(options.trials, options.seed)


if __name__ == "__main__":
    main()

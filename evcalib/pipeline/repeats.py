"""Calibrations of one rig from several runs: whether they agree, and what they say together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy import stats

from evcalib import checks
from evcalib.arrays import Floats
from evcalib.display import Rows, Shown
from evcalib.errors import InputError
from evcalib.geometry import rotation_vector, rotation_vector_to_matrix, rpy_text
from evcalib.joint import Systematic
from evcalib.pipeline._assessment import RefinedCalibration
from evcalib.uncertainty import Agreement, agreement, rotation_radius

LEVEL = 0.05
"""Chance that runs which agree are called contradictory, over all unknowns together.  A choice, the
one of 95 % intervals; the unknowns share it by Holm's rule."""

OWN = 0.1
"""Least share of a run's variance that is its own.  A choice: with less, a run whose error bars are
all but those that all share would outweigh every other."""

STEPS = 5
"""Rounds of the mean on the sphere of rotations: each squares the error of the last, of radians."""

DRIFTS = 0.01
"""Chance that answers which do not change are said to drift from run to run.  A choice, stricter
than `LEVEL`: that they contradict each other is told anyway."""


@dataclass(frozen=True, eq=False)
class RunAnswer(Shown):
    """What one run says, its error split into what is its own and what all runs share.

    Attributes
    ----------
    name : str
        Of the run.
    R_body_cam : ndarray, shape (3, 3)
        Its rotation.
    rotation_covariance : ndarray, shape (3, 3)
        Of the rotation vector in the body frame, its own part [rad^2].
    offset, offset_sd : float
        Its offset, and the standard deviation of its own part [s].
    samples : float
        Independent stretches of motion behind both.
    rotation_determined, offset_determined : bool
        Whether the run determines them; what it does not is left out.
    shared_rotation_sd, shared_offset_sd : float
        Standard deviation per axis [rad], and of the offset [s], of what all runs of a rig share.
    start : float, optional
        When it began [s], on a clock that all runs share.

    Raises
    ------
    InputError
        If an error bar is not positive.
    """

    name: str
    R_body_cam: Floats
    rotation_covariance: Floats
    offset: float
    offset_sd: float
    samples: float
    rotation_determined: bool = True
    offset_determined: bool = True
    shared_rotation_sd: float = 0.0
    shared_offset_sd: float = 0.0
    start: float | None = None

    def __post_init__(self) -> None:
        checks.positive(self.offset_sd, f"offset_sd of {self.name}", "s")
        checks.positive(self.samples, f"samples of {self.name}")
        covariance = checks.floats(self.rotation_covariance, f"covariance of {self.name}", (3, 3))
        if not np.linalg.eigvalsh(covariance)[0] > 0:
            raise InputError(f"the rotation covariance of {self.name} is none: it must be positive")

    @classmethod
    def of(cls, name: str, calibration: RefinedCalibration, systematic: Systematic) -> Self:
        """Take a run's answer out of its calibration; only refined ones hold a shared part."""
        refined = calibration.joint is not None
        return cls.split(
            name,
            calibration.R_body_cam,
            calibration.rotation_covariance,
            calibration.offset,
            calibration.offset_sd,
            samples=calibration.samples,
            rotation_determined=calibration.rotation_observable,
            offset_determined=calibration.offset_observable,
            shared_rotation_sd=systematic.rotation_sd if refined else 0.0,
            shared_offset_sd=systematic.time_sd if refined else 0.0,
        )

    @classmethod
    def split(
        cls,
        name: str,
        R_body_cam: Floats,
        rotation_covariance: Floats,
        offset: float,
        offset_sd: float,
        *,
        shared_rotation_sd: float,
        shared_offset_sd: float,
        **more: Any,
    ) -> Self:
        """Take the shared part out of whole error bars; `OWN` of each is left at least.

        A rotation that was kept from the alignment holds no shared part: what is left of it must
        not become nothing, or less.
        """
        values, axes = np.linalg.eigh(rotation_covariance)
        own = np.maximum(values - shared_rotation_sd**2, OWN * values)
        return cls(
            name=name,
            R_body_cam=R_body_cam,
            rotation_covariance=(axes * own) @ axes.T,
            offset=offset,
            offset_sd=math.sqrt(max(offset_sd**2 - shared_offset_sd**2, OWN * offset_sd**2)),
            shared_rotation_sd=shared_rotation_sd,
            shared_offset_sd=shared_offset_sd,
            **more,
        )

    @property
    def dof(self) -> float:
        """Degrees of freedom behind the covariances, as those of `t_quantile`."""
        return max(2.0 * self.samples - 4.0, 1.0)


@dataclass(frozen=True, eq=False)
class UnknownAgreement(Shown):
    """What the runs say of one unknown.

    Attributes
    ----------
    runs : tuple of str
        Those that determine it.
    agreement : Agreement
        Of their answers: offsets [s], or rotation vectors from the pooled rotation [rad].
    contradict : bool
        Whether they differ by more than their error bars explain.
    odd : str, optional
        The run that stands out, where all others agree without it.
    trend : float
        Change per run, or per hour where all starts are known, at its largest component.
    trend_p : float
        Probability of such a trend by chance; 1 with fewer than three runs.
    """

    runs: tuple[str, ...]
    agreement: Agreement
    contradict: bool
    odd: str | None
    trend: float
    trend_p: float


@dataclass(frozen=True, eq=False)
class Repeats(Shown):
    """Several runs of one rig together.

    Attributes
    ----------
    runs : tuple of RunAnswer
        As given.
    R_body_cam : ndarray, shape (3, 3), optional
        Pooled rotation; None where fewer than two runs determine it.
    rotation_sd : ndarray, shape (3,), optional
        Its standard deviation about the body's axes [rad], shared part included.
    rotation_radius : float
        Angle [rad] that its error stays below with 95 % probability.
    offset, offset_sd : float
        Pooled offset [s] and its standard deviation, shared part included; NaN where fewer than
        two runs determine it.
    unknowns : dict
        ``offset`` and ``rotation`` to `UnknownAgreement`.
    """

    runs: tuple[RunAnswer, ...]
    R_body_cam: Floats | None
    rotation_sd: Floats | None
    rotation_radius: float
    offset: float
    offset_sd: float
    unknowns: dict[str, UnknownAgreement]

    @property
    def contradict(self) -> bool:
        """Whether the runs contradict each other in any unknown."""
        return any(one.contradict for one in self.unknowns.values())

    def lines(self) -> list[str]:
        """Return what there is to say, a sentence each."""
        said = []
        for name, one in self.unknowns.items():
            many = f"The {name}s of {len(one.runs)} runs"
            chance = f"(probability by chance {one.agreement.p_value:.2g})"
            if not one.contradict:
                said.append(f"{many} agree within their error bars {chance}.")
            elif one.odd is not None:
                said.append(
                    f"{many} contradict each other {chance}: {one.odd} is off, the others agree."
                )
            else:
                said.append(f"{many} contradict each other {chance}, and not because of one.")
            if one.trend_p < DRIFTS:
                unit = "hour" if _timed(self.runs) else "run"
                amount = f"{1e3 * one.trend:+.2f} ms" if name == "offset" else (
                    f"{np.degrees(one.trend):+.3f} deg")  # fmt: skip
                said.append(
                    f"The {name} drifts by {amount} per {unit}"
                    f" (probability by chance {one.trend_p:.2g})."
                )
        if self.contradict:
            said.append("Do not use the pooled answer of what contradicts itself.")
        for name in ("offset", "rotation"):
            without = [r.name for r in self.runs if not getattr(r, f"{name}_determined")]
            if without:
                said.append(f"The {name} is not determined by, and taken without: "
                            + ", ".join(without) + ".")  # fmt: skip
        return said

    def _shown_rows(self) -> Rows:
        rows = [("runs", str(len(self.runs)))]
        if "offset" in self.unknowns:
            rows.append(("time offset", f"{self.offset:+.4f} s +- {self.offset_sd:.4f} s (sd)"))
        if self.R_body_cam is not None:
            sure = f"error below {np.degrees(self.rotation_radius):.2f} deg (95 %)"
            rows.append(("R_body_cam", f"{rpy_text(self.R_body_cam)}, {sure}"))
        return [*rows, *(("", line) for line in self.lines())]


def compare_runs(runs: Sequence[RunAnswer]) -> Repeats:
    """Test whether the answers of several runs agree, and pool them.

    Parameters
    ----------
    runs : sequence of RunAnswer
        At least two.

    Returns
    -------
    Repeats
        Where they contradict each other the pooled answer stands, but should not be used.

    Raises
    ------
    InputError
        If there are fewer than two runs, or none of the unknowns is determined by two.
    """
    for run in runs:
        checks.instance(run, "run", RunAnswer)
    if len(runs) < 2:
        raise InputError(f"two runs or more can be compared, not {len(runs)}")
    asked: dict[str, _Answers] = {}
    offset, offset_sd = np.nan, np.nan
    chosen = [run for run in runs if run.offset_determined]
    if len(chosen) > 1:
        asked["offset"] = found = _Answers.of(
            chosen,
            np.array([[run.offset] for run in chosen]),
            np.array([[[run.offset_sd**2]] for run in chosen]),
        )
        shared = max(run.shared_offset_sd for run in chosen)
        offset = float(found.agreement.pooled[0])
        offset_sd = float(np.hypot(np.sqrt(found.agreement.covariance[0, 0]), shared))
    R, sd, radius = None, None, np.pi
    chosen = [run for run in runs if run.rotation_determined]
    if len(chosen) > 1:
        R, asked["rotation"] = _rotations(chosen)
        shared = max(run.shared_rotation_sd for run in chosen)
        covariance = asked["rotation"].agreement.covariance + shared**2 * np.eye(3)
        sd = np.sqrt(np.diag(covariance))
        radius = rotation_radius(covariance, 0.95, sum(run.samples for run in chosen))
    if not asked:
        raise InputError("no two of the runs determine the offset, or the rotation")
    return Repeats(tuple(runs), R, sd, float(radius), offset, offset_sd, _judged(asked))


@dataclass(frozen=True, eq=False)
class _Answers:
    """Answers of some runs to one question, with the test of their agreement."""

    runs: list[RunAnswer]
    values: Floats
    covariances: Floats
    agreement: Agreement

    @classmethod
    def of(cls, runs: list[RunAnswer], values: Floats, covariances: Floats) -> _Answers:
        """Test the answers."""
        dof = np.array([run.dof for run in runs])
        return cls(runs, values, covariances, agreement(values, covariances, dof))

    def odd(self) -> str | None:
        """Return the run that stands out, if the others, two or more, agree without it."""
        odd = self.agreement.odd
        kept = self.runs[:odd] + self.runs[odd + 1 :]
        if len(kept) < 2:
            return None
        values, covariances = (np.delete(a, odd, 0) for a in (self.values, self.covariances))
        rest = _Answers.of(kept, values, covariances)
        return self.runs[odd].name if rest.agreement.p_value >= LEVEL else None

    def trend(self) -> tuple[float, float]:
        """Return the slope over hours, or over runs, of its surest component, and its chance."""
        k, p = self.values.shape
        at = np.arange(k, dtype=np.float64)
        if _timed(self.runs):
            at = np.array([run.start for run in self.runs], dtype=np.float64) / 3600.0
        if k < 3 or np.ptp(at) == 0:
            return 0.0, 1.0
        # Weighted least squares of intercept and slope, both of p components.
        design = np.stack([np.hstack([np.eye(p), (a - at.mean()) * np.eye(p)]) for a in at])
        weights = np.linalg.inv(self.covariances)
        covariance = np.linalg.inv(np.einsum("kai,kab,kbj->ij", design, weights, design))
        both = covariance @ np.einsum("kai,kab,kb->i", design, weights, self.values)
        slope, spread = both[p:], covariance[p:, p:]
        square = float(slope @ np.linalg.solve(spread, slope)) / p
        dof = sum(run.dof for run in self.runs)
        surest = int(np.argmax(np.abs(slope) / np.sqrt(np.diag(spread))))
        return float(slope[surest]), float(stats.f.sf(square, p, dof))


def _timed(runs: Sequence[RunAnswer]) -> bool:
    return all(run.start is not None for run in runs)


def _rotations(runs: list[RunAnswer]) -> tuple[Floats, _Answers]:
    """Return the pooled rotation, and the runs' rotation vectors from it."""
    R = runs[0].R_body_cam
    covariances = np.array([run.rotation_covariance for run in runs])
    for _ in range(STEPS):
        values = np.array([rotation_vector(run.R_body_cam @ R.T) for run in runs])
        answers = _Answers.of(runs, values, covariances)
        R = rotation_vector_to_matrix(answers.agreement.pooled) @ R
    return R, answers


def _judged(asked: dict[str, _Answers]) -> dict[str, UnknownAgreement]:
    """Return what the runs say of each unknown, `LEVEL` shared among them (Holm 1979)."""
    order = sorted(asked, key=lambda name: asked[name].agreement.p_value)
    judged, refused = {}, True
    for place, name in enumerate(order):
        answers = asked[name]
        refused = refused and answers.agreement.p_value < LEVEL / (len(order) - place)
        trend, chance = answers.trend()
        judged[name] = UnknownAgreement(
            runs=tuple(run.name for run in answers.runs),
            agreement=answers.agreement,
            contradict=refused,
            odd=answers.odd() if refused else None,
            trend=trend,
            trend_p=chance,
        )
    return {name: judged[name] for name in asked}

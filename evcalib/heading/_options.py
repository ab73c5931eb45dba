"""The options of a heading estimate: told once, checked once."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

from evcalib import checks
from evcalib.errors import InputError
from evcalib.features import LAST
from evcalib.features.corners import DETECTORS
from evcalib.heading._translation import Translation
from evcalib.heading.epipolar import five_point, two_point
from evcalib.surfaces import SURFACES

LOCALISATIONS: dict[str, float | None] = {"symmetric": LAST, "images": 1.0, "corners": None}
"""Where matches are measured, and the weight of last events in event images if on these."""

SOLVERS: dict[str, Callable[..., Translation | None]] = {
    "two_point": two_point,
    "five_point": five_point,
}
"""The solvers by their short names."""

MAX_STEPS = 128
"""Spans of keyframe pairs stay below this number of steps, so that one number holds both."""

_CHOICES: dict[str, Iterable[str]] = {
    "surface": SURFACES,
    "detector": DETECTORS,
    "localisation": LOCALISATIONS,
    "solver": SOLVERS,
}
_POSITIVE = {
    "rate": "hertz",
    "max_baseline": "seconds",
    "threshold": "pixels",
    "min_inliers": "",
    "max_sd": "degrees",
    "enough_sd": "degrees",
}


@dataclass(frozen=True)
class HeadingOptions:
    """How headings are estimated from events; see `estimate_headings`.

    Attributes
    ----------
    surface : {"tos_ts", "tos", "ts", "silc", "dist"}
        Where keypoints are described, polarities merged.
    detector : {"arc_star", "harris"}
        Which events are corners: see `evcalib.features.corners`.
    localisation : {"symmetric", "images", "corners"}
        How the displacement of matched corners is measured.  By alignment of patches of two event
        images, weighed so that lags of the events cancel (see `evcalib.features.align_patches`);
        the same without these weights; or between mean places of corner events, at their mean
        times.
    solver : {"two_point", "five_point"}
        A camera that does not turn, over all pairs; or the essential matrix of the one pair of
        most displacement, as in the paper.
    rate : float
        Keyframes per second [Hz].
    max_baseline : float
        Longest time between matched keyframes [s].
    threshold : float
        Largest epipolar residual of an inlier [px].
    min_inliers : int
        Fewest inliers of a heading.
    max_sd : float
        Largest standard deviation of a heading [deg].
    enough_sd : float
        The longest spans are left out as long as the standard deviation of a heading, by the
        scatter of its matches alone, stays below this [deg]: shorter spans follow a changing
        direction better.
    seed : int
        Of the descriptor's pattern and of the solver's samples.
    keep_correspondences : bool
        Keep the matches behind the headings; of a long recording those of some corners.
    denoise : bool
        Leave out what the sensor makes of itself, where it makes much; see
        `evcalib.filters.Denoiser`.  Never on sensors of fewer than 10,000 pixels.

    Raises
    ------
    InputError
        If an option is unusable.

    Notes
    -----
    The defaults of the numbers are choices, not fitted to data: half or double of `rate`,
    `max_baseline`, `threshold`, `min_inliers` or `enough_sd` gives the same heading of a simulated
    drive to half a degree (``tests/test_heading_thresholds.py``).
    """

    surface: str = "tos_ts"
    detector: str = "arc_star"
    localisation: str = "symmetric"
    solver: str = "two_point"
    rate: float = 20.0
    max_baseline: float = 0.7
    threshold: float = 1.5
    min_inliers: int = 20
    max_sd: float = 3.0
    enough_sd: float = 0.2
    seed: int = 0
    keep_correspondences: bool = False
    denoise: bool = True

    def __post_init__(self) -> None:
        for name, choices in _CHOICES.items():
            checks.one_of(getattr(self, name), name, tuple(choices))
        for name, unit in _POSITIVE.items():
            object.__setattr__(self, name, checks.positive(getattr(self, name), name, unit))
        if not 0.1 <= self.rate <= 1000:
            raise InputError(f"rate must be 0.1 to 1000 hertz, not {self.rate!r}")
        if not 1 <= self.steps < MAX_STEPS:
            raise InputError(
                f"max_baseline must be 1 to {MAX_STEPS - 1} keyframe intervals, not {self.steps}"
                f" ({self.max_baseline} s at {self.rate} hertz)"
            )

    @property
    def step_us(self) -> int:
        """Time between keyframes [us]."""
        return round(1e6 / self.rate)

    @property
    def step(self) -> float:
        """Time between keyframes [s]."""
        return self.step_us * 1e-6

    @property
    def steps(self) -> int:
        """Most keyframe intervals between matched keyframes."""
        return round(self.max_baseline * self.rate)


F = TypeVar("F", bound=Callable[..., Any])


def takes_options(function: F) -> F:
    """Name the options in the signature of a function that passes its keywords on to them."""
    signature, options = inspect.signature(function), inspect.signature(HeadingOptions)
    own = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
    named = [p.replace(kind=p.KEYWORD_ONLY) for p in options.parameters.values()]
    function.__signature__ = signature.replace(parameters=[*own, *named])  # type: ignore[attr-defined]
    return function

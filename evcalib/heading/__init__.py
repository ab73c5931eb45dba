"""Matches over many baselines to the direction of motion, with its covariance."""

from evcalib._moved import leftovers
from evcalib.heading._correspondences import Correspondences
from evcalib.heading._estimator import REACH, HeadingEstimator, estimate_headings
from evcalib.heading._keyframes import Counts
from evcalib.heading._matches import CELL_PX, MAX_STEPS, Matches
from evcalib.heading._result import Gap, HeadingEstimate, collected
from evcalib.heading._snapshot import EventRate, Snapshot
from evcalib.heading._translation import Translation
from evcalib.heading._window_fit import SOLVERS, FitOptions
from evcalib.heading._windows import HeadingWindows

__all__ = [
    "CELL_PX",
    "MAX_STEPS",
    "REACH",
    "SOLVERS",
    "Correspondences",
    "Counts",
    "EventRate",
    "FitOptions",
    "Gap",
    "HeadingEstimate",
    "HeadingEstimator",
    "HeadingWindows",
    "Matches",
    "Snapshot",
    "Translation",
    "collected",
    "estimate_headings",
]

__getattr__ = leftovers(__name__)

"""Matches over many baselines to the direction of motion, with its covariance."""

from evcalib._moved import leftovers
from evcalib.heading._correspondences import Correspondences
from evcalib.heading._estimator import HeadingEstimator, estimate_headings
from evcalib.heading._keyframes import REACH, Counts
from evcalib.heading._matches import KeyframeMatches, Matches
from evcalib.heading._options import HeadingOptions
from evcalib.heading._result import Gap, HeadingEstimate
from evcalib.heading._snapshot import EventRate, Snapshot
from evcalib.heading._translation import Translation
from evcalib.heading._windows import HeadingWindows

__all__ = [
    "REACH",
    "Correspondences",
    "Counts",
    "EventRate",
    "Gap",
    "HeadingEstimate",
    "HeadingEstimator",
    "HeadingOptions",
    "HeadingWindows",
    "KeyframeMatches",
    "Matches",
    "Snapshot",
    "Translation",
    "estimate_headings",
]

__getattr__ = leftovers(__name__)

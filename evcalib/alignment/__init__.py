"""Headings and velocities to offset, rotation, error bars and verdict."""

from evcalib.alignment._align import align
from evcalib.alignment._evidence import one_answer, unknown_axis
from evcalib.alignment._result import Calibration
from evcalib.alignment._stream_pair import (
    MIN_OVERLAP,
    covered_at_all,
    intervals,
    no_overlap,
    weights,
)

__all__ = [
    "MIN_OVERLAP",
    "Calibration",
    "align",
    "covered_at_all",
    "intervals",
    "no_overlap",
    "one_answer",
    "unknown_axis",
    "weights",
]

"""Headings and velocities to offset, rotation, error bars and verdict."""

from evcalib.alignment._align import align
from evcalib.alignment._answers import OffsetAnswer, RotationAnswer
from evcalib.alignment._evidence import one_answer, unknown_axis
from evcalib.alignment._result import Calibration
from evcalib.alignment._stream_pair import MIN_OVERLAP, StreamPair, enough

__all__ = [
    "MIN_OVERLAP",
    "Calibration",
    "OffsetAnswer",
    "RotationAnswer",
    "StreamPair",
    "align",
    "enough",
    "one_answer",
    "unknown_axis",
]

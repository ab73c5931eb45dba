"""Raw events and velocities to a calibration in one call, and its last judgement."""

from evcalib._moved import leftovers
from evcalib.pipeline._assessment import RefinedCalibration, finish, position_text
from evcalib.pipeline._calibrate import calibrate, calibrate_estimate
from evcalib.pipeline._position import Unknown
from evcalib.pipeline._run import CalibrationRun, Gating, InputFile, Truth
from evcalib.pipeline.repeats import Repeats, RunAnswer, compare_runs

__all__ = [
    "CalibrationRun",
    "Gating",
    "InputFile",
    "RefinedCalibration",
    "Repeats",
    "RunAnswer",
    "Truth",
    "Unknown",
    "calibrate",
    "calibrate_estimate",
    "compare_runs",
    "finish",
    "position_text",
]

__getattr__ = leftovers(__name__)

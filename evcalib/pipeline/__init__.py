"""Raw events and velocities to a calibration in one call, and its last judgement."""

from evcalib._moved import leftovers
from evcalib.pipeline._assessment import RefinedCalibration, finish, position_text
from evcalib.pipeline._calibrate import calibrate, calibrate_estimate
from evcalib.pipeline._position import Unknown
from evcalib.pipeline._run import CalibrationRun, Gating, InputFile, Truth

__all__ = [
    "CalibrationRun",
    "Gating",
    "InputFile",
    "RefinedCalibration",
    "Truth",
    "Unknown",
    "calibrate",
    "calibrate_estimate",
    "finish",
    "position_text",
]

__getattr__ = leftovers(__name__)

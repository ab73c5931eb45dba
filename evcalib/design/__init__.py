"""What a drive will tell, before anyone drives it."""

from evcalib._moved import leftovers
from evcalib.design._information import Viewing
from evcalib.design._legs import Limits
from evcalib.design._planning import Bars, Command, Plan, plan
from evcalib.design._prediction import (
    POSITION_GATE,
    REPEATS,
    ROTATION_GATE,
    Prediction,
    predict,
    self_likeness,
)

__all__ = [
    "POSITION_GATE",
    "REPEATS",
    "ROTATION_GATE",
    "Bars",
    "Command",
    "Limits",
    "Plan",
    "Prediction",
    "Viewing",
    "plan",
    "predict",
    "self_likeness",
]

__getattr__ = leftovers(__name__)

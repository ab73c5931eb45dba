"""What a drive will tell, before anyone drives it."""

from evcalib._moved import leftovers
from evcalib.design._information import Viewing
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
    "Prediction",
    "Viewing",
    "predict",
    "self_likeness",
]

__getattr__ = leftovers(__name__)

"""All observations of all corners to rotation, offset and position at once."""

from evcalib._moved import leftovers
from evcalib.joint._global_start import Start, global_start
from evcalib.joint._model_checks import SURE
from evcalib.joint._refine import refine_jointly
from evcalib.joint._result import SYSTEMATIC, JointRefinement, Systematic
from evcalib.joint._world_motion import NO_YAW_RATE

__all__ = [
    "NO_YAW_RATE",
    "SURE",
    "SYSTEMATIC",
    "JointRefinement",
    "Start",
    "Systematic",
    "global_start",
    "refine_jointly",
]

__getattr__ = leftovers(__name__)

"""Image-like surfaces of events: TS, TOS, SILC, DiST, and TOS AND TS.

Each comes as a class, which takes a long recording piece by piece with `update` and gives its
image at any time with `render`, and as a function, which does both at once.  Images have shape
(height, width), or (2, height, width) for OFF and ON with ``polarity="split"``.
"""

from evcalib.surfaces._base import Surface
from evcalib.surfaces._dist import Dist, dist
from evcalib.surfaces._names import SURFACES
from evcalib.surfaces._silc import Silc, silc
from evcalib.surfaces._time import TimeSurface, time_surface
from evcalib.surfaces._tos import Tos, tos
from evcalib.surfaces._tos_ts import TosTs, tos_ts

__all__ = [
    "SURFACES",
    "Dist",
    "Silc",
    "Surface",
    "TimeSurface",
    "Tos",
    "TosTs",
    "dist",
    "silc",
    "time_surface",
    "tos",
    "tos_ts",
]

"""The surfaces by their short names, as options and the command line take them."""

from evcalib.surfaces._base import Surface
from evcalib.surfaces._dist import Dist
from evcalib.surfaces._silc import Silc
from evcalib.surfaces._time import TimeSurface
from evcalib.surfaces._tos import Tos
from evcalib.surfaces._tos_ts import TosTs

SURFACES: dict[str, type[Surface]] = {
    "tos_ts": TosTs,
    "tos": Tos,
    "ts": TimeSurface,
    "silc": Silc,
    "dist": Dist,
}
"""The surfaces by their short names."""

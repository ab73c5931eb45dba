"""Time offset and rotation between an event camera and an omni-directional vehicle.

Conventions, the same everywhere in the package:

- Events: ``x`` = column, ``y`` = row (uint16), ``t`` = int64 microseconds, ascending,
  ``p`` = polarity (bool, True = ON).  Image shape is (height, width).  Every other time is
  float64 seconds.
- Frames: ``cam`` is the OpenCV camera frame (X right, Y down, Z along the optical axis); ``body``
  has X forward, Y left, Z up.
- Rotations are named by their frames: ``v_body = R_body_cam @ v_cam`` (the paper's R_oe).
- Offset: ``t_body = t_cam + offset``, so ``v_o(t + offset) = R_body_cam v_e(t)``.  Positive means
  that the odometry clock is ahead.  This is the sign of the paper's Alg. 1.
- Heading: unit direction of the camera's own motion, in the camera frame.

The method is that of Li et al., "Spatio-Temporal Calibration for Omni-Directional
Vehicle-Mounted Event Cameras", IEEE RA-L 9(3), 2024, doi 10.1109/LRA.2024.3355765.
"""

from typing import TYPE_CHECKING

from evcalib import _moved
from evcalib._lazy import lazy

if TYPE_CHECKING:
    from evcalib.alignment import Calibration, align
    from evcalib.camera import Camera
    from evcalib.errors import EvcalibError, InputError
    from evcalib.events import Events
    from evcalib.filters import denoise
    from evcalib.heading import estimate_headings
    from evcalib.imu import ImuSeries
    from evcalib.pipeline import calibrate
    from evcalib.series import HeadingSeries, VelocitySeries

__version__ = "0.1.0"

__all__ = [
    "Calibration",
    "Camera",
    "EvcalibError",
    "Events",
    "HeadingSeries",
    "ImuSeries",
    "InputError",
    "VelocitySeries",
    "align",
    "calibrate",
    "denoise",
    "estimate_headings",
]

_HOMES = {
    "Calibration": "alignment",
    "Camera": "camera",
    "EvcalibError": "errors",
    "Events": "events",
    "HeadingSeries": "series",
    "ImuSeries": "imu",
    "InputError": "errors",
    "VelocitySeries": "series",
    "align": "alignment",
    "calibrate": "pipeline",
    "denoise": "filters",
    "estimate_headings": "heading",
}

_MODULES = (
    *("camera", "errors", "events", "geometry", "imu", "poses", "series"),
    *("filters", "surfaces", "features", "heading", "kinematics", "alignment", "joint", "pipeline"),
    *("odometry", "uncertainty", "baselines", "design", "plots", "report", "widgets"),
)

_moved.install(_moved.MOVED)

__getattr__, __dir__ = lazy(__name__, _HOMES, _MODULES)

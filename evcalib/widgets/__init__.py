"""Panels with sliders for notebooks: one module per topic.

A panel is an ipywidgets container over the same functions that a static figure uses.  Its logic
runs and is tested without a browser.
"""

from evcalib._lazy import lazy

_HOMES = {
    "Cockpit": "cockpit",
    "DriveDesigner": "designer",
    "HeadingPanel": "heading",
    "OffsetPanel": "offset",
    "RivalPanel": "rivals",
    "RotationPanel": "rotation",
    "SurfacePanel": "surfaces",
    "SwervePanel": "kinematics",
    "TurningPanel": "turning",
}

__all__ = [
    "Cockpit",
    "DriveDesigner",
    "HeadingPanel",
    "OffsetPanel",
    "RivalPanel",
    "RotationPanel",
    "SurfacePanel",
    "SwervePanel",
    "TurningPanel",
]

__getattr__, __dir__ = lazy(__name__, _HOMES, _HOMES.values())

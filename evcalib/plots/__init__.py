"""Figures: one module per topic, one look for each quantity (`evcalib.plots.style`).

Plotting functions draw into axes that the caller made, label them with their units, and return
nothing.
"""

from evcalib._lazy import lazy

_HOMES = dict.fromkeys(("draw_motion", "draw_velocity_log", "explain_motion"), "kinematics")

__all__ = [
    "alignment",
    "design",
    "draw_motion",
    "draw_velocity_log",
    "events",
    "explain_motion",
    "full",
    "heading",
    "kinematics",
    "offset",
    "recording",
    "repeats",
    "rivals",
    "rotation",
    "studies",
    "style",
    "turning",
]

__getattr__, __dir__ = lazy(__name__, _HOMES, __all__)

"""Figures: one module per topic, one look for each quantity (`evcalib.plots.style`).

Plotting functions draw into axes that the caller made, label them with their units, and return
nothing.
"""

from evcalib.plots import style
from evcalib.plots.kinematics import draw_motion, draw_velocity_log, explain_motion

__all__ = ["draw_motion", "draw_velocity_log", "explain_motion", "style"]

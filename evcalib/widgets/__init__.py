"""Panels with sliders for notebooks: one module per topic.

A panel is an ipywidgets container over the same functions that a static figure uses.  Its logic
runs and is tested without a browser.
"""

from evcalib.widgets.kinematics import SwervePanel

__all__ = ["SwervePanel"]

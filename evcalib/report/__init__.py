"""A run as one HTML page."""

from evcalib._moved import leftovers
from evcalib.report._figures import report_figures
from evcalib.report._page import report_html

__all__ = ["report_figures", "report_html"]

__getattr__ = leftovers(__name__)

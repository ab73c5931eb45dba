"""A run, or several, as one HTML page."""

from evcalib._moved import leftovers
from evcalib.report._figures import report_figures
from evcalib.report._page import report_html
from evcalib.report._repeats import repeats_html

__all__ = ["repeats_html", "report_figures", "report_html"]

__getattr__ = leftovers(__name__)

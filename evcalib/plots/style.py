"""The visual language of every figure: what each colour, marker and size stands for.

The colours are those of Okabe & Ito (2008), which people with any colour vision can tell apart;
lines that carry the same meaning in a figure also differ in marker or dash.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from io import BytesIO
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

CAMERA = "#D55E00"
"""Whatever the camera saw or the camera frame holds: vermilion."""
BODY = "#0072B2"
"""Whatever belongs to the vehicle's body: blue."""
MEASURED = "#E69F00"
"""Raw measurements, before any model: orange."""
TRUE = "#000000"
"""The truth, where it is known: black."""
INLIER = "#009E73"
"""Data that a model explains: green."""
OUTLIER = "#CC79A7"
"""Data that a model does not explain, and residuals: purple."""
MUTED = "#8A8A8A"
"""Context that should not draw the eye: grey."""

SMALL = (4.2, 3.2)
"""One plain panel [inch]."""
SQUARE = (4.6, 4.6)
"""One panel with equal axes [inch]."""
WIDE = (8.2, 3.2)
"""A time series, or two panels side by side [inch]."""
PAIR = (8.2, 4.2)
"""Two square panels side by side [inch]."""
TALL = (8.2, 5.6)
"""Stacked time series [inch]."""

RC: Any = {
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 10,
    "figure.constrained_layout.use": True,
    "figure.dpi": 110,
    "font.size": 9.5,
    "grid.alpha": 0.3,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "savefig.dpi": 90,
}
"""Settings of matplotlib behind the look."""


def use() -> None:
    """Give all figures of this session the look (for notebooks and scripts)."""
    mpl.rcParams.update(RC)


def context() -> AbstractContextManager[None]:
    """Return a context in which new figures have the look."""
    return mpl.rc_context(RC)


def label(ax: Axes, x: str, y: str, *, title: str = "") -> None:
    """Name both axes, each as ``"quantity [unit]"``, and the panel."""
    ax.set_xlabel(x)
    ax.set_ylabel(y)
    if title:
        ax.set_title(title)


def dot(count: int) -> float:
    """Return a size of dots [pt] at which so many of them over time stay apart."""
    return 3.0 if count <= 2000 else 1.5


def new_figure(size: tuple[float, float] = SQUARE) -> Figure:
    """Return a figure of the given size [inch] that no window or notebook holds on to."""
    with context():
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)
    return figure


def png(figure: Figure, *, dpi: float = RC["savefig.dpi"]) -> bytes:
    """Return the figure as the bytes of a PNG file, the same for the same picture."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    return buffer.getvalue()

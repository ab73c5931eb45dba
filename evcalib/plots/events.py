"""Events in space and time, surfaces as images, and corners on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from evcalib.events import Events
from evcalib.plots import style
from evcalib.surfaces.quality import grey

NAMES = {
    "ts": "TS",
    "dist": "DiST",
    "silc": "SILC",
    "tos": "TOS",
    "tos_ts": "TOS AND TS",
}
"""Surfaces as the paper names them, in the order of its Fig. 2."""


DARK = "#404040"
"""Surfaces have no colour of their own: greys, and the camera's for the paper's."""

LEVELS = 8
"""Greys of a surface: enough for the eye, and pictures stay small."""


def draw_surface(
    ax: Axes,
    image: NDArray,
    corners: ArrayLike | None = None,
    *,
    title: str = "",
    part: tuple[int, int, int, int] | None = None,
) -> None:
    """Draw a surface, or a picture of the scene, with corners on it.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    image : ndarray, shape (height, width)
        Drawn from 0 (black) to its largest value (white).
    corners : array_like, shape (n, 2), optional
        Pixels.
    title : str
        Name of the panel.
    part : tuple of int, optional
        First column, first row, width and height [px] of what is shown; by default everything.
    """
    shades = matplotlib.colormaps["gray"].resampled(LEVELS)
    ax.imshow(grey(image), cmap=shades, vmin=0, vmax=255, interpolation="nearest")
    if corners is not None:
        x, y = np.reshape(corners, (-1, 2)).T
        size = 5.0 if part else 3.0
        ax.plot(x, y, "o", ms=size, mew=size / 5, mfc="none", color=style.MEASURED)
    left, top, width, height = part or (0, 0, image.shape[1], image.shape[0])
    ax.set_xlim(left - 0.5, left + width - 0.5)
    ax.set_ylim(top + height - 0.5, top - 0.5)
    ax.set(xticks=[], yticks=[], title=title)
    ax.grid(visible=False)


def draw_surfaces(
    figure: Figure,
    images: Mapping[str, NDArray],
    corners: ArrayLike | None = None,
    *,
    part: tuple[int, int, int, int] | None = None,
) -> None:
    """Draw a picture and five surfaces, or other six images, in two rows.

    Parameters
    ----------
    figure : Figure
        Empty.
    images : mapping of str to ndarray, shape (height, width)
        What to show, by title.
    corners, part
        As of `draw_surface`.
    """
    axes = figure.subplots(2, -(-len(images) // 2)).flat
    for ax, (name, image) in zip(axes, images.items(), strict=False):
        draw_surface(ax, image, corners, title=name, part=part)


def draw_rows_of_time(axes: Sequence[Axes], recordings: Mapping[str, Events], row: int) -> None:
    """Draw the middle of one row of pixels over time for several recordings, with titles."""
    for ax, (name, events) in zip(axes, recordings.items(), strict=True):
        draw_row_of_time(ax, events, row)
        edge = events.width // 16
        ax.set_xlim(edge, 9 * edge)
        ax.set_title(name)


def draw_row_of_time(ax: Axes, events: Events, row: int) -> None:
    """Draw the events of one row of pixels over column and time, ON and OFF apart."""
    here = events.y == row
    for on, color, marker, name in (
        (True, style.CAMERA, "^", "ON: brighter"),
        (False, style.MUTED, "v", "OFF: darker"),
    ):
        some = here & (events.p == on)
        ax.plot(events.x[some], 1e-6 * events.t[some], marker, ms=2.8, color=color, label=name)
    ax.set_xlim(-0.5, events.width - 0.5)
    ax.set_ylim(1e-6 * float(events.t[0]), 1e-6 * float(events.t[-1]))
    style.label(ax, "column [px]", "time [s]")


def draw_over_speed(
    ax: Axes, speeds: Sequence[float], values: dict[str, Sequence[float]], name: str
) -> None:
    """Draw a figure of several surfaces over the speed of the motion, each with its own mark."""
    looks = {
        "ts": ("s--", style.MUTED),
        "dist": ("^-", DARK),
        "silc": ("D-.", DARK),
        "tos": ("o:", style.MUTED),
        "tos_ts": ("o-", style.CAMERA),
    }
    for key, numbers in values.items():
        form, color = looks[key]
        ax.plot(speeds, numbers, form, color=color, ms=5, label=NAMES[key])
    ax.set_xscale("log")
    ax.minorticks_off()
    ax.set_xticks(speeds, [f"{speed:g}" for speed in speeds])
    ax.set_ylim(0.0, 1.1 * max(max(numbers) for numbers in values.values()))
    style.label(ax, "speed of the camera [m/s]", name)

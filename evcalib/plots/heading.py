"""Matches, epipolar lines, the focus of expansion, and directions against the truth."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike, NDArray

from evcalib.camera import Camera
from evcalib.geometry import angle_between, unit
from evcalib.plots import style
from evcalib.two_views import Pairs

Floats = NDArray[np.float64]


def draw_matches(
    ax: Axes, camera: Camera, pairs: Pairs, inliers: NDArray[np.bool_] | None = None
) -> None:
    """Draw matches as strokes that end in a dot where the point came to.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    camera : Camera
        Gives the size of the image.
    pairs : Pairs
        The matches.
    inliers : ndarray of bool, shape (n,), optional
        Which of them a direction explains; without, all look like plain measurements.
    """
    draw_strokes(ax, pairs.xy1, pairs.xy2, inliers)
    show_image_plane(ax, camera)


def draw_strokes(
    ax: Axes, xy1: Floats, xy2: Floats, inliers: NDArray[np.bool_] | None = None
) -> None:
    """Draw matched pixels, shape (n, 2), as strokes that end in a dot; see `draw_matches`."""
    kinds: dict[str, tuple[NDArray[np.bool_], str]] = {}
    if inliers is None:
        kinds["match"] = np.ones(len(xy1), dtype=np.bool_), style.MEASURED
    else:
        kinds["outlier"] = ~inliers, style.OUTLIER
        kinds["inlier"] = inliers, style.INLIER
    for name, (rows, color) in kinds.items():
        x, y = (np.column_stack((xy1[rows, k], xy2[rows, k])).T for k in (0, 1))
        ax.plot(x, y, color=color, lw=1.0)
        ax.plot(x[1], y[1], "o", ms=2.5, color=color, label=name)


def draw_epipolar(ax: Axes, camera: Camera, direction: ArrayLike, xy: ArrayLike) -> None:
    """Draw the lines on which points must move, if the camera moves in a direction.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    camera : Camera
        The camera.
    direction : array_like, shape (3,)
        Heading.
    xy : array_like, shape (n, 2)
        Points [px], one on each line.
    """
    ahead = unit(np.asarray(direction, dtype=np.float64))
    angles = np.radians(np.linspace(-179.0, 179.0, 359))
    for ray in camera.bearings(np.asarray(xy, dtype=np.float64)):
        across = ray - (ray @ ahead) * ahead
        if np.linalg.norm(across) < 1e-9:
            continue
        circle = np.outer(np.cos(angles), ahead) + np.outer(np.sin(angles), unit(across))
        # Half of the great circle is the line of points that move away from the focus.
        half = circle[angles > 0]
        line = camera.project(half[half[:, 2] > 0.05])
        ax.plot(*line.T, color=style.MUTED, lw=0.6, zorder=0)
    show_image_plane(ax, camera)


def draw_focus(
    ax: Axes, camera: Camera, direction: ArrayLike, *, true: bool = False, name: str = ""
) -> None:
    """Mark the focus of expansion, where a direction meets the image; nothing if outside of it."""
    x, y = camera.project(np.reshape(direction, (1, 3)))[0]
    if not (0 <= x <= camera.width - 1 and 0 <= y <= camera.height - 1):
        return
    form, color = ("+", style.TRUE) if true else ("x", style.CAMERA)
    ax.plot(x, y, form, ms=12, mew=2.5, color=color, label=name, zorder=5)


def show_image_plane(ax: Axes, camera: Camera) -> None:
    """Let an axes show the image: y down, equal scales, pixels as units."""
    ax.set_xlim(-0.5, camera.width - 0.5)
    ax.set_ylim(camera.height - 0.5, -0.5)
    ax.set_aspect("equal")
    style.label(ax, "x [px]", "y [px]")


def offsets(v: ArrayLike, truth: ArrayLike) -> Floats:
    """Return by how much directions are off, to the right and downwards [deg].

    Parameters
    ----------
    v : array_like, shape (n, 3)
        Directions in the camera frame.
    truth : array_like, shape (3,)
        True direction.

    Returns
    -------
    ndarray, shape (n, 2)
        Seen along the truth with the image's Y axis downwards (its Z axis, if the truth is Y).
        Their length is the angle between direction and truth.
    """
    ahead = unit(truth)
    down = np.array([0.0, 1.0, 0.0]) if abs(ahead[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    right = unit(np.cross(down, ahead))
    down = np.cross(ahead, right)
    directions = np.reshape(v, (-1, 3)).astype(np.float64)
    flat = directions @ np.column_stack((right, down))
    length = np.linalg.norm(flat, axis=1, keepdims=True)
    angle = np.degrees(angle_between(directions, ahead))[:, None]
    return flat / np.maximum(length, 1e-300) * angle


def draw_offsets(
    ax: Axes, v: ArrayLike, truth: ArrayLike, sd: ArrayLike | None = None, *, reach: float = 5.0
) -> None:
    """Draw directions around the true one, with bars of one standard deviation [rad]."""
    off = offsets(v, truth)
    bars = np.zeros(len(off)) if sd is None else np.degrees(np.asarray(sd, dtype=np.float64))
    x, y = off.T
    look: Any = {"fmt": "o", "ms": 3.5, "lw": 0.7, "color": style.CAMERA, "label": "heading"}
    ax.errorbar(x, y, bars, bars, **look)
    ax.plot(0, 0, "+", ms=14, mew=2.5, color=style.TRUE, label="truth")
    ticks = np.linspace(-reach, reach, 5)
    ax.set(xlim=(-reach, reach), ylim=(reach, -reach), xticks=ticks, yticks=ticks, aspect="equal")
    style.label(ax, "off to the right [deg]", "off downwards [deg]")

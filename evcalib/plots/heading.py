"""Matches, epipolar lines, the focus of expansion, and directions against the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from numpy.typing import ArrayLike, NDArray

from evcalib.arrays import Flags, Floats
from evcalib.camera import Camera
from evcalib.geometry import angle_between, unit
from evcalib.heading import Matches, Translation
from evcalib.plots import style
from evcalib.surfaces.quality import grey

LINES = 15
"""About so many epipolar lines are drawn."""


def draw_matches(ax: Axes, camera: Camera, pairs: Matches, inliers: Flags | None = None) -> None:
    """Draw matches as strokes that end in a dot where the point came to.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    camera : Camera
        Gives the size of the image.
    pairs : Matches
        The matches.
    inliers : ndarray of bool, shape (n,), optional
        Which of them a direction explains; without, all look like plain measurements.
    """
    draw_strokes(ax, pairs.xy1, pairs.xy2, inliers)
    show_image_plane(ax, camera)


def draw_strokes(ax: Axes, xy1: Floats, xy2: Floats, inliers: Flags | None = None) -> None:
    """Draw matched pixels, shape (n, 2), as strokes that end in a dot; see `draw_matches`."""
    kinds: dict[str, tuple[Flags, str]] = {}
    if inliers is None:
        kinds["match"] = np.ones(len(xy1), dtype=np.bool_), style.MEASURED
    else:
        kinds["outlier"] = ~inliers, style.OUTLIER
        kinds["inlier"] = inliers, style.INLIER
    for name, (rows, color) in kinds.items():
        strokes = np.stack((xy1[rows], xy2[rows]), axis=1)
        ax.add_collection(LineCollection(list(strokes), colors=color, lw=1.2))
        ax.plot(*xy2[rows].T, "o", ms=3, color=color, label=name)


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
    # Half of the great circle is the line of points that move away from the focus.
    angles = np.radians(np.linspace(1.0, 179.0, 179))
    lines = []
    for ray in camera.bearings(np.asarray(xy, dtype=np.float64)):
        across = ray - (ray @ ahead) * ahead
        if np.linalg.norm(across) < 1e-9:
            continue
        half = np.outer(np.cos(angles), ahead) + np.outer(np.sin(angles), unit(across))
        lines.append(camera.project(half[half[:, 2] > 0.05]))
    ax.add_collection(LineCollection(lines, colors=style.MUTED, lw=0.7, zorder=0.5))
    show_image_plane(ax, camera)


def draw_backdrop(ax: Axes, surface: NDArray) -> None:
    """Draw a surface in faint grey on white, as ground for coloured marks."""
    ax.imshow(grey(surface), cmap="Greys", vmin=0, vmax=4 * 255, interpolation="nearest", zorder=0)
    ax.grid(visible=False)


def draw_focus(
    ax: Axes, camera: Camera, direction: ArrayLike, *, true: bool = False, name: str = ""
) -> None:
    """Mark the focus of expansion, where a direction meets the image; nothing if outside of it."""
    x, y = camera.project(np.reshape(direction, (1, 3)))[0]
    if not (0 <= x <= camera.width - 1 and 0 <= y <= camera.height - 1):
        return
    form, color = ("+", style.TRUE) if true else ("x", style.CAMERA)
    ax.plot(x, y, form, ms=12, mew=2.5, color=color, label=name, zorder=5)


def draw_heading(
    ax: Axes, camera: Camera, pairs: Matches, found: Translation | None, truth: ArrayLike
) -> None:
    """Draw matches, the epipolar lines of the heading found for them, and both focuses.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    camera : Camera
        The camera.
    pairs : Matches
        The matches.
    found : Translation or None
        What a solver made of them.
    truth : array_like, shape (3,)
        True heading.
    """
    if found is None:
        draw_matches(ax, camera, pairs)
    else:
        inliers = np.flatnonzero(found.inliers)
        some = inliers[:: max(1, inliers.size // LINES)]
        draw_epipolar(ax, camera, found.direction, pairs.xy1[some])
        draw_matches(ax, camera, pairs, found.inliers)
        draw_focus(ax, camera, found.direction, name="focus found")
    draw_focus(ax, camera, truth, true=True, name="true focus")


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


def draw_solvers(
    axes: Sequence[Axes], angles: ArrayLike, errors: Mapping[str, Mapping[str, ArrayLike]]
) -> None:
    """Draw the median error of solvers over the direction of motion, one axes for each study.

    Parameters
    ----------
    axes : sequence of Axes
        One for each study.
    angles : array_like, shape (n,)
        Direction of motion from the optical axis [deg].
    errors : mapping of str to (mapping of str to array_like, shape (n,))
        Median errors [deg] by study and solver.
    """
    looks = (("o-", style.CAMERA), ("s--", style.MUTED))
    for ax, (study, by_solver) in zip(axes, errors.items(), strict=True):
        for (solver, error), (form, color) in zip(by_solver.items(), looks, strict=True):
            ax.plot(angles, error, form, color=color, label=solver)
        ax.set_yscale("log")
        ax.set_xticks(np.asarray(angles))
        ax.set_yticks([0.1, 1.0, 10.0], ["0.1", "1", "10"])
        name = "median error [deg]" if ax is axes[0] else ""
        style.label(ax, "direction from the optical axis [deg]", name, title=study)


def draw_errors_over_time(ax: Axes, t: ArrayLike, errors: ArrayLike, sd: ArrayLike) -> None:
    """Draw how far headings are off [deg] over time [s], with bars of one stated sd [deg]."""
    ax.errorbar(t, errors, sd, fmt="o", ms=5, lw=1.0, capsize=3, color=style.CAMERA)
    ax.set_ylim(bottom=0.0)
    style.label(ax, "time [s]", "error, bars of one sd [deg]")


def draw_offsets(
    ax: Axes, v: ArrayLike, truth: ArrayLike, sd: ArrayLike | None = None, *, reach: float = 5.0
) -> None:
    """Draw directions around the true one, with bars of one standard deviation [rad].

    How many are farther off than `reach` [deg] is said in a corner.
    """
    off = offsets(v, truth)
    bars = np.zeros(len(off)) if sd is None else np.degrees(np.asarray(sd, dtype=np.float64))
    x, y = off.T
    look: Any = {"fmt": "o", "ms": 4.5, "lw": 1.0, "color": style.CAMERA, "label": "heading"}
    ax.errorbar(x, y, bars, bars, **look)
    beyond = int((np.abs(off) > reach).any(axis=1).sum())
    if beyond:
        ax.text(0.03, 0.03, f"{beyond} farther off", transform=ax.transAxes, color=style.CAMERA)
    ax.plot(0, 0, "+", ms=14, mew=2.5, color=style.TRUE, label="truth")
    ticks = np.linspace(-reach, reach, 5)
    ax.set(xlim=(-reach, reach), ylim=(reach, -reach), xticks=ticks, yticks=ticks, aspect="equal")
    style.label(ax, "off to the right [deg]", "off downwards [deg]")

"""Rivals side by side on one drive: the paths that they align, and their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from evcalib.alignment import Calibration
from evcalib.arrays import Floats
from evcalib.baselines import RivalInput
from evcalib.plots import style
from evcalib.plots.studies import colour_of
from evcalib.poses import PoseSeries

LEAST_DEG = 0.02
"""Errors below this [deg] are drawn as this."""


def draw_paths(
    ax: Axes,
    body: PoseSeries,
    camera: PoseSeries,
    found: Calibration | None = None,
    *,
    true: Floats | None = None,
) -> None:
    """Draw two reckoned trajectories from above, the camera's as a calibration places it.

    The camera's starts where the body was then, by the offset found, and is turned by the rotation
    found.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    body, camera : PoseSeries
        Trajectories by dead reckoning, of a body that does not turn [m].
    found : Calibration, optional
        Rotation and offset; without it, the camera's trajectory is left out.
    true : ndarray, shape (n, 3), optional
        The path that was driven [m], from the same start as the body's.
    """
    if true is not None:
        ax.plot(true[:, 0], true[:, 1], color=style.TRUE, lw=1.0, ls="--", label="driven")
    ax.plot(*body.position[:, :2].T, color=style.BODY, label="body, reckoned")
    if found is not None:
        start = [np.interp(camera.t[0] + found.offset, body.t, axis) for axis in body.position.T]
        placed = (camera.position - camera.position[0]) @ found.R_body_cam.T + start
        ax.plot(placed[:, 0], placed[:, 1], color=style.CAMERA, ls="-.", label="camera, as placed")
    ax.set_aspect("equal", adjustable="datalim")
    style.label(ax, "x [m]", "y [m]")


def draw_rivals(
    axes: Sequence[Axes],
    given: RivalInput,
    errors: Mapping[str, float],
    chosen: str,
    found: Calibration | None,
    *,
    true: Floats | None = None,
) -> None:
    """Draw the trajectories as one method places them, and the errors of all: two panels.

    Parameters
    ----------
    axes : sequence of two Axes
        Where to draw.
    given : RivalInput
        The streams; without trajectories the first panel stays empty.
    errors : mapping of str to float
        As for `draw_errors`.
    chosen : str
        The method that places the trajectories.
    found : Calibration, optional
        What it found, if it did.
    true : ndarray, shape (n, 3), optional
        The path that was driven [m].
    """
    left, right = axes
    if given.body_poses is not None and given.camera_poses is not None:
        draw_paths(left, given.body_poses, given.camera_poses, found, true=true)
        left.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, columnspacing=1.0)
    draw_errors(right, errors, chosen=chosen)


def draw_errors(ax: Axes, errors: Mapping[str, float], *, chosen: str = "") -> None:
    """Draw a bar for the error of each method.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    errors : mapping of str to float
        Rotation errors [deg] by method; NaN where there is none.
    chosen : str
        The method whose bar is framed.
    """
    names = list(errors)
    for place, (name, error) in enumerate(errors.items()):
        if not np.isfinite(error):
            ax.text(1.15 * LEAST_DEG, place, "none", va="center", color=style.MUTED)
            continue
        long, colour = max(error, LEAST_DEG), colour_of(name, names)
        edge, width = (style.TRUE, 1.8) if name == chosen else (colour, 0.0)
        ax.barh(place, long, height=0.75, color=colour, edgecolor=edge, linewidth=width)
        ax.text(1.12 * long, place, f"{error:.2g}" if error < 10 else f"{error:.0f}", va="center")
    ax.set_xscale("log")
    ax.set_xlim(LEAST_DEG, 500.0)
    ax.set_xticks([0.1, 1, 10, 100], ["0.1", "1", "10", "100"])
    ax.set_xticks([], minor=True)
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.grid(visible=False, axis="y")
    ax.set_xlabel("rotation error [deg]")

"""The whole chain: tracks against the odometry, calibrations against the truth, lags, a cockpit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from evcalib.offset import OffsetCurve
from evcalib.plots import style
from evcalib.plots.alignment import draw_curve
from evcalib.plots.offset import MIN_SPAN, draw_streams
from evcalib.series import HeadingSeries
from evcalib.track import VelocityTrack, intervals

Floats = NDArray[np.float64]

LOOKS = {
    "corners": (style.OUTLIER, "s", "keypoints of corner events"),
    "images": (style.MEASURED, "^", "aligned event images"),
    "symmetric": (style.INLIER, "o", "the same, last events halved"),
}
"""Colour, marker and name of each way to measure displacements."""


def draw_growth(
    ax: Axes, t: Floats, length: Floats, models: Mapping[str, Floats], *, title: str = ""
) -> None:
    """Draw how far a corner has moved at each sighting, and what some offsets say it should have.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    t : ndarray, shape (n,)
        Times since the first sighting [s].
    length : ndarray, shape (n,)
        How far the corner moved [px].
    models : mapping of str to ndarray, shape (n,)
        What each offset predicts, scaled to fit best [px]; the first one is the true one.
    title : str
        Of the panel.
    """
    looks = ((style.TRUE, "-"), (style.BODY, "--"), (style.CAMERA, ":"))
    for (name, model), (color, dash) in zip(models.items(), looks, strict=False):
        ax.plot(t, model, dash, color=color, label=name)
    ax.plot(t, length, "o", ms=5, color=style.MEASURED, label="sightings")
    style.label(ax, "time since the first sighting [s]", "moved [px]", title=title)
    ax.legend(loc="upper left")


def draw_calibrations(ax: Axes, groups: Sequence[str], error: Floats, bar: Floats) -> None:
    """Draw the errors of many calibrations in groups, with what was said of them.

    Errors with a sign get the half width of their interval to both sides; sizes of errors, a mark
    below which they should lie.  Those that lie beyond are drawn as outliers.
    """
    x = np.arange(error.size) + 0.8 * np.cumsum([0, *(a != b for a, b in pairwise(groups))])
    holds = np.abs(error) <= bar
    signed = bool((error < 0).any())
    for mask, color, name in (
        (holds, style.INLIER, "within what was stated"),
        (~holds, style.OUTLIER, "beyond"),
    ):
        if not mask.any():
            continue
        low = error[mask] - bar[mask] if signed else np.zeros(int(mask.sum()))
        high = error[mask] + bar[mask] if signed else bar[mask]
        ax.vlines(x[mask], low, high, color=color, lw=1.2)
        ax.plot(x[mask], high, "_", ms=7, color=color)
        if signed:
            ax.plot(x[mask], low, "_", ms=7, color=color)
        ax.plot(x[mask], error[mask], "o", ms=4, color=color, label=name)
    ax.axhline(0.0, color=style.TRUE, lw=1)
    names = list(dict.fromkeys(groups))
    at = [float(np.mean(x[[g == name for g in groups]])) for name in names]
    ax.set_xticks(at, [name.replace(", ", "\n") for name in names])
    ax.grid(axis="x", visible=False)
    ax.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, borderaxespad=0.2)


def draw_lags(ax: Axes, flow: Mapping[str, Floats], late_ms: Mapping[str, Floats]) -> None:
    """Draw by how much an offset is off against the flow, for each way to measure displacements."""
    for name, (color, marker, words) in LOOKS.items():
        ax.plot(
            flow[name], late_ms[name], marker, ms=6, color=color, mec="white", mew=0.5, label=words
        )
    ax.axhline(0.0, color=style.TRUE, lw=1)
    ax.set_xscale("log")
    ax.set_xticks([15, 30, 60, 120], ["15", "30", "60", "120"])
    ax.minorticks_off()
    style.label(ax, "median flow [px/s]", "error of the offset [ms]")
    ax.legend(loc="upper right")


def draw_cockpit(
    figure: Figure,
    headings: HeadingSeries,
    track: VelocityTrack,
    offset: float,
    R_body_cam: Floats,
    curve: OffsetCurve,
    *,
    solved: float | None = None,
) -> None:
    """Draw directions under an offset and a rotation, the score of the offset, and the residuals.

    Parameters
    ----------
    figure : Figure
        Empty.
    headings, track
        The two streams.
    offset : float
        ``t_body = t_cam + offset`` [s].
    R_body_cam : ndarray, shape (3, 3)
        Turns the headings into the body frame.
    curve : OffsetCurve
        Score of every offset under its best rotation.
    solved : float, optional
        The offset of the solution [s], to mark.
    """
    grid = figure.add_gridspec(2, 2, width_ratios=(3, 2))
    azimuth, elevation = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0])
    draw_streams(azimuth, headings, track, offset, R_body_cam)
    azimuth.lines[0].set_label("camera, turned by hand")
    azimuth.set_xlabel("")
    t, body, camera = paired(headings, track, offset, R_body_cam)
    elevation.plot(t, _elevation(camera), ".", ms=3, color=style.CAMERA)
    elevation.plot(t, _elevation(body), color=style.BODY)
    low, high = elevation.get_ylim()
    spare = max(MIN_SPAN / 2 - (high - low), 0.0) / 2
    elevation.set_ylim(low - spare, high + spare)
    style.label(elevation, "camera time [s]", "elevation [deg]")
    score, residual = figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[1, 1])
    draw_curve(score, curve, found=solved)
    score.axvline(offset, color=style.MEASURED, lw=2, label="slider")
    score.legend(loc="lower center")
    residual.plot(t, np.degrees(_angle(body, camera)), ".", ms=3, color=style.OUTLIER)
    residual.set_ylim(bottom=0.0)
    style.label(residual, "camera time [s]", "residual [deg]")
    figure.legend(*azimuth.get_legend_handles_labels(), loc="outside upper left", ncols=2)


def paired(
    headings: HeadingSeries, track: VelocityTrack, offset: float, R_body_cam: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return times, body directions and turned headings where the odometry covers them."""
    body = track.directions(*intervals(headings), offset)
    known = np.any(body != 0, axis=1)
    return headings.t[known], body[known], headings.v[known] @ R_body_cam.T


def _angle(a: Floats, b: Floats) -> Floats:
    return 2 * np.arcsin(np.clip(0.5 * np.linalg.norm(a - b, axis=1), 0, 1))


def _elevation(v: Floats) -> Floats:
    return np.degrees(np.arctan2(v[:, 2], np.hypot(v[:, 0], v[:, 1])))

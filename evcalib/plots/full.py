"""The whole chain: tracks against the odometry, calibrations against the truth, lags, a cockpit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from evcalib.alignment.offset import OffsetCurve
from evcalib.arrays import Floats
from evcalib.geometry import angle_between
from evcalib.kinematics.velocity_track import VelocityTrack
from evcalib.plots import _angles, style
from evcalib.plots.offset import MIN_SPAN, paired
from evcalib.series import HeadingSeries

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
    looks = ((style.TRUE, "-"), (style.OUTLIER, "--"), (style.OUTLIER, ":"))
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


def draw_stages(ax: Axes, names: Sequence[str], values: Sequence[Floats], *, title: str) -> None:
    """Draw the errors of several drives after each of two stages, one line for each drive.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    names : sequence of two str
        The stages.
    values : sequence of two ndarray, shape (n,)
        Errors of the rotation [deg] after each.
    title : str
        Of the panel.
    """
    before, after = values
    for better, color, name in ((True, style.INLIER, "better"), (False, style.OUTLIER, "worse")):
        chosen = (after < before) == better
        for k, ends in enumerate(zip(before[chosen], after[chosen], strict=True)):
            label = f"{name}: {int(chosen.sum())}" if k == 0 else None
            dash = "-" if better else "--"
            ax.plot([0, 1], ends, "o", ls=dash, color=color, ms=4, lw=1.2, label=label)
    ax.set_xticks([0, 1], names)
    ax.set(xlim=(-0.25, 1.25), ylim=(0, None))
    ax.grid(axis="x", visible=False)
    style.label(ax, "", "error of the rotation [deg]")
    ax.set_title(title, loc="left")
    ax.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, borderaxespad=0.2)


def cockpit_axes(figure: Figure) -> tuple[Axes, Axes, Axes, Axes]:
    """Return empty panels for `draw_cockpit`: azimuth, elevation, score, residual."""
    figure.set_layout_engine("none")
    grid = figure.add_gridspec(
        2,
        2,
        width_ratios=(3, 2),
        left=0.075,
        right=0.985,
        bottom=0.1,
        top=0.94,
        wspace=0.2,
        hspace=0.52,
    )
    azimuth = figure.add_subplot(grid[0, 0])
    elevation = figure.add_subplot(grid[1, 0], sharex=azimuth)
    return azimuth, elevation, figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[1, 1])


def draw_cockpit(
    axes: Sequence[Axes],
    headings: HeadingSeries,
    track: VelocityTrack,
    R_body_cam: Floats,
    curve: OffsetCurve,
    tried: Sequence[tuple[float, float]],
    *,
    solved: float | None = None,
) -> None:
    """Draw directions under an offset and a rotation, the score of the offset, and the residuals.

    Parameters
    ----------
    axes : sequence of four Axes
        From `cockpit_axes`.
    headings, track
        The two streams.
    R_body_cam : ndarray, shape (3, 3)
        Turns the headings into the body frame.
    curve : OffsetCurve
        Score of every offset under its best rotation.
    tried : sequence of pairs of float
        Offsets [s] tried by hand with their scores, the present one last.
    solved : float, optional
        The offset of the solution [s], to mark.
    """
    azimuth, elevation, score, residual = axes
    t, body, camera = paired(headings, track, tried[-1][0], R_body_cam)
    line, cuts = _angles.unbroken(t, _angles.azimuth(body))
    dots = _angles.beside(line, _angles.azimuth(camera))
    azimuth.plot(t, dots, ".", ms=3, color=style.CAMERA, label="camera, turned by the angles")
    whole = _angles.cut(t, cuts)
    name = "body, shifted by the offset"
    azimuth.plot(whole, _angles.cut(line, cuts), color=style.BODY, label=name)
    _limits(azimuth, line, dots)
    style.label(azimuth, "", "azimuth [deg]")
    azimuth.legend(
        loc="lower left", bbox_to_anchor=(0, 0.98), ncols=2, markerscale=3, borderaxespad=0.2
    )
    elevation.plot(t, _angles.elevation(camera), ".", ms=3, color=style.CAMERA)
    elevation.plot(whole, _angles.cut(_angles.elevation(body), cuts), color=style.BODY)
    _limits(elevation, _angles.elevation(camera), np.zeros(1))
    style.label(elevation, "camera time [s]", "elevation [deg]")
    _draw_climb(score, curve, tried, solved)
    _draw_residuals(residual, t, np.degrees(angle_between(camera, body)))


def _draw_climb(
    ax: Axes, curve: OffsetCurve, tried: Sequence[tuple[float, float]], solved: float | None
) -> None:
    """Draw the curve that no hand gets above, and where the hand has been."""
    ax.plot(curve.offsets, curve.score, color=style.BODY, label="best angles")
    if solved is not None:
        ax.axvline(solved, color=style.INLIER, label="solved")
    ax.plot(*np.transpose(tried), ".", ms=4, color=style.MEASURED)
    ax.plot(*tried[-1], "o", ms=8, color=style.MEASURED, mec=style.TRUE, label="you")
    ax.set_xlim(curve.offsets[0], curve.offsets[-1])
    ax.set_ylim(-0.03, 1.05)
    style.label(ax, "offset [s]", "robust score [-]")
    ax.legend(loc="lower right", bbox_to_anchor=(1, 0.98), ncols=3, borderaxespad=0.2)


def _draw_residuals(ax: Axes, t: Floats, degrees: Floats) -> None:
    ax.plot(t, degrees, ".", ms=3, color=style.OUTLIER)
    top = 10.0
    if degrees.size:
        middle = float(np.median(degrees))
        ax.axhline(middle, color=style.TRUE, lw=1, label=f"median {middle:.2f} deg")
        ax.legend(loc="lower right", bbox_to_anchor=(1, 0.98), borderaxespad=0.2)
        top = max(top, 1.2 * float(np.quantile(degrees, 0.98)))
    ax.set_ylim(0.0, min(top, 185.0))
    style.label(ax, "camera time [s]", "residual [deg]")


def _limits(ax: Axes, *angles: Floats) -> None:
    """Show all angles, between multiples of a step, so that small moves leave the axis alone."""
    every = np.concatenate(angles)
    low, high = (float(every.min()), float(every.max())) if every.size else (0.0, 0.0)
    step = 15.0 if high - low < 120.0 else 45.0
    low, high = low - 0.1 * step, high + 0.1 * step
    low, high = step * np.floor(low / step), step * np.ceil(high / step)
    middle, half = 0.5 * (low + high), max(0.5 * (high - low), MIN_SPAN / 2)
    ax.set_ylim(middle - half, middle + half)

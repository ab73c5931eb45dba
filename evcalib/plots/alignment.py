"""Two streams before and after their alignment: curve, directions, residuals, sphere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

from evcalib.offset import OffsetCurve
from evcalib.plots import style
from evcalib.results import Calibration

_NAMES = {
    "profile": "robust score",
    "trace": "trace correlation",
    "canonical": "first canonical correlation",
    "scalar": "correlation of turning rates",
}

_SIZES = {
    "correlation": style.WIDE,
    "directions": style.TALL,
    "residuals": style.WIDE,
    "sphere": style.SQUARE,
}


def draw_curve(
    ax: Axes,
    curve: OffsetCurve,
    *,
    found: float | None = None,
    interval: tuple[float, float] | None = None,
    true: float | None = None,
) -> None:
    """Draw a score over candidate offsets, with the offset found, its interval, and the truth."""
    ax.plot(curve.offsets, curve.score, color=style.BODY)
    if interval is not None:
        ax.axvspan(*interval, color=style.INLIER, alpha=0.2, lw=0, label="95 % interval")
    if found is not None:
        ax.axvline(found, color=style.INLIER, label=f"found {found:.4f} s")
    if true is not None:
        ax.axvline(true, color=style.TRUE, ls="--", label=f"true {true:.4f} s")
    ax.margins(x=0)
    style.label(ax, "offset [s]", f"{_NAMES[curve.method]} [-]")
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="best")


def draw_directions(axes: Sequence[Axes], calibration: Calibration) -> None:
    """Draw azimuth and elevation of turned headings and body directions into two axes."""
    residuals = calibration.residuals
    inlier = _inliers(calibration)
    for ax, angle, name in zip(axes, (_azimuth, _elevation), ("azimuth", "elevation"), strict=True):
        camera, body = angle(residuals.turned), angle(residuals.direction)
        outside = ~inlier
        ax.plot(
            residuals.t[outside], camera[outside], ".", ms=3, color=style.OUTLIER, label="outliers"
        )
        ax.plot(
            residuals.t[inlier],
            camera[inlier],
            ".",
            ms=3,
            color=style.CAMERA,
            label="camera, turned into the body frame",
        )
        t, line = _broken(residuals.t, body)
        ax.plot(t, line, color=style.BODY, label="body, shifted by the offset")
        style.label(ax, "camera time [s]" if ax is axes[-1] else "", f"{name} [deg]")
    _legend_above(axes[0])


def draw_residuals(ax: Axes, calibration: Calibration) -> None:
    """Draw the angle between turned headings and body directions over time."""
    residuals, inlier = calibration.residuals, _inliers(calibration)
    degrees = np.degrees(residuals.angle)
    for mask, color, name in (
        (inlier, style.INLIER, "inliers"),
        (~inlier, style.OUTLIER, "outliers"),
    ):
        ax.plot(residuals.t[mask], degrees[mask], ".", ms=3, color=color, label=name)
    sigma = np.degrees(calibration.diagnostics.mixture.sigma)
    ax.axhline(
        1.177 * sigma, color=style.MUTED, lw=1, label=f"median of inliers, {1.177 * sigma:.2g} deg"
    )
    ax.set_ylim(bottom=0)
    style.label(ax, "camera time [s]", "residual angle [deg]")
    _legend_above(ax)


def draw_sphere(ax: Axes3D, calibration: Calibration) -> None:
    """Draw turned headings and body directions on the unit sphere of the body frame."""
    residuals, inlier = calibration.residuals, _inliers(calibration)
    u, v = np.mgrid[0 : 2 * np.pi : 25j, 0 : np.pi : 13j]
    x, y, z = np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)
    ax.plot_wireframe(x, y, z, color=style.MUTED, lw=0.3, alpha=0.6, zorder=1)
    for end, name in zip(np.eye(3) * 1.3, ("x forward", "y left", "z up"), strict=True):
        ax.plot(*np.outer([0, 1], end).T, color=style.MUTED, lw=1, zorder=2)
        ax.text(*end * 1.08, name, color=style.MUTED, ha="center", va="center")
    for mask, color, name in (
        (~inlier, style.OUTLIER, "outliers"),
        (inlier, style.CAMERA, "camera, turned"),
    ):
        ax.scatter(
            *residuals.turned[mask].T, s=4, color=color, depthshade=False, label=name, zorder=3
        )
    ax.scatter(
        *residuals.direction.T, s=3, color=style.BODY, depthshade=False, label="body", zorder=4
    )
    ax.set_box_aspect((1, 1, 1), zoom=1.35)
    ax.view_init(elev=35, azim=-50)
    ax.set_axis_off()
    ax.legend(loc="upper left", markerscale=3)


def alignment_figures(calibration: Calibration, *, true: float | None = None) -> dict[str, Figure]:
    """Return the figures of an alignment by file name, without its ending."""
    with style.context():
        figures = {name: style.new_figure(size) for name, size in _SIZES.items()}
        if calibration.curve is None:
            del figures["correlation"]
        else:
            observable = calibration.offset_observable
            draw_curve(
                figures["correlation"].subplots(),
                calibration.curve,
                found=calibration.offset if observable else None,
                interval=calibration.offset_interval,
                true=true,
            )
        draw_directions(figures["directions"].subplots(2, 1, sharex=True), calibration)
        draw_residuals(figures["residuals"].subplots(), calibration)
        sphere = figures["sphere"].add_subplot(projection="3d", computed_zorder=False)
        draw_sphere(sphere, calibration)
    return figures


def _inliers(calibration: Calibration) -> np.ndarray:
    """Return which headings lie within three standard deviations."""
    return calibration.residuals.angle <= 3.0 * calibration.diagnostics.mixture.sigma


def _legend_above(ax: Axes) -> None:
    ax.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, markerscale=3, borderaxespad=0.2)


def _azimuth(v: np.ndarray) -> np.ndarray:
    return np.degrees(np.arctan2(v[:, 1], v[:, 0]))


def _elevation(v: np.ndarray) -> np.ndarray:
    return np.degrees(np.arctan2(v[:, 2], np.hypot(v[:, 0], v[:, 1])))


def _broken(t: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a line that breaks at gaps in time and where the angle wraps."""
    step = np.median(np.diff(t)) if t.size > 1 else 1.0
    cut = np.flatnonzero((np.diff(t) > 5 * step) | (np.abs(np.diff(angle)) > 180.0)) + 1
    return np.insert(t, cut, np.nan), np.insert(angle, cut, np.nan)

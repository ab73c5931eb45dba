"""Two streams before and after their alignment: curve, directions, residuals, sphere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d import Axes3D

from evcalib import checks
from evcalib.alignment import Calibration
from evcalib.alignment.offset import OffsetCurve
from evcalib.arrays import Floats
from evcalib.geometry import LOOKS_FORWARD
from evcalib.plots import style
from evcalib.plots._angles import azimuth, elevation
from evcalib.plots._globe import draw_globe
from evcalib.series import HeadingSeries, VelocitySeries

SLOW = 0.1
"""Below this share of the median speed a direction of travel is not drawn.

That of `velocity_track`, which gives none there, but of the median: a choice for the eye alone.
"""

_NAMES = {
    "profile": "robust score",
    "trace": "trace correlation",
    "canonical": "first canonical correlation",
    "scalar": "correlation of turning rates",
    "tracks": "sightings met",
}

_SIZES = {
    "correlation": style.WIDE,
    "directions": style.TALL,
    "residuals": style.WIDE,
    "sphere": style.PAIR,
}

_FLAT = 0.1
"""The score's axis shows at least this range, so that its noise does not fill it."""

_PEAK_SPAN = 0.03
"""The curve's peak is shown over at least this far to either side [s]."""

_MAP_REACH = 5.0
"""Half width of the residuals' map in standard deviations."""


def draw_curve(
    ax: Axes,
    curve: OffsetCurve,
    *,
    found: float | None = None,
    interval: tuple[float, float] | None = None,
    true: float | None = None,
) -> None:
    """Draw a score over candidate offsets, with the offset found, its interval, and the truth.

    Without an offset found the interval is that of all plausible ones.
    """
    ax.plot(curve.offsets, curve.score, color=style.BODY)
    if interval is not None:
        name = "plausible" if found is None else "95 % interval"
        ax.axvspan(*interval, color=style.INLIER, alpha=0.2, lw=0, label=name)
    if found is not None:
        ax.axvline(found, color=style.INLIER, label=f"found {found:.4f} s")
    if true is not None:
        ax.axvline(true, color=style.TRUE, ls="--", label=f"true {true:.4f} s")
    ax.margins(x=0)
    low, high = ax.get_ylim()
    spare = max(_FLAT - (high - low), 0.0)
    ax.set_ylim(low - 0.5 * spare, high + 0.5 * spare)
    style.label(ax, "offset [s]", f"{_NAMES[curve.method]} [-]")
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="best")


def draw_peak(
    ax: Axes,
    curve: OffsetCurve,
    *,
    found: float,
    interval: tuple[float, float],
    true: float | None = None,
) -> None:
    """Draw the part of a score around the offset found, wide enough to show the interval."""
    draw_curve(ax, curve, found=found, interval=interval, true=true)
    half = max(_PEAK_SPAN, 1.5 * (interval[1] - interval[0]))
    if true is not None:
        half = max(half, 1.2 * abs(true - found))
    ax.set_xlim(found - half, found + half)
    near = curve.score[np.abs(curve.offsets - found) <= half]
    near = near[np.isfinite(near)]
    low, high = near.min(initial=1.0), near.max(initial=0.0)
    if low < high:
        ax.set_ylim(low - 0.1 * (high - low), high + 0.1 * (high - low))
    if legend := ax.get_legend():
        legend.remove()


def draw_directions(axes: Sequence[Axes], calibration: Calibration) -> None:
    """Draw azimuth and elevation of turned headings and body directions into two axes."""
    residuals, inlier = calibration.residuals, _inliers(calibration)
    size = style.dot(inlier.size)
    for ax, angle, name in zip(axes, (azimuth, elevation), ("azimuth", "elevation"), strict=True):
        camera, body = angle(residuals.turned), angle(residuals.direction)
        t, line = _broken(residuals.t, body)
        ax.plot(t, line, color=style.BODY, lw=3.5, alpha=0.5, label="body, shifted by the offset")
        for mask, color, kind in (
            (inlier, style.CAMERA, "camera, turned into the body frame"),
            (~inlier, style.OUTLIER, "outliers"),
        ):
            ax.plot(residuals.t[mask], camera[mask], ".", ms=size, color=color, label=kind)
        style.label(ax, "camera time [s]" if ax is axes[-1] else "", f"{name} [deg]")
    _legend_above(axes[0])


def draw_unaligned(
    axes: Sequence[Axes], headings: HeadingSeries, velocities: VelocitySeries
) -> None:
    """Draw the directions of both streams as they came, each on its own clock.

    The camera's are seen as if it looked straight ahead: what separates the two is the rotation
    (up and down) and the offset (sideways).
    """
    speed = velocities.speed
    moving = velocities.select(speed > SLOW * np.median(speed))
    turned = headings.v @ LOOKS_FORWARD.T
    for ax, angle, name in zip(axes, (azimuth, elevation), ("azimuth", "elevation"), strict=True):
        ax.plot(
            headings.t,
            angle(turned),
            ".",
            ms=style.dot(len(headings)),
            color=style.CAMERA,
            label="camera, as if it looked straight ahead",
        )
        t, line = _broken(moving.t, angle(moving.v))
        ax.plot(t, line, color=style.BODY, label="body, on its own clock")
        style.label(ax, "time on each clock [s]" if ax is axes[-1] else "", f"{name} [deg]")
    _legend_above(axes[0])


def draw_residuals(ax: Axes, calibration: Calibration) -> None:
    """Draw the angle between turned headings and body directions over time."""
    residuals, inlier = calibration.residuals, _inliers(calibration)
    degrees = np.degrees(residuals.angle)
    for mask, color, name in (
        (inlier, style.INLIER, "inliers"),
        (~inlier, style.OUTLIER, "outliers"),
    ):
        size = style.dot(mask.size)
        ax.plot(residuals.t[mask], degrees[mask], ".", ms=size, color=color, label=name)
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
    mean = residuals.direction.mean(axis=0)
    ahead = np.arctan2(mean[1], mean[0]) if np.linalg.norm(mean) > 0.3 else 0.0
    draw_globe(ax, elevation=30.0, azimuth=float(np.degrees(ahead)) - 30.0)
    looks: tuple[tuple[Floats, float, str, str], ...] = (
        (residuals.direction, 22, style.BODY, "body"),
        (residuals.turned[inlier], 3, style.CAMERA, "camera, turned"),
        (residuals.turned[~inlier], 3, style.OUTLIER, "outliers"),
    )
    for order, (v, size, color, name) in enumerate(looks, start=3):
        ax.scatter(
            *v.T, s=size, color=color, depthshade=False, lw=0, label=name, zorder=order, alpha=1
        )
    ax.set_axis_off()
    legend = ax.legend(loc="upper left")
    for handle in legend.legend_handles:
        handle.set_sizes([22])


def draw_residual_map(ax: Axes, calibration: Calibration) -> None:
    """Draw by how much turned headings are off their body directions, to the left and upwards.

    Circles mark one, two and three standard deviations; what lies outside is drawn on the border.
    """
    residuals, inlier = calibration.residuals, _inliers(calibration)
    sigma = np.degrees(calibration.diagnostics.mixture.sigma)
    reach = _MAP_REACH * sigma
    off = _tangent(residuals.turned, residuals.direction)
    off *= np.degrees(residuals.angle)[:, None]
    off = np.clip(off, -reach, reach)
    for mask, color, name in (
        (inlier, style.INLIER, "inliers"),
        (~inlier, style.OUTLIER, "outliers"),
    ):
        size = style.dot(mask.size)
        ax.plot(*off[mask].T, ".", ms=size, color=color, label=name, clip_on=False)
    turn = np.linspace(0.0, 2 * np.pi, 181)
    for k in (1, 2, 3):
        ax.plot(k * sigma * np.cos(turn), k * sigma * np.sin(turn), color=style.MUTED, lw=0.8)
    ax.set(xlim=(reach, -reach), ylim=(-reach, reach), aspect="equal")
    ax.locator_params(nbins=6)
    style.label(ax, "off to the left [deg]", "off upwards [deg]")
    _legend_above(ax)


def alignment_figures(calibration: Calibration, *, true: float | None = None) -> dict[str, Figure]:
    """Return the figures of an alignment by file name, without its ending."""
    checks.instance(calibration, "calibration", Calibration)
    with style.context():
        figures = {name: style.new_figure(size) for name, size in _SIZES.items()}
        if calibration.curve is None:
            del figures["correlation"]
        else:
            _draw_correlation(figures["correlation"], calibration, calibration.curve, true)
        draw_directions(figures["directions"].subplots(2, 1, sharex=True), calibration)
        draw_residuals(figures["residuals"].subplots(), calibration)
        grid = figures["sphere"].add_gridspec(1, 2, width_ratios=(6, 5), wspace=0.08)
        sphere = figures["sphere"].add_subplot(grid[0], projection="3d", computed_zorder=False)
        draw_sphere(sphere, calibration)
        draw_residual_map(figures["sphere"].add_subplot(grid[1]), calibration)
    return figures


def _draw_correlation(
    figure: Figure, calibration: Calibration, curve: OffsetCurve, true: float | None
) -> None:
    """Draw the whole curve, and its peak beside it where the offset is determined."""
    interval = calibration.offset_interval
    if not calibration.offset_observable:
        draw_curve(figure.subplots(), curve, interval=interval, true=true)
        return
    whole, peak = figure.subplots(1, 2, width_ratios=(3, 2))
    draw_curve(whole, curve, found=calibration.offset, interval=interval, true=true)
    draw_peak(peak, curve, found=calibration.offset, interval=interval, true=true)
    peak.set_ylabel("")


def _tangent(v: Floats, d: Floats) -> Floats:
    """Return the direction in which each `v` lies from its `d`: to the left, upwards; length 1."""
    left = np.stack([-d[:, 1], d[:, 0], np.zeros(len(d))], axis=1)
    left /= np.maximum(np.linalg.norm(left, axis=1, keepdims=True), 1e-12)
    up = np.cross(d, left)
    flat = np.stack([np.sum(v * left, axis=1), np.sum(v * up, axis=1)], axis=1)
    return flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12)


def _inliers(calibration: Calibration) -> np.ndarray:
    """Return which headings lie within three standard deviations."""
    return calibration.residuals.angle <= 3.0 * calibration.diagnostics.mixture.sigma


def _legend_above(ax: Axes) -> None:
    legend = ax.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, borderaxespad=0.2)
    for handle in legend.legend_handles:
        if isinstance(handle, Line2D) and handle.get_marker() == ".":
            handle.set_markersize(9.0)


def _broken(t: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a line that breaks at gaps in time and where the angle wraps."""
    step = np.median(np.diff(t)) if t.size > 1 else 1.0
    cut = np.flatnonzero((np.diff(t) > 5 * step) | (np.abs(np.diff(angle)) > 180.0)) + 1
    return np.insert(t, cut, np.nan), np.insert(angle, cut, np.nan)

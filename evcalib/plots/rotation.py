"""Directions and their residuals on the sphere, and the weight that each residual gets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from evcalib.alignment.rotation import RotationEstimate
from evcalib.arrays import Flags, Floats
from evcalib.geometry import angle_between
from evcalib.plots import style

GATE = 3.0
"""Residuals within this many standard deviations count as inliers, as in `plots.alignment`.

A choice for colours alone: of two normal errors per heading 1.1 % are larger.
"""

LOOKS = {
    "tukey": (style.INLIER, "o-"),
    "l1": (style.BODY, "s--"),
    "kabsch": (style.TRUE, "^-."),
    "gnc": (style.MEASURED, "v:"),
    "cca": (style.OUTLIER, "D-"),
}
"""Colour, marker and line of each loss where all of them stand in one panel."""

APART = 1.35
"""Names of lines stand at least by this factor apart on a logarithmic axis."""

TOP = 3.0
"""Highest relative weight that is drawn in its place."""


def draw_map(ax: Axes, e: Floats, d: Floats, estimate: RotationEstimate) -> None:
    """Draw headings, turned by an estimate, and body directions on a map of the sphere.

    The map has forward in its middle and left on its left, as one sees it from inside.  A grey
    line joins each heading with the body direction that it belongs to: its residual.

    Parameters
    ----------
    ax : Axes
        Axes of a projection of the whole sphere, such as ``"hammer"``.
    e, d : ndarray, shape (n, 3)
        Paired headings and body directions.
    estimate : RotationEstimate
        The rotation.
    """
    ax.set_autoscale_on(False)  # a map shows all there is
    turned, inlier = e @ estimate.R_body_cam.T, _inlier(e, d, estimate)
    x, y = np.stack([_on_map(turned), _on_map(d)], axis=-1)
    near = np.abs(np.diff(x, axis=1)[:, 0]) < np.pi
    ax.plot(x[near].T, y[near].T, color=style.MUTED, lw=0.4)
    for mask, color, name in (
        (inlier, style.INLIER, "headings, turned: inliers"),
        (~inlier, style.OUTLIER, "outliers"),
    ):
        # Not x[mask]: before matplotlib 3.11 a map of the sphere cannot draw a line of no points.
        ax.plot(np.where(mask, x[:, 0], np.nan), y[:, 0], ".", ms=4, color=color, label=name)
    ax.plot(x[:, 1], y[:, 1], ".", ms=5, color=style.BODY, label="body directions")
    ax.set_xticks(np.pi / 2 * np.array([-1, 0, 1]), [])
    for place, name in ((0.25, "left"), (0.5, "forward"), (0.75, "right")):
        ax.text(place, -0.12, name, transform=ax.transAxes, ha="center")
    ax.set_yticks(np.radians([-60, -30, 0, 30, 60]))


def draw_weights(ax: Axes, e: Floats, d: Floats, estimate: RotationEstimate) -> None:
    """Draw the weight of each pair, relative to the median inlier, over its residual angle.

    Weights above `TOP` are drawn at `TOP`.
    """
    angle = np.degrees(angle_between(e @ estimate.R_body_cam.T, d))
    inlier, weight = _inlier(e, d, estimate), estimate.weight
    usual = weight[inlier & (weight > 0)]
    relative = weight / (np.median(usual) if usual.size else weight.max(initial=1e-300))
    for mask, color in ((inlier, style.INLIER), (~inlier, style.OUTLIER)):
        ax.plot(angle[mask], np.minimum(relative[mask], TOP), ".", ms=5, color=color)
    ax.set_xlim(0.0, 180.0)
    ax.set_xticks(np.arange(0, 181, 45))
    ax.set_ylim(-0.1, TOP + 0.1)
    style.label(ax, "residual angle [deg]", "weight, median inlier = 1 [-]")


def draw_losses(
    axes: Sequence[Axes], e: Floats, d: Floats, estimate: RotationEstimate, *, title: str = ""
) -> None:
    """Draw what one loss makes of pairs: the map of the sphere, and the weights: two panels.

    Parameters
    ----------
    axes : sequence of two Axes
        The first one with a projection of the whole sphere.
    e, d, estimate
        As for `draw_map`.
    title : str
        Name of the loss.
    """
    left, right = axes
    draw_map(left, e, d, estimate)
    legend_of_map(left)
    draw_weights(right, e, d, estimate)
    right.set_title(title)


def legend_of_map(ax: Axes) -> None:
    """Explain the dots of a map above it."""
    ax.legend(
        loc="lower center", bbox_to_anchor=(0.5, 1.02), ncols=3, markerscale=2.5, columnspacing=1.0
    )


def draw_breakdown(
    ax: Axes, shares: Sequence[float], errors: Mapping[str, Sequence[float]]
) -> None:
    """Draw the error of each loss over the share of wrong headings.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    shares : sequence of float
        Shares of wrong headings, 0 to 1.
    errors : mapping of str to sequence of float
        By the name of the loss, its error at each share [deg].
    """
    at, place = 100 * np.array(shares), 0.0
    for name, values in sorted(errors.items(), key=lambda item: item[1][-1]):
        color, look = LOOKS[name]
        ax.semilogy(at, values, look, ms=5, color=color)
        place = max(values[-1], APART * place)
        ax.text(at[-1] + 2, place, name, color=color, va="center", fontweight="bold")
    ax.set_xlim(0, at[-1] + 14)
    ax.set_ylim(top=1.4 * place)
    ax.set_xticks(at)
    ax.set_yticks([1, 3, 10, 30], ["1", "3", "10", "30"])
    ax.set_yticks([], minor=True)
    style.label(ax, "random headings [%]", "median error [deg]")


def _inlier(e: Floats, d: Floats, estimate: RotationEstimate) -> Flags:
    angle = angle_between(e @ estimate.R_body_cam.T, d)
    return np.asarray(angle <= GATE * estimate.sigma)


def _on_map(v: Floats) -> tuple[Floats, Floats]:
    """Return longitude, growing to the right, and latitude of directions [rad]."""
    return -np.arctan2(v[:, 1], v[:, 0]), np.arctan2(v[:, 2], np.hypot(v[:, 0], v[:, 1]))

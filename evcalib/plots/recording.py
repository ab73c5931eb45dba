"""A recording at a glance: its event rate, where it has headings, and what corners look like."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from evcalib.arrays import Floats
from evcalib.heading import EventRate, HeadingEstimate, Snapshot
from evcalib.plots import style
from evcalib.plots.events import draw_surface
from evcalib.plots.heading import draw_strokes

FOUND = "heading found"
"""The row of `draw_gaps` that is no gap."""

DIM = 400
"""White of a surface that carries coloured marks: 255 is then a middle grey."""


def draw_event_rate(ax: Axes, rate: EventRate) -> None:
    """Draw events per second over time; bins without events count as zero.

    The first and the last bin are covered in part only and are left out where there are others.
    """
    t, count = _with_silence(rate)
    if t.size > 2:
        t, count = t[1:-1], count[1:-1]
    per_second = count / rate.width
    unit, name = (1e6, "million/s") if per_second.max() >= 1e6 else (1e3, "thousand/s")
    edges, level = np.append(t, t[-1] + rate.width), np.append(per_second, per_second[-1]) / unit
    ax.fill_between(edges, level, step="post", color=style.CAMERA, alpha=0.25, lw=0)
    ax.step(edges, level, where="post", color=style.CAMERA, lw=1.0)
    ax.set_xlim(edges[0], edges[-1])
    ax.set_ylim(bottom=0.0)
    style.label(ax, "camera time [s]", f"event rate [{name}]")


def draw_inlier_share(ax: Axes, t: Floats, share: Floats) -> None:
    """Draw the share of matches that agree with each heading over time [s]."""
    percent = 100.0 * share
    ax.plot(t, percent, ".", ms=style.dot(t.size), color=style.INLIER)
    if percent.size:
        median = float(np.median(percent))
        ax.axhline(median, color=style.MUTED, lw=1, label=f"median, {median:.0f} %")
        ax.legend(loc="lower right")
    ax.set_ylim(0.0, 103.0)
    style.label(ax, "camera time [s]", "inliers [% of matches]")


def draw_gaps(ax: Axes, estimate: HeadingEstimate) -> None:
    """Draw when there is a heading, and when there is none and why: one row for each reason."""
    reasons = sorted({gap.reason for gap in estimate.gaps})
    rows = [(FOUND, estimate.headings.t, style.INLIER)]
    rows += [
        (reason, np.array([g.t for g in estimate.gaps if g.reason == reason]), style.OUTLIER)
        for reason in reasons
    ]
    for row, (name, t, color) in enumerate(rows):
        ax.plot(t, np.full(t.size, row), "|", ms=9, mew=1.2, color=color)
        ax.annotate(
            f"{name} ({t.size})",
            (0.0, row),
            xycoords=ax.get_yaxis_transform(),
            xytext=(4, 6),
            textcoords="offset points",
            fontsize="small",
        )
    ax.set_yticks([])
    ax.set_ylim(len(rows) - 0.5, -0.9)
    style.label(ax, "camera time [s]", "")


def draw_snapshot(axes: Sequence[Axes], snapshot: Snapshot) -> None:
    """Draw two surfaces with their corners; on the later one also how far the matches came."""
    first, second = axes
    draw_surface(first, snapshot.image1, snapshot.corners1, title=f"t = {snapshot.t1:.2f} s")
    draw_surface(second, snapshot.image2, title=f"t = {snapshot.t2:.2f} s")
    for ax in axes:
        ax.images[0].set_clim(0, DIM)
    draw_strokes(second, snapshot.xy1, snapshot.xy2, snapshot.inlier)
    first.set_xlabel(f"{len(snapshot.corners1)} corners")
    agree = int(snapshot.inlier.sum())
    second.set_xlabel(f"{agree} of {snapshot.inlier.size} matches agree with one direction")
    second.legend(loc="lower right", frameon=True, framealpha=0.9)


def _with_silence(rate: EventRate) -> tuple[Floats, Floats]:
    """Return bins and counts with a zero after and before each bin that stands at a silence."""
    t, count = rate.t, rate.count.astype(np.float64)
    cut = np.flatnonzero(np.diff(t) > 1.5 * rate.width)
    zeros = np.concatenate((t[cut] + rate.width, t[cut + 1] - rate.width))
    starts, where = np.unique(np.round(np.append(t, zeros), 6), return_index=True)
    return starts.astype(np.float64), np.append(count, np.zeros(zeros.size))[where]

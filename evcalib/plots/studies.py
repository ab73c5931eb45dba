"""Pictures of studies: errors of methods by groups, as in the paper's Fig. 6, and costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from evcalib import checks
from evcalib.alignment.offset import OffsetCurve
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.plots import style

Table = Mapping[str, NDArray[Any]]
"""Columns of equal length: ``group``, a column of labels, and columns of numbers."""

COLOURS = {
    "ours": "#009E73",
    "vc": "#0072B2",
    "vc_wota": "#56B4E9",
    "authors": "#CC79A7",
    "cross_correlation": "#E69F00",
    "cca": "#F0E442",
    "hand_eye": "#D55E00",
    "hand_eye_offset": "#8C3B00",
    "cgoc": "#8A8A8A",
}
"""Colour of each method; others take what is left, in this order."""

WIDEST = 0.84
"""Share of a group's room that its boxes fill."""


def draw_boxes(
    ax: Axes,
    table: Table,
    values: Floats,
    *,
    labels: Sequence[str],
    groups: Sequence[str],
    by: str = "method",
) -> None:
    """Draw a box for each label in each group: quartiles, median, whiskers to 1.5 times the box.

    Values that are NaN are left out; a label without any value leaves a gap.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    table : mapping of ndarray, shape (n,)
        Tells group and label of each value.
    values : ndarray, shape (n,)
        What to draw.
    labels, groups : sequence of str
        What to draw, in this order.
    by : str
        Column of the labels.
    """
    width = WIDEST / len(labels)
    for k, label in enumerate(labels):
        sets, places = [], []
        for place, group in enumerate(groups):
            rows = (table["group"] == group) & (table[by] == label) & np.isfinite(values)
            if rows.any():
                sets.append(values[rows])
                places.append(place + (k - (len(labels) - 1) / 2) * width)
        if not sets:
            continue
        colour = colour_of(label, labels)
        ax.boxplot(
            sets,
            positions=places,
            widths=0.85 * width,
            patch_artist=True,
            manage_ticks=False,
            boxprops={"facecolor": colour, "edgecolor": colour, "alpha": 0.75},
            medianprops={"color": style.TRUE, "linewidth": 1.2},
            whiskerprops={"color": colour},
            capprops={"color": colour},
            flierprops={"marker": ".", "markersize": 2.5, "markeredgecolor": colour},
        )
    ax.set_xticks(range(len(groups)), groups)
    ax.set_xlim(-0.5, len(groups) - 0.5)
    ax.grid(visible=False, axis="x")
    for edge in range(1, len(groups)):
        ax.axvline(edge - 0.5, color=style.MUTED, lw=0.4)


def draw_rows(
    figure: Figure,
    table: Table,
    rows: Sequence[str],
    *,
    labels: Sequence[str],
    limits: tuple[float, float],
) -> None:
    """Draw the rotation errors of several motions, a row for each, as in the paper's Fig. 6.

    Parameters
    ----------
    figure : Figure
        Empty.
    table : mapping of ndarray, shape (n,)
        A study's table with ``group``, ``method`` and ``rotation_deg`` [deg].
    rows : sequence of str
        Motions; the groups of each are those whose names start with it.
    labels : sequence of str
        Methods, in this order.
    limits : tuple of float
        Of the error [deg], on a scale of powers of ten.
    """
    names = list(dict.fromkeys(table["group"].tolist()))
    for ax, motion in zip(figure.subplots(len(rows), 1, squeeze=False)[:, 0], rows, strict=True):
        groups = [name for name in names if name.startswith(motion)]
        draw_boxes(ax, table, table["rotation_deg"], labels=labels, groups=groups)
        ax.set_yscale("log")
        ax.set_yticks([0.1, 1, 10, 100], ["0.1", "1", "10", "100"])
        ax.set_ylim(*limits)
        ax.set_ylabel("rotation error [deg]")
    handles = [Patch(color=colour_of(name, labels), label=name) for name in labels]
    figure.legend(handles=handles, loc="outside upper center", ncols=5)


def draw_cost_of_clock(ax: Axes, expected: Sequence[Floats], found: Sequence[Floats]) -> None:
    """Draw errors of the rotation over those that a wrong clock explains, groups in turn.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    expected, found : sequence of ndarray, shape (n,)
        By group: errors that the offset explains, and those that there were [deg].
    """
    ax.axline((0.0, 0.0), slope=1.0, color=style.TRUE, lw=1, label="as explained")
    for x, y in zip(expected, found, strict=True):
        ax.plot(x, y, ".", ms=3, color=style.OUTLIER, label="drives" if y is found[0] else None)


def draw_arcs(
    axes: Sequence[Axes],
    curves: Mapping[str, OffsetCurve],
    found: Mapping[float, Sequence[Floats]],
    *,
    true: float,
) -> None:
    """Draw scores of offsets, and what a search on arcs at 1 m/s makes of the rotation.

    Parameters
    ----------
    axes : sequence of two Axes
        Where to draw.
    curves : mapping of str to OffsetCurve
        By the name of the drive; arcs are drawn as outliers.
    found : mapping of float to sequence of two ndarray, shape (n,)
        By the radius of the arc [m]: errors of the offset [s] and of the rotation [deg].
    true : float
        True offset of the curves [s].
    """
    left, right = axes
    for (name, curve), dash in zip(curves.items(), ("-", "--", ":", "-", "-."), strict=False):
        colour = style.OUTLIER if name.startswith("arc") else style.BODY
        left.plot(curve.offsets, curve.score, dash, color=colour, label=name)
    left.axvline(true, color=style.TRUE, lw=1.2, ls=":", label="true offset")
    left.locator_params(axis="x", nbins=5)
    style.label(left, "offset [s]", "trace correlation [-]")
    left.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, columnspacing=1.0)
    looks = ((style.OUTLIER, "o", "-"), (style.MEASURED, "s", "--"), (style.MUTED, "^", "-."))
    for (radius, (late, turned)), (colour, marker, dash) in zip(found.items(), looks, strict=False):
        late_ms, most = 1000 * np.abs(late), 1000 * float(np.abs(late).max(initial=0.1))
        right.plot(late_ms, turned, marker, ms=3.5, color=colour, label=f"arc of {radius:g} m")
        slope = np.degrees(1e-3 / radius)
        right.plot([0, most], [0, slope * most], dash, color=colour, lw=0.9)
    style.label(right, "error of the offset [ms]", "error of the rotation [deg]")
    right.legend(loc="upper left", markerscale=1.5)


def study_figure(
    table: Table,
    *,
    labels: Sequence[str] | None = None,
    groups: Sequence[str] | None = None,
    by: str = "method",
    scale: str = "log",
) -> Figure:
    """Return the rotation's error by groups, one box per label, and the offset's below it.

    Parameters
    ----------
    table : mapping of ndarray, shape (n,)
        A study's table with ``group``, ``rotation_deg`` [deg], ``offset_error_s`` [s] (optional)
        and the column `by`.
    labels, groups : sequence of str, optional
        What to draw, in this order; all, in the order of the table, if not given.
    by : str
        Column of the labels.
    scale : {"log", "linear"}
        Of both errors.

    Raises
    ------
    InputError
        If a column is missing, or nothing is left to draw.
    """
    checks.one_of(scale, "scale", ("log", "linear"))
    missing = [name for name in ("group", by, "rotation_deg") if name not in table]
    if missing:
        raise InputError(f"the table lacks the column(s) {', '.join(missing)}")
    groups = list(dict.fromkeys(table["group"].tolist())) if groups is None else list(groups)
    known = np.isfinite(table["rotation_deg"]) & np.isin(table["group"], groups)
    labels = list(dict.fromkeys(table[by][known].tolist())) if labels is None else list(labels)
    if not (labels and known.any()):
        raise InputError("there is nothing to draw: no row of these groups has a rotation error")
    panels = [("rotation error [deg]", table["rotation_deg"])]
    if "offset_error_s" in table:
        panels.append(("offset error [ms]", 1e3 * np.abs(table["offset_error_s"])))
    wide = max(style.WIDE[0], 0.16 * len(labels) * len(groups))
    with style.context():
        figure = style.new_figure((wide, 2.9 * len(panels)))
        axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for ax, (name, values) in zip(axes, panels, strict=True):
            draw_boxes(ax, table, values, labels=labels, groups=groups, by=by)
            ax.set_ylabel(name)
            ax.set_yscale(scale)
        axes[0].legend(
            handles=[Patch(color=colour_of(name, labels), label=name) for name in labels],
            ncols=min(len(labels), 5),
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
        )
        axes[-1].tick_params(axis="x", rotation=30 if len(groups) > 6 else 0)
    return figure


def cost_figure(
    trials: NDArray[Any], workers: NDArray[Any], seconds: NDArray[Any], *, name: str = "study"
) -> Figure:
    """Return how the time of a study grows with its trials, and how its rate does with workers.

    Parameters
    ----------
    trials, workers : ndarray of int, shape (n,)
        Trials in all, and workers, of each run.
    seconds : ndarray, shape (n,)
        Time that it took, start of the workers included [s].
    name : str
        Name of the study.
    """
    trials, workers = np.asarray(trials), np.asarray(workers)
    seconds = checks.floats(seconds, "seconds", (trials.size,))
    if workers.shape != trials.shape or trials.size == 0:
        raise InputError("trials, workers and seconds must have the same length, at least 1")
    counts = np.unique(workers)
    markers = "os^Dv<>p"
    with style.context():
        figure = style.new_figure(style.WIDE)
        left, right = figure.subplots(1, 2)
        for k, count in enumerate(counts):
            rows = np.flatnonzero(workers == count)
            rows = rows[np.argsort(trials[rows], kind="stable")]
            left.plot(
                trials[rows],
                seconds[rows],
                marker=markers[k % len(markers)],
                color=list(COLOURS.values())[k % len(COLOURS)],
                label=f"{count} worker{'s' if count > 1 else ''}",
            )
        style.label(left, "trials [-]", "time [s]", title=name)
        left.set_xlim(0.0)
        left.set_ylim(0.0)
        left.legend()
        most = [float(np.max(trials[workers == n] / seconds[workers == n])) for n in counts]
        right.plot(counts, most, "o-", color=style.TRUE, label="measured")
        ideal = most[0] * counts / counts[0]
        right.plot(counts, ideal, "--", color=style.MUTED, label="in proportion")
        style.label(right, "workers [-]", "best rate [trials/s]")
        right.set_xticks(counts)
        right.set_ylim(0.0)
        right.legend()
    return figure


def colour_of(label: str, labels: Sequence[str]) -> str:
    """Return the colour of a label among `labels`."""
    if label in COLOURS:
        return COLOURS[label]
    taken = {COLOURS[name] for name in labels if name in COLOURS}
    free = [colour for colour in COLOURS.values() if colour not in taken] or list(COLOURS.values())
    others = [name for name in labels if name not in COLOURS]
    return free[others.index(label) % len(free)]

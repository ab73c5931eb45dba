"""Several runs of one rig: their answers with error bars, and the pooled one."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from scipy import stats

from evcalib import checks
from evcalib.arrays import Floats
from evcalib.geometry import rotation_vector
from evcalib.pipeline import Repeats, RunAnswer
from evcalib.plots import style
from evcalib.uncertainty import t_quantile

PLANES = (("x", "y"), ("x", "z"))
"""Body axes of the two pictures of the rotation."""


def repeats_figure(repeats: Repeats) -> Figure:
    """Return the offsets with their 95 % intervals, and the rotations with their 95 % ellipses.

    Parameters
    ----------
    repeats : Repeats
        From `evcalib.pipeline.compare_runs`.

    Returns
    -------
    Figure
        Up to three panels; the own error bars of the runs, without what all share.
    """
    checks.instance(repeats, "repeats", Repeats)
    with style.context():
        panels = ("offset" in repeats.unknowns) + 2 * ("rotation" in repeats.unknowns)
        height = max(style.WIDE[1], 1.2 + 0.28 * len(repeats.runs))
        figure = style.new_figure((4.1 * panels, height))
        axes = list(np.atleast_1d(figure.subplots(1, panels)))
        if "offset" in repeats.unknowns:
            draw_offsets(axes.pop(0), repeats)
        if repeats.R_body_cam is not None:
            for ax, plane in zip(axes, PLANES, strict=True):
                draw_rotations(ax, repeats, plane)
    return figure


def draw_offsets(ax: Axes, repeats: Repeats) -> None:
    """Draw each run's offset with its own 95 % interval, and that of the pooled one as a band."""
    one = repeats.unknowns["offset"]
    runs = [run for run in repeats.runs if run.offset_determined]
    for place, run in enumerate(runs):
        half = 1e3 * t_quantile(run.samples) * run.offset_sd
        ax.errorbar(1e3 * run.offset, place, xerr=half, color=_colour(run, one.odd), fmt="o",
                    ms=5, capsize=3)  # fmt: skip
    middle, half = 1e3 * repeats.offset, 1.96e3 * repeats.offset_sd
    ax.axvspan(middle - half, middle + half, color=style.INLIER, alpha=0.2, lw=0)
    ax.set_yticks(range(len(runs)), [run.name for run in runs])
    ax.invert_yaxis()
    ax.grid(visible=False, axis="y")
    style.label(ax, "offset [ms]", "", title="offsets, 95 %; band: pooled")


def draw_rotations(ax: Axes, repeats: Repeats, plane: tuple[str, str]) -> None:
    """Draw each run's rotation from the pooled one, about two body axes, with 95 % ellipses."""
    assert repeats.R_body_cam is not None
    one = repeats.unknowns["rotation"]
    rows = ["xyz".index(axis) for axis in plane]
    for run in (run for run in repeats.runs if run.rotation_determined):
        at = np.degrees(rotation_vector(run.R_body_cam @ repeats.R_body_cam.T))[rows]
        covariance = np.degrees(np.degrees(run.rotation_covariance))[np.ix_(rows, rows)]
        colour = _colour(run, one.odd)
        ax.add_patch(_ellipse(at, covariance, run.dof, colour))
        ax.plot(*at, "o", ms=4, color=colour)
        place = (at[0], at[1])
        ax.annotate(run.name, place, (4, 4), textcoords="offset points", fontsize=7.5, color=colour)
    ax.axhline(0, color=style.MUTED, lw=0.8)
    ax.axvline(0, color=style.MUTED, lw=0.8)
    ax.set_aspect("equal", adjustable="datalim")
    ax.autoscale_view()
    style.label(
        ax,
        f"turn about body {plane[0]} [deg]",
        f"turn about body {plane[1]} [deg]",
        title="rotations from the pooled one, 95 %",
    )


def _colour(run: RunAnswer, odd: str | None) -> str:
    return style.OUTLIER if run.name == odd else style.CAMERA


def _ellipse(at: Floats, covariance: Floats, dof: float, colour: str) -> Ellipse:
    """Return the ellipse that holds 95 % of a plane's errors (F of two dimensions)."""
    values, vectors = np.linalg.eigh(covariance)
    width, height = 2 * np.sqrt(2 * stats.f.ppf(0.95, 2, dof) * np.maximum(values, 0.0))
    angle = np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0]))
    return Ellipse(tuple(at), width, height, angle=angle, fill=False, color=colour, alpha=0.7)

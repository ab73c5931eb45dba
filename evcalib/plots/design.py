"""A planned drive: where it goes, how direction and speed change, how like itself it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from evcalib.arrays import Floats
from evcalib.design import REPEATS, Prediction, self_likeness
from evcalib.plots import style
from evcalib.series import VelocitySeries, dead_reckon

JUMP = 60.0
"""Directions [deg] that differ by more from one sample to the next are not joined.

A choice for the eye: at 50 samples per second no vehicle turns by as much, and a line through a
jump of 360 would."""


def draw_course(ax: Axes, velocities: VelocitySeries) -> None:
    """Draw where a body goes, from above, forward at the start being up.

    A dot marks the start.
    """
    x, y = course(velocities).T
    ax.plot(y, x, color=style.BODY)
    ax.plot(y[:1], x[:1], "o", ms=7, mec="white", color=style.BODY)
    middle, reach = (0.5 * (y.max() + y.min()), 0.5 * (x.max() + x.min())), 0.25
    reach = max(reach, 0.58 * max(np.ptp(x), np.ptp(y)))
    ax.set(xlim=(middle[0] + reach, middle[0] - reach), ylim=(middle[1] - reach, middle[1] + reach))
    ax.set_aspect("equal")
    ax.locator_params(nbins=5)
    style.label(ax, "to the left [m]", "forward [m]")


def draw_plan(axes: Sequence[Axes], velocities: VelocitySeries) -> None:
    """Draw direction of travel and speed over time into two axes."""
    speed = velocities.speed
    moving = speed > 0.05 * speed.max(initial=1e-9)
    angle = np.degrees(np.arctan2(velocities.v[:, 1], velocities.v[:, 0]))
    angle[moving] = np.unwrap(angle[moving], period=360.0)
    angle[~moving] = np.nan
    axes[0].plot(velocities.t, angle, ".", ms=2, color=style.BODY)
    # A finger jumps from out to back: no line there.
    joined = np.where(np.abs(np.diff(angle, append=angle[-1:])) > JUMP, np.nan, angle)
    axes[0].plot(velocities.t, joined, lw=0.8, color=style.BODY)
    low, high = axes[0].get_ylim()
    spare = max(20.0 - (high - low), 0.0) / 2
    axes[0].set_ylim(low - spare, high + spare)
    axes[1].plot(velocities.t, speed, color=style.BODY)
    axes[1].set_ylim(0.0, 1.15 * speed.max(initial=1e-3))
    style.label(axes[0], "", "direction [deg]")
    style.label(axes[1], "time [s]", "speed [m/s]")


def draw_likeness(ax: Axes, prediction: Prediction, alone: Floats) -> None:
    """Draw how like itself the drive is when shifted, and how like if directions alone count.

    Above the grey line, apart from the middle, a drive may be taken for itself.
    """
    ax.axhline(REPEATS, color=style.MUTED, lw=1, ls=":")
    ax.plot(
        prediction.shifts,
        prediction.likeness,
        color=style.BODY,
        lw=3.5,
        alpha=0.6,
        label="with speeds",
    )
    ax.plot(prediction.shifts, alone, "--", color=style.CAMERA, label="directions alone")
    ax.set_ylim(0.0, 1.06)
    ax.margins(x=0)
    ax.legend(loc="lower right")
    style.label(ax, "shift [s]", "likeness to itself [-]")


def draw_plans(figure: Figure, plans: Mapping[str, tuple[VelocitySeries, Prediction]]) -> None:
    """Draw several drives side by side: their courses, and below how like themselves they are.

    Parameters
    ----------
    figure : Figure
        Empty.
    plans : mapping of str to (VelocitySeries, Prediction)
        Drives by name, each with what it allows.
    """
    axes = figure.subplots(2, len(plans), squeeze=False, height_ratios=(5, 4))
    for k, (name, (velocities, prediction)) in enumerate(plans.items()):
        top, bottom = axes[:, k]
        draw_course(top, velocities)
        alone = self_likeness(velocities, prediction.shifts, speed=False)
        draw_likeness(bottom, prediction, alone)
        bottom.get_legend().remove()
        top.set_title(name)
        if k:
            top.set_ylabel("")
            bottom.set_ylabel("")
    figure.legend(*axes[1, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)


def design_axes(figure: Figure) -> tuple[Axes, Axes, Axes, Axes]:
    """Return the axes of a planned drive in a figure: course, direction, speed, likeness."""
    grid = figure.add_gridspec(2, 3, width_ratios=(3, 4, 4))
    direction = figure.add_subplot(grid[0, 1])
    speed = figure.add_subplot(grid[1, 1], sharex=direction)
    direction.tick_params(labelbottom=False)
    for ax in (direction, speed):
        ax.yaxis.set_label_coords(-0.17, 0.5)
    engine = figure.get_layout_engine()
    if isinstance(engine, ConstrainedLayoutEngine):
        engine.set(wspace=0.06)
    return figure.add_subplot(grid[:, 0]), direction, speed, figure.add_subplot(grid[:, 2])


def draw_design(
    axes: Sequence[Axes],
    velocities: VelocitySeries,
    prediction: Prediction,
    alone: Floats,
) -> None:
    """Draw all panels of a planned drive into the axes of `design_axes`."""
    draw_course(axes[0], velocities)
    draw_plan(axes[1:3], velocities)
    draw_likeness(axes[3], prediction, alone)


def course(velocities: VelocitySeries) -> Floats:
    """Return where a body is at the times of a drive, seen from its start [m], shape (n, 2).

    Without a yaw rate it keeps its heading.
    """
    return dead_reckon(velocities)[:, :2]

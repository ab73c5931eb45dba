"""The figures of a report: what `evcalib.plots` draws, put together for one run."""

from __future__ import annotations

from matplotlib.figure import Figure

from evcalib import checks
from evcalib.heading import Snapshot
from evcalib.pipeline import CalibrationRun
from evcalib.plots import style
from evcalib.plots.alignment import alignment_figures, draw_unaligned
from evcalib.plots.recording import (
    draw_event_rate,
    draw_gaps,
    draw_inlier_share,
    draw_snapshot,
)


def report_figures(run: CalibrationRun) -> dict[str, Figure]:
    """Return the figures of a run by name, in the order of the report.

    ``unaligned``, ``directions``, ``correlation``, ``residuals``, ``sphere``, ``headings``,
    ``snapshot``, ``event_rate``; without those for which the run has no data.

    Parameters
    ----------
    run : CalibrationRun
        From `evcalib.calibrate`.

    Returns
    -------
    dict of str to Figure
        Name to figure.
    """
    checks.instance(run, "run", CalibrationRun)
    estimate = run.estimate
    true = None if run.truth is None else run.truth.offset
    with style.context():
        aligned = alignment_figures(run.calibration, true=true)
        before = style.new_figure(style.TALL)
        draw_unaligned(before.subplots(2, 1, sharex=True), estimate.headings, run.velocities)
        figures = {"unaligned": before, "directions": aligned.pop("directions"), **aligned}
        figures["headings"] = _headings_figure(run)
        if estimate.snapshot is not None:
            figures["snapshot"] = _snapshot_figure(estimate.snapshot)
        if estimate.event_rate is not None:
            figures["event_rate"] = style.new_figure(style.WIDE)
            draw_event_rate(figures["event_rate"].subplots(), estimate.event_rate)
    return figures


def _headings_figure(run: CalibrationRun) -> Figure:
    estimate = run.estimate
    rows = 1 + len(run.gap_reasons)
    if estimate.inlier_share is None:
        figure = style.new_figure((style.WIDE[0], 1.0 + 0.5 * rows))
        draw_gaps(figure.subplots(), estimate)
        return figure
    figure = style.new_figure(style.TALL)
    share, gaps = figure.subplots(2, 1, sharex=True, height_ratios=(7, 1 + rows))
    draw_inlier_share(share, estimate.headings.t, estimate.inlier_share)
    draw_gaps(gaps, estimate)
    share.set_xlabel("")
    return figure


def _snapshot_figure(snapshot: Snapshot) -> Figure:
    """Return two panels as high as the sensor asks for."""
    rows, columns = snapshot.image1.shape
    width = style.WIDE[0]
    height = min(0.5 * width * rows / columns + 0.5, 2 * width)
    figure = style.new_figure((width, height))
    draw_snapshot(figure.subplots(1, 2), snapshot)
    return figure

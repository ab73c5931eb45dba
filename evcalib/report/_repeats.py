"""The page of several runs of one rig."""

from __future__ import annotations

import numpy as np

from evcalib import checks
from evcalib.geometry import matrix_to_rpy, rotation_angle
from evcalib.pipeline import Repeats
from evcalib.plots.repeats import repeats_figure
from evcalib.report._html import Html, page, section, table, tag
from evcalib.report._page import picture, style_sheet

CAPTION = (
    "Each run with its own 95 % error bar, without what all runs of a rig share. Runs that agree"
    " overlap; one in purple stands out from the others."
)


def repeats_html(repeats: Repeats) -> str:
    """Return what several runs say together as one HTML page, its picture included.

    Parameters
    ----------
    repeats : Repeats
        From `evcalib.pipeline.compare_runs`.

    Returns
    -------
    str
        HTML that needs no script and no network.
    """
    checks.instance(repeats, "repeats", Repeats)
    names = ", ".join(run.name for run in repeats.runs)
    summary = "The runs contradict each other." if repeats.contradict else "The runs agree."
    return page(
        "Repeated calibrations",
        style_sheet(),
        tag("h1", "Repeated calibrations"),
        tag("p", names, class_="under"),
        tag(
            "div",
            tag("p", summary),
            *(tag("p", line) for line in repeats.lines()),
            class_=f"verdict {'no' if repeats.contradict else 'yes'}",
        ),
        section("Together", _together(repeats)),
        section("All answers", picture(repeats_figure(repeats), "Offsets and rotations", CAPTION)),
        section("Run by run", _runs(repeats)),
    )


def _together(repeats: Repeats) -> Html:
    rows = []
    if "offset" in repeats.unknowns:
        rows.append(
            ("Offset", f"{repeats.offset:+.5f} s", f"{1e3 * repeats.offset_sd:.2f} ms (sd)")
        )
    if repeats.R_body_cam is not None:
        matrix = "\n".join(" ".join(f"{x:+.5f}" for x in row) for row in repeats.R_body_cam)
        radius = f"error below {np.degrees(repeats.rotation_radius):.2f} deg (95 %)"
        rows.append(("R_body_cam", tag("pre", matrix), radius))
    return table(rows, ("Quantity", "Value", "How sure"))


def _runs(repeats: Repeats) -> Html:
    rows = []
    for run in repeats.runs:
        roll, pitch, yaw = np.degrees(matrix_to_rpy(run.R_body_cam))
        R = repeats.R_body_cam
        apart = "" if R is None else f"{np.degrees(rotation_angle(run.R_body_cam, R)):.2f} deg"
        offset = f"{run.offset:+.5f} s ± {1e3 * run.offset_sd:.2f} ms"
        rows.append(
            (
                run.name,
                offset if run.offset_determined else "not determined",
                f"{roll:+.2f}, {pitch:+.2f}, {yaw:+.2f}"
                if run.rotation_determined
                else "not determined",
                apart if run.rotation_determined else "",
                _chances(repeats, run.name),
            )
        )
    head = (
        "Run",
        "Offset, own sd",
        "Roll, pitch, yaw [deg]",
        "From the pooled",
        "Against the others",
    )
    return table(rows, head)


def _chances(repeats: Repeats, name: str) -> str:
    """Return how probable a run's answers are, if the others are right."""
    return ", ".join(
        f"{what} {one.agreement.without[one.runs.index(name)]:.2g}"
        for what, one in repeats.unknowns.items()
        if name in one.runs
    )

"""The report of a run: one page that holds all it shows, for any browser, without network."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from evcalib import checks
from evcalib.pipeline import CalibrationRun
from evcalib.plots import style
from evcalib.report import _text as text
from evcalib.report._figures import report_figures
from evcalib.report._html import Html, join, page, section, table, tag

DPI = 150
"""Pictures are 1230 pixels wide: sharp on a page of 60 rem, and in print."""

CAPTIONS = {
    "unaligned": (
        "Directions as they came",
        "The camera's headings, seen as if it looked straight ahead, and the vehicle's direction"
        " of travel, each on its own clock. The same shape should be seen twice, moved sideways by"
        " the offset and up or down by the mounting.",
    ),
    "directions": (
        "Directions aligned",
        "The same after the calibration: the dots should lie on the line. A slow wave in the lower"
        " panel would mean that the vehicle pitches, or that the camera's own calibration is off.",
    ),
    "correlation": (
        "Score of every offset",
        "How well the two streams agree under their best rotation, for each offset tried. One high"
        " peak within the search is good; several of one height would mean a motion that repeats"
        " itself. The green band is the 95 % interval, or all that is plausible where the offset is"
        " not determined.",
    ),
    "residuals": (
        "Residuals over time",
        "Angles between the headings and the directions of travel. They should look alike all the"
        " way; growth to one end would mean clocks that drift, a bump a stretch to look at.",
    ),
    "sphere": (
        "Directions and residuals on the sphere",
        "Left: where the vehicle travelled and where the camera says it did, in the body frame; the"
        " rotation is the better known the farther these directions spread. Right: by how much each"
        " heading is off, seen along the direction of travel, with circles of one to three standard"
        " deviations. The cloud should be centred.",
    ),
    "headings": (
        "Headings found, and why others were not",
        "Above: the share of matched corners that agree with each heading. Below: when there is a"
        " heading, and when there is none and why, one stroke for each window.",
    ),
    "snapshot": (
        "What the camera saw",
        "Event surfaces of two keyframes near the middle of the recording. Left: the corners found."
        " Right: matches, each a stroke that ends in a dot where the corner came to. Green strokes"
        " should run from one common point, the direction of travel; purple ones do not fit it.",
    ),
    "event_rate": (
        "Event rate",
        "Events per second. It should follow the speed of the vehicle; a flat top would mean a"
        " sensor or a link at its limit, a drop to zero lost data.",
    ),
}


def report_html(run: CalibrationRun) -> str:
    """Return the report of a run as one HTML page, pictures included.

    Parameters
    ----------
    run : CalibrationRun
        Result, data and circumstances.

    Returns
    -------
    str
        HTML that needs no script and no network, adapts to light and dark and prints.
    """
    checks.instance(run, "run", CalibrationRun)
    name = ", ".join(file.name for file in run.files.values())
    return page(
        "Calibration of camera and vehicle",
        style_sheet(),
        tag("h1", "Calibration of camera and vehicle"),
        tag("p", name, class_="under") if name else "",
        _verdict(run),
        section("Result", _numbers(run)),
        section("Pictures", _pictures(run)),
        section("What was read and what was left out", _data(run)),
        section("What the verdict rests on", table(text.evidence(run.calibration))),
        section("To repeat this run", _circumstances(run)),
        _footer(),
    )


def style_sheet() -> str:
    """Return the look of all pages (CSS)."""
    return files("evcalib").joinpath("report.css").read_text(encoding="utf-8")


def picture(figure: Figure, title: str, caption: str) -> Html:
    """Return a figure with its caption."""
    data = base64.b64encode(style.png(figure, dpi=DPI)).decode("ascii")
    width, height = (str(round(DPI * inches)) for inches in figure.get_size_inches())
    image = tag(
        "img",
        src=f"data:image/png;base64,{data}",
        alt=f"{title}. {caption}",
        width=width,
        height=height,
    )
    return tag(
        "figure",
        tag("h3", title),
        tag("div", image, class_="picture"),
        tag("figcaption", caption),
    )


def _verdict(run: CalibrationRun) -> Html:
    verdict = run.calibration.verdict
    said = [*text.findings(run), *verdict.reasons, *text.cautions(run)]
    return tag(
        "div",
        tag("p", verdict.summary),
        *(tag("p", sentence) for sentence in said),
        tag("h3", "What to do next"),
        _list(text.next_steps(run)),
        class_=f"verdict {text.success(run.calibration)}",
    )


def _numbers(run: CalibrationRun) -> Html:
    rows = [
        (name, tag("pre", value) if "\n" in value else value, unsure)
        for name, value, unsure in text.numbers(run)
    ]
    return table(rows, ("Quantity", "Value", "How sure"))


def _pictures(run: CalibrationRun) -> Html:
    figures = report_figures(run).items()
    return join(picture(figure, *CAPTIONS[name]) for name, figure in figures)


def _data(run: CalibrationRun) -> Html:
    estimate, counts = run.estimate, run.estimate.counts
    recording = [(role, str(file)) for role, file in run.files.items()]
    recording += run.recording.items()
    recording.append(("Events", f"{counts.events:,}"))
    if estimate.event_rate is not None:
        spanned = estimate.event_rate.t[-1] + estimate.event_rate.width - estimate.event_rate.t[0]
        recording.append(("Mean event rate", f"{counts.events / spanned:,.0f} per second"))
    recording += [(f"Lost: {what}", f"{count:,}") for what, count in run.losses.items()]
    if estimate.noise is not None:
        recording.append(("Left out as noise", estimate.noise.text()))
    windows = [
        ("Keyframes", f"{counts.keyframes:,}"),
        ("Corner events", f"{counts.corners:,}"),
        ("Corners described", f"{counts.keypoints:,}"),
        ("left out: of too few events", f"{counts.weak:,}"),
        ("left out: more than a keyframe holds", f"{counts.surplus:,}"),
        ("left out: outside the lens's image", f"{counts.unseen:,}"),
        ("Windows with a heading", f"{len(estimate.headings):,} ({100 * estimate.found:.0f} %)"),
        *((f"without: {reason}", f"{count:,}") for reason, count in run.gap_reasons),
    ]
    return join(
        (
            tag("h3", "Recording"),
            table(recording),
            tag(
                "div",
                tag("div", tag("h3", "Camera"), table(windows)),
                tag("div", tag("h3", "Vehicle"), table(_vehicle(run))),
                class_="pair",
            ),
        )
    )


def _vehicle(run: CalibrationRun) -> list[tuple[str, str]]:
    velocities, gating = run.velocities, run.gating
    rows = []
    if gating is not None:
        rows += [
            ("Rows of the wheel log", f"{gating.rows:,}"),
            ("over the slip limit", f"{gating.over_slip:,}"),
            ("over the yaw-rate limit", f"{gating.over_yaw_rate:,}"),
            ("left out in all", f"{gating.removed:,}"),
        ]
    rows.append(("Velocities used", f"{len(velocities):,}"))
    if len(velocities) > 1:
        step = float(np.median(np.diff(velocities.t)))
        rows += [
            ("Time on the vehicle's clock", f"{velocities.t[0]:.2f} to {velocities.t[-1]:.2f} s"),
            ("Rate, median", f"{1 / step:.1f} Hz"),
            ("Speed, median", f"{np.median(velocities.speed):.2f} m/s"),
        ]
    headings = run.estimate.headings
    if len(headings):
        rows.append(("Headings, camera's clock", f"{headings.t[0]:.2f} to {headings.t[-1]:.2f} s"))
    return rows


def _circumstances(run: CalibrationRun) -> Html:
    settings: dict[str, Any] = {**run.calibration.settings, **run.settings}
    parts: list[Html] = []
    if run.command:
        parts.append(tag("pre", run.command, class_="command"))
    columns = [tag("div", tag("h3", "Settings"), table(_shown(settings)))]
    right = []
    if run.versions:
        right += [tag("h3", "Versions"), table(run.versions.items())]
    if run.timings:
        total = sum(run.timings.values())
        rows = [(stage, f"{seconds:.1f} s") for stage, seconds in run.timings.items()]
        right += [tag("h3", "Time taken"), table([*rows, ("in all", f"{total:.1f} s")])]
    columns.append(tag("div", *right))
    parts.append(tag("div", *columns, class_="pair"))
    return join(parts)


def _footer() -> Html:
    return tag(
        "footer",
        "Frames: camera x right, y down, z forward; body x forward, y left, z up."
        " Camera orange, body blue, inliers green, outliers purple, truth black."
        " The run is complete if calibration.yaml stands beside this page and no file"
        " INCOMPLETE does.",
    )


def _shown(settings: Mapping[str, Any]) -> list[tuple[str, str]]:
    return [(name, "not set" if value is None else str(value)) for name, value in settings.items()]


def _list(items: list[str]) -> Html:
    return tag("ul", *(tag("li", item) for item in items))

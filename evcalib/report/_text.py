"""What a report says of a run: sentences for people, and rows of numbers with their units."""

from __future__ import annotations

import math

import numpy as np

from evcalib.alignment import Calibration
from evcalib.alignment.verdict import PIXEL_DELAY
from evcalib.arrays import Floats
from evcalib.geometry import (
    camera_looks,
    matrix_to_quaternion,
    matrix_to_rpy,
    mounting,
    rotation_angle,
)
from evcalib.pipeline import CalibrationRun, RefinedCalibration, position_text

Row = tuple[str, str, str]

FEW_HEADINGS = 0.7
"""Share of windows with a heading below which the report points it out.

A choice, for a sentence alone: rests at both ends of a drive stay below it.
"""

MUCH_GATED = 0.2
"""Share of wheel rows left out above which the report points it out.

A choice, for a sentence alone: turns between straight parts stay below it, wrong limits do not.
"""


MUCH_NOISE = 2.5
"""Noise [Hz per pixel] from which on the report says that it may delay slow edges.

A choice, for a sentence alone.  Of four simulated sweeps at 0.2 m/s with 3 to 5 Hz the offset came
out 9 and 16 ms early in two, as without noise (4 ms at most) in the others; at 0.5 m/s 5 ms off at
most.
"""


def success(calibration: Calibration) -> str:
    """Return how much of the question is answered: yes, partly or no."""
    answers = (calibration.rotation_observable, calibration.offset_observable)
    return "yes" if all(answers) else "partly" if any(answers) else "no"


def findings(run: CalibrationRun) -> list[str]:
    """Return what was found and how sure it is, in sentences."""
    calibration = run.calibration
    said = [_offset_sentence(calibration), _rotation_sentence(calibration)]
    if isinstance(calibration, RefinedCalibration) and any(calibration.position_observable):
        said.append(f"The camera sits in the body frame at {position_text(calibration)}.")
    if calibration.offset_observable:
        said.append(PIXEL_DELAY)
    if run.truth is not None:
        error = 1e3 * (calibration.offset - run.truth.offset)
        turn = np.degrees(rotation_angle(calibration.R_body_cam, run.truth.R_body_cam))
        said.append(
            f"The truth is known here: the offset is off by {error:+.1f} ms (true"
            f" {run.truth.offset:+.4f} s), the rotation by {turn:.2f} deg."
        )
    return said


def next_steps(run: CalibrationRun) -> list[str]:
    """Return what to do with the result, or for a better one."""
    calibration = run.calibration
    steps = list(calibration.verdict.advice)
    if calibration.rotation_observable:
        steps.append(
            "Use calibration.yaml; evcalib export turns it into the form of Kalibr, ROS tf or URDF."
        )
        steps.append(
            "To check it, calibrate a second drive: the two should agree within their error bars."
        )
    else:
        steps.append("Do not use the rotation of this run.")
    return steps


def cautions(run: CalibrationRun) -> list[str]:
    """Return what in the data deserves a look."""
    notes = []
    found, reasons = run.estimate.found, run.gap_reasons
    if found < FEW_HEADINGS and reasons:
        notes.append(
            f"{100 * (1 - found):.0f} % of the windows have no heading, most often because:"
            f" {reasons[0][0]}."
        )
    gating = run.gating
    if gating is not None and gating.rows and gating.removed > MUCH_GATED * gating.rows:
        notes.append(
            f"{100 * gating.removed / gating.rows:.0f} % of the wheel rows were left out, for slip"
            " or turning."
        )
    lost = [f"{count:,} {what}" for what, count in run.losses.items() if count]
    if lost:
        notes.append(f"Part of the recording could not be used: {', '.join(lost)}.")
    noise = run.estimate.noise
    if noise is not None and noise.rate >= MUCH_NOISE:
        notes.append(
            f"The sensor makes up to {noise.rate:.1f} events of noise per second and pixel. Most"
            " are left out, but they may delay the events of slow edges: in two of four simulated"
            " drives at 0.2 m/s by some 10 ms, which the stated error of the offset does not hold."
        )
    return notes


def numbers(run: CalibrationRun) -> list[Row]:
    """Return the result: quantity, value, uncertainty."""
    calibration = run.calibration
    sd = [degrees(math.sqrt(x)) for x in np.diag(calibration.rotation_covariance)]
    low, high = calibration.offset_interval
    R = calibration.R_body_cam
    if calibration.offset_observable:
        offset = f"sd {calibration.offset_sd:.4f} s; 95 % from {low:+.4f} to {high:+.4f} s"
    else:
        offset = f"not determined; plausible from {low:+.2f} to {high:+.2f} s"
    rotation = (
        f"error within {degrees(calibration.rotation_radius)} deg (95 %{_parts(calibration)});"
        f" sd about body x, y, z: {', '.join(sd)} deg"
    )
    if not calibration.rotation_observable:
        rotation = f"not determined; {rotation}"
    mixture = calibration.diagnostics.mixture
    return [
        ("Offset, t_body = t_cam + offset", f"{calibration.offset:+.4f} s", offset),
        (
            "Rotation matrix R_body_cam, v_body = R_body_cam v_cam",
            "\n".join(" ".join(f"{x:+.5f}" for x in row) for row in R),
            rotation,
        ),
        ("the same as quaternion (w, x, y, z)", _listed(matrix_to_quaternion(R), 6), ""),
        (
            "the same as roll, pitch, yaw: R = Rz(yaw) Ry(pitch) Rx(roll)",
            f"{_listed(np.degrees(matrix_to_rpy(R)), 2)} deg",
            "optical frame: x right, y down, z forward",
        ),
        (
            "Mounting against a camera that looks straight ahead: roll, pitch, yaw",
            f"{_listed(mounting(R), 2)} deg",
            "positive: right side down, looking down, looking left",
        ),
        *_position(calibration),
        (
            "Headings used",
            str(len(calibration.residuals.t)),
            f"{calibration.diagnostics.independent_headings:.0f} independent ones agree",
        ),
        (
            "Headings that agree with the result",
            f"{100 * calibration.inlier_share:.0f} %",
            f"flipped {100 * mixture.flipped:.1f} %, outliers {100 * mixture.outliers:.1f} %",
        ),
        ("Noise of a heading, per axis", f"{np.degrees(mixture.sigma):.2f} deg", ""),
    ]


def evidence(calibration: Calibration) -> list[Row]:
    """Return what the verdict rests on: quantity, value, meaning."""
    found = calibration.diagnostics
    return [
        (
            "Variation of the turning rate",
            f"z = {found.heading_rate_z:.1f}",
            "the offset needs a direction of travel that turns at a changing rate",
        ),
        (
            "Headings follow the turns",
            f"z = {found.follows_z:.1f}",
            "better than they would follow a steady turn",
        ),
        (
            "Spread of the directions of travel",
            f"{np.degrees(found.spread.spread):.1f} deg",
            f"root mean square; distinct axes, 10 deg apart: {found.spread.axes}",
        ),
        (
            "Second peak of the curve",
            f"{found.second_peak_ratio:.2f}",
            "its height over that of the first; near 1 where a motion repeats itself",
        ),
        (
            "Rotation over the plausible offsets",
            f"{np.degrees(found.offset_matters):.2f} deg",
            "largest change, where the offset is not determined",
        ),
        (
            "Memory of the residuals",
            f"{found.noise.memory:.2f} s",
            f"{100 * found.noise.share:.0f} % of their variance; counted in the error bars",
        ),
        ("Yaw rate of the body", f"{found.body_turns:.3f} rad/s", "root mean square"),
    ]


def degrees(radians: float) -> str:
    """Return an uncertainty [deg] as text, at most half a turn."""
    return f"{min(math.degrees(radians), 180.0):.2f}"


def _offset_sentence(calibration: Calibration) -> str:
    low, high = calibration.offset_interval
    if not calibration.offset_observable:
        origin = "assumed" if calibration.settings.get("offset") is None else "taken as given"
        return (
            f"The offset between the clocks is not determined; {calibration.offset:+.3f} s is"
            f" {origin}."
        )
    order, sign = ("ahead of", "+") if calibration.offset >= 0 else ("behind", "-")
    return (
        f"The vehicle's clock is {abs(calibration.offset):.4f} s {order} the camera's:"
        f" t_body = t_cam {sign} {abs(calibration.offset):.4f} s, with 95 % probability between"
        f" {low:+.4f} and {high:+.4f} s."
    )


def _rotation_sentence(calibration: Calibration) -> str:
    if not calibration.rotation_observable:
        return "The rotation below is only the best of many that the data cannot tell apart."
    return (
        f"The camera looks {camera_looks(calibration.R_body_cam)}. With 95 % probability this"
        f" rotation is off by less than {degrees(calibration.rotation_radius)} deg"
        f"{_parts(calibration)}."
    )


def _position(calibration: Calibration) -> list[Row]:
    """Return where the camera sits, and why coordinates of it are not known, each reason once."""
    if not isinstance(calibration, RefinedCalibration):
        return []
    reasons = [one.reason for one in calibration.unknowns if one.unit == "m" and not one.determined]
    why = " ".join(dict.fromkeys(reasons))
    return [("Position of the camera in the body frame", position_text(calibration), why)]


def _parts(calibration: Calibration) -> str:
    """Return what of the rotation's radius is data and what is odometry, if both are."""
    parts = calibration.radius_parts
    return f": {parts}" if parts else ""


def _listed(values: Floats, digits: int) -> str:
    return ", ".join(f"{x:+.{digits}f}" for x in values)

"""Two streams at an offset of one's choice, how well each fits, and what hides an offset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from evcalib.alignment import StreamPair
from evcalib.alignment.offset import OffsetCurve
from evcalib.arrays import Floats, Integers
from evcalib.kinematics.velocity_track import VelocityTrack
from evcalib.plots import style
from evcalib.plots._angles import azimuth, beside, cut, show_at_least, unbroken
from evcalib.plots.alignment import draw_curve
from evcalib.series import HeadingSeries, VelocitySeries

MIN_SPAN = 30.0
"""The azimuth axis shows at least this range [deg], so that noise does not fill it."""

DASHES = ("-", "--", "-.", ":")
"""Lines of one colour in a panel, in this order."""


def paired(
    headings: HeadingSeries, track: VelocityTrack, offset: float, R_body_cam: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return times, body directions and turned headings where the odometry covers them."""
    pair = StreamPair.of(headings, track)
    body, known = pair.directions(offset)
    return pair.headings.t[known], body[known], pair.headings.v[known] @ R_body_cam.T


def draw_apart(axes: Sequence[Axes], headings: HeadingSeries, velocities: VelocitySeries) -> None:
    """Draw both streams as they come, each in its own frame and on its own clock: two panels."""
    left, right = axes
    for name, values in zip("xyz", headings.v.T, strict=True):
        left.plot(headings.t, values, ".", ms=style.dot(len(headings)), color=style.CAMERA)
        end = headings.t[-1], float(values[-10:].mean())
        left.annotate(name, end, (7, 0), textcoords="offset points", va="center", fontweight="bold")
    left.set_ylim(-1.05, 1.05)
    left.set_xlim(right=headings.t[-1] + 0.08 * float(np.ptp(headings.t)))
    style.label(left, "camera time [s]", "heading, camera frame [-]", title="camera")
    right.plot(velocities.t, azimuth(velocities.v), color=style.BODY)
    style.label(right, "body time [s]", "azimuth, body frame [deg]", title="body")


def draw_streams(
    ax: Axes,
    headings: HeadingSeries,
    track: VelocityTrack,
    offset: float,
    R_body_cam: Floats,
) -> None:
    """Draw the azimuth of turned headings (dots) over that of the body, shifted by `offset`.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    headings, track
        The two streams.
    offset : float
        ``t_body = t_cam + offset`` [s].
    R_body_cam : ndarray, shape (3, 3)
        Turns the headings into the body frame.
    """
    t, body, camera = paired(headings, track, offset, R_body_cam)
    line, cuts = unbroken(t, azimuth(body))
    dots = beside(line, azimuth(camera))
    ax.plot(t, dots, ".", ms=3, color=style.CAMERA, label="camera, turned by its best rotation")
    ax.plot(cut(t, cuts), cut(line, cuts), color=style.BODY, label="body, shifted by the offset")
    show_at_least(ax, MIN_SPAN)
    style.label(ax, "camera time [s]", "azimuth [deg]")


def draw_tried(
    ax: Axes,
    curve: OffsetCurve,
    tried: Integers,
    *,
    reveal: bool = False,
    true: float | None = None,
) -> None:
    """Draw the scores of the offsets tried so far, and on `reveal` the whole curve.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    curve : OffsetCurve
        Score of every candidate.
    tried : ndarray of int, shape (k,)
        Indices of the candidates tried, the current one last.
    reveal : bool
        Show the curve, its peak and the truth.
    true : float, optional
        True offset [s].
    """
    if reveal:
        draw_curve(ax, curve, found=curve.offset, true=true)
    at, score = curve.offsets[tried], curve.score[tried]
    ax.plot(at, score, "o", ms=4, color=style.MEASURED, label="tried")
    ax.plot(at[-1:], score[-1:], "o", ms=9, mfc="none", color=style.TRUE, label="slider")
    ax.set_xlim(curve.offsets[0], curve.offsets[-1])
    ax.set_ylim(0.0, 1.05)
    style.label(ax, "offset [s]", "robust score [-]")
    ax.legend(
        loc="lower right", bbox_to_anchor=(1, 1), ncols=4, columnspacing=1.0, handlelength=1.5
    )


def draw_search(
    axes: Sequence[Axes],
    headings: HeadingSeries,
    track: VelocityTrack,
    R_body_cam: Floats,
    curve: OffsetCurve,
    tried: Sequence[int],
    *,
    reveal: bool = False,
    true: float | None = None,
) -> None:
    """Draw a search by hand: the streams at the last offset tried, and the scores of all tried.

    Parameters
    ----------
    axes : sequence of two Axes
        Where to draw.
    headings, track, R_body_cam
        As for `draw_streams`.
    curve, tried, reveal, true
        As for `draw_tried`.
    """
    left, right = axes
    draw_streams(left, headings, track, float(curve.offsets[tried[-1]]), R_body_cam)
    left.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2, markerscale=3, columnspacing=1.0)
    draw_tried(right, curve, np.array(tried), reveal=reveal, true=true)


def draw_slope(
    ax: Axes, rate: Floats, off: Floats, *, slope: float | None, title: str = ""
) -> None:
    """Draw by how much headings are off over the rate of turning, and the line through them.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    rate : ndarray, shape (n,)
        How fast the direction of travel turns [rad/s].
    off : ndarray, shape (n,)
        Azimuth of the body minus that of the turned heading [rad].
    slope : float, optional
        Of the line: the offset that is left [s].
    title : str
        Of the panel.
    """
    ax.plot(np.degrees(rate), np.degrees(off), ".", ms=3, color=style.CAMERA, label="headings")
    if slope is not None:
        ends = np.array([rate.min(), rate.max()])
        line = off.mean() + slope * (ends - rate.mean())
        name = f"slope {1e3 * slope:.0f} ms"
        ax.plot(np.degrees(ends), np.degrees(line), color=style.TRUE, label=name)
    ax.set_xlim(-42.0, 42.0)
    ax.legend(loc="upper left", markerscale=3)
    style.label(ax, "rate of turning [deg/s]", "off by [deg]", title=title)


def draw_refuge(
    axes: Sequence[Axes],
    offsets: Floats,
    scores: Mapping[str, Floats],
    errors: Mapping[str, Floats],
    *,
    true: float,
) -> None:
    """Draw the score of each offset, and how wrong the rotation is that belongs to it: two panels.

    Parameters
    ----------
    axes : sequence of two Axes
        Where to draw.
    offsets : ndarray, shape (m,)
        Candidates [s].
    scores, errors : mapping of str to ndarray, shape (m,)
        By the name of the drive: score [-], and error of the best rotation [deg].
    true : float
        True offset [s].
    """
    for ax, curves, name in zip(
        axes,
        (scores, errors),
        ("robust score [-]", "error of the best rotation [deg]"),
        strict=True,
    ):
        for (drive, values), dash in zip(curves.items(), DASHES, strict=False):
            ax.plot(offsets, values, dash, color=style.BODY, label=drive)
        ax.axvline(true, color=style.TRUE, lw=1.2, ls=":", label="true offset")
        style.label(ax, "offset [s]", name)
    axes[0].legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, borderaxespad=0.2)

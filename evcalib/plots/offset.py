"""Two streams at an offset of one's choice, and how well each offset tried fits."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from evcalib.offset import OffsetCurve
from evcalib.plots import style
from evcalib.plots.alignment import draw_curve
from evcalib.series import HeadingSeries
from evcalib.track import VelocityTrack, intervals

MIN_SPAN = 30.0
"""The azimuth axis shows at least this range [deg], so that noise does not fill it."""


def draw_streams(
    ax: Axes,
    headings: HeadingSeries,
    track: VelocityTrack,
    offset: float,
    R_body_cam: NDArray[np.float64],
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
    d = track.directions(*intervals(headings), offset)
    known = np.any(d != 0, axis=1)
    t, body = headings.t[known], _azimuth(d[known])
    camera = _azimuth(headings.v[known] @ R_body_cam.T)
    line = np.unwrap(body, period=360.0)
    # Dots stand on the same turn as the line, so that nothing jumps where the angle wraps.
    dots = line + (camera - body + 180.0) % 360.0 - 180.0
    ax.plot(t, dots, ".", ms=3, color=style.CAMERA, label="camera, turned by its best rotation")
    ax.plot(t, line, color=style.BODY, label="body, shifted by the offset")
    low, high = ax.get_ylim()
    if high - low < MIN_SPAN:
        middle = 0.5 * (low + high)
        ax.set_ylim(middle - MIN_SPAN / 2, middle + MIN_SPAN / 2)
    style.label(ax, "camera time [s]", "azimuth [deg]")


def draw_tried(
    ax: Axes,
    curve: OffsetCurve,
    tried: NDArray[np.int64],
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
    ax.legend(loc="lower right", ncols=2)


def _azimuth(v: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.degrees(np.arctan2(v[:, 1], v[:, 0]))

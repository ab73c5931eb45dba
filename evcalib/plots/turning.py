"""A body that turns with its camera on it: in space, from above, and how sure each unknown is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.path import Path
from matplotlib.transforms import Bbox
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from scipy import stats

from evcalib.arrays import Floats
from evcalib.design import POSITION_GATE, ROTATION_GATE, Prediction
from evcalib.geometry import rotation_vector_to_matrix, unit
from evcalib.plots import style
from evcalib.series import VelocitySeries, dead_reckon

REACH = 0.55
"""Half the side of the floor on which a body stands [m]."""
BODY = (0.32, 0.2)
"""Half length and half width of the body that stands for all [m]."""
UP = np.array([0.0, 0.0, 1.0])
LEAST, MOST = 1e-3, 300.0
"""Where the scale of error bars over their limits begins and ends."""


def draw_mounting(
    ax: Axes3D,
    R_body_cam: Floats,
    position: Floats,
    covariance: Floats,
    *,
    times: float = 1.0,
    true: Floats | None = None,
) -> None:
    """Draw a body, the camera on it, and how sure its place is.

    The camera is a pyramid that opens to where it looks.  Below it on the floor is the ellipse that
    holds 95 % of the errors of x and y, cut off where the floor ends; the dotted line is the height
    that no motion in a plane shows.

    Parameters
    ----------
    ax : Axes3D
        Where to draw.
    R_body_cam : ndarray, shape (3, 3)
        Rotation.
    position : ndarray, shape (3,)
        Of the camera in the body frame [m], the height as it is to be drawn.
    covariance : ndarray, shape (2, 2)
        Of x and y [m^2].
    times : float
        The ellipse is drawn so many times as large.
    true : ndarray, shape (3,), optional
        Where the camera is in truth; a cross on the floor.
    """
    _draw_body(ax)
    foot = np.append(position[:2], 0.0)
    edge = _on_floor(position[:2] + times * error_ellipse(covariance))
    if len(edge):
        look = {"facecolor": style.MEASURED, "alpha": 0.45, "edgecolor": style.MEASURED, "lw": 1.2}
        ax.add_collection3d(Poly3DCollection([_level(edge)], zorder=3, clip_on=False, **look))
    top = position + 0.15 * UP
    ax.plot(*np.stack([foot, top]).T, ":", color=style.TRUE, lw=1.2, zorder=4)
    ax.plot(*foot[:, None], "o", ms=4, color=style.CAMERA, zorder=5)
    if true is not None:
        ax.plot(*np.append(true[:2], 0.0)[:, None], "x", ms=8, mew=2, color=style.TRUE, zorder=6)
    _draw_camera(ax, R_body_cam, position)
    ax.set(xlim=(-REACH, REACH), ylim=(-REACH, REACH), zlim=(0.0, REACH))
    ax.set_box_aspect((2, 2, 1), zoom=1.03)
    ax.view_init(elev=40.0, azim=-125.0)
    ax.set_axis_off()


def error_ellipse(covariance: Floats, probability: float = 0.95) -> Floats:
    """Return the border (73, 2) of what holds so many of the errors of a plane."""
    turn = np.linspace(0.0, 2 * np.pi, 73)
    size, axes = np.linalg.eigh(covariance)
    radius = np.sqrt(stats.chi2.ppf(probability, 2) * np.maximum(size, 0.0))
    return np.asarray(np.stack([np.cos(turn), np.sin(turn)], axis=1) * radius @ axes.T)


def draw_paths(ax: Axes, velocities: VelocitySeries, position: Floats) -> None:
    """Draw the ways of a body and of a camera on it, from above, forward at the start being up.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    velocities : VelocitySeries
        Of the body.
    position : ndarray, shape (2,)
        Of the camera in the body frame [m].
    """
    lever = np.array([position[0], position[1], 0.0])
    rate = np.zeros(len(velocities)) if velocities.yaw_rate is None else velocities.yaw_rate
    moved = VelocitySeries(velocities.t, velocities.v + rate[:, None] * np.cross(UP, lever), rate)
    body, camera = dead_reckon(velocities)[:, :2], dead_reckon(moved)[:, :2] + lever[:2]
    every = np.concatenate([body, camera, [BODY, (-BODY[0], -BODY[1])]])
    middle = (every.max(axis=0) + every.min(axis=0)) / 2
    reach = 0.55 * float(np.ptp(every, axis=0).max())
    length, width = BODY
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * [length, width]
    ax.fill(*_on_page(corners).T, color=style.MUTED, alpha=0.25, lw=0)
    ax.plot(*_on_page(camera).T, color=style.CAMERA, lw=1.0, label="camera")
    ax.plot(*_on_page(body).T, color=style.BODY, label="body")
    for path, color in ((camera, style.CAMERA), (body, style.BODY)):
        ax.plot(*_on_page(path[:1]).T, "o", ms=5, mec="white", color=color)
    ax.set(xlim=(middle[1] + reach, middle[1] - reach), ylim=(middle[0] - reach, middle[0] + reach))
    ax.set_aspect("equal")
    ax.locator_params(nbins=5)
    style.label(ax, "to the left [m]", "forward [m]")


def draw_unknowns(
    ax: Axes, prediction: Prediction, before: Mapping[str, float] | None = None
) -> None:
    """Draw the error bar of each unknown, on one scale for all.

    The scale is relative to the limit below which an unknown counts as shown: bars that end left of
    the line are of unknowns that the motion shows.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    prediction : Prediction
        Of `evcalib.design.predict`.
    before : mapping of str to float, optional
        What `relative_errors` gave for another motion; a ring for each.
    """
    shares, texts = relative_errors(prediction), _texts(prediction)
    for row, (name, share) in enumerate(shares.items()):
        color, end = (
            style.INLIER if share < 1 else style.OUTLIER,
            float(np.clip(share, LEAST, MOST)),
        )
        ax.barh(row, end - LEAST, left=LEAST, height=0.55, color=color, lw=0)
        if before is not None:
            was = float(np.clip(before[name], LEAST, MOST))
            ax.plot(was, row, "o", ms=7, mfc="none", color=style.TRUE)
            end = max(end, 1.25 * was)
        ax.text(end, row, f" {texts[name]}", va="center", fontsize=8.5)
    ax.axvline(1.0, color=style.TRUE, lw=1, ls="--")
    for word, side in (("shown ", "right"), (" not shown", "left")):
        ax.text(1.0, -0.75, word, ha=side, va="center", fontsize=8.5, color=style.MUTED)
    ax.set_xscale("log")
    ax.set(xlim=(LEAST, MOST), ylim=(len(shares) - 0.4, -1.1))
    ax.set_xticks([0.01, 0.1, 1, 10, 100], ["1/100", "1/10", "1", "10", "100"])
    ax.set_xticks([], minor=True)
    ax.set_yticks(range(len(shares)), list(shares))
    ax.grid(axis="y", visible=False)
    style.label(ax, "standard deviation over its limit [-]", "")


def relative_errors(prediction: Prediction) -> dict[str, float]:
    """Return the standard deviation of each unknown over the limit below which it counts as shown.

    Parameters
    ----------
    prediction : Prediction
        Of `evcalib.design.predict`.

    Returns
    -------
    dict of str to float
        By the name of the unknown, from roll to y.
    """
    roll, pitch, yaw = prediction.rotation_sd / ROTATION_GATE
    x, y = prediction.position_sd / POSITION_GATE
    offset = prediction.offset_sd / (prediction.max_offset / 4)
    found = {"roll": roll, "pitch": pitch, "yaw": yaw, "offset": offset, "x": x, "y": y}
    return {name: float(share) for name, share in found.items()}


def _texts(prediction: Prediction) -> dict[str, str]:
    angles = (f"{_short(np.degrees(sd))} deg" for sd in prediction.rotation_sd)
    places = (f"{_short(100 * sd)} cm" for sd in prediction.position_sd)
    told = [*angles, f"{_short(1e3 * prediction.offset_sd)} ms", *places]
    return dict(zip(relative_errors(prediction), told, strict=True))


def _short(value: float) -> str:
    return f"{value:.2g}" if value < 9.95 else f"{value:.0f}"


def turning_axes(figure: Figure) -> tuple[Axes, Axes3D, Axes]:
    """Return the axes of a motion in a figure: the ways, the body in space, the error bars."""
    grid = figure.add_gridspec(1, 3, width_ratios=(3, 4, 4))
    space = figure.add_subplot(grid[1], projection="3d", computed_zorder=False)
    return figure.add_subplot(grid[0]), space, figure.add_subplot(grid[2])


def draw_turning(
    axes: tuple[Axes, Axes3D, Axes],
    velocities: VelocitySeries,
    prediction: Prediction,
    R_body_cam: Floats,
    position: Floats,
    *,
    times: float = 1.0,
    before: Mapping[str, float] | None = None,
) -> None:
    """Draw a motion, the camera on its body, and what the motion will tell, into `turning_axes`.

    Parameters
    ----------
    axes : tuple of Axes
        Of `turning_axes`.
    velocities, prediction
        The motion, and what it will tell.
    R_body_cam, position, times
        As for `draw_mounting`.
    before : mapping of str to float, optional
        As for `draw_unknowns`.
    """
    ways, space, bars = axes
    draw_paths(ways, velocities, position[:2])
    draw_mounting(space, R_body_cam, position, prediction.covariance[4:, 4:], times=times)
    draw_unknowns(bars, prediction, before)


def draw_places(
    ax: Axes,
    x: Floats,
    y: Floats,
    met: Floats,
    *,
    true: Sequence[float],
    scale: tuple[float, float] = (0.0, 1.0),
) -> None:
    """Draw how well each place of the camera explains what is seen, from above.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    x, y : ndarray, shape (n,), (m,)
        Places in the body frame [m], evenly spaced.
    met : ndarray, shape (n, m)
        Share of the observations that are met with the camera there, 0 to 1.
    true : sequence of float
        Where the camera is, x and y [m]; a cross.
    scale : tuple of float
        Shares of the palest and the darkest colour.
    """
    half = (x[1] - x[0]) / 2, (y[1] - y[0]) / 2
    sides = (y[0] - half[1], y[-1] + half[1], x[0] - half[0], x[-1] + half[0])
    low, high = scale
    ax.imshow(met, origin="lower", extent=sides, cmap="Blues", vmin=low, vmax=high)
    ax.plot(true[1], true[0], "x", ms=9, mew=2, color=style.CAMERA)
    ax.invert_xaxis()
    ax.grid(visible=False)
    ax.locator_params(nbins=4)
    style.label(ax, "y, to the left [m]", "x, forward [m]")


def draw_trade(
    ax: Axes,
    centre: Floats,
    position: Floats,
    yaw: float,
    others: Sequence[tuple[float, float]],
) -> None:
    """Draw cameras, from above, that see the same while a body turns about one point.

    Each is the first one turned about that point and set nearer or farther: the angle between where
    it looks (the open side) and where it goes (the arrow) stays the same.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    centre, position : ndarray, shape (2,)
        The point that the body turns about, and the camera's place, in the body frame [m].
    yaw : float
        Where the camera looks, from forward to the left [rad].
    others : sequence of (float, float)
        By how much each is turned [rad], and how many times as far from the centre.
    """
    length, width = BODY
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * [length, width]
    ax.fill(*_on_page(corners).T, color=style.MUTED, alpha=0.25, lw=0)
    ax.plot(*_on_page(centre), "X", ms=10, color=style.BODY)
    for k, (angle, scale) in enumerate([(0.0, 1.0), *others]):
        turn = rotation_vector_to_matrix([0.0, 0.0, angle])[:2, :2]
        place = centre + scale * turn @ (position - centre)
        arm = place - centre
        color = style.MUTED if k else style.CAMERA
        ax.plot(*_on_page(np.stack([centre, place])).T, ":", color=style.MUTED, lw=1)
        going = place + 0.35 * unit(np.array([-arm[1], arm[0]]))
        look = {"arrowstyle": "-|>", "color": style.BODY, "lw": 1.8, "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", tuple(_on_page(going)), tuple(_on_page(place)), arrowprops=look)
        wedge = np.radians([[0.0, 0.0], [28.0, 1.0], [-28.0, 1.0]])
        at = yaw + angle + wedge[:, 0]
        sides = place + 0.24 * np.degrees(wedge[:, 1:]) * np.stack([np.cos(at), np.sin(at)], axis=1)
        ax.fill(*_on_page(sides).T, color=color, alpha=0.75, lw=0, zorder=3)
    ax.set_aspect("equal")
    ax.margins(0.12)
    ax.invert_xaxis()
    style.label(ax, "body y, to the left [m]", "body x, forward [m]")


def _draw_body(ax: Axes3D) -> None:
    """Draw a plate with two wheels on a floor, and the axes of the body frame."""
    length, width = BODY
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]])
    floor = {"facecolor": "none", "edgecolor": style.MUTED, "lw": 0.6, "zorder": 0}
    floor["clip_on"] = False
    ax.add_collection3d(Poly3DCollection([_level(REACH * corners)], **floor))
    plate = {"facecolor": style.MUTED, "alpha": 0.3, "lw": 0, "zorder": 1}
    ax.add_collection3d(Poly3DCollection([_level(corners * [length, width])], **plate))
    for side in (1, -1):
        wheel = corners * [0.09, 0.025] + [0.0, side * (width + 0.035)]
        ax.add_collection3d(
            Poly3DCollection([_level(wheel)], facecolor="0.3", lw=0, alpha=1, zorder=1)
        )
    for end, name in zip(np.eye(3) * [0.48, 0.42, 0.34], "xyz", strict=True):
        ax.plot(*np.stack([0 * end, end]).T, color=style.BODY, lw=1.6, zorder=2)
        ax.text(*end * 1.1, name, color=style.BODY, ha="center", va="center", zorder=9)


def _draw_camera(ax: Axes3D, R_body_cam: Floats, position: Floats) -> None:
    frame = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * [0.08, 0.06]
    far = position + np.column_stack([frame, np.full(4, 0.15)]) @ R_body_cam.T
    sides = [np.stack([position, far[k], far[k - 1]]) for k in range(4)]
    look = {"facecolor": style.CAMERA, "edgecolor": style.CAMERA, "lw": 1.0, "alpha": 0.35}
    ax.add_collection3d(Poly3DCollection([*sides, far], zorder=7, **look))
    ahead = np.stack([position, position + 0.3 * R_body_cam[:, 2]])
    ax.plot(*ahead.T, color=style.CAMERA, lw=1.6, zorder=8)


def _on_floor(points: Floats) -> Floats:
    """Return what of a polygon (n, 2) lies on the floor; empty if nothing does."""
    floor = Bbox.from_extents(-REACH, -REACH, REACH, REACH)
    return np.asarray(Path(points).clip_to_bbox(floor, inside=True).vertices)


def _level(points: Floats) -> Floats:
    return np.column_stack([points, np.zeros(len(points))])


def _on_page(points: Floats) -> Floats:
    """Body (x forward, y left) to plot coordinates: y across (its axis runs leftwards), x up."""
    return points[..., ::-1]

"""A vehicle seen from above, its wheels and how it moves; a log of its velocity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from evcalib.arrays import Floats
from evcalib.kinematics import BodyVelocities, Mecanum, Vehicle, WheelStates
from evcalib.plots import style
from evcalib.series import VelocitySeries, dead_reckon, yaw_angles

SECONDS = 0.3
"""A velocity is drawn as the way it goes in this time [s]."""
MIN_ARROW = 0.01
"""Shorter arrows [m] are not drawn."""

ORIGIN, UPRIGHT = np.zeros(2), np.eye(2)


def draw_motion(
    ax: Axes, vehicle: Vehicle, states: WheelStates, *, row: int = 0, reach: float | None = None
) -> None:
    """Draw a vehicle from above: what its wheels measure and the motion that explains it.

    Forward is up and left is left.  Arrows show the way of 0.3 s: orange what each wheel
    measures, blue the body (and, thin, what the body's motion means for each wheel), a purple
    bar is the slip between the two.  A blue cross marks the point about which the body turns.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    vehicle : Swerve, Mecanum, Omni or Rolling
        The vehicle.
    states : WheelStates
        States of its wheels.
    row : int
        Which row of the states to draw.
    reach : float, optional
        Half the side of the picture [m]; as large as the drawing needs if not given.

    See Also
    --------
    explain_motion : puts the legend below the figure.
    """
    one = WheelStates(
        states.speed[row : row + 1], None if states.steer is None else states.steer[row : row + 1]
    )
    twist = vehicle.twist(one)
    positions, angle = vehicle.positions, vehicle.directions(one)[0]
    implied = _implied(vehicle, twist.v[0], float(twist.yaw_rate[0]), angle)
    measured = _measured(vehicle, one, angle, implied)
    size = float(np.abs(positions).max())
    _draw_chassis(ax, vehicle, angle, size)
    for place, is_, should in zip(positions, measured, implied, strict=True):
        _arrow(ax, place, place + SECONDS * should, style.BODY, width=1.0)
        _arrow(ax, place, place + SECONDS * is_, style.MEASURED)
        _bar(ax, place + SECONDS * should, place + SECONDS * is_)
    _arrow(ax, np.zeros(2), SECONDS * twist.v[0], style.BODY, width=3.0)
    if reach is None:
        reach = _reach(vehicle, one)
    _draw_turning_point(ax, twist.v[0], float(twist.yaw_rate[0]), reach)
    _frame(ax, reach)


def draw_motions(axes: Sequence[Axes], cases: Mapping[str, tuple[Vehicle, WheelStates]]) -> None:
    """Draw vehicles and their motions side by side to one scale (`draw_motion`), with titles."""
    reach = max(_reach(vehicle, states) for vehicle, states in cases.values())
    for ax, (name, (vehicle, states)) in zip(axes, cases.items(), strict=True):
        draw_motion(ax, vehicle, states, reach=reach)
        ax.set_title(name)
        if ax is not axes[0]:
            ax.set_ylabel("")


def draw_travel(
    ax: Axes, vehicle: Vehicle, states: WheelStates, *, seconds: float, now: float
) -> None:
    """Draw where a vehicle goes while its wheels stay as they are, from above.

    The body's motion is constant in its own frame, so it goes along a circle or a line.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    vehicle : Swerve, Mecanum, Omni or Rolling
        The vehicle.
    states : WheelStates
        States of its wheels; the first row counts.
    seconds : float
        How long it goes [s].
    now : float
        When it is drawn [s]; where it started is drawn in grey.
    """
    twist = vehicle.twist(states)
    motion = *twist.v[0], float(twist.yaw_rate[0])
    angle = vehicle.directions(states)[0]
    size = float(np.abs(vehicle.positions).max())
    path = np.array([_placed(motion, t)[0] for t in np.linspace(0.0, seconds, 61)])
    ax.plot(*_on_page(path).T, color=style.BODY, lw=1.6, zorder=3)
    for t, alpha in ((0.0, 0.3), (now, 1.0)):
        place, turn = _placed(motion, t)
        _draw_chassis(ax, vehicle, angle, size, place=place, turn=turn, alpha=alpha)
    place, turn = _placed(motion, now)
    ahead = np.stack([place, place + turn @ [0.8 * size, 0.0]])
    ax.plot(*_on_page(ahead).T, color=style.BODY, lw=3, zorder=5)
    corners = path[:, None] + 1.5 * size * np.array([[-1, -1], [1, 1]])
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    middle, reach = (low + high) / 2, max(float((high - low).max()) / 2, 2.5 * size)
    ax.set(xlim=(middle[1] + reach, middle[1] - reach), ylim=(middle[0] - reach, middle[0] + reach))
    ax.set_aspect("equal")
    ax.locator_params(nbins=6)
    style.label(ax, "to the left [m]", "forward [m]")


def explain_motion(figure: Figure) -> None:
    """Put the legend of `draw_motion` below all panels of a figure.

    Parameters
    ----------
    figure : Figure
        With a constrained layout.
    """
    looks: dict[str, Any] = {
        "measured by a wheel": {"color": style.MEASURED, "lw": 2},
        "velocity of the body": {"color": style.BODY, "lw": 3},
        "the body's motion at a wheel": {"color": style.BODY, "lw": 1},
        "slip": {"color": style.OUTLIER, "lw": 4},
        "centre of rotation": {"color": style.BODY, "marker": "X", "ls": "", "ms": 8},
    }
    handles = [Line2D([], [], label=name, **look) for name, look in looks.items()]
    columns = 5 if figure.get_figwidth() > style.WIDE[0] - 1 else 2
    figure.legend(handles=handles, loc="outside lower center", ncols=columns)


def draw_velocity_log(axes: Sequence[Axes], result: BodyVelocities) -> None:
    """Draw velocity, yaw rate and slip of a log over time.

    Parameters
    ----------
    axes : sequence of Axes
        Three, stacked.
    result : BodyVelocities
        From `evcalib.kinematics.body_velocities`.
    """
    series = result.velocities
    assert series.yaw_rate is not None
    names = ("forward $v_x$", "left $v_y$")
    for values, name, dash in zip(series.v.T[:2], names, ("-", "--"), strict=True):
        axes[0].plot(series.t, values, dash, color=style.BODY, label=name)
    axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    axes[1].plot(series.t, series.yaw_rate, color=style.BODY)
    axes[2].plot(series.t, result.slip, ".", ms=3, color=style.OUTLIER)
    labels = ("velocity [m/s]", "yaw rate [rad/s]", "slip [m/s]")
    for ax, name in zip(axes, labels, strict=True):
        style.label(ax, "time [s]" if ax is axes[-1] else "", name)


def draw_claimed_path(ax: Axes, velocities: VelocitySeries, *, marks: int = 12) -> None:
    """Draw the path that a log claims, from its start facing up, and how the body faces on it.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    velocities : VelocitySeries
        Velocity of the body's origin; without a yaw rate the body is drawn as if it never turned.
    marks : int
        At so many places a short line shows where the body's front is.
    """
    t, yaw = velocities.t, yaw_angles(velocities)
    ahead = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    path = dead_reckon(velocities)[:, :2]
    middle = (path.max(axis=0) + path.min(axis=0)) / 2
    reach = max(0.58 * float(np.ptp(path, axis=0).max()), 0.1)
    ax.plot(*_on_page(path).T, color=style.BODY, lw=1.6)
    for k in np.linspace(0, t.size - 1, marks).astype(int):
        front = np.stack([path[k], path[k] + 0.12 * reach * ahead[k]])
        ax.plot(*_on_page(front).T, color=style.MEASURED, lw=2.5, zorder=4)
        ax.plot(*_on_page(path[k]), "o", color=style.BODY, ms=7 if k == 0 else 3, zorder=5)
    ax.set(xlim=(middle[1] + reach, middle[1] - reach), ylim=(middle[0] - reach, middle[0] + reach))
    ax.set_aspect("equal")
    ax.locator_params(nbins=5)
    title = f"path of {t[-1] - t[0]:.3g} s from the large dot,\norange: where the front is"
    style.label(ax, "to the left of the start [m]", "forward of the start [m]", title=title)


def motion_figure(
    velocities: VelocitySeries,
    vehicle: Vehicle | None = None,
    states: WheelStates | None = None,
) -> Figure:
    """Return a picture by which a person sees signs that no check can: vehicle, arrows and path.

    Parameters
    ----------
    velocities : VelocitySeries
        What came of a log.
    vehicle : Swerve, Mecanum, Omni or Rolling, optional
        The vehicle, if the log is of wheels.
    states : WheelStates, optional
        Its wheels; the row that moves fastest is drawn.

    Returns
    -------
    Figure
        One panel, or two with a vehicle.
    """
    if vehicle is None or states is None:
        figure = style.new_figure()
        draw_claimed_path(figure.subplots(), velocities)
        return figure
    figure = style.new_figure((style.WIDE[0] - 1, 4.8))
    left, right = figure.subplots(1, 2)
    row = int(np.argmax(np.linalg.norm(vehicle.twist(states).v, axis=1)))
    draw_motion(left, vehicle, states, row=row)
    left.set_title(f"row {row + 1} of the log,\nits fastest", loc="left")
    draw_claimed_path(right, velocities)
    explain_motion(figure)
    return figure


def draw_speed_error(ax: Axes, rates: NDArray, errors: Mapping[str, NDArray]) -> None:
    """Draw errors of the forward speed [m/s] over the yaw rate [rad/s], one line each."""
    looks = (("--", style.OUTLIER), ("-", style.BODY))
    for (name, error), (dash, color) in zip(errors.items(), looks, strict=True):
        ax.plot(rates, error, dash, color=color, label=name)
    ax.legend(loc="upper left")
    style.label(ax, "yaw rate [rad/s]", "error of the forward speed [m/s]")


def _reach(vehicle: Vehicle, one: WheelStates) -> float:
    """Return half the side [m] of a picture that holds a vehicle and all arrows."""
    twist, angle = vehicle.twist(one), vehicle.directions(one)[0]
    implied = _implied(vehicle, twist.v[0], float(twist.yaw_rate[0]), angle)
    measured = _measured(vehicle, one, angle, implied)
    tips = vehicle.positions + SECONDS * np.stack([measured, implied])
    return float(max(2.2 * np.abs(vehicle.positions).max(), 1.08 * np.abs(tips).max()))


def _implied(vehicle: Vehicle, v: Floats, yaw_rate: float, angle: Floats) -> Floats:
    """Return what the wheels would measure under this twist, as vectors (k, 2) [m/s]."""
    said = vehicle.matrix @ np.array([v[0], v[1], yaw_rate])
    return said.reshape(-1, 2) if said.size > angle.size else said[:, None] * _unit(angle)


def _measured(vehicle: Vehicle, one: WheelStates, angle: Floats, implied: Floats) -> Floats:
    """Return what the wheels measure (k, 2) [m/s]; one that tells no speed shows its direction."""
    told = dict(zip(vehicle.speed_names, one.speed[0], strict=True))
    ahead = (_unit(angle) * implied).sum(axis=1)
    speed = np.array([told.get(n, a) for n, a in zip(vehicle.names, ahead, strict=True)])
    return speed[:, None] * _unit(angle)


def _unit(angle: Floats) -> Floats:
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _on_page(points: Floats) -> Floats:
    """Body (x forward, y left) to plot coordinates: y across (its axis runs leftwards), x up."""
    return points[..., ::-1]


def _placed(motion: tuple[float, float, float], t: float) -> tuple[Floats, Floats]:
    """Return where a constant twist takes the body in some time, and how it is turned then."""
    vx, vy, rate = motion
    turned = rate * t
    turn = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
    # sin(a)/a and (1 - cos(a))/a, which have limits on a straight line
    along = float(np.sinc(turned / np.pi))
    across = float(np.sin(turned / 2) * np.sinc(turned / (2 * np.pi)))
    return t * np.array([along * vx - across * vy, across * vx + along * vy]), turn


def _draw_chassis(
    ax: Axes,
    vehicle: Vehicle,
    angle: Floats,
    size: float,
    *,
    place: Floats = ORIGIN,
    turn: Floats = UPRIGHT,
    alpha: float = 1.0,
) -> None:
    places = vehicle.positions
    around = places - places.mean(axis=0)
    order = np.argsort(np.arctan2(around[:, 1], around[:, 0]), kind="stable")
    fill = {"facecolor": style.MUTED, "alpha": 0.15 * alpha, "zorder": 1}
    ax.add_patch(Polygon(_on_page(place + places[order] @ turn.T), closed=True, **fill))
    half = 0.22 * size * np.array([[1, 0.4], [1, -0.4], [-1, -0.4], [-1, 0.4]])
    rollers = (-1, 1, 1, -1) if isinstance(vehicle, Mecanum) else (0,) * len(places)
    for here, a, roller in zip(places, angle, rollers, strict=True):
        steer = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
        tyre = {"facecolor": "0.75", "edgecolor": "0.2", "zorder": 2, "alpha": alpha}
        corners = place + (here + half @ steer.T) @ turn.T
        ax.add_patch(Polygon(_on_page(corners), closed=True, **tyre))
        for along in (-0.12, 0.0, 0.12) if roller else ():
            # the rollers as seen from above: those on the ground lie the other way round
            ends = size * np.array([[along - 0.06, 0.06 * roller], [along + 0.06, -0.06 * roller]])
            ends = place + (here + ends) @ turn.T
            ax.plot(*_on_page(ends).T, color="0.2", lw=1, zorder=3, alpha=alpha)


def _arrow(ax: Axes, start: Floats, end: Floats, color: str, width: float = 2.0) -> None:
    if np.hypot(*(end - start)) < MIN_ARROW:
        return
    look = {"arrowstyle": "-|>", "color": color, "lw": width, "shrinkA": 0, "shrinkB": 0}
    look["mutation_scale"] = 6 + 2 * width
    tip, tail = (end[1], end[0]), (start[1], start[0])
    ax.annotate("", xy=tip, xytext=tail, arrowprops=look, annotation_clip=False, zorder=5)


def _bar(ax: Axes, start: Floats, end: Floats) -> None:
    if np.hypot(*(end - start)) >= MIN_ARROW:
        ax.plot(*_on_page(np.stack([start, end])).T, color=style.OUTLIER, lw=4, zorder=6)


def _draw_turning_point(ax: Axes, v: Floats, yaw_rate: float, reach: float) -> None:
    if abs(yaw_rate) * reach <= np.hypot(*v):
        return
    ax.plot(v[0] / yaw_rate, -v[1] / yaw_rate, "X", color=style.BODY, ms=9, zorder=6)


def _frame(ax: Axes, reach: float) -> None:
    ax.set_xlim(reach, -reach)
    ax.set_ylim(-reach, reach)
    ax.set_aspect("equal")
    ax.locator_params(nbins=6)
    style.label(ax, "body y, to the left [m]", "body x, forward [m]")

"""Pictures of a body that turns: its camera's way, the ellipse of the position, bars, cameras."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from data_tools.simulation.drives import PLANS
from data_tools.simulation.trajectory import Trajectory
from evcalib.design import Viewing, predict
from evcalib.geometry import LOOKS_FORWARD, rotation_vector_to_matrix
from evcalib.plots import style
from evcalib.plots.turning import (
    REACH,
    draw_mounting,
    draw_paths,
    draw_places,
    draw_trade,
    draw_turning,
    draw_unknowns,
    error_ellipse,
    relative_errors,
    turning_axes,
)
from evcalib.series import VelocitySeries

PLACE = np.array([0.25, -0.18, 0.3])


@pytest.fixture
def figure():
    figure = style.new_figure()
    yield figure
    plt.close(figure)


@pytest.fixture
def space(figure):
    return figure.add_subplot(projection="3d", computed_zorder=False)


def series(name, swing=45.0, period=6.0, duration=8.0):
    drive = PLANS[name](swing, period, 0.5, duration)
    t = np.arange(0.0, duration, 0.005)
    return drive, VelocitySeries(t, drive.velocity(t), drive.yaw_rate(t))


def lines(ax, color):
    return [line.get_xydata() for line in ax.lines if line.get_color() == color]


def test_the_camera_goes_where_a_rigid_body_carries_it(figure):
    """Against the simulator's trajectory, turned and moved as a whole."""
    drive, velocities = series("figure-eight")
    ax = figure.subplots()
    draw_paths(ax, velocities, PLACE[:2])
    path, t = Trajectory.of_drive(drive), velocities.t
    want = path.position_at(t) + path.rotation_at(t) @ (PLACE * [1, 1, 0])
    (drawn, _), (body, _) = lines(ax, style.CAMERA), lines(ax, style.BODY)
    np.testing.assert_allclose(drawn[:, ::-1], want[:, :2], atol=2e-3)
    np.testing.assert_allclose(body[:, ::-1], path.position_at(t)[:, :2], atol=2e-3)
    assert ax.get_xlim()[0] > ax.get_xlim()[1]


def test_a_body_without_yaw_rate_is_drawn_straight(figure):
    _, velocities = series("straight", swing=0.0)
    ax = figure.subplots()
    draw_paths(ax, VelocitySeries(velocities.t, velocities.v), PLACE[:2])
    drawn = lines(ax, style.CAMERA)[0]
    np.testing.assert_allclose(drawn[:, 0], PLACE[1], atol=1e-12)


def test_the_ellipse_holds_95_percent_of_the_errors():
    rng = np.random.default_rng(0)
    covariance = np.array([[4.0, 1.5], [1.5, 1.0]])
    errors = rng.multivariate_normal(np.zeros(2), covariance, 40_000)
    square = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(covariance), errors)
    border = error_ellipse(covariance)
    on = np.einsum("ni,ij,nj->n", border, np.linalg.inv(covariance), border)
    np.testing.assert_allclose(on, on[0])
    assert np.mean(square < on[0]) == pytest.approx(0.95, abs=0.004)
    np.testing.assert_allclose(error_ellipse(np.zeros((2, 2))), 0.0)


@pytest.fixture
def ellipses(monkeypatch):
    """Return the corners, in x and y, of each polygon that gets the colour of the ellipse."""
    found = []

    def polygons(corners, **look):
        if look["facecolor"] == style.MEASURED:
            found.append(corners[0][:, :2])
        return Poly3DCollection(corners, **look)

    monkeypatch.setattr("evcalib.plots.turning.Poly3DCollection", polygons)
    return found


def test_the_ellipse_lies_about_the_foot_of_the_camera_and_ends_with_the_floor(space, ellipses):
    small = np.diag([0.004, 0.008]) ** 2
    draw_mounting(space, LOOKS_FORWARD, PLACE, small, times=10, true=PLACE)
    half = np.ptp(ellipses[0], axis=0) / 2
    np.testing.assert_allclose(half, 10 * 2.4477 * np.array([0.004, 0.008]), rtol=1e-3)
    middle = (ellipses[0].max(axis=0) + ellipses[0].min(axis=0)) / 2
    np.testing.assert_allclose(middle, PLACE[:2])
    draw_mounting(space, LOOKS_FORWARD, PLACE, np.diag([1.0, 4.0]))
    np.testing.assert_allclose([ellipses[1].min(), ellipses[1].max()], [-REACH, REACH])


def test_an_ellipse_beside_the_floor_is_not_drawn(space, ellipses):
    draw_mounting(space, LOOKS_FORWARD, np.array([9.0, 0.0, 0.3]), 1e-4 * np.eye(2))
    assert ellipses == []


def test_the_camera_is_drawn_where_it_looks(space):
    R = rotation_vector_to_matrix([0.0, 0.0, 0.5]) @ LOOKS_FORWARD
    draw_mounting(space, R, PLACE, 1e-6 * np.eye(2))
    last = np.stack(space.lines[-1].get_data_3d(), axis=1)
    ahead = (last[1] - last[0]) / np.linalg.norm(last[1] - last[0])
    np.testing.assert_allclose(ahead, [np.cos(0.5), np.sin(0.5), 0.0], atol=1e-12)


def test_bars_end_left_of_the_line_just_where_the_prediction_says_shown(figure):
    for name in ("figure-eight", "parking", "turning in place"):
        figure.clear()
        _, velocities = series(name, duration=12.0)
        found = predict(velocities, viewing=Viewing(position=(0.25, -0.18)))
        shares = relative_errors(found)
        assert list(shares) == ["roll", "pitch", "yaw", "offset", "x", "y"]
        assert (max(shares["x"], shares["y"]) < 1) == found.position_determined
        assert (shares["offset"] < 1) == (found.offset_sd < found.max_offset / 4)
        ax = figure.subplots()
        draw_unknowns(ax, found, shares)
        ends = [bar.get_x() + bar.get_width() for bar in ax.patches]
        np.testing.assert_allclose(ends, np.clip(list(shares.values()), 1e-3, 300.0))
        rings = [line.get_xdata()[0] for line in ax.lines if line.get_marker() == "o"]
        np.testing.assert_allclose(rings, ends)


def test_error_bars_are_told_in_units(figure):
    _, velocities = series("turning in place", duration=12.0)
    ax = figure.subplots()
    draw_unknowns(ax, predict(velocities))
    words = [text.get_text().strip() for text in ax.texts]
    units = [word.split()[-1] for word in words if word[0].isdigit()]
    assert units == ["deg", "deg", "deg", "ms", "cm", "cm"]
    assert not any("e+" in word for word in words)


def test_all_three_panels_of_a_motion_are_drawn(figure):
    _, velocities = series("slalom", duration=12.0)
    axes = turning_axes(figure)
    draw_turning(axes, velocities, predict(velocities), LOOKS_FORWARD, PLACE, times=5.0)
    assert all(ax.has_data() for ax in axes)


def test_cameras_that_trade_see_the_same(figure):
    """The angle between the axis of each wedge and its arrow, read off the drawing."""
    ax = figure.subplots()
    centre = np.array([0.0, 0.9])
    draw_trade(ax, centre, PLACE[:2], -0.3, [(0.9, 1.4), (-0.4, 1.2)])
    _, *wedges = [patch.get_xy()[:, ::-1] for patch in ax.patches]
    going = [np.subtract(text.xy, text.xyann)[::-1] for text in ax.texts]
    axes = [wedge[1:3].mean(axis=0) - wedge[0] for wedge in wedges]
    angles = [
        np.arctan2(a[0] * g[1] - a[1] * g[0], a @ g) for a, g in zip(axes, going, strict=True)
    ]
    arm = PLACE[:2] - centre
    want = np.arctan2(arm[0], -arm[1]) + 0.3
    np.testing.assert_allclose(angles, want, atol=1e-9)
    away = [np.linalg.norm(wedge[0] - centre) / np.linalg.norm(arm) for wedge in wedges]
    np.testing.assert_allclose(away, [1.0, 1.4, 1.2])


def test_a_map_of_places_lies_as_the_body_does(figure):
    ax, side = figure.subplots(), np.linspace(-0.5, 0.5, 11)
    met = np.zeros((11, 11))
    met[8, 2] = 1.0
    draw_places(ax, side, side, met, true=(side[8], side[2]))
    (image,), (cross,) = ax.images, ax.lines
    left, right, bottom, top = image.get_extent()
    assert (left, bottom) == pytest.approx((-0.55, -0.55))
    assert (right, top) == pytest.approx((0.55, 0.55))
    assert image.origin == "lower"
    assert cross.get_xydata()[0] == pytest.approx([side[2], side[8]])

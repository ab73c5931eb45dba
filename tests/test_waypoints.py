"""Drives along way points: where they end, how fast they are, and what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evcalib.design import predict
from evcalib.design.waypoints import BLEND, PAUSE, drive_through, read_way_points
from evcalib.errors import InputError

coordinate = st.floats(-20, 20).map(lambda x: round(x, 2))


def path(drive):
    steps = 0.5 * (drive.v[1:, :2] + drive.v[:-1, :2]) * np.diff(drive.t)[:, None]
    return np.vstack(([0.0, 0.0], np.cumsum(steps, axis=0)))


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(coordinate, coordinate), min_size=2, max_size=12))
def test_a_drive_goes_from_the_first_point_to_the_last_and_never_too_fast(points):
    drive = drive_through(points, speed=2.0)
    travel = np.subtract(points[-1], points[0])
    np.testing.assert_allclose(path(drive)[-1], travel, atol=0.02)
    assert drive.speed.max() <= 2.0 + 1e-9
    assert drive.speed[0] == 0.0
    assert drive.speed[-1] < 0.2


def test_a_straight_leg_is_a_trapezoid():
    drive = drive_through([[0, 0], [3, 4]], speed=1.0)
    assert drive.t[-1] == pytest.approx(5.0 + BLEND, abs=0.03)
    even = (drive.t > BLEND) & (drive.t < 5.0)
    np.testing.assert_allclose(drive.v[even], np.tile([0.6, 0.8, 0.0], (even.sum(), 1)), atol=1e-9)
    half = np.interp(BLEND / 2, drive.t, drive.speed)
    assert half == pytest.approx(0.5)


def test_a_corner_is_cut_by_its_parabola_alone():
    drive = drive_through([[0, 0], [2, 0], [2, 2]], speed=1.0)
    nearest = np.linalg.norm(path(drive) - [2.0, 0.0], axis=1).min()
    # The middle of the blend is an eighth of its length away from the corner, on either leg.
    assert nearest == pytest.approx(np.sqrt(2) * BLEND / 8, abs=0.01)


def test_a_point_twice_is_a_pause():
    drive = drive_through([[0, 0], [1, 0], [1, 0], [2, 0]], speed=1.0)
    still = np.count_nonzero(drive.speed < 1e-9) / 50.0
    assert still == pytest.approx(PAUSE - BLEND, abs=0.1)


def test_text_is_read_with_commas_spaces_and_empty_lines():
    points = read_way_points("0 0\n\n 1.5, -2\n1e1\t3")
    np.testing.assert_array_equal(points, [[0, 0], [1.5, -2], [10, 3]])
    assert read_way_points("").shape == (0, 2)


@pytest.mark.parametrize("text", ["0 0\n1", "0 0\n1 2 3", "0 0\nleft 2"])
def test_a_bad_line_is_named(text):
    with pytest.raises(InputError, match="line 2"):
        read_way_points(text)


@pytest.mark.parametrize(
    ("points", "says"),
    [([[0, 0]], "from 2"), ([[0, 0], [5000, 0]], "metres"), ([[0, 0], [np.nan, 0]], "way points"),
     ([[0, 0]] * 300, "from 2 to 200"), ([[0, 0], [900, 0]], "takes")],
)  # fmt: skip
def test_what_cannot_be_driven_is_refused(points, says):
    with pytest.raises(InputError, match=says):
        drive_through(points, speed=0.5)


def test_a_zigzag_shows_what_a_straight_line_does_not():
    zigzag = predict(drive_through([[0, 0], [2, 1], [3, -1], [6, 1], [7, 0]], speed=0.6))
    line = predict(drive_through([[0, 0], [8, 0]], speed=0.6), speed=False)
    assert zigzag.offset_determined
    assert not line.offset_determined

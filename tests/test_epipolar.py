"""Epipolar solvers on points whose motion is known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import approx_fprime, least_squares
from scipy.stats import chi2

from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.geometry import angle_between, rotation_vector_to_matrix, unit
from evcalib.heading.epipolar import CUT, NEUTRAL_GAIN, five_point, turn_explains, two_point
from evcalib.kernels.heading import epipolar as kernels
from evcalib.kernels.heading import lens as lenses
from evcalib.kernels.linalg import tangent_basis

PIXEL = 1 / 300  # [rad]
SIDEWAYS, FORWARD, OBLIQUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (-0.6, 0.3, 0.74)


def bearings(seed, shift, n=300, *, noise=0.0, turn=(0, 0, 0), false=0.0, field=0.4):
    """Points 1 to 3 m away, seen before and after the camera moved by `shift` and turned."""
    rng = np.random.default_rng(seed)
    plane = rng.uniform(-field, field, (n, 2))
    points = np.column_stack((plane, np.ones(n))) * rng.uniform(1, 3, (n, 1))
    R = rotation_vector_to_matrix(turn)
    r1, r2 = unit(points), unit((points - shift) @ R)
    lost = rng.random(n) < false
    r2[lost] = unit(r1[lost] + rng.normal(0, 25 * PIXEL, (lost.sum(), 3)))
    return tuple(unit(r + rng.normal(0, noise * PIXEL + 1e-15, r.shape)) for r in (r1, r2))


def error(found, truth):
    return np.degrees(angle_between(found.direction, truth))


@settings(deadline=None, max_examples=60)
@given(st.tuples(*[st.floats(-1, 1)] * 3), st.integers(0, 2**32 - 1))
def test_exact_bearings_give_the_exact_direction(axis, seed):
    if np.linalg.norm(axis) < 1e-3:
        axis = SIDEWAYS
    truth = unit(axis)
    found = two_point(*bearings(seed, 0.1 * truth, 40), threshold=PIXEL, seed=seed)
    assert error(found, truth) < 1e-5
    assert found.inliers.all()
    assert found.noise < 1e-5


@pytest.mark.parametrize("truth", [SIDEWAYS, FORWARD, OBLIQUE])
def test_four_in_ten_false_matches_are_borne(truth):
    truth = unit(truth)
    errors = [
        error(
            two_point(*bearings(s, 0.1 * truth, noise=0.5, false=0.4), threshold=2 * PIXEL), truth
        )
        for s in range(40)
    ]
    assert np.median(errors) < 1.0
    assert np.max(errors) < 5.0


@pytest.mark.parametrize("truth", [FORWARD, (0.2, 0.1, 1.0)])
def test_false_matches_beside_the_focus_of_expansion_do_not_pull(truth):
    truth = unit(truth)
    errors = [
        error(
            two_point(*bearings(s, 0.08 * truth, noise=0.7, false=0.4), threshold=2 * PIXEL), truth
        )
        for s in range(60)
    ]
    # Without a bound on their leverage the medians are 1.3 and 1.4 degrees.
    assert np.median(errors) < 0.95


@pytest.mark.parametrize("truth", [SIDEWAYS, FORWARD, OBLIQUE])
def test_the_covariance_is_that_of_the_errors(truth):
    truth = unit(truth)
    squares = []
    for seed in range(150):
        found = two_point(*bearings(seed, 0.2 * truth, noise=0.5), threshold=3 * PIXEL)
        basis = tangent_basis(truth)
        off = basis @ found.direction
        squares.append(off @ np.linalg.solve(basis @ found.covariance @ basis.T, off))
        assert np.isclose(found.direction @ found.covariance @ found.direction, 0, atol=1e-15)
    # Chi squared of two degrees of freedom; the standard error of the mean is 0.16.
    assert 1.5 < np.mean(squares) < 2.6
    assert 0.88 < np.mean(np.array(squares) < 5.99) < 0.99


def test_the_noise_is_recovered():
    found = two_point(*bearings(3, (0.2, 0, 0), 3000, noise=0.5), threshold=3 * PIXEL)
    assert found.noise == pytest.approx(0.5 * PIXEL, rel=0.05)


def test_a_seed_gives_its_result_again_and_another_seed_nearly_the_same():
    pair = bearings(5, (0, 0.1, 0), noise=0.5, false=0.3)
    first, again, other = (two_point(*pair, threshold=2 * PIXEL, seed=s) for s in (1, 1, 2))
    assert np.array_equal(first.direction, again.direction)
    assert np.degrees(angle_between(first.direction, other.direction)) < 0.3


def test_reversing_time_reverses_the_direction():
    r1, r2 = bearings(6, (0.05, 0.02, 0.1), noise=0.4)
    ahead, back = two_point(r1, r2, threshold=2 * PIXEL), two_point(r2, r1, threshold=2 * PIXEL)
    assert np.degrees(angle_between(ahead.direction, -back.direction)) < 0.1


def test_copies_in_a_group_add_no_certainty():
    r1, r2 = bearings(7, (0.1, 0, 0.1), noise=0.5)
    fourfold = [np.tile(r, (4, 1)) for r in (r1, r2)]
    groups = np.tile(np.arange(len(r1)), 4)
    once = two_point(r1, r2, threshold=2 * PIXEL)
    grouped = two_point(*fourfold, threshold=2 * PIXEL, groups=groups)
    far = two_point(*fourfold, threshold=2 * PIXEL, groups=groups * 10**12)
    naive = two_point(*fourfold, threshold=2 * PIXEL)
    assert grouped.sd == pytest.approx(once.sd, rel=0.02)
    assert far.sd == grouped.sd
    assert naive.sd == pytest.approx(once.sd / 2, rel=0.02)


@pytest.mark.parametrize("solver", [two_point, five_point])
def test_no_motion_and_no_matches_give_no_direction(solver):
    r1, _ = bearings(0, (0.1, 0, 0))
    assert solver(r1, r1, threshold=PIXEL) is None
    assert solver(r1[:2], r1[:2], threshold=PIXEL) is None
    assert solver(np.empty((0, 3)), np.empty((0, 3)), threshold=PIXEL) is None


@pytest.mark.parametrize("solver", [two_point, five_point])
def test_unusable_bearings_are_refused(solver):
    r1, r2 = bearings(0, (0.1, 0, 0), 20)
    with pytest.raises(InputError, match="not a unit vector"):
        solver(2 * r1, r2, threshold=PIXEL)
    with pytest.raises(InputError, match="r2 must have shape"):
        solver(r1, r2[:-1], threshold=PIXEL)
    with pytest.raises(InputError, match="NaN"):
        solver(r1 * np.nan, r2, threshold=PIXEL)
    with pytest.raises(InputError, match="threshold"):
        solver(r1, r2, threshold=0)
    with pytest.raises(InputError, match="groups must be 20 whole numbers"):
        solver(r1, r2, threshold=PIXEL, groups=np.zeros(3, int))


@pytest.mark.parametrize("turn", [(0, 0, 0), (0, 0.05, 0), (0.03, -0.02, 0.1)])
def test_five_points_see_through_a_turn(turn):
    truth = unit((0.8, 0.1, 0.5))
    r1, r2 = bearings(1, 0.3 * truth, turn=turn, field=0.9)
    found = five_point(r1, r2, threshold=PIXEL)
    halfway = rotation_vector_to_matrix(-0.5 * np.array(turn)) @ truth
    assert error(found, halfway) < 0.1
    assert found.inliers.mean() > 0.95


def test_two_points_beat_five_where_the_camera_does_not_turn():
    truth = np.array(SIDEWAYS)
    pairs = [bearings(s, 0.15 * truth, noise=0.5, field=0.35) for s in range(15)]
    two, five = (
        np.median([error(solver(*pair, threshold=2 * PIXEL), truth) for pair in pairs])
        for solver in (two_point, five_point)
    )
    assert two < 0.7
    assert 1.5 * two < five


def judged(r1, r2):
    return turn_explains(r1, r2, np.ones(len(r1)), two_point(r1, r2, threshold=2 * PIXEL))


@pytest.mark.parametrize("seed", range(5))
def test_a_turn_is_told_from_a_translation(seed):
    for axis in np.eye(3):
        assert judged(*bearings(seed, (0, 0, 0), turn=0.1 * axis, noise=0.5, false=0.2))
        assert not judged(*bearings(seed, 0.1 * axis, noise=0.5, false=0.2))


def test_a_wall_in_a_narrow_view_has_no_parallax():
    rng = np.random.default_rng(0)
    plane = np.column_stack((rng.uniform(-0.05, 0.05, (300, 2)), np.ones(300)))
    r1, r2 = unit(100 * plane), unit(100 * plane - (5.0, 0, 0))
    r1, r2 = (unit(r + rng.normal(0, 0.5 * PIXEL, r.shape)) for r in (r1, r2))
    assert judged(r1, r2)


TRUE_LENS = Camera(240, 180, 200.0, 200.0, 119.5, 89.5, (-0.37, 0.15, 0.0, 0.0, 0.0))
PLAIN_LENS = replace(TRUE_LENS, distortion=(0.0,) * 5)


def seen_over_time(seed, velocity, turned, lens, n=400):
    """Points at two times each, behind `TRUE_LENS` but taken for `lens`; `turned` is R(t)."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform((20, 20), (220, 160), (n, 2))
    points = TRUE_LENS.bearings(xy) * rng.uniform(0.8, 3, (n, 1))
    span, middle = rng.uniform(0.2, 0.5, n), rng.uniform(-0.1, 0.1, n)
    seen = []
    for t in (middle - 0.5 * span, middle + 0.5 * span):
        R = np.array([rotation_vector_to_matrix(turned(at)) for at in t])
        there = np.einsum("nji,nj->ni", R, points - t[:, None] * velocity)
        pixels = TRUE_LENS.project(there) + rng.normal(0, 0.3, (n, 2))
        seen.append(lens.bearings(pixels))
    known = np.isfinite(np.hstack(seen)).all(axis=1)
    return *(r[known] for r in seen), span[known], middle[known]


def explained(r1, r2, span, middle):
    found = two_point(r1, r2, threshold=1.5 / 200)
    return found is None or turn_explains(r1, r2, span, found, middles=middle, floor=0.15 / 200)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("lens", [TRUE_LENS, PLAIN_LENS], ids=["true", "plain"])
@pytest.mark.parametrize("axis", np.eye(3), ids=["tilt", "pan", "roll"])
def test_an_unsteady_turn_behind_a_wrong_lens_is_a_turn(axis, lens, seed):
    def turned(t):
        return (0.15 * t + 0.3 * t**2) * axis

    assert explained(*seen_over_time(seed, np.zeros(3), turned, lens))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("velocity", [SIDEWAYS, FORWARD, OBLIQUE])
def test_parallax_is_seen_through_the_true_lens(velocity, seed):
    def still(t):
        return np.zeros(3)

    assert not explained(*seen_over_time(seed, 0.3 * unit(velocity), still, TRUE_LENS))


def test_spans_that_are_none_are_refused():
    r1, r2 = bearings(0, (0.1, 0, 0))
    found = two_point(r1, r2, threshold=PIXEL)
    with pytest.raises(InputError, match="spans row 3 is not above zero"):
        turn_explains(r1, r2, np.where(np.arange(len(r1)) == 3, 0.0, 1.0), found)


def test_the_neutral_gain_is_that_of_its_chi_squares():
    def cut(degrees, most):
        return chi2.cdf(most, degrees + 2) * degrees + most * chi2.sf(most, degrees)

    assert cut(2, 2 * CUT) - cut(1, CUT) == pytest.approx(NEUTRAL_GAIN, abs=1e-3)


def displaced(m, lens):
    """What a lens that is known badly makes of bearings, by its formula."""
    x, y, z = m
    q = 2.0 * (1.0 - z)
    radial = (z * m - (0, 0, 1)) * (lens[0] + lens[1] * q + lens[2] * q**2)
    return m + radial + lens[3] * ((1, 0, 0) - x * m) + lens[4] * ((0, 1, 0) - y * m)


@pytest.mark.parametrize("seed", range(5))
def test_a_turn_behind_a_displaced_picture_is_seen_as_its_definition_says(seed):
    """The displaced bearing is turned by a little, and what is seen of it solved for."""
    rng = np.random.default_rng(seed)
    m = unit(np.array([*rng.uniform(-0.5, 0.5, 2), 1.0]))
    basis, lens = np.array(tangent_basis(m)), rng.uniform(-0.3, 0.3, lenses.LENS)
    seen = np.empty((2, 3))
    lenses.seen_turns(m, basis, lens, seen)
    for axis in range(3):
        after = rotation_vector_to_matrix(1e-4 * np.eye(3)[axis]) @ unit(displaced(m, lens))

        def miss(change, after=after):
            return np.cross(displaced(unit(m + change @ basis), lens), after)

        moved = least_squares(miss, np.zeros(2), xtol=1e-15, ftol=1e-15, gtol=1e-15).x
        np.testing.assert_allclose(seen[:, axis], 1e4 * moved, atol=2e-3)


def test_rates_and_displacement_of_a_turn_are_recovered():
    """Flow made by integrating what is seen of a turn along its way, in many small steps."""
    rng = np.random.default_rng(1)
    lens = np.array([0.02, -0.2, 0.05, 0.03, -0.02])
    rates = np.array([0.1, -0.2, 0.3, 0.2, 0.1, -0.3, 0.0, 0.0, 0.0])
    n, steps = 300, 200
    m = unit(np.column_stack((rng.uniform(-0.5, 0.5, (n, 2)), np.ones(n))))
    span, middle, seen = rng.uniform(0.2, 0.5, n), rng.uniform(-0.2, 0.2, n), np.empty((2, 3))
    middle[0] = np.median(middle[1:])
    r2 = m.copy()
    for i in range(n):
        for k in range(steps):
            t = middle[i] - np.median(middle) + span[i] * ((k + 0.5) / steps - 0.5)
            basis = np.array(tangent_basis(r2[i]))
            lenses.seen_turns(r2[i], basis, lens, seen)
            turn = (rates[:3] + t * rates[3:6]) * span[i] / steps
            r2[i] = unit(r2[i] + (seen @ turn) @ basis)
    flow = lenses.flow(m, r2, span, middle)
    known = lenses.Lens(np.full(lenses.LENS, 10.0), 0.6)
    found, displacement = lenses.fit_turn(0.8 * rates[:3], flow, 5e-3, known, 30)
    np.testing.assert_allclose(found[:6], rates[:6], atol=0.01)
    np.testing.assert_allclose(displacement, lens, atol=0.02)
    squares = np.empty(n)
    lenses.squared_residuals(found, displacement, flow, squares)
    assert np.sqrt(squares.mean()) < 2e-4


def test_a_swinging_direction_is_followed():
    rng = np.random.default_rng(2)
    n, t = 400, unit((1.0, 0.1, 0.2))
    basis, times = (
        np.array(tangent_basis(t)),
        np.column_stack((np.ones(400), rng.uniform(-1, 1, (400, 2)))),
    )
    swing = np.array([[0.01, 0.02], [0.1, -0.05], [0.03, 0.08]])
    plane = rng.uniform(-0.4, 0.4, (n, 2))
    points = np.column_stack((plane, np.ones(n))) * rng.uniform(1, 3, (n, 1))
    r1, r2 = unit(points), unit(points - 0.1 * unit(t + times @ swing @ basis))
    rows = kernels.Bearings(r1, r2, np.cross(r1, r2))
    before, after = (kernels.refine_swinging(t, rows, times, 0.01, k)[0] for k in (0, 10))
    assert np.abs(before).mean() > 1e-3
    assert np.abs(after).max() < 1e-6


def test_residuals_and_slopes_follow_their_definition():
    r1, r2 = bearings(2, (0.1, 0, 0.05), 1, noise=0.5)
    t = unit((1.0, 0.2, -0.4))
    basis = tangent_basis(t)

    def sampson(change):
        moved = unit(t + change @ basis)
        slope = np.linalg.norm([np.cross(moved, r1[0]), np.cross(moved, r2[0])])
        return moved @ np.cross(r1[0], r2[0]) / slope

    normals = np.cross(r1, r2)
    residual, rise, *slopes = kernels.slope_of_sampson(t, r1[0], r2[0], normals[0], basis)
    assert residual == pytest.approx(sampson(np.zeros(2)), rel=1e-12)
    assert rise == pytest.approx(t @ (r2[0] - r1[0]), rel=1e-12)
    np.testing.assert_allclose(slopes, approx_fprime(np.zeros(2), sampson, 1e-7), rtol=1e-5)


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3))
@settings(deadline=None)
def test_the_tangent_basis_is_a_right_handed_frame(axis):
    t = unit(axis)
    frame = np.vstack((t, tangent_basis(t)))
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame) > 0

"""Registration of directions: against SciPy, plain twins, exact answers and a table of medians."""

from itertools import pairwise

import montecarlo
import naive_backend as naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.integrate import quad, trapezoid
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from evcalib.alignment.rotation import (
    METHODS,
    Mixture,
    cosine_residuals,
    estimate_rotation,
    fit_mixture,
    kabsch,
    tukey_scale,
)
from evcalib.errors import InputError
from evcalib.geometry import random_rotation, rotation_angle, rotation_vector_to_matrix, unit
from evcalib.kernels.alignment import rotation as kernel

seeds = st.integers(0, 10**6)

NEAR = {"tukey": 1e-3, "gnc": 0.03}
"""Rotations [rad] that count as equal, else 1e-6: the mixture's scale is found to 0.1 % only, and
at another scale GNC may take in a pair more or less."""


def pairs(seed, n=50, sigma=0.1, planar=True):
    """Return headings, directions and the rotation between them."""
    rng = np.random.default_rng(seed)
    R = random_rotation(rng)
    d = unit(rng.standard_normal((n, 3)) * [1, 1, 0 if planar else 1])
    return unit(d @ R + sigma * rng.standard_normal((n, 3))), d, R, rng


def columns(a):
    return np.ascontiguousarray(a.T)


# Least squares ----------------------------------------------------------------------------------


@settings(deadline=None, max_examples=50)
@given(seeds, st.booleans())
def test_kabsch_is_scipys_alignment_of_vectors(seed, planar):
    e, d, _, rng = pairs(seed, sigma=0.3, planar=planar)
    weight = rng.uniform(0.1, 2, 50)
    expected = naive.aligned(e, d, weight)
    assert rotation_angle(kabsch(e, d, weight), expected) < 1e-9
    assert rotation_angle(kernel.best_rotation((d * weight[:, None]).T @ e), expected) < 1e-9


@settings(deadline=None, max_examples=50)
@given(seeds)
def test_planar_directions_never_give_a_reflection(seed):
    e, d, _, _ = pairs(seed, n=5, sigma=0.5)
    for R in (kabsch(e, d, np.ones(5)), kernel.best_rotation(d.T @ e)):
        assert np.linalg.det(R) == pytest.approx(1, abs=1e-12)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)


def test_without_its_determinant_the_papers_formula_gives_reflections():
    """The paper's text has R = V U^T."""
    signs = []
    for seed in range(100):
        e, d, _, _ = pairs(seed)
        U, _, Vt = np.linalg.svd(d.T @ e)
        signs.append(np.sign(np.linalg.det(U @ Vt)))
        assert np.linalg.det(kabsch(e, d, np.ones(50))) > 0
    assert signs.count(-1) > 20


@settings(deadline=None, max_examples=50)
@given(seeds)
def test_the_largest_eigenvector_is_that_of_lapack(seed):
    A = np.random.default_rng(seed).standard_normal((4, 4))
    A = A + A.T
    values, vectors = np.linalg.eigh(A)
    found = kernel.largest_eigenvector(np.triu(A))
    assert abs(found @ vectors[:, -1]) == pytest.approx(1, abs=1e-12)
    assert found @ A @ found == pytest.approx(values[-1], abs=1e-12)


@pytest.mark.parametrize("axis", range(3))
def test_a_half_turn_is_found(axis):
    R = -np.eye(3)
    R[axis, axis] = 1
    d = np.eye(3)
    assert rotation_angle(kernel.best_rotation(d.T @ (d @ R)), R) < 1e-12


def test_no_pairs_at_all_give_some_rotation():
    R = kernel.best_rotation(np.zeros((3, 3)))
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)


# Robust steps -----------------------------------------------------------------------------------


@settings(deadline=None, max_examples=25)
@given(seeds, st.floats(0.01, 2))
def test_a_tukey_pass_equals_that_of_the_twin(seed, reach):
    e, d, R, rng = pairs(seed, sigma=0.4)
    weight = rng.uniform(0, 2, 50)
    H, score = kernel.tukey_pass(columns(e), columns(d), weight, R, reach, np.empty((3, 50)))
    weights, expected = naive.tukey(e, d, weight, R, reach)
    assert score == pytest.approx(expected, rel=1e-12, abs=1e-12)
    np.testing.assert_allclose(H, (d * weights[:, None]).T @ e, atol=1e-12)


def test_residuals_are_one_minus_the_cosine():
    e, d, R, _ = pairs(0, sigma=1.0)
    np.testing.assert_allclose(
        cosine_residuals(e, d, R), 1 - np.sum(d * (e @ R.T), axis=1), atol=1e-15
    )
    assert cosine_residuals(d @ R, d, R).max() < 1e-30


def test_tukeys_reach_keeps_95_percent_efficiency_in_two_dimensions():
    """Efficiency of a location estimate in the plane: E[psi']^2 / E[psi^2], by quadrature."""
    reach = tukey_scale(1.0)
    u = np.linspace(0, reach, 100_001)
    density = np.exp(-u)  # half the square of a normal pair's length is exponential
    rest = 1 - u / reach
    slope = trapezoid((rest**2 - 2 * u * rest / reach) * density, u)
    square = trapezoid(rest**4 * u * density, u)
    assert slope**2 / square == pytest.approx(0.95, abs=0.003)


def test_the_l1_rotation_minimises_the_sum_of_distances():
    e, d, R, _ = pairs(3, n=40, sigma=0.3)

    def cost(vector):
        turn = rotation_vector_to_matrix(vector) @ R
        return np.linalg.norm(d - e @ turn.T, axis=1).sum()

    best = minimize(
        cost, np.zeros(3), method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-10}
    )
    found = estimate_rotation(e, d, method="l1")
    assert rotation_angle(found.R_body_cam, rotation_vector_to_matrix(best.x) @ R) < 1e-4


def test_tukeys_rotation_is_a_fixed_point_of_its_weights():
    e, d, _, _ = pairs(4, n=200, sigma=0.1)
    e[:60] = unit(np.random.default_rng(0).standard_normal((60, 3)))
    found = estimate_rotation(e, d)
    again = kabsch(e, d, found.weight)
    assert rotation_angle(found.R_body_cam, again) < 1e-9
    start = estimate_rotation(e, d, method="l1").R_body_cam
    reach = tukey_scale(fit_mixture(cosine_residuals(e, d, start)).sigma)
    expected, _ = naive.tukey(e, d, np.ones(200), again, reach)
    np.testing.assert_allclose(found.weight, expected, atol=1e-8)


def test_gnc_ends_with_weights_of_zero_for_outliers_and_one_for_inliers():
    e, d, R, rng = pairs(5, n=200, sigma=0.05)
    e[:80] = unit(rng.standard_normal((80, 3)))
    found = estimate_rotation(e, d, method="gnc")
    assert found.converged
    assert set(np.unique(found.weight)) == {0.0, 1.0}
    apart = np.sqrt(2 * cosine_residuals(e, d, found.R_body_cam))
    assert apart[found.weight == 1].max() < apart[found.weight == 0].min()
    # Three standard deviations in the plane keep 1 - exp(-9 / 2) of the inliers.
    assert found.weight[80:].mean() > 0.95
    # The square of the farthest comes down to the limit by a factor of 1.4 a step.
    assert 2 < found.iterations < 40


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("planar", [True, False])
def test_exact_pairs_give_the_exact_rotation(method, planar):
    e, d, R, _ = pairs(1, sigma=0.0, planar=planar)
    found = estimate_rotation(e, d, method=method)
    assert found.converged
    assert rotation_angle(found.R_body_cam, R) < 1e-8


@settings(deadline=None, max_examples=20)
@given(seeds, st.sampled_from(METHODS))
def test_turning_the_camera_or_the_body_turns_the_answer(seed, method):
    e, d, _, rng = pairs(seed, sigma=0.2, planar=False)
    cam, body = random_rotation(rng), random_rotation(rng)
    plain = estimate_rotation(e, d, method=method).R_body_cam
    turned = estimate_rotation(e @ cam.T, d @ body.T, method=method).R_body_cam
    assert rotation_angle(turned, body @ plain @ cam.T) < NEAR.get(method, 1e-6)


@settings(deadline=None, max_examples=20)
@given(seeds, st.sampled_from(METHODS))
def test_the_order_of_the_pairs_does_not_matter(seed, method):
    e, d, _, rng = pairs(seed, sigma=0.2)
    weight, order = rng.uniform(0.5, 2, 50), rng.permutation(50)
    plain = estimate_rotation(e, d, method=method, weight=weight)
    mixed = estimate_rotation(e[order], d[order], method=method, weight=weight[order])
    assert rotation_angle(plain.R_body_cam, mixed.R_body_cam) < NEAR.get(method, 1e-6)
    if method != "gnc":
        np.testing.assert_allclose(plain.weight[order], mixed.weight, rtol=1e-2, atol=1e-2)


@pytest.mark.parametrize("method", ["tukey", "l1", "kabsch", "cca"])
def test_a_weight_of_two_is_a_pair_given_twice(method):
    e, d, _, rng = pairs(6, sigma=0.2)
    weight = rng.integers(1, 3, 50)
    twice = [np.repeat(a, weight, axis=0) for a in (e, d)]
    found = estimate_rotation(e, d, method=method, weight=weight)
    expected = estimate_rotation(*twice, method=method)
    assert rotation_angle(found.R_body_cam, expected.R_body_cam) < NEAR.get(method, 1e-6)
    assert found.sigma == pytest.approx(expected.sigma, rel=1e-2)


@pytest.mark.parametrize("method", METHODS)
def test_a_weight_of_zero_is_no_pair(method):
    e, d, _, _ = pairs(7, sigma=0.2)
    weight = np.r_[np.zeros(10), np.ones(40)]
    found = estimate_rotation(e, d, method=method, weight=weight)
    expected = estimate_rotation(e[10:], d[10:], method=method)
    assert rotation_angle(found.R_body_cam, expected.R_body_cam) < NEAR.get(method, 1e-6)
    assert not found.weight[:10].any()


# Noise of directions ----------------------------------------------------------------------------


def test_residuals_of_small_noise_are_exponential():
    """Fisher's distribution: u / sigma^2 is exponential, so the angle is Rayleigh."""
    e, d, R, _ = pairs(0, n=5000, sigma=0.05)
    u = cosine_residuals(e, d, R) / 0.05**2
    assert stats.kstest(u, "expon").pvalue > 0.01
    assert stats.kstest(np.sqrt(2 * u), "rayleigh").pvalue > 0.01


@pytest.mark.parametrize("sigma", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("shares", [(1, 0, 0), (0.6, 0.4, 0), (0.4, 0, 0.6), (0.5, 0.2, 0.3)])
def test_a_mixture_is_found_again(sigma, shares):
    """2000 draws from the model itself; five binomial standard errors, ten for the scale."""
    rng = np.random.default_rng(0)
    scale, n = sigma**2, 2000
    near = -scale * np.log1p(-rng.random(n) * -np.expm1(-2 / scale))
    u = np.choose(rng.choice(3, n, p=shares), [near, 2 - near, rng.uniform(0, 2, n)])
    found = fit_mixture(u)
    assert found.sigma == pytest.approx(sigma, rel=10 * 0.5 / np.sqrt(n * (1 - shares[2])))
    np.testing.assert_allclose(
        (found.inliers, found.flipped, found.outliers), shares, atol=5 * 0.5 / np.sqrt(n)
    )


def test_exact_pairs_have_the_smallest_sigma_allowed():
    assert fit_mixture(np.zeros(50)).sigma == 1e-5


def test_weights_of_a_mixture_count_pairs():
    rng = np.random.default_rng(0)
    u, weight = rng.exponential(0.01, 300), rng.integers(1, 4, 300)
    found, expected = fit_mixture(u, weight.astype(float)), fit_mixture(np.repeat(u, weight))
    assert isinstance(found, Mixture)
    assert found.sigma == pytest.approx(expected.sigma, rel=1e-6)


# Medians under outliers --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "medians"),
    [
        ("kabsch", (0.66, 2.9, 6.8, None)),
        ("l1", (0.74, 0.97, 1.5, 3.3)),
        ("tukey", (0.65, 0.85, 1.2, 1.2)),
        ("gnc", (0.66, 0.85, 1.3, 1.3)),
    ],
)
def test_medians_are_those_of_a_prototype_or_below(method, medians):
    """Medians of 40 trials; each has a standard error of about a tenth: three of them."""
    for noise, expected in zip(montecarlo.SPOILS, medians, strict=True):
        found = np.degrees(np.median(montecarlo.rotation_errors(method, noise, 40, seed=2)))
        assert expected is None or found < 1.3 * expected


@pytest.mark.parametrize("method", ["tukey", "l1", "gnc"])
def test_forty_percent_flips_do_not_turn_the_answer(method):
    e, d, R, rng = pairs(8, n=300, sigma=0.1)
    e[rng.random(300) < 0.4] *= -1
    assert rotation_angle(estimate_rotation(e, d, method=method).R_body_cam, R) < np.radians(4)


def test_more_than_half_flipped_gives_the_opposite_direction():
    """What no method can tell."""
    e, d, R, rng = pairs(9, n=300, sigma=0.1)
    e[rng.random(300) < 0.6] *= -1
    error = rotation_angle(estimate_rotation(e, d).R_body_cam, R)
    assert error == pytest.approx(np.pi, abs=np.radians(5))


# Bad input --------------------------------------------------------------------------------------


def test_an_unknown_method_is_refused_with_those_that_are_known():
    e, d, _, _ = pairs(0)
    with pytest.raises(InputError, match=r"rotation_method must be one of tukey, l1, .*not 'svd'"):
        estimate_rotation(e, d, method="svd")


@pytest.mark.parametrize("weight", [np.zeros(50), np.r_[1.0, np.zeros(49)]])
def test_two_pairs_with_weight_are_needed(weight):
    e, d, _, _ = pairs(0)
    with pytest.raises(InputError, match="at least two pairs of directions with weight"):
        estimate_rotation(e, d, weight=weight)


def test_unusable_pairs_are_refused():
    e, d, _, _ = pairs(0)
    with pytest.raises(InputError, match=r"directions must have shape \(50, 3\), not \(49, 3\)"):
        estimate_rotation(e, d[1:])
    with pytest.raises(InputError, match=r"weight must have shape \(50\), not \(3,\)"):
        estimate_rotation(e, d, weight=np.ones(3))
    with pytest.raises(InputError, match=r"headings holds 1 value.* NaN"):
        estimate_rotation(np.vstack([[np.nan, 0, 0], e[1:]]), d)
    with pytest.raises(InputError, match="weight is negative in row 4"):
        estimate_rotation(e, d, weight=np.r_[np.ones(4), -1, np.ones(45)])


def test_two_pairs_are_enough():
    e, d = np.eye(3)[:2], np.eye(3)[1:]
    expected = Rotation.align_vectors(d, e)[0].as_matrix()
    for method in METHODS[:-1]:
        found = estimate_rotation(e, d, method=method).R_body_cam
        assert rotation_angle(found, expected) < 1e-9


@pytest.mark.parametrize("sigma", [0.03, 0.3, 1.0])
@pytest.mark.parametrize(
    "shares", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.1, 0.3)]
)
def test_evidence_is_that_of_a_density_over_the_sphere(sigma, shares):
    """Misfits 1 - cos are uniform over [0, 2] where directions are: densities integrate to 1."""
    mixture = Mixture(sigma, *shares)
    one = np.ones(1)

    def density(u):
        return 0.5 * np.exp(mixture.evidence(np.array([u]), one))

    # Nearly all of the mass lies at both ends.
    ends = [0.0, *(k * sigma**2 for k in (1, 5, 20) if k * sigma**2 < 0.9)]
    knots = np.unique([*ends, *(2 - np.array(ends)), 1.0])
    total = sum(quad(density, a, b)[0] for a, b in pairwise(knots))
    assert total == pytest.approx(1.0, rel=1e-6)


def test_evidence_of_outliers_alone_is_none():
    u, weight = np.linspace(0.0, 2.0, 9), np.linspace(1.0, 3.0, 9)
    assert Mixture(0.1, 0.0, 0.0, 1.0).evidence(u, weight) == pytest.approx(0.0, abs=1e-12)

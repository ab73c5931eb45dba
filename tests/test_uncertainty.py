"""Correlated noise and covariances: dense algebra, closed forms, and known distributions."""

import naive_backend as naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from data_tools.simulation import drives
from data_tools.simulation.streams import Noise, simulate
from evcalib.alignment import StreamPair
from evcalib.alignment._bootstrap import bootstrap
from evcalib.alignment.offset_refinement import refine_offset
from evcalib.kernels.uncertainty import noise as kernel
from evcalib.kinematics.velocity_track import velocity_track
from evcalib.series import HeadingSeries
from evcalib.uncertainty import (
    UNKNOWN,
    NoiseModel,
    fit_noise,
    joint_covariance,
    peak_of_parabola,
    rotation_radius,
    t_quantile,
)

shares, memories = st.floats(0, 1), st.floats(0.01, 10)


def irregular_times(rng, n=25):
    return np.cumsum(rng.exponential(0.05, n) + rng.choice([0.001, 1.0], n, p=[0.9, 0.1]))


def coloured(t, share, memory, columns, rng):
    """Draw white plus Ornstein-Uhlenbeck noise of variance 1 at times t."""
    noise = np.sqrt(1 - share) * rng.standard_normal((t.size, columns))
    state = rng.standard_normal(columns)
    for i in range(t.size):
        decay = np.exp(-(t[i] - t[i - 1]) / memory) if i else 1.0
        state = decay * state + np.sqrt(1 - decay**2) * rng.standard_normal(columns)
        noise[i] += np.sqrt(share) * state
    return noise


def curve(n=400, rate=30.0, swing=1.0, period=5.0):
    """Return times, directions of an S-curve, and their derivatives."""
    t = np.arange(n) / rate
    angle, turn = swing * np.sin(2 * np.pi * t / period), 2 * np.pi / period
    rate_ = (swing * turn * np.cos(turn * t))[:, None]
    d = np.stack([np.cos(angle), np.sin(angle), 0 * t], axis=1)
    return t, d, rate_ * np.stack([-np.sin(angle), np.cos(angle), 0 * t], axis=1)


# Kernels against dense algebra ------------------------------------------------------------------


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6), shares, memories)
def test_the_likelihood_is_that_of_the_dense_gaussian(seed, share, memory):
    rng = np.random.default_rng(seed)
    t, noise = irregular_times(rng), rng.standard_normal((25, 3))
    # White noise of at least 1e-3 of the variance keeps the dense matrix well conditioned.
    share = min(share, 0.999)
    found = kernel.log_likelihood(t, noise, share, memory)
    assert found == pytest.approx(naive.log_likelihood(t, noise, share, memory), rel=1e-8)
    fitted = np.linalg.qr(rng.standard_normal((25, 3)))[0]
    found = kernel.restricted_likelihood(t, noise, fitted, share, memory)
    expected = naive.restricted_likelihood(t, noise, fitted, share, memory)
    assert found == pytest.approx(expected, rel=1e-8)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6), shares, memories)
def test_the_correlated_information_is_the_double_sum(seed, share, memory):
    rng = np.random.default_rng(seed)
    t, scores = irregular_times(rng), rng.standard_normal((25, 3, 4))
    expected = naive.correlated_information(t, scores, share, memory)
    found = kernel.correlated_information(t, scores, share, memory)
    np.testing.assert_allclose(found, expected, atol=1e-10)


def test_noise_that_is_zero_has_no_likelihood_to_compare():
    assert kernel.log_likelihood(np.arange(5.0), np.zeros((5, 2)), 0.5, 1.0) == 0.0


# Noise models -----------------------------------------------------------------------------------


@pytest.mark.parametrize("rho", [0.0, 0.4, 0.8])
def test_a_mean_under_ar1_noise_has_the_textbook_inflation(rho):
    """(1 + rho) / (1 - rho) for long series, less the ends' 2 rho / (n (1 - rho)^2)."""
    n, step = 3000, 0.02
    model = NoiseModel(1.0, -step / np.log(rho)) if rho else NoiseModel(0.0, 1.0)
    expected = (1 + rho) / (1 - rho) - 2 * rho / (1 - rho) ** 2 / n
    assert model.inflation(step * np.arange(n)) == pytest.approx(expected, rel=1e-6)


def test_noise_adds_up_where_its_weights_do():
    """The sum over all pairs of times, written out; opposite weights near each other give 1."""
    rng = np.random.default_rng(0)
    t, weights = np.sort(rng.uniform(0, 5, 40)), rng.uniform(0, 1, (40, 3))
    model = NoiseModel(0.6, 0.5)
    lag = np.abs(np.subtract.outer(t, t))
    correlation = np.where(lag == 0, 1.0, 0.6 * np.exp(-lag / 0.5))
    expected = np.einsum("ia,ij,ja->", weights, correlation, weights) / np.sum(weights**2)
    assert model.inflation_of(t, weights) == pytest.approx(expected)
    assert model.inflation_of(t, np.where(np.arange(40) % 2, 1.0, -1.0)[:, None]) == 1.0
    assert model.inflation_of(t, 0 * weights) == 1.0


def test_the_correlation_falls_by_e_over_its_memory():
    assert NoiseModel(0.6, 0.5).correlation(0.5) == pytest.approx(0.6 / np.e)


@pytest.mark.parametrize(("share", "memory"), [(0.5, 0.5), (0.9, 0.1), (1.0, 0.3)])
def test_a_noise_model_is_found_again(share, memory):
    """What counts, the inflation of a mean, within 35 %; 2000 samples hold 50 to 300 memories."""
    rng = np.random.default_rng(0)
    t = np.arange(2000) / 30
    found = fit_noise(t, coloured(t, share, memory, 3, rng))
    assert found.inflation(t) == pytest.approx(NoiseModel(share, memory).inflation(t), rel=0.35)


def test_the_fit_is_the_best_on_a_fine_grid():
    rng = np.random.default_rng(1)
    t = irregular_times(rng, 300)
    noise = coloured(t, 0.7, 0.4, 2, rng)
    found = fit_noise(t, noise)
    best = kernel.log_likelihood(t, noise, found.share, found.memory)
    grid = [
        kernel.log_likelihood(t, noise, s, m)
        for s in np.linspace(0, 0.99, 25)
        for m in np.geomspace(0.02, 10, 40)
    ]
    assert best >= max(grid) - 1e-2


def test_noise_as_slow_as_what_was_fitted_is_not_missed():
    """Residuals of an S-curve's offset and turn; 24 s hold few memories, so 40 drives are asked."""
    rng = np.random.default_rng(8)
    t = np.arange(720) / 30
    fitted = np.stack([np.ones_like(t), np.cos(2 * np.pi * t / 8)], axis=1)
    fit = fitted @ np.linalg.pinv(fitted)
    weights, truth = fitted[:, 1:], NoiseModel(0.2, 1.0)
    ratio = []
    for _ in range(40):
        noise = coloured(t, truth.share, truth.memory, 1, rng)
        found = fit_noise(t, noise - fit @ noise, fitted)
        ratio.append(found.inflation_of(t, weights) / truth.inflation_of(t, weights))
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.2)


def test_white_noise_has_next_to_no_inflation():
    rng = np.random.default_rng(2)
    t = np.arange(1000) / 30
    assert fit_noise(t, rng.standard_normal((1000, 3))).inflation(t) < 1.3


@pytest.mark.parametrize("n", [3, 200])
def test_too_few_or_no_residuals_count_as_white(n):
    noise = np.zeros((n, 3)) if n > 8 else np.ones((n, 3))
    assert fit_noise(np.arange(float(n)), noise).share == 0.0


# Covariances ------------------------------------------------------------------------------------


def test_the_covariance_of_least_squares_is_that_of_the_normal_equations():
    """White noise: sigma^2 (J^T J)^-1 with J = [-[d]_x, -d'], and the Cramer-Rao bound for td."""
    rng = np.random.default_rng(0)
    t, d, rate = curve()
    sigma = 0.05
    noisy = d + sigma * rng.standard_normal(d.shape)
    noisy -= np.sum((noisy - d) * d, axis=1)[:, None] * d
    found = joint_covariance(t, noisy, d, rate, np.ones(t.size), np.inf)
    J = np.concatenate([np.cross(np.eye(3), d[:, None]).transpose(0, 2, 1), -rate[:, :, None]], 2)
    expected = sigma**2 * np.linalg.inv(np.einsum("ica,icb->ab", J, J))
    # The estimated variance of 800 numbers: a few percent; more where the noise looks coloured.
    np.testing.assert_allclose(np.diag(found.full), np.diag(expected), rtol=0.2)
    omega = np.sum(np.cross(d, rate)[:, 2:], axis=1)
    assert expected[3, 3] == pytest.approx(sigma**2 / np.sum((omega - omega.mean()) ** 2))
    assert found.samples == pytest.approx(t.size, rel=0.3)


def test_the_covariance_does_not_depend_on_the_body_frame():
    rng = np.random.default_rng(1)
    t, d, rate = curve()
    R = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    R *= np.sign(np.linalg.det(R))
    e, w = d + 0.05 * rng.standard_normal(d.shape), rng.uniform(0.5, 1.5, t.size)
    plain = joint_covariance(t, e, d, rate, w, 0.1)
    turned = joint_covariance(t, e @ R.T, d @ R.T, rate @ R.T, w, 0.1)
    G = np.eye(4)
    G[:3, :3] = R
    np.testing.assert_allclose(turned.full, G @ plain.full @ G.T, rtol=1e-6, atol=1e-12)


def test_coloured_noise_widens_the_covariance_by_its_inflation():
    """Of the tilt, whose scores change as slowly as the direction does."""
    rng = np.random.default_rng(2)
    t, d, rate = curve(3000)
    d, rate = np.tile([1.0, 0, 0], (3000, 1)), 0 * rate
    ratio = []
    for share in (0.0, 1.0):
        e = d + 0.02 * coloured(t, share, 0.15, 3, rng)
        ratio.append(joint_covariance(t, e, d, rate, np.ones(t.size), np.inf).full[1, 1])
    expected = NoiseModel(1.0, 0.15).inflation(t)
    assert ratio[1] / ratio[0] == pytest.approx(expected, rel=0.4)


def test_what_the_data_do_not_hold_is_unknown():
    """Parallel directions: the turn about them, and the offset."""
    rng = np.random.default_rng(3)
    t, d = np.arange(300) / 30, np.tile([1.0, 0, 0], (300, 1))
    e = d + 0.05 * rng.standard_normal(d.shape)
    found = joint_covariance(t, e, d, 0 * d, np.ones(300), np.inf)
    assert found.full[0, 0] == pytest.approx(UNKNOWN)
    assert found.full[3, 3] == pytest.approx(UNKNOWN)
    assert found.full[1, 1] == pytest.approx(0.05**2 / 300, rel=0.3)
    assert found.rotation_given_offset[0, 0] == pytest.approx(UNKNOWN)


def test_on_an_arc_an_offset_is_a_turn_at_the_rate_of_the_arc():
    t = np.arange(300) / 30
    d = np.stack([np.cos(0.3 * t), np.sin(0.3 * t), 0 * t], axis=1)
    rate = 0.3 * np.stack([-d[:, 1], d[:, 0], 0 * t], axis=1)
    e = d + 0.05 * np.random.default_rng(4).standard_normal(d.shape)
    found = joint_covariance(t, e, d, rate, np.ones(300), np.inf)
    np.testing.assert_allclose(found.offset_sensitivity, [0, 0, 0.3], atol=1e-12)
    assert found.full[3, 3] > 100


def test_a_robust_covariance_forgets_outliers():
    rng = np.random.default_rng(5)
    t, d, rate = curve(1000)
    e = d + 0.05 * rng.standard_normal(d.shape)
    spoilt = e.copy()
    spoilt[::5] *= -1
    reach = 0.5 * (5.12 * 0.05) ** 2
    clean, dirty = (
        np.sqrt(joint_covariance(t, x, d, rate, np.ones(1000), reach).full[3, 3])
        for x in (e, spoilt)
    )
    # 80 % of the headings are left.
    assert dirty / clean == pytest.approx(1 / np.sqrt(0.8), rel=0.1)


def test_tukeys_loss_costs_five_percent_of_the_variance_on_normal_noise():
    """Apart from the inflation, for which either takes some white noise to be coloured."""
    rng = np.random.default_rng(6)
    t, d, rate = curve(4000)
    e = d + 0.05 * rng.standard_normal(d.shape)
    e -= np.sum((e - d) * d, axis=1)[:, None] * d
    variances = []
    for reach in (0.5 * (5.12 * 0.05) ** 2, np.inf):
        found = joint_covariance(t, e, d, rate, np.ones(4000), reach)
        variances.append(np.diag(found.full)[2:] / found.noise.inflation(t))
    np.testing.assert_allclose(variances[0] / variances[1], 1 / 0.95, rtol=0.05)


def test_a_weight_of_zero_is_no_heading():
    rng = np.random.default_rng(7)
    t, d, rate = curve(1000)
    e, used = d + 0.05 * rng.standard_normal(d.shape), np.arange(1000) % 2 == 0
    weighted = joint_covariance(t, e, d, rate, used.astype(float), np.inf).full
    selected = joint_covariance(t[used], e[used], d[used], rate[used], np.ones(500), np.inf).full
    np.testing.assert_allclose(np.diag(weighted), np.diag(selected), rtol=0.2)


# Quantiles --------------------------------------------------------------------------------------


@pytest.mark.parametrize("sds", [(1, 0, 0), (1, 1, 0), (1, 1, 1), (3, 1, 0.2)])
def test_the_radius_holds_95_percent_of_normal_errors(sds):
    """Exact for equal standard deviations; Satterthwaite's approximation is within 2 % else."""
    covariance = np.diag(np.square(sds)) * 1e-4
    radius = rotation_radius(covariance)
    draws = 0.01 * np.random.default_rng(0).standard_normal((100_000, 3)) * sds
    assert np.mean(np.linalg.norm(draws, axis=1) < radius) == pytest.approx(0.95, abs=0.01)


def test_the_radius_of_one_and_two_equal_axes_is_the_chi_square_quantile():
    assert rotation_radius(np.diag([0, 0, 1e-4])) == pytest.approx(
        0.01 * stats.norm.ppf(0.975), rel=1e-6
    )
    rayleigh = 0.01 * stats.rayleigh.ppf(0.95)
    assert rotation_radius(np.diag([0, 1e-4, 1e-4])) == pytest.approx(rayleigh, rel=1e-6)


def test_few_samples_widen_the_radius_and_nothing_exceeds_half_a_turn():
    covariance = 1e-4 * np.eye(3)
    assert rotation_radius(covariance, samples=5) > 1.1 * rotation_radius(covariance, samples=1e6)
    assert rotation_radius(UNKNOWN * np.eye(3)) == np.pi
    assert rotation_radius(np.zeros((3, 3))) == 0.0


def test_the_offsets_quantile_is_students():
    assert t_quantile(1e9) == pytest.approx(1.959964, rel=1e-5)
    assert t_quantile(4) == pytest.approx(stats.t.ppf(0.975, 4))
    assert t_quantile(1) == pytest.approx(12.7062, rel=1e-5)


# Bootstrap --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("limit", "at"), [(1.0, 0.3), (0.2, 0.2)])
def test_the_peak_of_a_parabola_is_its_vertex(limit, at):
    x = np.array([-1.0, -0.4, 0.1, 0.6, 1.0])
    assert peak_of_parabola(x, 2 - 3 * (x - 0.3) ** 2, limit) == pytest.approx((at, -6.0))
    assert peak_of_parabola(-x, 2 - 3 * (x - 0.3) ** 2, limit) == pytest.approx((-at, -6.0))
    assert peak_of_parabola(x, 3 * (x - 0.3) ** 2, limit) == pytest.approx((0.0, 6.0))


def bootstrapped(seed, drive=None, noise=None):
    rng = np.random.default_rng(7)
    made = simulate(drive or drives.s_curve(), rng, offset=0.1, heading_noise=Noise(0.1))
    track = velocity_track(made.velocities)
    refined = refine_offset(made.headings, track, 0.1)
    model = noise or NoiseModel(0.0, 1.0)
    pair = StreamPair.of(made.headings, track)
    return bootstrap(pair, refined, model, np.random.default_rng(seed)), refined


def test_the_bootstrap_agrees_with_the_cramer_rao_bound_on_a_smooth_curve():
    """The bound is 8.4 ms here; 200 draws give a standard deviation to 5 %, 40 blocks to 11 %."""
    joint, _ = bootstrapped(0)
    t = np.arange(0, 20, 1 / 30)
    omega = np.pi / 4 * np.pi / 4 * np.cos(np.pi / 4 * t)
    bound = 0.1 / np.sqrt(np.sum((omega - omega.mean()) ** 2))
    assert np.sqrt(joint[3, 3]) == pytest.approx(bound, rel=0.4)
    assert np.all(np.linalg.eigvalsh(joint) > 0)


def test_the_same_seed_gives_the_same_bootstrap():
    assert bootstrapped(1)[0].tobytes() == bootstrapped(1)[0].tobytes()
    assert bootstrapped(1)[0].tobytes() != bootstrapped(2)[0].tobytes()


def test_resampled_offsets_scatter_about_zero_with_the_rotation_of_the_arc():
    """On an arc a resampled offset is a turn at the arc's rate: full correlation."""
    joint, _ = bootstrapped(3, drives.arc(radius=2.0))
    correlation = joint[2, 3] / np.sqrt(joint[2, 2] * joint[3, 3])
    assert abs(correlation) > 0.9
    assert np.sqrt(joint[3, 3]) > 0.03


def test_one_block_of_headings_is_not_resampled_into_nothing():
    rng = np.random.default_rng(0)
    made = simulate(drives.s_curve(), rng, offset=0.0, heading_noise=Noise(0.05))
    track = velocity_track(made.velocities)
    part = made.headings.select(np.abs(made.headings.t - 4) < 1)
    assert isinstance(part, HeadingSeries)
    refined = refine_offset(part, track, 0.0)
    joint = bootstrap(StreamPair.of(part, track), refined, NoiseModel(0.9, 5.0), rng)
    assert np.isfinite(joint).all()

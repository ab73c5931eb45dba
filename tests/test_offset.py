"""The offset's search: curves against twins and closed forms, peaks by hand, and its symmetries."""

import naive_backend as naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.simulation import drives
from data_tools.simulation.streams import Noise, simulate
from evcalib.alignment import StreamPair
from evcalib.alignment import offset as module
from evcalib.alignment.offset import METHODS, WIDE_LOSS_SCALES, candidate_offsets, find_offset
from evcalib.alignment.offset_refinement import (
    inliers_at,
    plausible_offsets,
    preference,
    refine_offset,
)
from evcalib.alignment.rotation import Mixture
from evcalib.errors import InputError
from evcalib.geometry import random_rotation, rotation_angle
from evcalib.kernels.alignment import offset as kernel
from evcalib.kinematics.velocity_track import velocity_track
from evcalib.series import HeadingSeries, VelocitySeries
from evcalib.uncertainty import NoiseModel

SEARCHES = METHODS[:-1]
seeds = st.integers(0, 10**6)


def streams(drive=None, seed=0, *, sigma=0.0, sigma_o=0.0, offset=0.2, **more):
    """Return simulated streams and the track of their velocities."""
    rng = np.random.default_rng(seed)
    noise, velocity_noise = Noise(sigma, **more), Noise(sigma_o)
    made = simulate(
        drive or drives.s_curve(10.0, amplitude=1.0, period=5.0),
        rng,
        offset=offset,
        heading_noise=noise,
        velocity_noise=velocity_noise,
    )
    return made, velocity_track(made.velocities)


def kernel_input(made, track, weight=None):
    columns = StreamPair.of(made.headings, track).columns
    columns = columns if weight is None else columns._replace(weight=weight)
    return columns, (track.arrays, track.limits)


# Curves against the twins -----------------------------------------------------------------------


@settings(deadline=None, max_examples=10)
@given(seeds, st.floats(-0.5, 0.5))
def test_a_candidates_profile_equals_that_of_the_twin(seed, offset):
    made, track = streams(drives.s_curve(2.0, period=2.0), seed, sigma=0.1, outliers=0.2)
    weight = np.random.default_rng(seed).uniform(0.5, 2, len(made.headings))
    data, sampled = kernel_input(made, track, weight)
    score, total, R = kernel.profile(data, np.array([offset]), *sampled, WIDE_LOSS_SCALES)
    d = track.directions(data.start, data.end, offset)
    expected = naive.profile(made.headings.v, d, weight, WIDE_LOSS_SCALES)
    assert score[0] == pytest.approx(expected[0], rel=1e-9)
    assert total[0] == pytest.approx(expected[1])
    assert rotation_angle(R[0], expected[2]) < 1e-6


@settings(deadline=None, max_examples=20)
@given(seeds)
def test_the_profiles_rotations_are_never_reflections(seed):
    made, track = streams(drives.s_curve(2.0), seed, sigma=0.5)
    data, sampled = kernel_input(made, track)
    _, _, R = kernel.profile(data, candidate_offsets(2.5, 0.1), *sampled, WIDE_LOSS_SCALES)
    np.testing.assert_allclose(np.linalg.det(R), 1, atol=1e-12)


def test_moments_are_numpys_weighted_covariances():
    made, track = streams(sigma=0.1)
    weight = np.random.default_rng(0).uniform(0.5, 2, len(made.headings))
    data, sampled = kernel_input(made, track, weight)
    S_ee, S_oo, S_oe, total = kernel.moments(data, np.array([0.4]), *sampled)
    d = track.directions(data.start, data.end, 0.4)
    known = np.any(d != 0, axis=1)
    both = np.hstack([made.headings.v, d])[known]
    expected = np.cov(both.T, aweights=weight[known], bias=True)
    np.testing.assert_allclose(S_ee[0], expected[:3, :3], atol=1e-14)
    np.testing.assert_allclose(S_oo[0], expected[3:, 3:], atol=1e-14)
    np.testing.assert_allclose(S_oe[0], expected[3:, :3], atol=1e-14)
    assert total[0] == pytest.approx(weight[known].sum())


def test_contrasts_are_means_and_variances_of_score_differences():
    made, track = streams(drives.s_curve(3.0), sigma=0.1)
    weight = np.random.default_rng(0).uniform(0, 2, len(made.headings))
    weight[::7] = 0
    data, sampled = kernel_input(made, track, weight)
    R, reach = made.R_body_cam, 0.2
    at_peak = naive_scores(made, track, 0.2, R, reach)
    at_other = naive_scores(made, track, 0.5, R, reach)
    both = (at_peak >= 0) & (at_other >= 0) & (weight > 0)
    gap = (at_peak - at_other)[both]
    ours, others = (track.directions(data.start, data.end, at) @ R for at in (0.2, 0.5))
    peak, memory = kernel.Peak(at_peak, ours), (0.4, 0.3)
    args = (np.array([0.5]), *sampled, R[None], reach, peak, memory)
    mean, variance, pairs, inflation = kernel.contrast(data, *args)
    expected = np.average(gap, weights=weight[both])
    assert mean[0] == pytest.approx(expected)
    assert variance[0] == pytest.approx(np.average((gap - expected) ** 2, weights=weight[both]))
    assert pairs[0] == both.sum()
    apart, t = (weight[:, None] * (others - ours))[both], data.start[both]
    lag = np.abs(np.subtract.outer(t, t))
    correlation = np.where(lag == 0, 1.0, memory[0] * np.exp(-lag / memory[1]))
    shared = np.einsum("ia,ij,ja->", apart, correlation, apart)
    assert inflation[0] == pytest.approx(shared / np.sum(apart**2))


def naive_scores(made, track, offset, R, reach):
    """Return each heading's Tukey score, -1 where it is not covered."""
    d, known = StreamPair.of(made.headings, track).directions(offset)
    rest = np.maximum(0, 1 - (1 - np.sum(d * (made.headings.v @ R.T), axis=1)) / reach)
    return np.where(known, rest**3, -1.0)


# Closed forms -----------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["trace", "canonical", "profile"])
def test_on_an_arc_all_offsets_correlate_fully(method):
    """v_o(t + td) = Rz(omega td) v_o(t); every offset fits, each with its own rotation."""
    made, track = streams(drives.arc(10.0))
    curve = find_offset(made.headings, track, method=method)
    np.testing.assert_allclose(curve.score, 1.0, atol=1e-4)


def test_planar_motion_correlates_fully_at_the_true_offset_despite_its_rank():
    """The paper's factor 1/3 would cap the trace correlation at sqrt(2/3) = 0.8165."""
    made, track = streams(offset=0.2)
    curve = find_offset(made.headings, track, method="trace")
    assert curve.score.max() == pytest.approx(1.0, abs=1e-3)


def test_the_trace_is_the_root_mean_square_of_the_canonical_correlations():
    made, track = streams(sigma=0.1, offset=0.0)
    part = made.headings.select(np.abs(made.headings.t - 5) < 3)
    zero = find_offset(part, track, method="trace", max_offset=0.05)
    first = find_offset(part, track, method="canonical", max_offset=0.05)
    d = StreamPair.of(part, track).directions(0.0)[0][:, :2]
    # Principal angles between the column spaces of the two centred data matrices.
    q_e, q_d = (np.linalg.qr(x - x.mean(axis=0))[0] for x in (part.v, d))
    rho = np.linalg.svd(q_e.T @ q_d, compute_uv=False)
    assert zero.score[5] == pytest.approx(np.sqrt(np.mean(rho**2)), abs=1e-9)
    assert first.score[5] == pytest.approx(rho[0], abs=1e-9)


# Finding ----------------------------------------------------------------------------------------

# The grid's parabola is as exact as the curve is one: a twentieth of a step or so for smooth ones.
EXACT = {"profile": 1e-3, "trace": 2e-3, "canonical": 2e-2, "scalar": 5e-3}


@pytest.mark.parametrize("method", SEARCHES)
@pytest.mark.parametrize("offset", [-0.4137, 0.0, 0.2518])
def test_every_method_finds_the_offset_of_a_clean_curve(method, offset):
    made, track = streams(drives.s_curve(20.0, amplitude=1.0, period=5.0, phase=0.7), offset=offset)
    assert find_offset(made.headings, track, method=method).offset == pytest.approx(
        offset, abs=EXACT[method]
    )


@pytest.mark.parametrize("offset", [-0.3, 0.3])
def test_a_positive_offset_means_that_the_odometry_clock_is_ahead(offset):
    made, track = streams(offset=0.0)
    later = HeadingSeries(made.headings.t - offset, made.headings.v)
    assert find_offset(later, track).offset == pytest.approx(offset, abs=1e-3)


@settings(deadline=None, max_examples=10)
@given(seeds, st.sampled_from(SEARCHES))
def test_the_rotation_of_the_camera_does_not_change_the_curve(seed, method):
    made, track = streams(seed=seed, sigma=0.1)
    turned = HeadingSeries(
        made.headings.t, made.headings.v @ random_rotation(np.random.default_rng(seed))
    )
    one, two = (find_offset(h, track, method=method).score for h in (made.headings, turned))
    np.testing.assert_allclose(one, two, atol=1e-9)


@settings(deadline=None, max_examples=10)
@given(seeds, st.integers(-20, 20))
def test_shifting_a_clock_by_whole_steps_shifts_the_curve(seed, steps):
    made, track = streams(seed=seed, sigma=0.1)
    kept = made.headings.select(np.abs(made.headings.t + 0.2 - 5) < 3)
    moved = HeadingSeries(kept.t + steps * 0.01, kept.v)
    one, two = (find_offset(h, track, max_offset=0.5).score for h in (kept, moved))
    common = slice(max(steps, 0), min(101 + steps, 101))
    np.testing.assert_allclose(two[max(-steps, 0) :][: 101 - abs(steps)], one[common], atol=1e-9)


@pytest.mark.parametrize("method", SEARCHES)
def test_the_speed_of_the_vehicle_does_not_matter(method):
    made, track = streams(sigma=0.1)
    faster = velocity_track(VelocitySeries(made.velocities.t, 7 * made.velocities.v))
    one, two = (find_offset(made.headings, t, method=method) for t in (track, faster))
    assert one.offset == pytest.approx(two.offset, abs=1e-9)


def test_outliers_and_flips_leave_the_profile_where_it_is():
    """Medians are 2.5 and 3.6 ms (see montecarlo.py); no error is beyond 50 ms."""
    for spoil in ({"outliers": 0.6}, {"flips": 0.4}):
        drive = drives.s_curve(20.0, amplitude=np.pi / 2, period=5.0)
        made, track = streams(drive, 1, sigma=0.1, sigma_o=0.02, **spoil)
        assert abs(find_offset(made.headings, track).offset - 0.2) < 0.05


def test_headings_over_intervals_are_compared_with_mean_velocities():
    """Stamped at their ends, headings of long intervals are late by half of them; not ours."""
    drive = drives.s_curve(20.0, amplitude=1.0, period=5.0)
    t = np.arange(1.0, 19.0, 0.05)
    mean = np.mean([drive.velocity(t + s) for s in np.linspace(-0.3, 0.3, 61)], axis=0)
    v = mean / np.linalg.norm(mean, axis=1)[:, None]
    ends = HeadingSeries(t + 0.3, v, t_start=t - 0.3, t_end=t + 0.3)
    _, track = streams(drive)
    assert find_offset(ends, track).offset == pytest.approx(0.0, abs=1e-3)
    assert find_offset(HeadingSeries(t + 0.3, v), track).offset == pytest.approx(-0.3, abs=5e-3)


# Cover ------------------------------------------------------------------------------------------


def test_the_overlap_is_the_share_that_the_odometry_covers():
    made, track = streams(drives.s_curve(4.0), offset=0.0)
    wide = candidate_offsets(3.0, 0.5)
    _, total, _ = StreamPair.of(made.headings, track).profile(wide, WIDE_LOSS_SCALES)
    expected = [
        np.sum((made.headings.t + x >= track.t[0]) & (made.headings.t + x <= track.t[-1]))
        for x in wide
    ]
    np.testing.assert_array_equal(total, expected)


def test_candidates_with_little_overlap_are_not_compared():
    made, track = streams(drives.s_curve(4.0), offset=0.0)
    curve = find_offset(made.headings, track, max_offset=3.0)
    np.testing.assert_array_equal(
        np.isfinite(curve.score), curve.overlap >= 0.5 * curve.overlap.max()
    )
    assert np.isnan(curve.score[[0, -1]]).all()


def test_a_gap_of_the_odometry_is_never_bridged():
    """With a gap of 2 s in the velocities, headings inside it have no say at any offset."""
    noise = Noise(gaps=((4.0, 6.0),))
    rng = np.random.default_rng(0)
    drive = drives.s_curve(10.0, period=5.0)
    made = simulate(drive, rng, offset=0.0, velocity_noise=noise)
    track = velocity_track(made.velocities)
    inside = (made.headings.t > 5.01) & (made.headings.t < 5.4)
    wild = made.headings.v.copy()
    wild[inside] *= -1
    changed = HeadingSeries(made.headings.t, wild)
    one, two = (find_offset(h, track, max_offset=0.5).score for h in (made.headings, changed))
    np.testing.assert_allclose(one, two, atol=1e-12)


def test_streams_apart_are_refused_with_their_spans():
    made, track = streams()
    late = HeadingSeries(made.headings.t + 100, made.headings.v)
    message = r"headings \(99\.\d+ to 10\d\.\d+ s\) and velocities .* do not overlap .* \+-1 s"
    with pytest.raises(InputError, match=message):
        find_offset(late, track)


def test_unusable_headings_are_refused():
    made, track = streams()
    none = HeadingSeries(made.headings.t, made.headings.v, valid=np.zeros(len(made.headings), bool))
    with pytest.raises(InputError, match="no usable row is left"):
        find_offset(none, track)


def test_unknown_methods_and_widths_are_refused():
    made, track = streams()
    with pytest.raises(InputError, match="offset_method must be one of profile, trace, canonical"):
        find_offset(made.headings, track, method="none")
    with pytest.raises(InputError, match="max_offset must be a positive number of seconds"):
        find_offset(made.headings, track, max_offset=0)
    with pytest.raises(InputError, match="step must be a positive number of seconds"):
        find_offset(made.headings, track, step=np.nan)


# Peaks by hand ----------------------------------------------------------------------------------


def test_candidates_are_whole_steps_about_zero():
    np.testing.assert_allclose(
        candidate_offsets(0.03, 0.01), [-0.03, -0.02, -0.01, 0, 0.01, 0.02, 0.03]
    )
    np.testing.assert_allclose(candidate_offsets(0.025, 0.01), [-0.02, -0.01, 0, 0.01, 0.02])
    assert 0.0 in candidate_offsets(1.0, 0.03)


@given(st.floats(-0.049, 0.049))
def test_the_vertex_of_a_parabola_is_found_between_the_candidates(vertex):
    offsets = candidate_offsets(0.3)
    score = 1 - (offsets - vertex) ** 2
    found = module._subgrid_peak(offsets, score, int(np.argmax(score)))
    assert found == pytest.approx(vertex, abs=1e-12)


def test_a_peak_without_neighbours_stays_on_the_grid():
    score = np.full(11, np.nan)
    score[5] = 1.0
    assert module._subgrid_peak(candidate_offsets(0.05), score, 5) == 0.0


def test_the_second_peak_is_the_next_hill_beyond_a_valley():
    ratio = module.second_peak_ratio
    assert ratio(np.array([0.0, 1, 0, 0.5, 0]), 1) == 0.5
    assert ratio(np.array([0.0, 0.2, 1, 0.2, 0]), 2) == 0.0
    # A ripple of 3 % of the height is no hill.
    assert ratio(np.array([0.0, 1, 0.80, 0.83, 0]), 1) == 0.0
    assert ratio(np.array([0.9, 0, 1, 0, 0.7]), 2) == 0.9
    assert ratio(np.array([np.nan, 0.9, 0, 1, 0]), 3) == 0.9


def test_a_peak_at_the_last_finite_candidate_is_at_the_edge():
    score = np.array([np.nan, 1.0, 0.5, 0.2, np.nan])
    assert module._at_edge(score, 1)
    assert not module._at_edge(np.array([0.2, 1.0, 0.5]), 1)


def test_an_offset_beyond_the_search_is_reported_at_its_edge():
    made, track = streams(offset=0.5)
    assert find_offset(made.headings, track, max_offset=0.3).at_edge
    assert not find_offset(made.headings, track, max_offset=0.8).at_edge


def test_a_periodic_drive_has_a_second_peak_as_high_as_the_first():
    made, track = streams(drives.s_curve(40.0, period=1.6, amplitude=1.0), offset=0.0)
    curve = find_offset(made.headings, track, max_offset=2.0)
    assert curve.second_peak_ratio > 0.95


# Weights ----------------------------------------------------------------------------------------


def test_weights_are_as_given_or_from_the_standard_deviations_and_one_on_average():
    t, v = np.arange(3.0), np.tile([1.0, 0, 0], (3, 1))
    _, track = streams()

    def weights(headings):
        return StreamPair.of(headings, track).weight

    np.testing.assert_array_equal(weights(HeadingSeries(t, v)), 1)
    np.testing.assert_array_equal(weights(HeadingSeries(t, v, sd=np.zeros(3))), 1)
    from_sd = weights(HeadingSeries(t, v, sd=[0.1, 0.1, 0.3]))
    np.testing.assert_allclose(from_sd, np.array([1, 1, 0.2]) * 3 / 2.2)
    given_ = HeadingSeries(t, v, sd=[0.1, 0.1, 0.3], weight=[1, 2, 3])
    np.testing.assert_allclose(weights(given_), [0.5, 1, 1.5])


# Refinement and plausibility --------------------------------------------------------------------


@pytest.mark.parametrize("start", [0.12, 0.2, 0.28])
def test_refinement_reaches_the_same_peak_from_either_side(start):
    made, track = streams(drives.s_curve(), sigma=0.05, sigma_o=0.02)
    refined = refine_offset(made.headings, track, start)
    assert refined.converged
    assert refined.curvature < 0
    assert refined.offset == pytest.approx(
        refine_offset(made.headings, track, 0.2).offset, abs=1e-3
    )


def test_refinement_of_clean_streams_is_exact_and_finds_the_rotation():
    made, track = streams()
    refined = refine_offset(made.headings, track, 0.22)
    assert refined.offset == pytest.approx(0.2, abs=2e-4)
    assert rotation_angle(refined.R_body_cam, made.R_body_cam) < 1e-3
    assert refined.mixture.inliers > 0.99


def test_an_offset_taken_as_it_is_stays():
    made, track = streams(sigma=0.05)
    fixed = inliers_at(made.headings, track, 0.2)
    assert (fixed.offset, fixed.converged) == (0.2, True)
    assert fixed.mixture.sigma == pytest.approx(0.05, rel=0.2)
    assert isinstance(fixed.mixture, Mixture)


def test_on_an_arc_every_offset_is_plausible():
    made, track = streams(drives.arc(), sigma=0.1, sigma_o=0.02)
    offsets = candidate_offsets(0.5)
    refined = inliers_at(made.headings, track, 0.2)
    assert plausible_offsets(made.headings, track, offsets, refined).mean() > 0.9


def test_on_an_s_curve_only_offsets_near_the_peak_are_plausible():
    """Up to four standard deviations of 10 ms, and the grid."""
    made, track = streams(drives.s_curve(), sigma=0.1, sigma_o=0.02)
    offsets = candidate_offsets(1.0)
    refined = refine_offset(made.headings, track, 0.2)
    near = offsets[plausible_offsets(made.headings, track, offsets, refined)]
    assert np.abs(near - refined.offset).max() < 0.06
    slow = NoiseModel(0.9, 1.0)
    wider = plausible_offsets(made.headings, track, offsets, refined, noise=slow)
    assert wider.sum() > 2 * near.size


def test_headings_prefer_the_track_they_come_from():
    made, track = streams(drives.s_curve(), sigma=0.1)
    _, other = streams(drives.arc())
    refined = refine_offset(made.headings, track, 0.2)
    assert preference(made.headings, track, other, refined) > 5
    assert preference(made.headings, track, track, refined) == pytest.approx(0, abs=0.5)

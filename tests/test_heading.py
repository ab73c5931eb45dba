"""The chain from events to headings: simulated, real, transformed, turning, broken."""

import tracemalloc
from dataclasses import replace
from inspect import signature
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from data_tools.logs.camera_files import read_calib_txt
from data_tools.recordings.formats.events_text import load_events_text
from data_tools.simulation.scenes import furnished_room
from data_tools.simulation.simulator import Simulator, simulate_translation
from data_tools.simulation.trajectory import Trajectory
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.geometry import angle_between, unit
from evcalib.heading import HeadingEstimator, HeadingOptions, KeyframeMatches, estimate_headings
from evcalib.heading._keyframes import BearingTable
from evcalib.heading._options import MAX_STEPS
from evcalib.heading._window_fit import NO_PARALLAX, SHARED, TO_AND_FRO, fit
from evcalib.heading.epipolar import two_point
from evcalib.surfaces import SURFACES

SIMULATED = Camera(346, 260, 250.0, 250.0, 172.5, 129.5)
SMALL = Camera(120, 90, 100.0, 100.0, 59.5, 44.5)


def errors(estimate, truth, start=0.0, end=np.inf):
    """Errors [deg] of the headings between two times, and the share of keyframes with one."""
    headings = estimate.headings
    rows = (headings.t >= start) & (headings.t <= end)
    lost = sum(start <= gap.t <= end for gap in estimate.gaps)
    return np.degrees(angle_between(headings.v[rows], unit(truth))), rows.sum() / (
        rows.sum() + lost
    )


@pytest.fixture(scope="module")
def sideways():
    return simulate_translation((1, 0, 0.3), 0.5, 0.9, SIMULATED, seed=11).events


@pytest.fixture(scope="module")
def slider(data):
    folder = data / "slider_depth"
    events = load_events_text(folder / "events.txt.gz", 240, 180)
    return events, read_calib_txt(folder / "calib.txt", 240, 180)


def rebuilt(x, y, t, p, width, height):
    return Events.from_arrays(x, y, t, p, width, height)


def transformed(how, events, camera):
    """An exact transform of recording and calibration, with its heading and its steady time."""
    x, y, t, p = events.x.astype(int), events.y.astype(int), events.t, events.p
    width, height, (k1, k2, p1, p2, k3) = camera.width, camera.height, camera.distortion
    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    if how == "reversed":
        back = rebuilt(x[::-1], y[::-1], (t[-1] - t)[::-1], ~p[::-1], width, height)
        return back, camera, (-1, 0, 0), (0.0, 1e-6 * t[-1] - 0.2)
    if how == "transposed":
        turned = Camera(height, width, fy, fx, cy, cx, (k1, k2, p2, p1, k3))
        return rebuilt(y, x, t, p, height, width), turned, (0, 1, 0), (0.2, np.inf)
    if how == "mirrored":
        flipped = Camera(width, height, fx, fy, width - 1 - cx, cy, (k1, k2, p1, -p2, k3))
        return rebuilt(width - 1 - x, y, t, p, width, height), flipped, (-1, 0, 0), (0.2, np.inf)
    return events, camera, (1, 0, 0), (0.2, np.inf)


@pytest.mark.parametrize("how", ["as it is", "reversed", "transposed", "mirrored"])
def test_the_real_slider_moves_along_its_axis(slider, how):
    events, camera, truth, (start, end) = transformed(how, *slider)
    estimate = estimate_headings(events, camera)
    off, found = errors(estimate, truth, start, end)
    # The true direction is known to about a degree; the headings agree with each other better.
    assert np.median(off) <= 1.3
    assert np.percentile(off, 90) <= 2.5
    assert found >= 0.8
    steady = (estimate.headings.t >= start) & (estimate.headings.t <= end)
    off, _ = errors(estimate, estimate.headings.v[steady].mean(axis=0), start, end)
    assert np.median(off) <= 0.6


def test_the_real_slider_moves_back_as_it_came(slider):
    """The tilt of its mount shows alike in both directions of time."""
    mean = []
    for how in ("as it is", "reversed"):
        events, camera, _, (start, end) = transformed(how, *slider)
        headings = estimate_headings(events, camera).headings
        steady = (headings.t >= start) & (headings.t <= end)
        mean.append(unit(headings.v[steady].mean(axis=0)))
    assert np.degrees(angle_between(mean[0], -mean[1])) < 0.5


@pytest.mark.parametrize("surface", [name for name in SURFACES if name != "tos_ts"])
def test_every_surface_finds_the_real_direction(slider, surface):
    off, found = errors(estimate_headings(*slider, surface=surface), (1, 0, 0), 0.2)
    assert np.median(off) <= 1.5
    assert found >= 0.8


@pytest.mark.parametrize("localisation", ["corners", "images"])
def test_every_localisation_finds_the_real_direction(slider, localisation):
    off, found = errors(estimate_headings(*slider, localisation=localisation), (1, 0, 0), 0.2)
    assert np.median(off) <= 1.3
    assert found >= 0.8


def test_harris_corners_find_the_real_direction(slider):
    off, found = errors(estimate_headings(*slider, detector="harris"), (1, 0, 0), 0.2)
    assert np.median(off) <= 1.5
    assert found >= 0.8


def test_five_points_find_the_real_direction_roughly(slider):
    off, _ = errors(estimate_headings(*slider, solver="five_point"), (1, 0, 0), 0.2)
    assert len(off) >= 5
    assert np.median(off) < 15


@pytest.mark.parametrize("name", ["shapes_rotation", "boxes_rotation"])
@pytest.mark.parametrize("rate", [200, 500])
def test_real_turns_have_no_heading(data, name, rate):
    folder = data / "rotation" / name
    events = load_events_text(folder / "events.txt.gz", 240, 180)
    camera = read_calib_txt(folder / "calib.txt", 240, 180)
    estimate = estimate_headings(events, camera, rate=rate, max_baseline=0.1)
    assert len(estimate.headings) == 0
    assert len(estimate.gaps) > 0


@pytest.mark.parametrize("degrees", [0, 45])
def test_simulated_translations_are_found_without_a_wrong_sign(degrees):
    truth = (np.sin(np.deg2rad(degrees)), 0.0, np.cos(np.deg2rad(degrees)))
    events = simulate_translation(truth, 0.5, 0.8, SIMULATED, seed=degrees).events
    require_simulated(estimate_headings(events, SIMULATED), truth)


def test_simulated_sideways_translation_is_found(sideways):
    require_simulated(estimate_headings(sideways, SIMULATED), (1, 0, 0.3))


def require_simulated(estimate, truth):
    off, found = errors(estimate, truth, 0.2, 0.6)
    assert np.median(off) <= 0.5
    assert np.percentile(off, 90) <= 1.5
    assert found >= 0.8
    assert errors(estimate, truth)[0].max() < 30


@pytest.mark.parametrize("rate", [(0.0, 0.0, 0.4), (0.5, 0.0, 0.0)], ids=["yaw", "roll"])
def test_a_simulated_turn_has_no_heading(rate):
    t = np.linspace(0.0, 0.7, 71)
    position = np.tile([0.0, 0.0, 1.2], (71, 1))
    turns = Rotation.from_rotvec(np.outer(t - 0.35, rate)).as_matrix()
    scene = furnished_room(position + np.linspace(-0.3, 0.3, 71)[:, None] * [1, 1, 0], 1)
    simulator = Simulator(Trajectory(t, position, turns), SMALL, scene, lever=(0.0, 0.0, 0.0))
    estimate = estimate_headings(simulator.run().events, SMALL)
    assert len(estimate.headings) == 0
    assert {NO_PARALLAX, TO_AND_FRO} & {gap.reason for gap in estimate.gaps}


@pytest.mark.parametrize(
    "camera",
    [
        Camera(240, 180, 199.1, 198.8, 132.2, 110.7, (-0.368, 0.151, -3e-4, -7.6e-4, 0.0)),
        Camera(346, 260, 130.0, 131.0, 170.0, 128.0, (-0.02, 0.01, 0.0, 0.0), "fisheye"),
        Camera(1, 1, 50.0, 50.0, 0.0, 0.0),
        Camera(6, 3, 50.0, 50.0, 2.5, 1.0),
    ],
)
def test_bearings_between_the_nodes_of_the_table_are_exact_to_a_hundredth_of_a_pixel(camera):
    rng = np.random.default_rng(0)
    xy = rng.uniform(0, (camera.width - 1, camera.height - 1), (2000, 2))
    xy = np.vstack((xy, [0, 0], [camera.width - 1, camera.height - 1]))
    off = angle_between(BearingTable(camera)(xy), camera.bearings(xy))
    assert off.max() * camera.fx < 0.01


def test_corners_that_the_lens_cannot_map_are_counted(sideways):
    # The distortion turns back 102 px from the centre.
    lens = Camera(346, 260, 250.0, 250.0, 172.5, 129.5, (-0.9, 0.0, 0.0, 0.0))
    estimate = estimate_headings(sideways, lens, keep_correspondences=True)
    assert estimate.counts.unseen > 500
    assert np.isfinite(estimate.correspondences.r1).all()


def test_pieces_of_any_size_give_the_same(sideways):
    whole = estimate_headings(sideways, SIMULATED, keep_correspondences=True)
    cuts = np.sort(np.random.default_rng(0).integers(0, len(sideways), 60))
    edges = [0, *cuts, len(sideways)]
    pieces = (sideways[a:b] for a, b in pairwise(edges))
    pieced = estimate_headings(pieces, SIMULATED, keep_correspondences=True)
    assert np.array_equal(whole.headings.v, pieced.headings.v)
    assert np.array_equal(whole.headings.t, pieced.headings.t)
    assert np.array_equal(whole.correspondences.t1, pieced.correspondences.t1)
    assert whole.counts == pieced.counts
    assert whole.gaps == pieced.gaps


def test_correspondences_are_those_behind_the_headings(sideways):
    estimate = estimate_headings(sideways, SIMULATED, keep_correspondences=True)
    kept, headings = estimate.correspondences, estimate.headings
    # Windows without heading have theirs, too.
    assert set(kept.heading) <= {-1, *range(len(headings))}
    assert not kept.inlier[kept.heading < 0].any()
    kept = kept.select(kept.heading >= 0)
    # The outermost windows may have pairs of their neighbours' only.
    assert np.unique(kept.heading).size >= len(headings) - 2
    assert np.all(np.diff(kept.heading) >= 0)
    assert np.all(kept.t2 > kept.t1)
    for r in (kept.r1, kept.r2):
        np.testing.assert_allclose(np.linalg.norm(r, axis=1), 1.0, rtol=1e-12)
    inside = kept.inlier
    t = headings.v[kept.heading[inside]]
    lever = np.cross(kept.r1[inside], kept.r2[inside])
    slope = np.hypot(*(np.linalg.norm(np.cross(t, r[inside]), axis=1) for r in (kept.r1, kept.r2)))
    residuals = np.abs(np.sum(t * lever, axis=1) / slope)
    # The headings themselves are of shorter spans, and differ by a fraction of a degree.
    assert np.quantile(residuals, 0.95) <= 1.5 / 250
    assert residuals.max() <= 2.5 / 250
    assert inside.mean() > 0.5
    # A pair of keyframes belongs to one heading, and lies about it.
    pairs = np.unique(np.column_stack((kept.pair, kept.heading)), axis=0)
    assert np.unique(pairs[:, 0]).size == len(pairs)
    middle = 0.5 * (kept.t1 + kept.t2)
    assert np.abs(middle - headings.t[kept.heading]).max() < 0.15
    assert estimate_headings(sideways, SIMULATED).correspondences is None


def test_a_heading_carries_its_own_time_and_certainty(sideways):
    estimate = estimate_headings(sideways, SIMULATED)
    headings = estimate.headings
    assert np.all(headings.t_start < headings.t)
    assert np.all(headings.t < headings.t_end)
    assert np.all(headings.t_end - headings.t_start < 0.7)
    assert headings.weight is None
    traces = np.trace(estimate.covariance, axis1=1, axis2=2)
    np.testing.assert_allclose(headings.sd**2, traces / 2)
    counts = estimate.counts
    assert counts.events == len(sideways)
    assert counts.keyframes == 17
    assert len(headings) + len(estimate.gaps) == 17
    assert 0 < counts.clipped < counts.keypoints < counts.corners < counts.events
    assert estimate.found == len(headings) / 17


def test_certain_headings_are_of_shorter_spans(sideways):
    long = estimate_headings(sideways, SIMULATED, enough_sd=1e-3).headings
    short = estimate_headings(sideways, SIMULATED, enough_sd=0.5).headings
    assert np.median(long.t_end - long.t_start) > 1.3 * np.median(short.t_end - short.t_start)
    assert np.median(long.sd) < np.median(short.sd) < np.deg2rad(0.5)
    off = np.degrees(angle_between(short.v, unit((1, 0, 0.3))))
    assert np.median(off) < 1.0


def test_pairs_whose_matches_did_not_survive_are_left_out():
    rng = np.random.default_rng(0)
    n, focal = 300, 250.0
    xy1 = rng.uniform(20, (326, 240), (n, 2))
    span = np.repeat([2, 10], n // 2)
    shift = rng.uniform(3, 9, n)[:, None] * (-1.0, 0.0) * span[:, None] / 2
    lost = span == 10
    shift[lost] = rng.normal(0, 30, (lost.sum(), 2))
    xy2 = xy1 + shift + rng.normal(0, 0.4, (n, 2))
    r1, r2 = (unit(np.column_stack(((p - (173, 130)) / focal, np.ones(n)))) for p in (xy1, xy2))
    t1 = np.full(n, 1.0)
    pair = 1000 * MAX_STEPS + span
    matches = KeyframeMatches(xy1, xy2, r1, r2, t1, t1 + 0.05 * span, pair)
    found = fit(matches, HeadingOptions(max_sd=5.0, enough_sd=1e-7), focal)
    assert not found.agreeing[lost].any()
    assert found.agreeing[~lost].mean() > 0.9
    assert np.degrees(angle_between(found.translation.direction, (1, 0, 0))) < 3
    assert found.t_end - found.t_start == pytest.approx(0.1)


def moved_matches(low, high, towards, noise=0.3):
    """Matches of two spans between two corners of the picture; depths from 1 to 3 m."""
    rng = np.random.default_rng(0)
    n, focal = 300, 250.0
    xy1 = rng.uniform(low, high, (n, 2))
    span = np.repeat([4, 8], n // 2)
    shift = rng.uniform(4, 12, n)[:, None] * towards(rng, n) * span[:, None] / 8
    xy2 = xy1 + shift + rng.normal(0, noise, (n, 2))
    r1, r2 = (unit(np.column_stack(((p - (173, 130)) / focal, np.ones(n)))) for p in (xy1, xy2))
    t1 = 1.0 - 0.025 * span
    return KeyframeMatches(xy1, xy2, r1, r2, t1, t1 + 0.05 * span, 1000 * MAX_STEPS + span)


def aside(rng, n):
    return np.tile((-1.0, 0.0), (n, 1))


def to_and_fro(rng, n):
    return np.column_stack((np.where(rng.random(n) < 0.3, 1.0, -1.0), np.zeros(n)))


def test_what_moves_in_one_place_only_may_be_one_thing():
    size = (346, 260)
    everywhere = moved_matches((20, 20), (326, 240), aside)
    somewhere = moved_matches((100, 80), (220, 150), aside)
    for matches in (everywhere, somewhere):
        assert np.abs(fit(matches, HeadingOptions(), 250.0).translation.direction[0]) > 0.999
    assert not isinstance(fit(everywhere, HeadingOptions(), 250.0, size), str)
    assert fit(somewhere, HeadingOptions(), 250.0, size) == "only a small part of the image moves"


def test_things_that_pass_each_other_have_no_sign():
    matches = moved_matches((20, 20), (326, 240), to_and_fro)
    reason = "matches move to and fro along the direction"
    assert fit(matches, HeadingOptions(), 250.0, (346, 260)) == reason


def test_the_stated_error_is_more_than_the_scatter_of_the_matches():
    matches = moved_matches((20, 20), (326, 240), aside)
    found = fit(matches, HeadingOptions(enough_sd=1e-6), 250.0)
    alone = two_point(matches.r1, matches.r2, threshold=1.5 / 250.0, groups=matches.groups)
    np.testing.assert_allclose(found.translation.sd, SHARED * alone.sd, rtol=1e-9)
    with_limit = HeadingOptions(max_sd=np.degrees(1.2 * alone.sd))
    assert fit(matches, with_limit, 250.0) == "direction uncertain"


@pytest.mark.parametrize("yaw", [0.3, 0.8])
def test_a_simulated_unsteady_pan_behind_a_wrong_lens_has_no_heading(yaw):
    t = np.linspace(0.0, 0.9, 91)
    position = np.tile([0.0, 0.0, 1.2], (91, 1))
    angle = 0.1 * np.sin(yaw * 2 * np.pi * t) + 0.3 * t
    turns = Rotation.from_rotvec(np.outer(angle, (0.0, 0.0, 1.0))).as_matrix()
    scene = furnished_room(position + np.linspace(-0.3, 0.3, 91)[:, None] * [1, 1, 0], 1)
    lens = Camera(160, 120, 110.0, 110.0, 79.5, 59.5, (-0.35, 0.12, 0.0, 0.0, 0.0))
    simulator = Simulator(Trajectory(t, position, turns), lens, scene, lever=(0.0, 0.0, 0.0))
    events = simulator.run().events
    for told in (lens, replace(lens, distortion=(0.0,) * 5)):
        estimate = estimate_headings(events, told)
        assert len(estimate.headings) == 0
        assert "no parallax" in " ".join(gap.reason for gap in estimate.gaps)


def test_the_sign_holds_out_and_back():
    """A camera that goes aside and comes back: the sign changes once, where it turns."""
    t = np.linspace(0.0, 1.6, 161)
    aside = 0.35 * np.minimum(t, 1.6 - t)
    position = np.column_stack((np.zeros(161), aside, np.full(161, 1.2)))
    scene = furnished_room(position, 3)
    lens = Camera(160, 120, 110.0, 110.0, 79.5, 59.5)
    simulator = Simulator(Trajectory(t, position), lens, scene, lever=(0.0, 0.0, 0.0))
    headings = estimate_headings(simulator.run().events, lens).headings
    sign = np.sign(headings.v[:, 0])
    assert len(headings) > 12
    clear = np.abs(headings.t - 0.8) > 0.2
    assert np.count_nonzero(np.diff(sign[clear])) == 1
    assert np.abs(headings.v[clear, 0]).min() > 0.99


def test_standing_still_and_noise_have_no_heading():
    rng = np.random.default_rng(0)
    n = 60_000
    noise = (rng.integers(0, 120, n), rng.integers(0, 90, n))
    t, p = np.sort(rng.integers(0, 10**6, n)), rng.random(n) < 0.5
    estimate = estimate_headings(Events.from_arrays(*noise, t, p, 120, 90), SMALL)
    assert len(estimate.headings) == 0
    assert {gap.reason for gap in estimate.gaps} <= {"too few corners", "matches disagree"}
    # A board of squares that lights up and goes out in place, one ring of each after the other.
    rows, columns = np.mgrid[:90, :120]
    ring = np.maximum(rows % 15, columns % 20)
    flashes = [(columns, rows, 25_000 * k + 500 * ring, k % 2 + 0 * ring) for k in range(40)]
    x, y, t, p = (np.concatenate([np.ravel(f[i]) for f in flashes]) for i in range(4))
    order = np.argsort(t, kind="stable")
    still = Events.from_arrays(x[order], y[order], t[order], p[order], 120, 90)
    assert len(estimate_headings(still, SMALL).headings) == 0
    estimate = estimate_headings(still, SMALL, localisation="corners")
    assert estimate.counts.keypoints > 500
    assert len(estimate.headings) == 0
    assert any("standing still" in gap.reason for gap in estimate.gaps)


def shifted(events, seconds):
    later = events.t + round(1e6 * seconds)
    return Events(events.x, events.y, later, events.p, events.width, events.height)


def test_a_long_silence_costs_nothing_and_parts_stay_apart(sideways):
    once = estimate_headings(sideways, SIMULATED)
    day = 86_400.0
    twice = estimate_headings([sideways, shifted(sideways, day)], SIMULATED)
    n = len(once.headings)
    assert twice.counts.keyframes < 50
    # The silence completes a last keyframe, which the windows that reach it use.
    early = once.headings.t < 0.4
    assert early.sum() > 3
    assert np.array_equal(twice.headings.v[:n][early], once.headings.v[early])
    assert np.all((twice.headings.t < 1.0) | (twice.headings.t > day))
    assert len(twice.headings) >= 2 * n - 3


def test_memory_does_not_grow_with_the_recording(sideways):
    part = sideways.between(100_000, 300_000)

    def peak(repeats):
        tracemalloc.start()
        estimate_headings((shifted(part, 0.2 * k) for k in range(repeats)), SIMULATED)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    peak(2)
    assert peak(16) < 1.3 * peak(8)


def test_unusable_streams_are_refused(sideways):
    with pytest.raises(InputError, match="calibrated for 120x90"):
        estimate_headings(sideways, SMALL)
    with pytest.raises(InputError, match="holds no events"):
        estimate_headings(Events.empty(346, 260), SIMULATED)
    with pytest.raises(InputError, match="holds no events"):
        estimate_headings([], SIMULATED)
    with pytest.raises(InputError, match="shorter than one baseline"):
        estimate_headings(sideways.between(0, 60_000), SIMULATED)
    with pytest.raises(InputError, match="before the"):
        estimate_headings([sideways, sideways], SIMULATED)
    with pytest.raises(InputError, match="must be Events"):
        estimate_headings([sideways.x], SIMULATED)
    with pytest.raises(InputError, match="Events or pieces"):
        estimate_headings(5, SIMULATED)


@pytest.mark.parametrize(
    "option",
    [
        {"surface": "sae"},
        {"detector": "fast"},
        {"localisation": "centroid"},
        {"solver": "eight_point"},
        {"rate": 0},
        {"rate": np.nan},
        {"rate": 5000},
        {"max_baseline": -1},
        {"max_baseline": 100},
        {"threshold": 0},
        {"min_inliers": 0},
        {"max_sd": np.inf},
        {"enough_sd": 0},
    ],
)
def test_unusable_options_are_refused(option):
    with pytest.raises(InputError, match=next(iter(option))):
        HeadingEstimator(SMALL, **option)


@pytest.mark.parametrize("function", [estimate_headings, HeadingEstimator])
def test_options_are_named_in_the_signature_and_no_others_taken(function):
    named = signature(function).parameters
    assert named["enough_sd"].default == 0.2
    given = [n for n in named if n in ("events", "camera")]
    assert list(named) == [*given, "attitude", *vars(HeadingOptions())]
    with pytest.raises(TypeError, match="unexpected keyword argument 'max_sigma'"):
        function(*[SMALL] * len(given), max_sigma=1.0)


@settings(deadline=None, max_examples=40)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 400),
    st.sampled_from([0, 1, 500, 20_000, 10**7]),
    st.sampled_from(["two_point", "five_point"]),
    st.sampled_from([(1, 1), (9, 9), (40, 12)]),
)
def test_random_events_never_crash(seed, n, longest_us, solver, size):
    width, height = size
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.integers(0, longest_us + 1, n))
    columns = rng.integers(0, width, n), rng.integers(0, height, n), t, rng.random(n) < 0.5
    events = Events.from_arrays(*columns, width, height)
    camera = Camera(width, height, 50.0, 50.0, width / 2, height / 2)
    passed = events.t[-1] // 50_000 - events.t[0] // 50_000
    if passed < 2:
        with pytest.raises(InputError, match="shorter than one baseline"):
            estimate_headings(events, camera, solver=solver)
        return
    estimate = estimate_headings(events, camera, solver=solver)
    assert estimate.counts.keyframes >= 1
    assert estimate.counts.events == n

"""What the estimation of headings keeps for a report: event rate, inlier shares, one pair."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.simulation.drives import s_curve
from data_tools.simulation.scenes import furnished_room
from data_tools.simulation.simulator import FORWARD, Simulator
from data_tools.simulation.trajectory import Trajectory
from evcalib.camera import Camera
from evcalib.events import Events
from evcalib.geometry import angle_between
from evcalib.heading import HeadingEstimator, KeyframeMatches, estimate_headings
from evcalib.heading import _snapshot as recording
from evcalib.heading._options import MAX_STEPS


def events_at(t):
    zero = np.zeros(len(t), dtype=np.uint16)
    return Events(zero, zero, np.asarray(t, dtype=np.int64), zero == 0, 4, 4)


@settings(deadline=None, max_examples=40)
@given(st.lists(st.integers(0, 3_000_000), min_size=1, max_size=60), st.integers(1, 7))
def test_the_event_rate_is_a_histogram_whatever_the_pieces(times, pieces):
    t, counter = np.sort(times), recording.RateCounter()
    for part in np.array_split(t, pieces):
        counter.update(events_at(part))
    rate = counter.result()
    count, edges = np.histogram(t, bins=np.arange(0, 3_200_001, 100_000))
    full = count > 0
    np.testing.assert_array_equal(rate.count, count[full])
    np.testing.assert_allclose(rate.t, 1e-6 * edges[:-1][full], atol=1e-12)
    assert rate.width == pytest.approx(0.1)


def test_a_clock_that_jumps_by_years_takes_no_memory():
    counter = recording.RateCounter()
    counter.update(events_at([0, 10, 10**14]))
    np.testing.assert_array_equal(counter.result().count, [2, 1])


def window(number, spans, shift, agreeing):
    """Return keyframes 0 to 9 after `number`, and matches of the first with each `span` later."""
    frame = lambda k: SimpleNamespace(  # noqa: E731
        number=k,
        t=0.05 * k,
        surface=np.full((3, 4), k % 200),
        keypoints=SimpleNamespace(xy=np.zeros((5, 2))),
    )
    n = len(spans)
    xy1, xy2 = np.zeros((n, 2)), np.column_stack((shift, np.zeros(n)))
    pair = np.array([number * MAX_STEPS + span for span in spans])
    zero = np.zeros(n)
    rays = np.zeros((n, 3))
    matches = KeyframeMatches(xy1, xy2, rays, rays, zero, zero, pair)
    fit = SimpleNamespace(
        agreeing=np.array(agreeing), translation=SimpleNamespace(direction=np.eye(3)[0])
    )
    return [frame(number + k) for k in range(10)], matches, fit


def test_the_pair_shown_is_the_one_whose_agreeing_matches_moved_farthest():
    keeper = recording.SnapshotKeeper()
    spans, shift = [2, 2, 4, 4, 6], [3.0, 3.0, 5.0, 4.0, 50.0]
    keeper.offer(*window(100, spans, shift, [True, True, True, True, False]))
    shot = keeper.result(0.0, 10.0)
    assert (shot.t1, shot.t2) == (pytest.approx(5.0), pytest.approx(5.2))
    np.testing.assert_array_equal(shot.xy2[:, 0], [5.0, 4.0])
    assert shot.inlier.all()
    assert shot.image1.dtype == np.uint8
    assert shot.image1.shape == (3, 4)


@pytest.mark.parametrize("count", [5, 300, 5000])
def test_few_pairs_are_held_and_the_one_shown_is_near_the_middle(count):
    keeper, most = recording.SnapshotKeeper(), 0
    for number in range(count):
        keeper.offer(*window(number, [3], [1.0 + number % 7], [True]))
        most = max(most, len(keeper._best))
    assert most <= recording.CANDIDATES
    length = 0.05 * count
    shot = keeper.result(0.0, length)
    middle = 0.5 * (shot.t1 + shot.t2)
    assert abs(middle - 0.5 * length) <= recording.MIDDLE * length + 0.3
    assert shot.xy2[0, 0] == 7.0 or count == 5


def test_a_recording_with_headings_at_one_end_shows_the_nearest_pair():
    keeper = recording.SnapshotKeeper()
    for number in (0, 10, 20):
        keeper.offer(*window(number, [3], [1.0], [True]))
    # Slots of half a second: the last of them holds keyframe 20 alone.
    assert keeper.result(0.0, 100.0).t1 == pytest.approx(1.0)


def test_without_headings_there_is_nothing_to_show():
    assert recording.SnapshotKeeper().result(0.0, 1.0) is None


@pytest.fixture(scope="module")
def drive():
    camera = Camera(160, 120, 130.0, 130.0, 79.5, 59.5)
    trajectory = Trajectory.of_drive(s_curve(2.5, amplitude=0.5, period=2.5, speed=0.5))
    room = furnished_room(trajectory.position, 4)
    simulator = Simulator(trajectory, camera, room, FORWARD, seed=4)
    return camera, simulator.run().events


def test_a_recording_keeps_its_notes(drive):
    camera, events = drive
    estimate = estimate_headings(events, camera)
    assert estimate.event_rate.count.sum() == len(events)
    assert estimate.inlier_share.shape == estimate.headings.t.shape
    assert (estimate.inlier_share > 0.3).all()
    assert (estimate.inlier_share <= 1.0).all()
    shot = estimate.snapshot
    assert shot.image1.shape == shot.image2.shape == (120, 160)
    assert shot.image1.dtype == np.uint8
    assert 0.4 < shot.t1 < shot.t2 < 2.1
    # Matches are measured at the centroids of patches, which lie about the corners.
    for matched, corners in ((shot.xy1, shot.corners1), (shot.xy2, shot.corners2)):
        apart = np.linalg.norm(matched[:, None] - corners, axis=2).min(axis=1)
        assert apart.max() < 12
    shot = estimate_headings(events, camera, localisation="corners").snapshot
    for matched, corners in ((shot.xy1, shot.corners1), (shot.xy2, shot.corners2)):
        assert {tuple(xy) for xy in matched} <= {tuple(xy) for xy in corners}


def test_inliers_of_the_snapshot_flow_away_from_its_direction(drive):
    """A point moves on the plane through its bearing and the heading, away from the heading."""
    camera, events = drive
    shot = estimate_headings(events, camera).snapshot
    r1, r2 = camera.bearings(shot.xy1[shot.inlier]), camera.bearings(shot.xy2[shot.inlier])
    assert len(r1) >= 10
    ahead = angle_between(r1, shot.direction), angle_between(r2, shot.direction)
    assert np.mean(ahead[1] > ahead[0]) > 0.9
    normal = np.cross(r1, shot.direction)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    off = np.degrees(np.arcsin(np.abs(np.sum(normal * r2, axis=1))))
    assert np.median(off) < 0.5


def test_surfaces_other_than_bytes_are_shown_as_bytes(drive):
    camera, events = drive
    estimate = estimate_headings(events[: len(events) // 2], camera, surface="ts")
    assert estimate.snapshot.image2.dtype == np.uint8
    assert estimate.snapshot.image2.max() == 255


def test_no_matches_are_held_once_a_window_is_done(drive):
    camera, events = drive
    estimator = HeadingEstimator(camera)
    estimator.update(events)
    kept = estimator.finish().headings
    assert len(estimator._windows._found) == len(kept)
    values = [value for one in estimator._windows._found for value in vars(one).values()]
    assert max(np.size(value) for value in values) == 9

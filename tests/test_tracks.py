"""Tracks of corners out of correspondences, and the keeper that holds these in bounded memory."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evcalib.geometry import unit
from evcalib.heading import Correspondences, KeyframeMatches
from evcalib.heading._correspondences import CorrespondenceKeeper
from evcalib.joint.tracks import Tracks, tracks_of


def correspondences(rows):
    """Rows of (corner, t1, t2); each corner has a bearing of its own."""
    corner, t1, t2 = (np.array(column, dtype=float) for column in zip(*rows, strict=True))
    r1 = unit(np.stack([0.01 * corner, 0.02 * corner, np.ones_like(corner)], axis=1))
    r2 = unit(r1 + 0.1 * np.stack([t2 - t1, 0 * t1, 0 * t1], axis=1))
    whole = np.zeros(len(rows), dtype=np.int64)
    return Correspondences(r1, r2, t1, t2, whole == 0, whole, whole)


def test_observations_of_one_corner_become_a_track():
    rows = [
        (1, 0.2, 0.5),
        (2, 0.1, 0.4),
        (1, 0.2, 0.3),
        (2, 0.1, 0.2),
        (3, 0.1, 0.2),
        (1, 0.2, 0.4),
    ]
    tracks = tracks_of(correspondences(rows))
    # Corner 3 was seen again only once.
    assert tracks.first.tolist() == [0, 2, 5]
    assert tracks.start == pytest.approx([0.1, 0.2])
    assert tracks.end == pytest.approx([0.4, 0.5])
    assert tracks.t2 == pytest.approx([0.2, 0.4, 0.3, 0.4, 0.5])


def test_one_bearing_at_two_times_is_two_corners():
    rows = [(1, 0.1, 0.2), (1, 0.1, 0.3), (1, 0.5, 0.6), (1, 0.5, 0.7)]
    assert tracks_of(correspondences(rows)).length.tolist() == [2, 2]


def test_no_correspondences_are_no_tracks():
    tracks = tracks_of(CorrespondenceKeeper().result())
    assert len(tracks) == 0
    assert tracks.start.size == tracks.end.size == 0


row = st.tuples(st.integers(0, 4), st.integers(0, 3), st.integers(1, 4))


@settings(deadline=None, max_examples=100)
@given(st.lists(row, min_size=1, max_size=40), st.integers(1, 3), st.randoms())
def test_tracks_hold_every_observation_that_is_not_alone(rows, shortest, random):
    """Against a dictionary; the order of the rows does not matter."""
    rows = [(corner, 0.1 * a, 0.1 * (a + b)) for corner, a, b in rows]
    random.shuffle(rows)
    tracks = tracks_of(correspondences(rows), shortest=shortest)
    wanted = {}
    for corner, t1, t2 in rows:
        wanted.setdefault((t1, corner), []).append(t2)
    wanted = [(key, sorted(seen)) for key, seen in sorted(wanted.items()) if len(seen) >= shortest]
    assert tracks.length.tolist() == [len(seen) for _, seen in wanted]
    assert tracks.start.tolist() == [t1 for (t1, _), _ in wanted]
    assert tracks.t2.tolist() == [t2 for _, seen in wanted for t2 in seen]
    assert tracks.end.tolist() == [seen[-1] for _, seen in wanted]
    assert (np.diff(tracks.start) >= 0).all()


def numbered(lengths):
    """Tracks of these lengths whose second times are the numbers of their tracks."""
    first = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    t1 = np.repeat(0.1 * np.arange(len(lengths)), lengths)
    t2 = np.repeat(np.arange(len(lengths), dtype=float), lengths)
    rays = np.tile([0.0, 0.0, 1.0], (t2.size, 1))
    return Tracks(first, rays, rays, t1, t2)


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(2, 9), st.booleans()), max_size=30))
def test_chosen_tracks_stay_whole(parts):
    lengths, chosen = [n for n, _ in parts], np.array([c for _, c in parts], dtype=bool)
    tracks = numbered(lengths).select(chosen)
    kept = np.flatnonzero(chosen)
    assert tracks.length.tolist() == [lengths[k] for k in kept]
    assert tracks.t2.tolist() == [float(k) for k in kept for _ in range(lengths[k])]


@settings(deadline=None)
@given(st.integers(1, 400), st.integers(2, 9), st.integers(1, 4000))
def test_thinning_keeps_whole_tracks_evenly_over_time(count, length, most):
    tracks = numbered([length] * count)
    thinned = tracks.thinned(most)
    total = count * length
    if total <= most:
        assert thinned is tracks
        return
    # A share may fall just short of a whole number by rounding.
    assert most - 2 * length < int(thinned.first[-1]) <= most
    assert (thinned.length == length).all()
    kept = thinned.t2[thinned.first[:-1]]
    # Each share of the recording keeps its share of tracks, up to one.
    through = (kept + 1) * most / total
    assert np.abs(through - np.arange(1, kept.size + 1)).max(initial=0) <= 1 + 1e-6


def matches(rng, n, times):
    """Random matches; corners recur as they do when several keyframes see them."""
    r1 = np.repeat(unit(rng.normal(0, 0.3, (n, 3)) + [0, 0, 1]), 2, axis=0)
    r2 = unit(rng.normal(0, 0.3, (2 * n, 3)) + [0, 0, 1])
    t = np.full(2 * n, float(times))
    pair = np.full(2 * n, 128 * times, dtype=np.int64)
    none = np.zeros((2 * n, 2))
    return KeyframeMatches(none, none, r1, r2, t, t + 0.1, pair)


def fed(parts, most):
    keeper = CorrespondenceKeeper(most)
    for number, part in enumerate(parts):
        keeper.add(part, np.ones(len(part), dtype=bool), number)
        assert keeper._count <= most
    return keeper.result()


def test_short_recordings_keep_everything():
    parts = [matches(np.random.default_rng(k), 50, k) for k in range(4)]
    kept = fed(parts, 1000)
    assert len(kept) == 400
    assert kept.r2.tolist() == KeyframeMatches.pooled(parts).r2.tolist()
    assert kept.heading.tolist() == np.repeat(range(4), 100).tolist()
    assert kept.pair.tolist() == np.repeat(range(4), 100).tolist()


@settings(deadline=None, max_examples=30)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(20, 500),
    st.lists(st.integers(1, 399), max_size=6, unique=True),
)
def test_what_is_kept_does_not_depend_on_how_the_stream_was_cut(seed, most, cuts):
    whole = matches(np.random.default_rng(seed), 200, 0)
    edges = [0, *sorted(cuts), 400]
    pieces = [whole[np.arange(a, b)] for a, b in pairwise(edges)]
    once, often = fed([whole], most), fed(pieces, most)
    assert len(once) <= most
    assert once.r2.tolist() == often.r2.tolist()
    # A corner stays with all its matches, or goes with all.
    _, seen = np.unique(once.r1, axis=0, return_counts=True)
    assert (seen == 2).all()


def test_corners_are_kept_as_if_by_lot():
    """Half of them, then a quarter; also of bearings on a regular grid."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 240), np.linspace(-0.4, 0.4, 180))
    r1 = unit(np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1))
    n = len(r1)
    t, none = np.zeros(n), np.zeros((n, 2))
    whole = np.zeros(n, dtype=np.int64)
    grid = KeyframeMatches(none, none, r1, r1, t, t, whole)
    for halvings in (1, 2, 3):
        share = 0.5**halvings
        keeper = CorrespondenceKeeper(most=int(1.1 * share * n))
        keeper.add(grid, np.ones(n, dtype=bool), 0)
        kept = keeper.result()
        assert len(kept) == pytest.approx(share * n, abs=5 * np.sqrt(share * n))
        middle, spread = np.mean(kept.r1[:, :2], axis=0), np.std(kept.r1[:, 0])
        assert np.abs(middle).max() < 5 * 0.3 / np.sqrt(share * n)
        assert spread == pytest.approx(np.std(r1[:, 0]), rel=0.05)

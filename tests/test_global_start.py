"""The start from nothing: its closed form against SciPy, and any motion that shows it."""

from dataclasses import replace
from types import SimpleNamespace

import naive_joint as naive
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from evcalib.errors import InputError
from evcalib.geometry import LOOKS_FORWARD, rotation_angle, rotation_vector_to_matrix
from evcalib.joint import global_start
from evcalib.joint._global_start import OFFSET_STEP, _rotation, _sphere
from evcalib.kernels.joint import global_start as kernel
from evcalib.kinematics.velocity_track import velocity_track
from evcalib.series import VelocitySeries

FOCAL, OFFSET, LEVER = 200.0, 0.13, (0.25, -0.15, 0.4)
R_BODY_CAM = rotation_vector_to_matrix([0.3, -0.4, 1.2]) @ LOOKS_FORWARD


def eights(duration=10.0, *, speed=0.5, change=0.3, turn=0.9, side=0.0):
    """Velocities of a body that turns to either side while its speed changes."""
    t = np.arange(0.0, duration, 0.02)
    forward = speed * (1 + change * np.sin(2 * np.pi * t / 3.1))
    v = np.stack([forward, side * np.sin(2 * np.pi * t / 4.3), np.zeros_like(t)], axis=1)
    return VelocitySeries(t, v, turn * np.sin(2 * np.pi * t / 5.7))


def made(velocities, *, seed=0, count=400, false=0.2, noise=0.3):
    """Return tracks with noise, some of which are of nothing."""
    rng = np.random.default_rng(seed)
    tracks = naive.made_tracks(rng, velocities, R_BODY_CAM, OFFSET, lever=LEVER, count=count)
    return naive.spoiled(rng, tracks, noise=noise / FOCAL, false=false)


def started(tracks, velocities, **options):
    track = velocity_track(velocities)
    return global_start(tracks, velocities, track, focal=FOCAL, max_offset=0.5, **options)


@pytest.fixture(scope="module")
def eight():
    velocities = eights()
    return SimpleNamespace(velocities=velocities, tracks=made(velocities))


@pytest.mark.parametrize("side", [0.0, 0.3], ids=["differential", "omni-directional"])
def test_rotation_offset_and_position_are_found_from_nothing(side):
    velocities = eights(side=side)
    found = started(made(velocities, seed=1), velocities)
    assert np.degrees(rotation_angle(found.R_body_cam, R_BODY_CAM)) < 1.0
    assert abs(found.offset - OFFSET) < 0.03
    np.testing.assert_allclose(found.position[:2], LEVER[:2], atol=0.05)
    assert found.runner_up is None or found.margin > 3.0


def test_a_body_that_does_not_turn_leaves_the_position_as_expected():
    t = np.arange(0.0, 10.0, 0.02)
    angle = 1.5 * np.sin(2 * np.pi * t / 5.7)
    v = 0.5 * np.stack([np.cos(angle), np.sin(angle), 0 * t], axis=1)
    for yaw_rate in (None, 0 * t):
        velocities = VelocitySeries(t, v, yaw_rate)
        found = started(made(velocities, seed=2), velocities, lever=(0.1, 0.2, 0.7))
        assert np.degrees(rotation_angle(found.R_body_cam, R_BODY_CAM)) < 1.5
        np.testing.assert_allclose(found.position, (0.1, 0.2, 0.7), atol=1e-6)


def test_a_straight_line_leaves_others_as_good():
    t = np.arange(0.0, 10.0, 0.02)
    v = np.tile([0.5, 0.0, 0.0], (t.size, 1))
    velocities = VelocitySeries(t, v, 0 * t)
    found = started(made(velocities, seed=3), velocities)
    assert found.runner_up is not None
    assert found.margin < 3.0


def test_the_same_seed_gives_the_same_start(eight):
    one, two = (started(eight.tracks, eight.velocities, seed=5) for _ in range(2))
    np.testing.assert_array_equal(one.R_body_cam, two.R_body_cam)
    assert (one.offset, one.loss) == (two.offset, two.loss)


def test_too_few_sightings_or_none_under_the_odometry_give_no_start(eight):
    few = eight.tracks.select(np.arange(len(eight.tracks)) < 3)
    assert started(few, eight.velocities) is None
    late = replace(eight.tracks, t1=eight.tracks.t1 + 100, t2=eight.tracks.t2 + 100)
    assert started(late, eight.velocities) is None


def test_wrong_input_is_refused(eight):
    with pytest.raises(InputError, match="tracks"):
        started("tracks", eight.velocities)


def exact_moves(velocities, tracks, offset=OFFSET):
    """Return pairs and moves by the slow twin's integrals."""
    motion = naive.Motion(velocities)
    paths, turns = [], []
    for a, b in zip(tracks.t1 + offset, tracks.t2 + offset, strict=True):
        (p1, R1), (p2, R2) = motion.pose(a), motion.pose(b)
        paths.append((R1.T @ (p2 - p1))[:2])
        turns.append(Rotation.from_matrix(R1.T @ R2).as_rotvec()[2])
    pairs = kernel.Pairs(np.ascontiguousarray(tracks.r1), np.ascontiguousarray(tracks.r2))
    return pairs, np.array(paths), np.array(turns)


@pytest.fixture(scope="module")
def exact(eight):
    tracks = made(eight.velocities, seed=7, count=60, false=0.0, noise=0.0)
    return exact_moves(eight.velocities, tracks)


def test_exact_sightings_lie_in_their_planes(exact):
    pairs, path, turn = exact
    out = np.empty((turn.size, 2))
    kernel.residuals(pairs, path, turn, R_BODY_CAM, np.array(LEVER[:2]), out)
    assert np.abs(out).max() < 1e-6
    # The other way round in time all points flow the wrong way.
    kernel.residuals(pairs, -path, turn, R_BODY_CAM, -np.array(LEVER[:2]), out)
    assert (out[:, 1] > 0).mean() > 0.5


def test_residuals_are_those_of_the_essential_matrix(exact):
    """Distance of a bearing from its epipolar plane, by matrices alone."""
    pairs, path, turn = exact
    R = rotation_vector_to_matrix([0.05, 0.02, -0.04]) @ R_BODY_CAM
    position = np.array([0.1, 0.3])
    out = np.empty((turn.size, 2))
    kernel.residuals(pairs, path, turn, R, position, out)
    for i in range(turn.size):
        between = Rotation.from_rotvec([0, 0, turn[i]]).as_matrix()
        lever = np.append(position, 0.0)
        t = R.T @ (np.append(path[i], 0.0) + between @ lever - lever)
        normal = np.cross(t, pairs.r1[i])
        seen = R.T @ between @ R @ pairs.r2[i]
        # The kernel's normal is r1 x r2, whose product with t is that of t x r1 with r2.
        assert out[i, 0] == pytest.approx(normal @ seen / np.linalg.norm(normal), abs=1e-12)


def test_the_closed_form_is_the_least_of_all_turns_and_positions(exact):
    """At the true axis it is the truth; at another one what SciPy finds, both from all around."""
    pairs, path, turn = exact
    options = kernel.Options(3.0 / FOCAL, (0.0, 0.0), 10.0, 1.0 / FOCAL)
    other = Rotation.from_rotvec([0.004, -0.006, 0.0]).as_matrix()
    axes = np.stack([R_BODY_CAM[2], other @ R_BODY_CAM[2]])
    moves = kernel.Moves(path[None], turn[None], np.ones((1, turn.size), dtype=np.bool_))
    losses, found = np.empty((1, 2)), np.empty((1, 2, 4))
    kernel.scan(pairs, moves, axes, options, losses, found)
    R = _rotation(axes[0], *found[0, 0, :2])
    assert rotation_angle(R, R_BODY_CAM) < 1e-3
    np.testing.assert_allclose(found[0, 0, 2:], LEVER[:2], atol=2e-3)
    assert losses[0, 0] < 1e-6 < losses[0, 1]

    def off(x):
        out = np.empty((turn.size, 2))
        kernel.residuals(pairs, path, turn, _rotation(axes[1], *x[:2]), x[2:], out)
        return out[:, 0]

    angles = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    starts = [np.array([np.cos(a), np.sin(a), 0.0, 0.0]) for a in angles]
    best = min(
        (least_squares(off, x, loss="cauchy", f_scale=3.0 / FOCAL) for x in starts),
        key=lambda one: one.cost,
    )
    sign = np.sign(best.x[:2] @ found[0, 1, :2])
    length = np.hypot(*best.x[:2])
    np.testing.assert_allclose(found[0, 1, :2], sign * best.x[:2] / length, atol=0.02)
    np.testing.assert_allclose(found[0, 1, 2:], best.x[2:], atol=0.02)


def test_axes_cover_the_sphere():
    axes = _sphere(400)
    np.testing.assert_allclose(np.linalg.norm(axes, axis=1), 1.0, atol=1e-12)
    directions = Rotation.random(500, np.random.default_rng(0)).apply([0, 0, 1])
    nearest = np.degrees(np.arccos((directions @ axes.T).max(axis=1)))
    assert nearest.max() < 8.0
    assert OFFSET_STEP <= 0.1

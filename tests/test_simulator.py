"""The simulated camera in its scene against closed forms, twins and invariants."""

import naive_raycast
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.simulation import _simulator_kernels as kernels
from data_tools.simulation import _simulator_tiles, drives
from data_tools.simulation.scenes import Scene, dead_leaves, furnished_room
from data_tools.simulation.sensor import Sensor, empty_buffer
from data_tools.simulation.simulator import FORWARD, Simulator, simulate_translation
from data_tools.simulation.trajectory import Trajectory
from evcalib.camera import Camera
from evcalib.errors import InputError

IDEAL = Sensor(mismatch=0.0, refractory=0.0, noise_rate=0.0)
CAMERA = Camera(48, 36, 40.0, 40.0, 23.5, 17.5)
ROOM = np.array([[-4.0, -9.0, -9.0], [4.0, 9.0, 9.0]])


def moving(direction, speed=0.5, duration=1.0, start=(0.0, 0.0, 0.0)):
    t = np.array([0.0, duration])
    return Trajectory(t, np.array(start) + np.outer(t, speed * np.asarray(direction)))


def step_wall():
    """A room whose walls are dark at y < 0 and bright at y > 0 (period 10.24 m)."""
    texture = np.full((1, 1024, 1024), 0.2)
    texture[..., 512:] = 0.8
    faces = np.tile([0.0, 5.12, 0.0, 1.0], (6, 1))
    return Scene(ROOM, texture, 0.01, faces=faces)


@pytest.fixture(scope="module")
def room():
    return furnished_room(np.array([[0.0, 0.0, 1.0]]), seed=3, density=0.8)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_edge_reports_when_it_passes_each_pixel(sign):
    # The edge at y = 0 on the wall 4 m ahead passes column c when the camera is at
    # y = 4 (c - cx) / fx: it moves over the image at 5 px/s.  A square pixel then sees
    # 0.5 + 0.6 s, s = distance moved on [px], and event k leaves at (dark + D) exp(0.2 k) - D.
    path = moving([0.0, sign, 0.0], duration=2.0)
    events = Simulator(path, CAMERA, step_wall(), lever=(0, 0, 0), sensor=IDEAL).run().events
    assert (events.p == (sign > 0)).all()
    dark, bright = 0.2 + kernels.DARK, 0.8 + kernels.DARK
    rising = dark * np.exp(0.2 * np.arange(1, 7)) - kernels.DARK
    falling = bright * np.exp(-0.2 * np.arange(1, 7)) - kernels.DARK
    expected = (rising - 0.5) / 0.6 if sign > 0 else (0.5 - falling) / 0.6
    columns = 23.5 + sign * np.arange(1.5, 9.0)
    for column in columns:
        own = events[events.x == column]
        when = sign * 4.0 * (column - CAMERA.cx) / CAMERA.fx / 0.5
        moved = 5.0 * (1e-6 * own.t.reshape(6, CAMERA.height) - when)
        np.testing.assert_allclose(moved, np.tile(expected[:, None], CAMERA.height), atol=0.08)


def test_finer_rendering_moves_events_by_a_hundredth_of_a_pixel_only():
    path, scene = moving([0.0, 1.0, 0.0], duration=0.6), step_wall()
    coarse, fine = (
        Simulator(path, CAMERA, scene, lever=(0, 0, 0), sensor=IDEAL, fraction=f).run().events
        for f in (0.5, 0.05)
    )
    assert len(coarse) == len(fine) > 300
    order = [np.lexsort((events.t, events.y, events.x)) for events in (coarse, fine)]
    shift = 5e-6 * (coarse.t[order[0]] - fine.t[order[1]])
    assert np.abs(shift).max() < 0.02
    assert abs(shift.mean()) < 0.005


def test_events_follow_the_flow_of_the_pose():
    # A wall 3 m ahead, seen in sideways motion, flows at fx v / Z: undone, events line up best.
    textures = dead_leaves(5, side=512)[None]
    room = Scene(np.array([[-3.0, -9.0, -9.0], [3.0, 9.0, 9.0]]), textures, 0.02)
    camera = Camera(96, 72, 90.0, 90.0, 47.5, 35.5)
    path = moving([0.0, -1.0, 0.0], speed=0.6, duration=0.5)
    events = Simulator(path, camera, room, lever=(0, 0, 0)).run().events
    flow = -90.0 * 0.6 / 3.0
    speeds = flow * np.linspace(0.7, 1.3, 25)

    def sharpness(speed):
        x = np.rint(events.x - speed * 1e-6 * events.t).astype(int)
        image = np.zeros((72, 200))
        np.add.at(image, (events.y, x - x.min()), np.where(events.p, 1.0, -1.0))
        return (image**2).sum()

    best = speeds[np.argmax([sharpness(v) for v in speeds])]
    assert best == pytest.approx(flow, rel=0.03)


def test_depth_equals_the_plain_twin(room):
    rotation = FORWARD @ np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])
    path = Trajectory([0.0, 1.0], np.array([[0.0, 0.0, 0.9], [0.0, 0.1, 0.9]]), [0.3, 0.5])
    simulator = Simulator(path, CAMERA, room, R_body_cam=rotation, lever=(0.0, 0.05, 0.0))
    depth = simulator.depth(0.25)
    truth = simulator.truth([0.25])
    pixels = np.argwhere(np.ones((36, 48)))[:, ::-1]
    rays = CAMERA.bearings(pixels) @ truth.R_world_cam[0].T

    def twin(boxes):
        hits = [naive_raycast.first_hit(truth.position[0], r, room.room, boxes) for r in rays]
        return np.array(hits).reshape(depth.shape)

    np.testing.assert_allclose(depth, twin(room.boxes), rtol=1e-9)
    hidden = twin(room.boxes[:0]) > depth + 1e-6
    assert 0.1 < hidden.mean() < 0.9, "boxes must be seen, and walls too"


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 10_000), st.floats(-1.0, 1.0))
def test_no_image_point_moves_further_than_the_fraction(room, seed, yaw_rate):
    rng = np.random.default_rng(seed)
    ends = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    ends[1] += 0.02 * rng.normal(size=3)
    path = Trajectory([0.0, 0.02], ends, [0.0, 0.02 * yaw_rate])
    simulator = Simulator(path, CAMERA, room, lever=(0, 0, 0))
    view, arrays = simulator._view, simulator._arrays
    near = np.empty((len(room.boxes), 5))
    poses = simulator._poses(np.array([0.0, 20_000.0]))
    moved = image_motion(simulator, 0.0, 0.02)
    for tile, (left, right, top, bottom) in enumerate(view.bounds):
        steps, _ = kernels.plan(tile, 0.0, 20_000.0, 0.05, view, poses, arrays, near)
        # 2 %: the motion over the block is straight, its rate is not quite constant
        assert moved[top:bottom, left:right].max() / steps < 0.05 * 1.02


def image_motion(simulator, t0, t1):
    """Return how far [px] each image point moves, by projecting what it shows at t0 and t1."""
    before, after = simulator.truth([t0]), simulator.truth([t1])
    pixels = np.argwhere(np.ones((36, 48)))[:, ::-1].astype(float)
    points = CAMERA.bearings(pixels) * simulator.depth(t0).reshape(-1, 1)
    world = points @ before.R_world_cam[0].T + before.position[0]
    seen = (world - after.position[0]) @ after.R_world_cam[0]
    projected = seen[:, :2] / seen[:, 2:] * CAMERA.fx + [CAMERA.cx, CAMERA.cy]
    return np.linalg.norm(projected - pixels, axis=1).reshape(36, 48)


def test_far_texture_is_averaged_not_aliased():
    checker = np.indices((256, 256)).sum(axis=0) % 2 * 0.6 + 0.2
    scene = Scene(ROOM, checker[None], 0.005)
    path = moving([0.0, 1.0, 0.0], duration=0.1)
    simulator = Simulator(path, CAMERA, scene, lever=(0, 0, 0), sensor=IDEAL)
    np.testing.assert_allclose(simulator.frame(0.0), 0.5, atol=1e-6)
    assert len(simulator.run().events) == 0


def test_light_changes_smoothly_within_a_pixel(room):
    # 0.02 px steps over 1 px: no step carries more than a tenth of what the texture can do
    t = np.linspace(0.0, 1.0, 51)
    camera = Camera(40, 30, 300.0, 300.0, 19.5, 14.5)
    path = moving([0.0, 1.0, 0.0], speed=0.01, start=(0.0, 0.0, 1.0))
    simulator = Simulator(path, camera, room, lever=(0, 0, 0))
    frames = np.stack([simulator.frame(s) for s in t])
    assert np.ptp(frames, axis=0).max() > 0.2
    assert np.abs(np.diff(frames, axis=0)).max() < 0.25


def test_a_still_camera_sees_noise_only(room):
    still = Trajectory([0.0, 0.5], np.tile([0.0, 0.0, 1.0], (2, 1)))
    assert len(Simulator(still, CAMERA, room, lever=(0, 0, 0), sensor=IDEAL).run().events) == 0
    noisy = Sensor(noise_rate=20.0)
    events = Simulator(still, CAMERA, room, lever=(0, 0, 0), sensor=noisy).run().events
    expected = 20.0 * 0.5 * 48 * 36
    assert abs(len(events) - expected) < 4 * np.sqrt(expected)


def same(a, b):
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in "xytp")


def test_threads_and_pieces_do_not_change_a_byte(room):
    path = moving([0.5, 0.5, 0.0], duration=0.47, start=(0.0, 0.0, 1.0))
    sensor = Sensor(mismatch=0.1, noise_rate=5.0)
    simulator = Simulator(path, CAMERA, room, lever=(0, 0, 0), sensor=sensor, seed=4)
    runs = [simulator.run(threads=n).events for n in (1, 2, 5)]
    assert len(runs[0]) > 1000
    assert same(runs[0], runs[1])
    assert same(runs[0], runs[2])
    pieces = list(simulator.stream())
    assert [int(piece.t[-1]) // 200_000 for piece in pieces] == [0, 1, 2]
    order = np.lexsort((runs[0].x, runs[0].y, runs[0].t))
    np.testing.assert_array_equal(order, np.arange(len(order)))


def test_the_seed_decides(room):
    path = moving([1.0, 0.0, 0.0], duration=0.1, start=(0.0, 0.0, 1.0))
    runs = [
        Simulator(path, CAMERA, room, lever=(0, 0, 0), sensor=Sensor(mismatch=0.1), seed=s).run()
        for s in (1, 1, 2)
    ]
    assert same(runs[0].events, runs[1].events)
    assert not same(runs[0].events, runs[2].events)


def test_a_full_buffer_changes_nothing(room, monkeypatch):
    path = moving([0.0, 1.0, 0.0], duration=0.3, start=(0.0, 0.0, 1.0))
    simulator = Simulator(path, CAMERA, room, lever=(0, 0, 0))
    events = simulator.run().events
    asked = []

    def tiny_at_first(capacity):
        asked.append(capacity)
        return empty_buffer(3 if capacity == asked[0] else capacity)

    monkeypatch.setattr(_simulator_tiles, "empty_buffer", tiny_at_first)
    assert same(simulator.run(threads=1).events, events)
    assert min(asked) < asked[0], "buffers of just the right size must have been asked for"


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, -1, 0), (0, 0, 1), (1, 0, 1), (-1, 0, 1)])
def test_translation_has_the_heading_asked_for(direction):
    result = simulate_translation(direction, 0.5, 0.1, CAMERA, seed=1)
    headings = result.truth.headings()
    np.testing.assert_allclose(headings.v, np.tile(headings.v[0], (len(headings), 1)), atol=1e-9)
    np.testing.assert_allclose(headings.v[0], np.array(direction) / np.linalg.norm(direction))
    moved = result.truth.R_world_cam[0].T @ np.ptp(result.truth.position, axis=0)
    assert np.linalg.norm(moved) == pytest.approx(0.05, rel=1e-6)
    assert len(result.events) > 100
    assert result.events.shape == (36, 48)


def test_the_lever_turns_yaw_into_motion():
    t = np.linspace(0.0, 2.0, 401)
    position = np.stack([0.3 * np.sin(t), 0.2 * t, 0 * t], axis=1)
    path = Trajectory(t, position, 0.4 * t)
    scene = furnished_room(position + [0, 0, 0.8], seed=0, clearance=1.0)
    simulator = Simulator(path, CAMERA, scene, lever=(0.4, -0.2, 0.8))
    at = np.linspace(0.1, 1.9, 37)
    truth, step = simulator.truth(at), 1e-4
    difference = (simulator.truth(at + step).position - simulator.truth(at - step).position) / 2e-4
    world = np.einsum("nij,nj->ni", truth.R_world_cam, truth.v_cam)
    np.testing.assert_allclose(world, difference, atol=1e-4)
    np.testing.assert_allclose(truth.rate_body, np.tile([0.0, 0.0, 0.4], (37, 1)), atol=1e-9)
    assert np.abs(truth.v_cam @ FORWARD.T - truth.v_body).max() > 0.1


def test_a_drive_arrives_on_the_camera_clock():
    drive = drives.arc(4.0, radius=1.0, speed=0.5)
    path = Trajectory.of_drive(drive, offset=0.5)
    assert path.t[0] == pytest.approx(0.0, abs=2e-3)
    at = np.array([0.5, 1.5, 3.0])
    np.testing.assert_allclose(path.velocity_at(at), drive.velocity(at + 0.5), atol=1e-4)
    # direction turns, the body does not: a circle about (0, radius), starting at the origin
    radius = np.linalg.norm(path.position_at(at) - [0.0, 1.0, 0.0], axis=1)
    np.testing.assert_allclose(radius, 1.0, atol=1e-5)
    np.testing.assert_allclose(path.rotation_at(at), np.tile(np.eye(3), (3, 1, 1)), atol=1e-12)


def test_a_furnished_room_leaves_the_path_free():
    t = np.linspace(0, 2 * np.pi, 200)
    path = np.stack([2 * np.cos(t), 1.5 * np.sin(t), np.full_like(t, 0.8)], axis=1)
    for seed in range(3):
        scene = furnished_room(path, seed, clearance=0.5)
        assert scene.clearance(path).min() >= 0.5
        assert len(scene.boxes) >= 5


def test_textures_wrap_around_and_keep_their_range():
    texture = dead_leaves(0, side=256)
    assert 0.08 <= texture.min() < 0.15
    assert 0.7 < texture.max() <= 0.92
    assert not np.array_equal(texture, dead_leaves(1, side=256))
    np.testing.assert_array_equal(texture, dead_leaves(0, side=256))
    # the step across the border is like any other step
    border = np.abs(texture[:, 0] - texture[:, -1]).mean()
    assert border < 2 * np.abs(np.diff(texture, axis=1)).mean()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lever": (9.0, 0.0, 0.0)}, "clear of walls and boxes"),
        ({"R_body_cam": np.diag([1.0, 1.0, -1.0])}, "not a rotation"),
        ({"fraction": 0.0}, "fraction must be a positive"),
        ({"trajectory": Trajectory([-1.0, 1.0], np.zeros((2, 3)))}, "starts at time 0"),
    ],
)
def test_unusable_simulators(change, message):
    given_ = {"trajectory": moving([0.0, 1.0, 0.0]), "lever": (0.0, 0.0, 0.0), **change}
    with pytest.raises(InputError, match=message):
        Simulator(camera=CAMERA, scene=step_wall(), **given_)


def test_a_camera_that_sees_nothing_in_a_pixel_is_refused():
    folded = Camera(48, 36, 10.0, 10.0, 23.5, 17.5, (-0.3, 0.0, 0.0, 0.0))
    simulator = Simulator(moving([0.0, 1.0, 0.0]), folded, step_wall(), lever=(0, 0, 0))
    with pytest.raises(InputError, match="no direction maps to pixel"):
        simulator.run()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"room": ROOM[::-1]}, "lower corner"),
        ({"textures": np.ones((1, 24, 24))}, "power of two"),
        ({"textures": np.zeros((1, 32, 32))}, "positive"),
        ({"boxes": np.zeros((1, 7))}, "half sizes"),
        ({"faces": np.tile([3.0, 0, 0, 1], (6, 1))}, "index of a texture"),
    ],
)
def test_unusable_scenes(change, message):
    usable = {"room": ROOM, "textures": np.ones((1, 32, 32)), "texel": 0.01}
    with pytest.raises(InputError, match=message):
        Scene(**{**usable, **change})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.0], np.zeros((1, 3))), "at least two samples"),
        (([0.0, 1.0], np.zeros((2, 3)), np.ones((2, 3, 3))), "not a rotation"),
        (([0.0, 0.0], np.zeros((2, 3))), "must increase"),
    ],
)
def test_unusable_trajectories(arguments, message):
    with pytest.raises(InputError, match=message):
        Trajectory(*arguments)


def test_times_outside_a_trajectory_are_refused():
    with pytest.raises(InputError, match=r"1\.5.* outside the trajectory"):
        moving([1.0, 0.0, 0.0]).position_at([0.5, 1.5])

"""Visual odometry: kernels against slow twins, maps and poses against closed forms and truth."""

import naive_odometry as naive
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_tools.logs.camera_files import read_camera
from data_tools.logs.trajectory_files import read_tum
from data_tools.recordings import open_recording
from data_tools.simulation.recorded_drive import CAMERA
from data_tools.simulation.scenes import furnished_room
from data_tools.simulation.simulator import Simulator
from data_tools.simulation.trajectory import Trajectory
from evcalib import Camera, Events, InputError
from evcalib.errors import NoAnswerError
from evcalib.geometry import angle_between, rotation_angle, unit
from evcalib.heading import Correspondences
from evcalib.kernels.odometry import space_sweep as sweeping
from evcalib.kernels.odometry import tracking as aligning
from evcalib.kernels.odometry.space_sweep import Planes, View
from evcalib.odometry import VisualOdometry, estimate_trajectory
from evcalib.odometry._bootstrap import _steady_part
from evcalib.odometry._odometry import doubts_of, is_flat
from evcalib.odometry.mapping import DepthMap, space_sweep
from evcalib.odometry.tracking import Pose, ProjectedMap
from evcalib.poses import PoseSeries

VIEW = View(24, 18, 20.0, 21.0, 11.5, 8.5)
AXIS = np.array([1.0, 0.0079, 0.0166])
"""Direction of slider_depth in the camera, by four exact transforms of the recording."""


def random_rays(n, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.6, 0.6, (n, 2)).astype(np.float32)


def test_the_volume_is_that_of_rays_met_with_planes_one_by_one():
    rng = np.random.default_rng(1)
    rays, ends = random_rays(40), np.array([15, 15, 40])
    R = Rotation.from_rotvec(rng.normal(0, 0.1, (3, 3))).as_matrix()
    R[2] = Rotation.from_rotvec([0.0, 2.0, 0.0]).as_matrix() @ R[2]
    C = rng.normal(0, 0.3, (3, 3)) + [[0, 0, 0.9], [0, 0, 0], [0, 0, 0]]
    R[2], C[2] = (R[0], C[0] + 0.1) if rng.random() > 2 else (R[2], C[2])
    planes = Planes(0.2, 0.1, 12)
    lines = np.empty((40, 5), dtype=np.float32)
    volume = np.zeros((12, VIEW.height, VIEW.width), dtype=np.float32)
    sweeping.trace(rays, ends, R, C, VIEW, planes, lines)
    sweeping.vote(lines, volume)
    poses = [(R[k], C[k]) for k in np.repeat([0, 2], [15, 25])]
    expected = naive.volume(rays, poses, VIEW, 1 / (0.2 + 0.1 * np.arange(12)))
    assert expected.sum() > 50
    np.testing.assert_allclose(volume, expected, atol=1e-4)


def test_rays_of_one_point_meet_at_its_depth():
    point = np.array([0.1, -0.05, 2.0])
    C = np.linspace([-0.3, 0, 0], [0.3, 0.1, 0.2], 50)
    rays = ((point - C)[:, :2] / (point - C)[:, 2:]).astype(np.float32)
    lines = np.empty((50, 5), dtype=np.float32)
    planes, volume = Planes(0.0, 0.05, 21), np.zeros((21, 18, 24), dtype=np.float32)
    sweeping.trace(rays, np.arange(1, 51), np.tile(np.eye(3), (50, 1, 1)), C, VIEW, planes, lines)
    sweeping.vote(lines, volume)
    k, row, col = np.unravel_index(volume.argmax(), volume.shape)
    assert k == 10  # 1 / 2.0 = 10 * 0.05
    assert (col, row) == (round(20 * 0.05 + 11.5), round(-21 * 0.025 + 8.5))


def test_medians_are_those_of_marked_neighbours():
    rng = np.random.default_rng(2)
    values, marked = rng.normal(size=(12, 9)), rng.random((12, 9)) < 0.4
    out = np.zeros((12, 9))
    sweeping.median_of_marked(values, marked, 2, out)
    np.testing.assert_array_equal(out, naive.median_of_marked(values, marked, 2))


def test_events_and_points_are_drawn_with_fractions_of_pixels():
    rays = random_rays(60, 3)
    image, expected = np.zeros((18, 24), dtype=np.float32), np.zeros((18, 24))
    aligning.draw(rays, VIEW, image)
    for x, y in rays:
        naive.add(expected, VIEW.fx * x + VIEW.cx, VIEW.fy * y + VIEW.cy, 1.0)
    np.testing.assert_allclose(image, expected, atol=1e-5)
    depth = np.random.default_rng(4).uniform(-1, 3, 60)
    points = np.column_stack([rays * depth[:, None], depth])
    image[:], inverse = 0, np.zeros((18, 24), dtype=np.float32)
    seen = aligning.project(points, np.eye(3), np.zeros(3), VIEW, image, inverse)
    expected[:], rho = 0, np.zeros((18, 24))
    for (x, y), z in zip(rays[depth > 0], depth[depth > 0], strict=True):
        naive.add(expected, VIEW.fx * x + VIEW.cx, VIEW.fy * y + VIEW.cy, 1.0)
        naive.add(rho, VIEW.fx * x + VIEW.cx, VIEW.fy * y + VIEW.cy, 1 / z)
    np.testing.assert_allclose(image, expected, atol=1e-5)
    np.testing.assert_allclose(inverse, rho, rtol=1e-5, atol=1e-5)
    assert seen == pytest.approx(expected.sum(), abs=1e-6)


def cloud(n=1500, seed=5):
    rng = np.random.default_rng(seed)
    depth = rng.uniform(1.0, 4.0, n)
    return np.column_stack([rng.uniform(-0.6, 0.6, (n, 2)) * depth[:, None], depth])


LARGE = View(120, 90, 90.0, 90.0, 59.5, 44.5)


def test_alignment_takes_the_steps_of_its_twin():
    here = Pose(np.eye(3), np.zeros(3))
    there = Pose(
        Rotation.from_rotvec([0.004, -0.006, 0.01]).as_matrix(), np.array([0.01, 0.0, 0.02])
    )
    projected = ProjectedMap(cloud(), here, LARGE)
    image = ProjectedMap(cloud(), there, LARGE).image
    R, t = np.eye(3), np.zeros(3)
    aligning.align(projected.template, image, LARGE, aligning.Limits(4, 0.0), R, t)
    expected = naive.align(projected.template, image, LARGE, 4, np.eye(3), np.zeros(3))
    np.testing.assert_allclose(R, expected[0], atol=1e-9)
    np.testing.assert_allclose(t, expected[1], atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_a_pose_is_found_whatever_the_contrast(seed):
    rng = np.random.default_rng(seed)
    # About a pixel away, as from one event image to the next.
    turn, place = rng.normal(0, 0.002, 3), rng.normal(0, 0.005, 3)
    true = Pose(Rotation.from_rotvec(turn).as_matrix(), place)
    points = cloud(seed=seed)
    image = 3.0 * ProjectedMap(points, true, LARGE).image + 0.5
    found = ProjectedMap(points, Pose(np.eye(3), np.zeros(3)), LARGE).locate(
        image.astype(np.float32), Pose(np.eye(3), np.zeros(3))
    )
    assert rotation_angle(found.pose.R, true.R) < 1e-3
    assert np.linalg.norm(found.pose.position - true.position) < 2e-3
    assert found.correlation > 0.95


def flow(turn, v, n=400, seed=6):
    """Matches of points at many depths, half a second apart, within two seconds."""
    rng = np.random.default_rng(seed)
    t1 = rng.uniform(0, 1.4, n)
    t2 = t1 + rng.uniform(0.2, 0.5, n)
    depth = rng.uniform(1.5, 5.0, n)
    X = np.column_stack([rng.uniform(-0.4, 0.4, (n, 2)) * depth[:, None], depth])

    def seen(t):
        R = Rotation.from_rotvec(np.outer(t, turn))
        return unit(R.inv().apply(X - np.outer(t, v)) + rng.normal(0, 1e-3, (n, 3)))

    whole = np.zeros(n, dtype=np.int64)
    return Correspondences(seen(t1), seen(t2), t1, t2, whole == 0, whole, whole)


def test_a_start_has_the_direction_of_the_motion():
    v = np.array([0.5, 0.1, -0.2])
    found = _steady_part(flow(np.zeros(3), v), 0.0, 2.0, CAMERA)
    assert np.degrees(angle_between(found.direction, v)) < 1.0


@pytest.mark.parametrize("v", [np.zeros(3), np.array([0.3, 0.0, 0.0])])
def test_a_turn_is_no_start(v):
    assert "turn" in _steady_part(flow(np.array([0.1, 0.3, 0.3]), v), 0.0, 2.0, CAMERA)


@pytest.mark.slow
def test_a_simulated_turn_to_the_side_is_no_trajectory():
    rng = np.random.default_rng(1)
    phase, pace = rng.uniform(0, 6.28, 6), rng.uniform(0.15, 0.35, 6)
    t = np.linspace(0.0, 2.4, 481)
    swing = np.sin(2 * np.pi * pace * t[:, None] + phase)
    position = [0.4, 0.4, 0.12] * swing[:, :3] + [0, 0, 1.2]
    turn = Rotation.from_rotvec(np.radians(8) * swing[:, 3:]).as_matrix()
    scene = furnished_room(position, 1)
    run = Simulator(
        Trajectory(t, position, turn), CAMERA, scene, lever=(0.0, 0.0, 0.0), seed=1
    ).run()
    with pytest.raises(NoAnswerError, match="no map could be made"):
        estimate_trajectory(run.events, CAMERA)


@pytest.mark.parametrize(
    ("correlation", "maps", "told"),
    [
        ([0.6] * 20, 3, ()),
        ([0.6] * 20 + [np.nan] + [0.35] * 9, 3, ("hardly fit",)),
        ([0.6] * 20, 2, ("beyond the start",)),
    ],
)
def test_weak_ends_and_unproven_starts_are_doubted(correlation, maps, told):
    doubts = doubts_of(correlation, maps)
    assert len(doubts) == len(told)
    assert all(word in doubt for word, doubt in zip(told, doubts, strict=True))


def test_standing_still_is_no_start():
    assert "moves too little" in _steady_part(flow(np.zeros(3), np.zeros(3)), 0.0, 2.0, CAMERA)


def test_one_plane_is_told_from_a_room():
    rows, columns = np.mgrid[:18, :24]
    inverse = 0.3 + 0.01 * columns - 0.004 * rows
    mask = (rows + columns) % 3 == 0
    for values, flat in ((inverse, True), (inverse + 0.1 * (columns % 5), False)):
        depth = DepthMap(
            np.eye(3), np.zeros(3), VIEW, mask.astype(np.float32), mask, np.where(mask, values, 0)
        )
        assert is_flat(depth) is flat


def test_bad_streams_are_told_apart():
    camera = Camera(24, 18, 20.0, 20.0, 12.0, 9.0)
    with pytest.raises(InputError, match="holds no events"):
        estimate_trajectory(Events.empty(24, 18), camera)
    short = Events(x=[3, 4], y=[3, 4], t=[0, 1000], p=[1, 0], width=24, height=18)
    with pytest.raises(NoAnswerError, match=r"no map could be made.*shorter than one baseline"):
        estimate_trajectory(short, camera)
    t = np.arange(0, 3_000_000, 20_000)
    dark = Events.from_arrays(t % 24, t % 18, t, t % 2, 24, 18)
    with pytest.raises(NoAnswerError, match="too few corners were matched"):
        estimate_trajectory(dark, camera)
    with pytest.raises(InputError, match="calibrated for 24x18"):
        VisualOdometry(camera).update(Events.empty(8, 8)[:0])
    with pytest.raises(InputError, match="are needed, not int"):
        estimate_trajectory(3, camera)


def similarity(a, b):
    """Return a, turned, shifted and scaled on b (Umeyama, PAMI 13, 1991)."""
    ca, cb = a - a.mean(axis=0), b - b.mean(axis=0)
    U, S, Vt = np.linalg.svd(cb.T @ ca)
    D = np.diag([1.0, 1.0, np.linalg.det(U @ Vt)])
    scale = np.trace(D @ np.diag(S)) / (ca**2).sum()
    return scale * ca @ (U @ D @ Vt).T + b.mean(axis=0)


@pytest.fixture(scope="module")
def bent_drive():
    """A camera that goes straight ahead to the side, then bends away and turns by ten degrees."""
    t = np.linspace(0.0, 4.0, 801)
    bend = np.clip(t - 1.5, 0, None)
    position = np.column_stack([0.05 * bend**2, -0.4 * t, 1.2 + 0.02 * bend**2])
    turn = Rotation.from_rotvec(np.outer(np.radians(1.6) * bend**2, [0.0, 0.3, 0.95]))
    path = Trajectory(t, position, turn.as_matrix())
    scene = furnished_room(position, 3)
    return Simulator(path, CAMERA, scene, lever=(0.0, 0.0, 0.0), seed=3).run()


@pytest.mark.slow
def test_a_simulated_drive_is_followed(bent_drive):
    events, truth = bent_drive.events, bent_drive.truth
    pieces = [events.between(k, k + 170_000) for k in range(0, 4_200_000, 170_000)]
    found = estimate_trajectory(pieces, CAMERA)
    poses = found.poses
    assert not found.lost
    assert poses.t[-1] > 3.75  # The last event image is not full.
    true = np.stack([np.interp(poses.t, truth.t, column) for column in truth.position.T], axis=1)
    off = np.linalg.norm(similarity(poses.position, true) - true, axis=1)
    way = np.linalg.norm(np.diff(true, axis=0), axis=1).sum()
    assert np.sqrt(np.mean(off**2)) < 0.03 * way
    whole = estimate_trajectory(events, CAMERA)
    np.testing.assert_array_equal(whole.poses.position, poses.position)


@pytest.mark.slow
def test_a_space_sweep_finds_the_true_depths(bent_drive):
    truth = bent_drive.truth
    span = slice(200, 1001)
    poses = PoseSeries(truth.t[span], truth.position[span], truth.R_world_cam[span])
    depth, volume = space_sweep(bent_drive.events, CAMERA, poses, (0.0, 2.0), at=0.6)
    assert volume.shape == (100, 180, 240)
    true = true_depths(bent_drive, 0.6)[depth.mask]
    ratio = depth.inverse_depth[depth.mask] * true
    assert len(depth) > 500
    assert np.median(np.abs(ratio - 1)) < 0.03


def true_depths(drive, t):
    """Depth along the optical axis at each pixel."""
    position = drive.truth.position
    simulator = Simulator(
        Trajectory(drive.truth.t, position, drive.truth.R_world_cam),
        CAMERA,
        furnished_room(np.column_stack([position[:, 0], position[:, 1], position[:, 2]]), 3),
        R_body_cam=np.eye(3),
        lever=(0.0, 0.0, 0.0),
    )
    rows, columns = np.mgrid[:180, :240]
    ahead = CAMERA.bearings(np.column_stack([columns.ravel(), rows.ravel()]))[:, 2]
    return simulator.depth(t) * ahead.reshape(180, 240)


@pytest.mark.slow
def test_the_slider_goes_along_its_axis(run, data, tmp_path):
    folder = data / "slider_depth"
    out = tmp_path / "traj.txt"
    words = (folder / "events.txt.gz", "--camera", folder / "calib.txt", "--size", "240x180")
    code, told, _ = run("trajectory", *words, "-o", out)
    assert code == 0
    assert "the scale is not known" in told
    poses = read_tum(out)
    assert poses.t[0] < 0.1
    assert poses.t[-1] > 1.65
    centred = poses.position - poses.position.mean(axis=0)
    axis = np.linalg.svd(centred, full_matrices=False)[2][0]
    axis *= np.sign(axis[0])
    assert np.degrees(angle_between(axis, AXIS)) < 1.5
    across = np.linalg.norm(centred - np.outer(centred @ axis, axis), axis=1)
    assert np.sqrt(np.mean(across**2)) < 0.01 * np.ptp(centred @ axis)


def test_a_real_tilt_is_no_trajectory(data):
    folder = data / "rotation" / "evbench"
    recordings = sorted(folder.rglob("*.txt.gz"))
    assert recordings, f"{folder} holds no events"
    for path in recordings:
        camera = read_camera(folder / "calib.txt", 240, 180)
        with pytest.raises(NoAnswerError, match="no map could be made"):
            estimate_trajectory(iter(open_recording(path, size=(240, 180))), camera)


def test_a_recording_too_short_ends_with_exit_code_3(run, tmp_path):
    (tmp_path / "e.csv").write_text("t,x,y,p\n" + "".join(f"{k},3,4,1\n" for k in range(0, 900, 9)))
    (tmp_path / "calib.txt").write_text("200 200 120 90 0 0 0 0 0\n")
    words = ("trajectory", tmp_path / "e.csv", "--camera", tmp_path / "calib.txt")
    code, out, err = run(*words, "--size", "240x180", "--time-unit", "us", "-o", tmp_path / "t.txt")
    assert code == 3
    assert out == ""
    assert "no map could be made" in err
    assert not (tmp_path / "t.txt").exists()

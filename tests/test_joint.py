"""The joint refinement: its kernel against a slow twin, exactness, robustness, honest intervals."""

import contextlib
import importlib
import re
from dataclasses import replace
from types import SimpleNamespace

import naive_joint as naive
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import binom

from evcalib import checks
from evcalib.errors import InputError
from evcalib.geometry import LOOKS_FORWARD, rotation_angle, rotation_vector_to_matrix
from evcalib.joint import Systematic, refine_jointly
from evcalib.joint._refine import POSITION_BIAS
from evcalib.joint._solver import Problem, begin, linearise, slope_of_loss
from evcalib.joint._world_motion import turning_radius, world_motion
from evcalib.kinematics.velocity_track import velocity_track
from evcalib.pipeline._assessment import offset_observable
from evcalib.series import VelocitySeries
from evcalib.uncertainty import rotation_radius, t_quantile

FOCAL = 200.0
PIXEL = 1.0 / FOCAL
NONE = Systematic(lag=0.0, lag_sd=0.1, time_sd=0.0, rotation_sd=0.0, yaw_rate_sd=1e-4)
PINNED = replace(NONE, lag_sd=1e-4)
R_BODY_CAM = rotation_vector_to_matrix([0.1, -0.2, 0.3]) @ LOOKS_FORWARD
OFFSET = 0.13
LEVER = (0.3, 0.1, 0.5)


def swinging(duration=8.0, *, speed=0.5, change=0.4, swing=0.6, yaw=0.2, rate=50.0):
    """Velocities whose direction and speed change, of a body that may turn."""
    t = np.arange(0.0, duration, 1.0 / rate)
    angle = swing * np.sin(2 * np.pi * t / 5.0) + swing / 3 * np.sin(2 * np.pi * t / 2.3)
    size = speed * (1 + change * np.sin(2 * np.pi * t / 3.1))
    v = np.stack([size * np.cos(angle), size * np.sin(angle), np.zeros_like(t)], axis=1)
    return VelocitySeries(t, v, yaw * np.sin(t) if yaw else None)


def refined(tracks, velocities, start=R_BODY_CAM, offset=0.0, *, smooth=False, **options):
    options = {"focal": FOCAL, "systematic": NONE, "lever": LEVER, "max_offset": 0.5, **options}
    track = velocity_track(velocities, smooth=smooth)
    return refine_jointly(tracks, velocities, track, start, offset, **options)


@pytest.fixture(scope="module")
def drive():
    velocities = swinging()
    rng = np.random.default_rng(1)
    return velocities, naive.made_tracks(
        rng, velocities, R_BODY_CAM, OFFSET, lever=LEVER, count=300
    )


def problem_of(tracks, velocities, lag=0.0, lever=LEVER, gyro_sd=None):
    motion = world_motion(velocities, velocity_track(velocities, smooth=False))
    return Problem(
        tracks,
        tracks.group,
        motion,
        lever,
        lever_sd=1.0,
        slowest=0.0,
        lag=lag,
        lag_sd=0.1 * PIXEL,
        yaw_rate_sd=1e-3,
        gyro_sd=gyro_sd,
    )


def linearised(
    tracks, velocities, R=R_BODY_CAM, offset=OFFSET, *, lag=0.0, bias=0.0, lever=LEVER,
    loss_scale=1e3, passes=12, gyro_sd=None,
):  # fmt: skip
    problem = problem_of(tracks, velocities, lag, lever, gyro_sd)
    fit = begin(problem, R, offset, loss_scale)
    fit.yaw_rate_bias[:] = bias
    for _ in range(passes):
        linearise(problem, fit)
    return fit


def rows(tracks, k):
    return slice(tracks.first[k], tracks.first[k + 1])


OFF_R = rotation_vector_to_matrix([0.004, -0.003, 0.005]) @ R_BODY_CAM
OFF_OFFSET = OFFSET + 0.02


@pytest.mark.parametrize("seed", range(3))
def test_tracks_are_fitted_as_the_slow_twin_fits_them(drive, seed):
    """All weights one: inverse distance, mean and residuals of plain least squares."""
    velocities, tracks = drive
    tracks = naive.spoiled(np.random.default_rng(seed), tracks, noise=0.5 * PIXEL)
    fit = linearised(tracks, velocities, OFF_R, OFF_OFFSET)
    motion, compared = naive.Motion(velocities), 0
    covered = tracks.end + OFF_OFFSET < velocities.t[-1]
    for k in np.flatnonzero((fit.distances > 0) & covered)[seed::12]:
        mine = naive.observed(motion, naive.rows_of(tracks, k), OFF_R, OFF_OFFSET, LEVER)
        rho, residuals = naive.fit_squares(mine)
        assert fit.distances[k] == pytest.approx(rho, rel=1e-5, abs=1e-6)
        assert fit.residuals[rows(tracks, k)] == pytest.approx(residuals[1:], abs=1e-9)
        compared += 1
    assert compared > 20


def test_outliers_are_weighed_as_the_slow_twin_weighs_them(drive):
    """Tukey's loss, solved for distance and mean by SciPy.

    The kernel forgets the anchor's weight between passes, which costs a little.
    """
    velocities, tracks = drive
    rng = np.random.default_rng(2)
    tracks = naive.spoiled(rng, tracks, noise=0.4 * PIXEL, false=0.1, shift=0.08)
    loss_scale = 5.0 * PIXEL
    fit = linearised(tracks, velocities, loss_scale=loss_scale)
    motion, out = naive.Motion(velocities), 0
    for k in np.flatnonzero(fit.distances > 0)[::10]:
        mine = naive.observed(motion, naive.rows_of(tracks, k), R_BODY_CAM, OFFSET, LEVER)
        rho, off, loss = naive.fit_tukey(mine, loss_scale, fit.distances[k])
        weights = np.maximum(1 - np.sum(off**2, axis=1) / loss_scale**2, 0) ** 2
        assert fit.losses[k] == pytest.approx(loss, rel=1e-3)
        assert fit.distances[k] == pytest.approx(rho, rel=1e-2)
        assert fit.weights[rows(tracks, k)] == pytest.approx(weights[1:], abs=0.02)
        out += np.sum(weights == 0)
    assert out > 5


def test_a_lag_shifts_each_observation_back_along_its_flow(drive):
    velocities, tracks = drive
    lag, motion = 0.3 * PIXEL, naive.Motion(velocities)
    plain, lagging = linearised(tracks, velocities), linearised(tracks, velocities, lag=lag)
    for k in range(0, len(tracks), 30):
        rho, mine = lagging.distances[k], naive.rows_of(tracks, k)
        track = naive.observed(motion, mine, R_BODY_CAM, OFFSET, LEVER)
        flow = naive.flow(motion, mine, R_BODY_CAM, OFFSET, LEVER, rho)
        # The anchor flows as it would if it were seen again at once.
        anchor = tuple(part[:1] for part in (mine[0], mine[0], mine[2], mine[2]))
        first = naive.flow(motion, anchor, R_BODY_CAM, OFFSET, LEVER, rho)
        off = track.off(rho) + lag * np.vstack([first, flow])
        off -= off.mean(axis=0)
        assert lagging.residuals[rows(tracks, k)] == pytest.approx(off[1:], abs=1e-7)
    assert np.abs(plain.residuals).max() < 1e-9


def losses_at(change, tracks, velocities, lag, **options):
    """The loss of each track with the eight unknowns moved."""
    R = rotation_vector_to_matrix(change[:3]) @ OFF_R
    offset, lag = OFF_OFFSET + change[3], lag + change[4]
    lever = (LEVER[0] + change[5], LEVER[1] + change[6], LEVER[2])
    return linearised(
        tracks, velocities, R, offset, lag=lag, bias=change[7], lever=lever, loss_scale=0.2,
        **options,
    ).losses  # fmt: skip


@pytest.mark.parametrize(
    ("lag", "tolerance", "gyro_sd"),
    [(0.0, 1e-5, None), (0.2 * PIXEL, 0.25, None), (0.0, 1e-5, 1e-3)],
)
def test_the_gradients_are_the_derivatives_of_the_losses(drive, lag, tolerance, gyro_sd):
    """Exact without lag; the change of the flow's direction is left out on purpose.

    Tracks that start or end just at a sample of the odometry are at a kink and do not count.
    """
    velocities, tracks = drive
    if gyro_sd is not None:
        tracks = turned_back(tracks, velocities)
    tracks = naive.spoiled(np.random.default_rng(3), tracks, noise=0.5 * PIXEL)
    gradients = linearised(
        tracks, velocities, OFF_R, OFF_OFFSET, lag=lag, loss_scale=0.2, gyro_sd=gyro_sd
    ).gradients
    for k in range(8):
        if k == 4 and lag == 0:
            continue
        step = 1e-5 * np.eye(8)[k]
        high, low = (losses_at(h, tracks, velocities, lag, gyro_sd=gyro_sd) for h in (step, -step))
        wanted = (high - low) / 2e-5
        size = np.sqrt(np.mean(wanted**2))
        assert np.quantile(np.abs(gradients[:, k] - wanted), 0.99) < tolerance * size


def turned_back(tracks, velocities, R=R_BODY_CAM, offset=OFFSET):
    """Return tracks whose later bearings a right gyro has turned back to the first time."""
    yaw = naive.Motion(velocities)
    psi = np.interp(tracks.t2 + offset, yaw.t, yaw.yaw) - np.interp(
        tracks.t1 + offset, yaw.t, yaw.yaw
    )
    turns = np.stack([naive.about_z(angle) for angle in psi])
    return replace(tracks, r2=np.einsum("ji,njk,kl,nl->ni", R, turns, R, tracks.r2))


def test_bearings_that_a_gyro_turned_back_are_fitted_as_those_seen(drive):
    """Where the odometry's yaw is right, too, it is the same whether one or the other is told."""
    velocities, tracks = drive
    tracks = naive.spoiled(np.random.default_rng(5), tracks, noise=0.5 * PIXEL)
    seen = linearised(tracks, velocities)
    told = linearised(turned_back(tracks, velocities), velocities, gyro_sd=1e-3)
    assert told.residuals == pytest.approx(seen.residuals, abs=1e-9)
    assert told.distances == pytest.approx(seen.distances, rel=1e-6)
    assert np.abs(told.residuals).max() > PIXEL / 2


def test_the_error_of_a_gyro_enters_the_error_bars():
    """A gyro that is off by its stated error, about one axis after the other."""
    velocities = swinging()
    rng = np.random.default_rng(6)
    tracks = naive.made_tracks(rng, velocities, R_BODY_CAM, OFFSET, lever=(0.0, 0.0, 0.0))
    tracks = turned_back(tracks, velocities)
    tracks = naive.spoiled(rng, tracks, noise=0.3 * PIXEL)
    options = {"lever": (0.0, 0.0, 0.0), "systematic": PINNED}
    right = refined(tracks, velocities, gyro_sd=1e-6, **options)
    error, moved = 3e-4, np.zeros(3)
    for axis in np.eye(3):
        by = error * (tracks.t2 - tracks.t1)[:, None] * np.cross(axis, tracks.r2)
        found = refined(replace(tracks, r2=tracks.r2 + by), velocities, gyro_sd=1e-6, **options)
        moved += Rotation.from_matrix(found.R_body_cam @ right.R_body_cam.T).as_rotvec() ** 2
    stated = refined(tracks, velocities, gyro_sd=error, **options).covariance
    added = np.diag(stated - right.covariance)[:3]
    assert added == pytest.approx(moved, rel=0.3)
    assert np.degrees(np.sqrt(moved.sum())) > 0.03
    with pytest.raises(InputError, match="gyro_sd"):
        refined(tracks, velocities, gyro_sd=0.0)


def test_the_information_is_the_curvature_of_the_losses_at_the_truth(drive):
    velocities, tracks = drive
    information, step = linearised(tracks, velocities).information.sum(axis=0), 1e-4
    for k in (0, 1, 2, 3, 5, 6):
        total = 0.0
        for h in (-step, step):
            change = np.zeros(7)
            change[k] = h
            R = rotation_vector_to_matrix(change[:3]) @ R_BODY_CAM
            lever = (LEVER[0] + change[5], LEVER[1] + change[6], LEVER[2])
            total += linearised(
                tracks, velocities, R, OFFSET + change[3], lever=lever, loss_scale=0.2
            ).losses.sum()
        # Half a square is lost per side, and at the truth nothing.
        assert total / step**2 == pytest.approx(information[k, k], rel=1e-3)


def test_what_the_odometry_does_not_cover_is_not_linearised(drive):
    velocities, tracks = drive
    fit = linearised(tracks, velocities, offset=OFFSET + 2.0, loss_scale=0.1)
    lost = tracks.start + OFFSET + 2.0 > velocities.t[-1]
    assert lost.any()
    assert fit.losses[lost] == pytest.approx(tracks.length[lost] * 0.1**2 / 6)
    assert (fit.gradients[lost] == 0).all()
    assert (fit.weights[np.repeat(lost, tracks.length)] == 0).all()


def test_a_wrong_type_is_told_with_what_makes_the_right_one(drive):
    velocities, tracks = drive
    right = {"tracks": tracks, "velocities": velocities, "track": velocity_track(velocities)}
    for name, kind in zip(right, ("Tracks", "VelocitySeries", "VelocityTrack"), strict=True):
        with pytest.raises(InputError, match=f"{name} must be {kind}, not ndarray; make it with "):
            refine_jointly(
                **{**right, name: np.zeros(3)}, R_body_cam=R_BODY_CAM, offset=0.0, focal=FOCAL
            )


@pytest.mark.parametrize("text", checks.MADE_BY.values())
def test_what_makes_a_type_is_there(text):
    names = re.findall(r"(?:evcalib|data_tools)[.\w]+", text)
    assert names
    for name in names:
        thing = importlib.import_module(name.partition(".")[0])
        for k, part in enumerate(name.split(".")[1:], 2):
            with contextlib.suppress(ModuleNotFoundError):
                importlib.import_module(".".join(name.split(".")[:k]))
            thing = getattr(thing, part)
        assert callable(thing)


START = rotation_vector_to_matrix([0.05, 0.02, -0.04]) @ R_BODY_CAM

MOTIONS = {
    "turning body": (swinging(), LEVER),
    "camera at the origin": (swinging(), (0.0, 0.0, 0.0)),
    "no yaw rate": (swinging(yaw=0.0), LEVER),
    "only the speed changes": (swinging(swing=0.0), LEVER),
    "only the direction changes": (swinging(change=0.0), LEVER),
    "slow odometry": (swinging(rate=15.0), LEVER),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_noise_free_tracks_give_the_truth(name):
    velocities, lever = MOTIONS[name]
    rng = np.random.default_rng(4)
    tracks = naive.made_tracks(rng, velocities, R_BODY_CAM, OFFSET, lever=lever, count=150)
    found = refined(tracks, velocities, START, lever=lever)
    assert found.offset == pytest.approx(OFFSET, abs=1e-6)
    assert rotation_angle(found.R_body_cam, R_BODY_CAM) < 1e-6
    assert found.inlier_share == 1.0
    assert found.converged


def test_nothing_is_linearised_across_gaps_of_the_odometry():
    whole = swinging(10.0)
    keep = (np.abs(whole.t - 3.0) > 0.3) & (np.abs(whole.t - 6.5) > 0.5)
    gappy = whole.select(keep)
    tracks = naive.made_tracks(np.random.default_rng(5), whole, R_BODY_CAM, OFFSET, lever=LEVER)
    found = refined(tracks, gappy, START)
    assert found.offset == pytest.approx(OFFSET, abs=1e-6)
    assert rotation_angle(found.R_body_cam, R_BODY_CAM) < 1e-6
    assert found.inlier_share < 0.95


def test_a_circle_is_met_in_closed_form():
    """Independent of the twin's integrals: a body that turns at a steady rate on a circle."""
    rate, speed = 0.5, 0.6
    t = np.arange(0, 6, 0.002)
    sway = 0.5 * np.sin(1.7 * t)
    v = np.stack([speed * np.cos(sway), speed * np.sin(sway), 0 * t], axis=1)
    velocities = VelocitySeries(t, v, np.full(t.size, rate))
    # In the world the direction is sway + rate t; its integral by Simpson on a fine grid.
    fine = np.linspace(0, 6, 60001)
    direction = 0.5 * np.sin(1.7 * fine) + rate * fine
    steps = speed * np.diff(fine)
    middle = 0.5 * np.sin(1.7 * (fine[1:] + fine[:-1]) / 2) + rate * (fine[1:] + fine[:-1]) / 2

    def simpson(f):
        parts = steps * (f(direction[:-1]) + 4 * f(middle) + f(direction[1:])) / 6
        return np.concatenate([[0.0], np.cumsum(parts)])

    x, y = simpson(np.cos), simpson(np.sin)

    class Circle(naive.Motion):
        def position(self, time):
            return np.array([np.interp(time, fine, x), np.interp(time, fine, y), 0.0])

    original, naive.Motion = naive.Motion, Circle
    try:
        rng = np.random.default_rng(6)
        tracks = naive.made_tracks(rng, velocities, R_BODY_CAM, OFFSET, lever=LEVER, count=150)
    finally:
        naive.Motion = original
    found = refined(tracks, velocities, START)
    assert found.offset == pytest.approx(OFFSET, abs=1e-5)
    assert rotation_angle(found.R_body_cam, R_BODY_CAM) < 1e-5


@pytest.mark.parametrize("seed", [7, 8, 9])
def test_false_observations_do_no_harm(drive, seed):
    """Nearly a third of all observations is up to 30 px away from where it should be."""
    velocities, clean = drive
    rng = np.random.default_rng(seed)
    tracks = naive.spoiled(rng, clean, noise=0.4 * PIXEL, false=0.3)
    found = refined(tracks, velocities, START)
    assert abs(found.offset - OFFSET) < 7e-3
    assert rotation_angle(found.R_body_cam, R_BODY_CAM) < np.radians(0.5)
    assert 0.5 < found.inlier_share < 0.75
    assert found.noise == pytest.approx(0.4, rel=0.2)


def test_the_lag_is_found():
    """Each observation trails by 0.6 px along its own flow, the prior allows for 0.5 px."""
    velocities, rng = swinging(), np.random.default_rng(8)
    tracks = naive.made_tracks(rng, velocities, R_BODY_CAM, OFFSET, lever=LEVER, count=120)
    motion, lag = naive.Motion(velocities), 0.6 * PIXEL
    distances = np.repeat(linearised(tracks, velocities).distances, tracks.length)

    def trailing(rays, times):
        """The flow of a corner as it is seen at an instant, by the distance at its anchor."""
        out = rays.copy()
        for i, rho in enumerate(distances):
            at = rays[i : i + 1], rays[i : i + 1], times[i : i + 1], times[i : i + 1]
            flow = naive.flow(motion, at, R_BODY_CAM, OFFSET, LEVER, rho)
            out[i] = naive.moved(at[0], -lag * flow)[0]
        return out

    r1, r2 = trailing(tracks.r1, tracks.t1), trailing(tracks.r2, tracks.t2)
    lagging = replace(tracks, r1=r1, r2=r2)
    found = refined(lagging, velocities, systematic=replace(NONE, lag_sd=0.5))
    ignored = refined(lagging, velocities, systematic=PINNED)
    assert found.lag == pytest.approx(0.6, abs=0.1)
    assert abs(found.offset - OFFSET) < 2e-3
    assert abs(ignored.offset - OFFSET) > 2 * abs(found.offset - OFFSET)


def test_the_stated_intervals_hold_the_truth():
    """Of 60 intervals at 95 %, fewer than 52 hold the truth by bad luck three times in 1000."""
    trials, inside, drives = 60, np.zeros(2, dtype=int), []
    for seed in range(3):
        velocities = swinging(10.0, swing=0.4 + 0.2 * seed)
        rng = np.random.default_rng([9, seed])
        tracks = naive.made_tracks(rng, velocities, R_BODY_CAM, OFFSET, lever=LEVER, count=150)
        drives.append((velocities, tracks))
    for trial in range(trials):
        velocities, clean = drives[trial % len(drives)]
        rng = np.random.default_rng([10, trial])
        tracks = naive.spoiled(rng, clean, noise=0.3 * PIXEL, false=0.05)
        found = refined(tracks, velocities, offset=OFFSET, max_offset=0.1, systematic=PINNED)
        half = t_quantile(found.samples) * np.sqrt(found.covariance[3, 3])
        radius = rotation_radius(found.covariance[:3, :3], samples=found.samples)
        turn = rotation_angle(found.R_body_cam, R_BODY_CAM)
        inside += abs(found.offset - OFFSET) < half, turn < radius
    assert (inside >= binom.ppf(0.003, trials, 0.95)).all(), inside


TURNING = swinging(yaw=0.8)


def test_a_body_that_turns_shows_where_its_camera_sits():
    """Exactly, from a start 40 cm off; what does not turn leaves it unknown by metres."""
    rng = np.random.default_rng(40)
    tracks = naive.made_tracks(rng, TURNING, R_BODY_CAM, OFFSET, lever=LEVER, count=150)
    there = LEVER[0] - 0.3, LEVER[1] + 0.25, LEVER[2]
    found = refined(tracks, TURNING, START, lever=there, estimate_position=True)
    assert found.position == pytest.approx(LEVER, abs=1e-5)
    assert rotation_angle(found.R_body_cam, R_BODY_CAM) < 1e-5
    assert found.offset == pytest.approx(OFFSET, abs=1e-5)
    straight = swinging(yaw=0.0)
    tracks = naive.made_tracks(rng, straight, R_BODY_CAM, OFFSET, lever=LEVER, count=150)
    tracks = naive.spoiled(rng, tracks, noise=0.3 * PIXEL)
    found = refined(tracks, straight, START, lever=there, estimate_position=True)
    sd = np.sqrt(np.diag(found.covariance)[4:])
    assert (sd > 0.9).all()
    assert (np.abs(found.position - LEVER)[:2] < 3.0 * sd).all()


def test_what_all_directions_share_moves_the_position_by_the_radius_of_the_turn():
    """By hand: a body that turns at 0.5 rad/s at 1 m/s drives on a radius of 2 m."""
    t = np.arange(0.0, 4.0, 0.02)
    v = np.stack([np.ones_like(t), 0 * t, 0 * t], axis=1)
    velocities = VelocitySeries(t, v, np.full_like(t, 0.5))
    motion = world_motion(velocities, velocity_track(velocities))
    assert turning_radius(motion) == pytest.approx(2.0, rel=1e-6)
    rng = np.random.default_rng(43)
    tracks = naive.made_tracks(rng, TURNING, R_BODY_CAM, OFFSET, lever=LEVER, count=150)
    tracks = naive.spoiled(rng, tracks, noise=0.1 * PIXEL)
    radius = turning_radius(world_motion(TURNING, velocity_track(TURNING)))
    one, two = (
        refined(
            tracks, TURNING, offset=OFFSET, lever=LEVER, estimate_position=True,
            systematic=replace(PINNED, rotation_sd=sd),
        ).covariance[4:, 4:]
        for sd in (0.0, 0.01)
    )  # fmt: skip
    shared = POSITION_BIAS * 0.01 * radius
    np.testing.assert_allclose(two - one, shared**2 * np.eye(2), atol=1e-9)


def test_the_stated_positions_hold_the_truth():
    """As above: fewer than 52 of 60 by bad luck three times in 1000, of each of four numbers."""
    trials, inside, drives = 60, np.zeros(4, dtype=int), []
    for seed in range(3):
        velocities = swinging(10.0, swing=0.4 + 0.2 * seed, yaw=0.5 + 0.2 * seed)
        rng = np.random.default_rng([41, seed])
        tracks = naive.made_tracks(rng, velocities, R_BODY_CAM, OFFSET, lever=LEVER, count=150)
        drives.append((velocities, tracks))
    for trial in range(trials):
        velocities, clean = drives[trial % len(drives)]
        rng = np.random.default_rng([42, trial])
        tracks = naive.spoiled(rng, clean, noise=0.3 * PIXEL, false=0.05)
        found = refined(
            tracks, velocities, offset=OFFSET, max_offset=0.1, systematic=PINNED,
            estimate_position=True,
        )  # fmt: skip
        half = t_quantile(found.samples) * np.sqrt(np.diag(found.covariance)[3:])
        off = np.abs([found.offset - OFFSET, *(found.position[:2] - LEVER[:2])])
        radius = rotation_radius(found.covariance[:3, :3], samples=found.samples)
        turn = rotation_angle(found.R_body_cam, R_BODY_CAM)
        inside += [*(off < half), turn < radius]
    assert (inside >= binom.ppf(0.003, trials, 0.95)).all(), inside
    assert np.median(half[1:]) < 0.05


def test_a_yaw_rate_that_is_off_is_estimated_along():
    """A gyroscope with a bias of 0.02 rad/s."""
    velocities = swinging()
    rng = np.random.default_rng(14)
    tracks = naive.made_tracks(rng, velocities, R_BODY_CAM, OFFSET, lever=LEVER, count=300)
    biased = VelocitySeries(velocities.t, velocities.v, velocities.yaw_rate + 0.02)
    found = refined(tracks, biased, systematic=replace(NONE, yaw_rate_sd=0.03))
    ignored = refined(tracks, biased, systematic=replace(NONE, yaw_rate_sd=1e-6))
    turn, ignorant = (rotation_angle(f.R_body_cam, R_BODY_CAM) for f in (found, ignored))
    assert abs(found.offset - OFFSET) < 1e-3
    assert turn < np.radians(0.1)
    assert ignorant > np.radians(1.0)


@pytest.fixture(scope="module")
def noisy(drive):
    velocities, clean = drive
    tracks = naive.spoiled(np.random.default_rng(11), clean, noise=0.3 * PIXEL, false=0.1)
    return velocities, tracks, refined(tracks, velocities)


def same(a, b):
    assert a.offset == pytest.approx(b.offset, abs=1e-5)
    assert rotation_angle(a.R_body_cam, b.R_body_cam) < 1e-5
    assert a.covariance == pytest.approx(b.covariance, rel=1e-2, abs=1e-10)


@pytest.mark.parametrize("scale", [0.02, 20.0])
def test_the_scale_of_speeds_does_not_matter(noisy, scale):
    """Wheels of a wrong radius: only distances change, and the lever with them."""
    velocities, tracks, found = noisy
    other = VelocitySeries(velocities.t, scale * velocities.v, velocities.yaw_rate)
    same(refined(tracks, other, lever=tuple(scale * np.array(LEVER))), found)


def test_turning_the_camera_turns_the_answer(noisy):
    velocities, tracks, found = noisy
    Q = rotation_vector_to_matrix([0.7, -1.1, 0.4])
    turned = replace(tracks, r1=tracks.r1 @ Q, r2=tracks.r2 @ Q)
    other = refined(turned, velocities, R_BODY_CAM @ Q)
    same(replace(other, R_body_cam=other.R_body_cam @ Q.T), found)


def test_shifting_a_clock_shifts_the_offset(noisy):
    velocities, tracks, found = noisy
    later = refined(replace(tracks, t1=tracks.t1 + 0.2, t2=tracks.t2 + 0.2), velocities)
    same(replace(later, offset=later.offset + 0.2), found)


def test_with_the_offset_given_only_the_rotation_is_estimated(noisy):
    velocities, tracks, found = noisy
    given = refined(tracks, velocities, START, OFFSET, estimate_offset=False)
    assert given.offset == OFFSET
    assert given.curve is None
    assert given.plausible.size == 0
    assert given.covariance[3, 3] == 0
    assert rotation_angle(given.R_body_cam, R_BODY_CAM) < np.radians(0.3)


def test_systematic_errors_add_to_what_is_stated(noisy):
    velocities, tracks, found = noisy
    shared = replace(NONE, time_sd=0.004, rotation_sd=0.01)
    more = refined(tracks, velocities, systematic=shared)
    added = np.diag(more.covariance - found.covariance)
    assert added == pytest.approx([1e-4, 1e-4, 1e-4, 1.6e-5, 0.0, 0.0], rel=1e-6)


def constant(angle_rate=0.0, yaw=0.0, speed=0.5):
    t = np.arange(0.0, 10.0, 0.02)
    angle = 0.2 + angle_rate * t
    v = speed * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(t)], axis=1)
    return VelocitySeries(t, v, np.full(t.size, yaw) if yaw else None)


def claims(found, velocities, max_offset=0.5):
    track = velocity_track(velocities, smooth=False)
    return found is not None and offset_observable(found, track, max_offset)


CANNOT = {
    "straight": constant(),
    "arc": constant(angle_rate=0.2),
    "arc of a body that turns": constant(yaw=0.2),
}


@pytest.mark.parametrize("name", CANNOT)
def test_constant_motion_does_not_determine_the_offset(name):
    velocities, rng = CANNOT[name], np.random.default_rng(12)
    clean = naive.made_tracks(rng, velocities, R_BODY_CAM, OFFSET, lever=LEVER, count=250)
    tracks = naive.spoiled(rng, clean, noise=0.3 * PIXEL)
    found = refined(tracks, velocities)
    assert not claims(found, velocities)


@pytest.mark.parametrize("seed", range(3))
def test_the_odometry_of_another_drive_determines_nothing(noisy, seed):
    velocities, tracks, found = noisy
    rng = np.random.default_rng([13, seed])
    t = np.arange(0.0, 8.0, 0.02)
    phase, rate = rng.uniform(0, 6, 4), rng.uniform(0.5, 3.0, 4)
    angle = 0.8 * np.sin(rate[0] * t + phase[0]) + 0.4 * np.sin(rate[1] * t + phase[1])
    speed = 0.5 + 0.15 * np.sin(rate[2] * t + phase[2]) + 0.15 * np.sin(rate[3] * t + phase[3])
    v = speed * np.stack([np.cos(angle), np.sin(angle), 0 * t])
    another = VelocitySeries(t, v.T)
    assert claims(found, velocities)
    assert not claims(refined(tracks, another), another)


def test_an_offset_outside_the_search_is_not_claimed(noisy):
    velocities, tracks, _ = noisy
    far = replace(tracks, t1=tracks.t1 - 1.0, t2=tracks.t2 - 1.0)
    found = refined(far, velocities, max_offset=0.3)
    assert not claims(found, velocities, 0.3)


def test_too_few_tracks_are_not_refined(noisy):
    velocities, tracks, _ = noisy
    few = np.arange(len(tracks)) < 40
    assert refined(tracks.select(few), velocities) is None
    assert refined(tracks.select(few), velocities, estimate_offset=False) is None


@pytest.mark.parametrize("focal", [0.0, -1.0, np.nan])
def test_a_focal_length_must_be_positive(noisy, focal):
    velocities, tracks, _ = noisy
    with pytest.raises(InputError, match="focal"):
        refined(tracks, velocities, focal=focal)


@pytest.mark.parametrize("loss_scale", [2.5, 5.0])
def test_the_bend_of_the_loss_is_that_of_its_second_derivative(loss_scale):
    """For normal residuals: the mean of psi' over that of the weight, by central differences."""
    rng, h = np.random.default_rng(15), 1e-4
    off = rng.standard_normal((200_000, 2))

    def psi(r):
        u = np.minimum(np.sum(r**2, axis=1) / loss_scale**2, 1.0)
        return (1 - u) ** 2 * r[:, 0]

    slope = np.mean(psi(off + [h, 0]) - psi(off - [h, 0])) / (2 * h)
    weights = (1 - np.minimum(np.sum(off**2, axis=1) / loss_scale**2, 1.0)) ** 2
    fit = SimpleNamespace(residuals=off, weights=weights, loss_scale=loss_scale)
    assert slope_of_loss(fit) == pytest.approx(slope / weights.mean(), rel=0.02)


def test_a_clock_that_gains_keeps_its_middle(noisy):
    _, tracks, _ = noisy
    faster = tracks.on_clock(1e-3)
    middle = 0.5 * (tracks.start[0] + tracks.start[-1])
    assert faster.t1 - tracks.t1 == pytest.approx(1e-3 * (tracks.t1 - middle))
    assert faster.t2 - tracks.t2 == pytest.approx(1e-3 * (tracks.t2 - middle))

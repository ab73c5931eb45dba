"""What must not change the answer, or must change it in a known way: from sightings to the verdict.

The stages by themselves have tests like these beside them (test_align, test_joint, test_rotation,
test_heading); here all that follows the front end runs as `evcalib.calibrate` runs it, and events
run backwards.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from data_tools.simulation.drives import Drive, s_curve
from data_tools.simulation.simulator import simulate_translation
from data_tools.simulation.streams import Noise, simulate
from data_tools.studies.sighting_drives import sight
from data_tools.studies.sightings import Corners
from evcalib.alignment import align
from evcalib.camera import Camera
from evcalib.events import Events
from evcalib.geometry import angle_between, random_rotation, rotation_angle, unit
from evcalib.heading import estimate_headings
from evcalib.pipeline import calibrate_estimate
from evcalib.series import HeadingSeries, VelocitySeries

CAMERA = Camera(240, 180, 150.0, 150.0, 119.5, 89.5)
OFFSET = 0.15

turns = st.builds(lambda *xyz: Rotation.from_rotvec(xyz).as_matrix(), *(3 * [st.floats(-1.7, 1.7)]))
few = settings(deadline=None, max_examples=3)


def made(noise, false, odometry):
    curve = s_curve(9.0, amplitude=1.1, period=4.5, heading=0.4)
    drive = Drive("s", 9.0, curve.angle, lambda t: 0.6 + 0.2 * np.sin(1.9 * t))
    rng = np.random.default_rng(3)
    return sight(
        drive,
        rng,
        camera=CAMERA,
        R_body_cam=random_rotation(rng),
        offset=OFFSET,
        corners=Corners(count=7, noise=noise, false=false),
        odometry_noise=odometry,
    )


@pytest.fixture(scope="module")
def noisy():
    drive = made(0.2, 0.15, 0.005)
    estimate = drive.estimate()
    return estimate, drive.velocities, solved(estimate, drive.velocities)


@pytest.fixture(scope="module")
def gappy(noisy):
    """Odometry whose gaps are as long as may be, where the next longer one would part it."""
    estimate, velocities, _ = noisy
    left = np.arange(len(velocities.t)) % 40 >= 4
    fewer = VelocitySeries(velocities.t[left], velocities.v[left], velocities.yaw_rate[left])
    return estimate, fewer, solved(estimate, fewer)


def solved(estimate, velocities):
    return calibrate_estimate(estimate, velocities, focal=CAMERA.focal, max_offset=0.4)


def changed(estimate, **columns):
    """Return an estimate with other columns of its headings and correspondences, by prefix."""
    headings = {k[2:]: v for k, v in columns.items() if k.startswith("h_")}
    matches = {k[2:]: v for k, v in columns.items() if k.startswith("c_")}
    return replace(
        estimate,
        headings=replace(estimate.headings, **headings),
        correspondences=replace(estimate.correspondences, **matches),
    )


def same(a, b, *, time=1e-5, turn=1e-5):
    assert a.offset == pytest.approx(b.offset, abs=time)
    assert rotation_angle(a.R_body_cam, b.R_body_cam) < turn
    assert a.verdict.summary == b.verdict.summary
    assert a.offset_observable == b.offset_observable
    assert a.offset_sd == pytest.approx(b.offset_sd, rel=0.05)
    assert a.rotation_radius == pytest.approx(b.rotation_radius, rel=0.05)


def test_what_is_compared_is_a_calibration(noisy):
    assert noisy[2].offset_observable
    assert noisy[2].rotation_observable
    assert abs(noisy[2].offset - OFFSET) < 4 * noisy[2].offset_sd


@few
@given(Q=turns)
def test_turning_the_camera_turns_the_answer(noisy, Q):
    estimate, velocities, found = noisy
    c = estimate.correspondences
    turned = changed(estimate, h_v=estimate.headings.v @ Q.T, c_r1=c.r1 @ Q.T, c_r2=c.r2 @ Q.T)
    other = solved(turned, velocities)
    same(replace(other, R_body_cam=other.R_body_cam @ Q), found)


def delayed(estimate, by):
    """Return the estimate with all its times later."""
    h, c = estimate.headings, estimate.correspondences
    return changed(
        estimate,
        h_t=h.t + by,
        h_t_start=h.t_start + by,
        h_t_end=h.t_end + by,
        c_t1=c.t1 + by,
        c_t2=c.t2 + by,
    )


@few
@given(shift=st.floats(-0.2, 0.2))
def test_shifting_the_cameras_clock_shifts_the_offset(noisy, shift):
    estimate, velocities, found = noisy
    later = delayed(estimate, shift)
    other = solved(later, velocities)
    same(replace(other, offset=other.offset + shift), found)


@pytest.mark.parametrize("case", ["noisy", "gappy"])
@few
@given(start=st.floats(-1e6, 2e9))
def test_shifting_both_clocks_shifts_nothing(case, start, request):
    estimate, velocities, found = request.getfixturevalue(case)
    later = delayed(estimate, start)
    same(solved(later, replace(velocities, t=velocities.t + start)), found, time=2e-5)


@few
@given(scale=st.floats(0.02, 50.0))
def test_the_scale_of_speeds_changes_nothing(noisy, scale):
    estimate, velocities, found = noisy
    same(solved(estimate, replace(velocities, v=scale * velocities.v)), found)


def test_backwards_in_time_the_offset_has_the_other_sign_and_the_rotation_is_the_same():
    """All headings and velocities turn round; nearly, as anchors are other sightings then."""
    drive = made(0.0, 0.0, 0.0)
    estimate, velocities = drive.estimate(), drive.velocities
    h, c = estimate.headings, estimate.correspondences
    back = changed(
        estimate,
        h_t=-h.t[::-1],
        h_v=-h.v[::-1],
        h_t_start=-h.t_end[::-1],
        h_t_end=-h.t_start[::-1],
        h_sd=h.sd[::-1],
        h_inliers=h.inliers[::-1],
        c_t1=-c.t2,
        c_t2=-c.t1,
        c_r1=c.r2,
        c_r2=c.r1,
    )
    backwards = VelocitySeries(-velocities.t[::-1], -velocities.v[::-1], -velocities.yaw_rate[::-1])
    found, other = solved(estimate, velocities), solved(back, backwards)
    assert other.offset == pytest.approx(-found.offset, abs=2e-4)
    assert rotation_angle(other.R_body_cam, found.R_body_cam) < 2e-4


@few
@given(seed=st.integers(0, 1000))
def test_the_order_of_correspondences_changes_no_bit(noisy, seed):
    estimate, velocities, found = noisy
    c = estimate.correspondences
    order = np.random.default_rng(seed).permutation(len(c))
    names = ("r1", "r2", "t1", "t2", "inlier", "pair", "heading")
    mixed = changed(estimate, **{f"c_{name}": getattr(c, name)[order] for name in names})
    assert bits(solved(mixed, velocities)) == bits(found)


def bits(found):
    joint = found.joint
    return b"".join(
        np.asarray(part).tobytes()
        for part in (found.R_body_cam, found.offset, found.rotation_covariance, joint.covariance,
                     joint.curve.score, joint.plausible)
    )  # fmt: skip


def test_two_threads_give_the_bytes_of_one(noisy):
    estimate, velocities, found = noisy
    with ThreadPoolExecutor(2) as pool:
        both = list(pool.map(lambda _: solved(estimate, velocities), range(2)))
    assert [bits(one) for one in both] == 2 * [bits(found)]


@settings(deadline=None, max_examples=5)
@given(seed=st.integers(0, 1000))
def test_outliers_may_change_places(seed):
    """Beyond the reach of the loss it does not matter where they point."""
    rng = np.random.default_rng(seed)
    streams = simulate(
        s_curve(10.0, period=5.0, amplitude=1.0),
        rng,
        offset=OFFSET,
        heading_noise=Noise(0.03),
        velocity_noise=Noise(0.01),
    )
    v = streams.headings.v.copy()
    wrong = rng.permutation(len(v))[: len(v) // 4]
    # All point away from every direction of the drive, to one side of its plane or the other.
    away = rng.standard_normal((wrong.size, 3)) * 0.2 + [[0, 0, 1.0]] * np.sign(
        rng.standard_normal((wrong.size, 1))
    )
    v[wrong] = away @ streams.R_body_cam / np.linalg.norm(away, axis=1, keepdims=True)
    found = align(HeadingSeries(streams.headings.t, v), streams.velocities, max_offset=0.4)
    v[wrong] = v[rng.permutation(wrong)]
    other = align(HeadingSeries(streams.headings.t, v), streams.velocities, max_offset=0.4)
    assert other.offset == pytest.approx(found.offset, abs=1e-4)
    assert rotation_angle(other.R_body_cam, found.R_body_cam) < 1e-4


def test_events_backwards_with_their_polarity_turned_show_the_opposite_heading():
    camera = Camera(120, 90, 90.0, 90.0, 59.5, 44.5)
    events = simulate_translation((1.0, 0.0, 0.4), 0.5, 0.7, camera, seed=2).events
    back = Events.from_arrays(
        events.x[::-1].astype(int),
        events.y[::-1].astype(int),
        (events.t[-1] - events.t)[::-1],
        ~events.p[::-1],
        camera.width,
        camera.height,
    )
    ahead, behind = (estimate_headings(e, camera).headings for e in (events, back))
    assert len(ahead) >= 4
    assert len(behind) >= 4
    # A sensor this small knows a heading to some degrees.
    for headings, truth in ((ahead, (1.0, 0.0, 0.4)), (behind, (-1.0, 0.0, -0.4))):
        off = np.degrees(angle_between(headings.v, unit(np.tile(truth, (len(headings), 1)))))
        assert np.median(off) < 4.0
        assert off.max() < 15.0

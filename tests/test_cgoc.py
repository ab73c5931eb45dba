import builtins

import naive_hand_eye as naive
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from trajectories import camera_of, pair, smooth_body

from data_tools.logs.trajectory_files import read_tum
from evcalib.baselines import cgoc as module
from evcalib.baselines.cgoc import CERTIFIED, certify, cgoc
from evcalib.baselines.hand_eye import Quadratic, hand_eye, minimise, quadratic
from evcalib.errors import InputError
from evcalib.geometry import rotation_angle
from evcalib.poses import PoseSeries, motions

cvxpy = pytest.importorskip("cvxpy")


def lifted(R):
    return np.append(np.ravel(R), 1.0)


def test_the_constraints_hold_for_rotations_and_for_nothing_else():
    P = module._constraints()
    assert P.shape == (21, 10, 10)
    for R in Rotation.random(5, random_state=0).as_matrix():
        np.testing.assert_allclose(np.einsum("kab,a,b->k", P, lifted(R), lifted(R)), 0, atol=1e-12)
        for wrong in (-R, 2 * R, R @ np.diag([1, 1, -1]), R + 0.1):
            broken = np.einsum("kab,a,b->k", P, lifted(wrong), lifted(wrong))
            assert np.abs(broken).max() > 0.05


@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("noise", [0.01, 0.03, 0.1, 0.3])
def test_fifty_poses_are_certified_at_every_noise(noise, planar):
    for seed in range(3):
        camera, body, _, _ = pair(seed, n=50, noise=noise, planar=planar, scale=1.0 + 2 * seed)
        found = cgoc(camera, body)
        assert found.certificate.certified
        assert abs(found.certificate.relative_gap) <= 1e-4
        assert found.certificate.min_eigenvalue > -1e-6


@pytest.mark.parametrize("monocular", [True, False])
def test_the_optimum_is_that_of_many_starts(monocular):
    """scipy's least squares from 12 starts, on homogeneous matrices, without any elimination."""
    camera, body, _, _ = pair(11, n=10, noise=0.2)
    found = cgoc(camera, body, monocular=monocular)
    R, lever, scale, cost = naive.hand_eye(camera, body, monocular=monocular)
    assert rotation_angle(found.solution.R_body_cam, R) < 1e-6
    np.testing.assert_allclose(found.solution.lever_arm, lever, atol=1e-5)
    assert found.solution.scale == pytest.approx(scale, rel=1e-6)
    assert found.certificate.bound == pytest.approx(cost, rel=CERTIFIED)


def test_exact_trajectories_give_x_and_are_certified():
    for planar in (False, True):
        camera, body, X, _ = pair(2, scale=3.0, planar=planar)
        found = cgoc(camera, body)
        assert rotation_angle(found.solution.R_body_cam, X) < 1e-6
        assert found.solution.scale == pytest.approx(3.0)
        assert found.certificate.certified


def test_pure_translation_in_the_plane_is_certified_though_a_half_turn_costs_the_same():
    rng = np.random.default_rng(3)
    t, position, _ = smooth_body(rng, 50, planar=True)
    X, still = Rotation.random(random_state=rng), Rotation.identity(50)
    camera = camera_of(rng, t, position, still, X=X, lever=np.zeros(3))
    camera = PoseSeries(t, camera.position + 0.05 * rng.normal(size=(50, 3)), camera.rotation)
    found = cgoc(camera, PoseSeries(t, position))
    assert found.certificate.certified
    assert found.solution.scale > 0
    assert rotation_angle(found.solution.R_body_cam, X.as_matrix()) < np.radians(3)
    assert np.isnan(found.solution.lever_arm).all()


def random_form(seed):
    half = np.random.default_rng(seed).normal(size=(6, 10))
    return Quadratic(half.T @ half, np.zeros((4, 10)), np.zeros((3, 0)))


@pytest.mark.parametrize("seed", range(8))
def test_no_rotation_is_below_the_bound(seed):
    """Forms that no trajectory gives: the bound holds also where it is not reached."""
    form = random_form(seed)
    _, certificate = certify(form)
    some = Rotation.random(2000, random_state=seed).as_matrix()
    best = min(
        naive_cost(form, minimise(form, np.ascontiguousarray(R), polished=24)) for R in some[:20]
    )
    assert best >= certificate.bound - 1e-9 * np.trace(form.Q)
    assert min(naive_cost(form, R) for R in some) >= certificate.bound
    if certificate.certified:
        assert best >= certificate.bound + (1 - CERTIFIED) * certificate.gap - 1e-9
    assert certificate.certified == (certificate.relative_gap <= CERTIFIED)


def naive_cost(form, R):
    return lifted(R) @ form.Q @ lifted(R)


def test_a_rotation_above_the_bound_is_not_certified(monkeypatch):
    """With the minimiser broken, the certificate refuses what it returns."""
    camera, body, _, _ = pair(4, noise=0.05)
    monkeypatch.setattr(module, "minimise", lambda form, start: np.eye(3))
    found = cgoc(camera, body)
    assert not found.certificate.certified
    assert found.certificate.relative_gap > 0.1


def test_hand_eye_and_cgoc_agree_where_the_optimum_is_global():
    camera, body, _, _ = pair(6, noise=0.1)
    a, b = hand_eye(camera, body), cgoc(camera, body)
    assert rotation_angle(a.R_body_cam, b.solution.R_body_cam) < 1e-6
    assert a.cost == pytest.approx(b.solution.cost, rel=1e-9)


def test_the_cost_of_the_form_is_that_of_the_plain_residuals():
    camera, body, _, _ = pair(7, n=8, noise=0.1)
    form = quadratic(motions(camera, body, camera.t, 0.0))
    A = naive.motions(body.position, body.matrices)
    B = naive.motions(camera.position, camera.matrices)
    for turn in Rotation.random(3, random_state=0):
        scale, *t = form.recover @ lifted(turn.as_matrix())
        x = np.concatenate([turn.as_rotvec(), t, [scale]])
        expected = np.sum(naive.residuals(x, A, B) ** 2)
        assert naive_cost(form, turn.as_matrix()) == pytest.approx(expected, rel=1e-9)
        for change in 1e-3 * np.eye(7)[3:]:
            assert np.sum(naive.residuals(x + change, A, B) ** 2) > expected


def test_a_car_drive_is_certified(data):
    vo = read_tum(data / "dsec_traj" / "vo_04c.txt")
    found = cgoc(vo, read_tum(data / "dsec_traj" / "gt_04c.txt"))
    assert found.certificate.certified


def test_without_cvxpy_the_extra_is_named(monkeypatch):
    plain = builtins.__import__

    def refuse(name, *args, **kwargs):
        if name == "cvxpy":
            raise ImportError(name)
        return plain(name, *args, **kwargs)

    module._dual.cache_clear()
    monkeypatch.setattr(builtins, "__import__", refuse)
    camera, body, _, _ = pair(1)
    with pytest.raises(InputError, match=r'pip install "evcalib\[rivals\]"'):
        cgoc(camera, body)

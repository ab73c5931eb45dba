"""Pairs of trajectories with a known X, made independently of the library's own formulas."""

import numpy as np
from scipy.spatial.transform import Rotation

from evcalib.poses import PoseSeries


def smooth_body(rng, n=50, duration=10.0, turning=1.0, planar=False):
    """Return times, positions and rotations of a body that moves along sums of sines."""
    t = np.linspace(0.0, duration, n)
    phase, rate = rng.uniform(0, 2 * np.pi, (2, 6, 1)), rng.uniform(0.3, 1.2, (6, 1))
    waves = np.sin(rate * t + phase[0]) + 0.5 * np.cos(2 * rate * t + phase[1])
    position, vector = 2 * waves[:3].T, turning * waves[3:].T
    if planar:
        position[:, 2], vector[:, :2] = 0.0, 0.0
    return t, position, Rotation.from_rotvec(vector)


def camera_of(rng, t, position, turn, *, X, lever, scale=1.0, noise=0.0, offset=0.0):
    """Return what a camera at X on the body logs: its own world and scale, and noise."""
    world, n = Rotation.random(random_state=rng), len(t)
    spot = world.apply(position + turn.apply(lever)) / scale + rng.normal(size=3)
    spot = spot + noise * rng.normal(size=(n, 3)) / scale
    spin = world * turn * X * Rotation.from_rotvec(noise * rng.normal(size=(n, 3)))
    return PoseSeries(t - offset, spot, spin.as_matrix())


def pair(seed, *, n=50, scale=1.0, noise=0.0, planar=False, turning=1.0, offset=0.0):
    """Return camera, body, X (3, 3) and lever arm of a random problem."""
    rng = np.random.default_rng(seed)
    t, position, turn = smooth_body(rng, n, turning=turning, planar=planar)
    X, lever = Rotation.random(random_state=rng), rng.normal(size=3)
    camera = camera_of(
        rng, t, position, turn, X=X, lever=lever, scale=scale, noise=noise, offset=offset
    )
    return camera, PoseSeries(t, position, turn.as_matrix()), X.as_matrix(), lever

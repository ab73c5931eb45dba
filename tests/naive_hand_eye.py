"""Eq. 2 in plain scipy: homogeneous matrices, rotation vectors, many starts, no elimination."""

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation


def motions(position, rotation):
    """Return T_i^-1 T_j (m, 4, 4) of all pairs of poses."""
    T = np.tile(np.eye(4), (len(position), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = rotation, position
    i, j = np.triu_indices(len(T), 1)
    return np.linalg.inv(T)[i] @ T[j]


def residuals(x, A, B):
    """Return B Y - Y A for Y = (rotation vector, translation), with B's translation scaled."""
    Y = np.eye(4)
    Y[:3, :3], Y[:3, 3] = Rotation.from_rotvec(x[:3]).as_matrix(), x[3:6]
    scaled = B.copy()
    scaled[:, :3, 3] *= x[6]
    return (scaled @ Y - Y @ A)[:, :3].ravel() / np.sqrt(len(A))


def hand_eye(camera, body, *, monocular=True, starts=12, seed=0):
    """Return R_body_cam, lever arm, scale and cost per motion, the best of several starts."""
    A, B = motions(body.position, body.rotation), motions(camera.position, camera.rotation)

    def loss(x):
        return residuals(x if monocular else np.append(x, 1.0), A, B)

    best = None
    for turn in Rotation.random(starts, random_state=seed).as_rotvec():
        start = np.concatenate([turn, np.zeros(3), [1.0] if monocular else []])
        found = least_squares(loss, start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
        scale = found.x[6] if monocular else 1.0
        if scale > 0 and (best is None or found.cost < best.cost):
            best = found
    R = Rotation.from_rotvec(best.x[:3]).as_matrix()
    return R.T, -R.T @ best.x[3:6], best.x[6] if monocular else 1.0, 2 * best.cost

"""Sums and steps of hand-eye calibration (see evcalib.baselines.hand_eye)."""

import numpy as np

from evcalib.kernels.jit import jit

UNKNOWNS = 13
"""Rotation R_cam_body by rows (0 to 8), scale (9), translation of body in camera (10 to 12)."""


@jit
def normal_matrix(camera, camera_turn, body, body_turn, weight):
    """Return the matrix N (13, 13) and the number of motions.

    For x = (r, s, t) the sum over all pairs of poses is x^T N x, of the squares of

        R_B R - R R_A   and, times `weight`,   (I - R_B) t + R t_A - s t_B,

    where B and A are the motions of camera and body from the first to the second pose of a pair.
    """
    N = np.zeros((UNKNOWNS, UNKNOWNS))
    row, products = np.empty(UNKNOWNS), np.zeros((9, 9))
    R_A, R_B, t_A, t_B = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(3)
    count = 0
    for i in range(len(camera) - 1):
        for j in range(i + 1, len(camera)):
            _motion(camera, camera_turn, i, j, R_B, t_B)
            _motion(body, body_turn, i, j, R_A, t_A)
            count += 1
            for a in range(3):
                for b in range(3):
                    for c in range(3):
                        for d in range(3):
                            products[3 * a + c, 3 * b + d] += R_B[a, b] * R_A[c, d]
                row[:] = 0.0
                for b in range(3):
                    row[3 * a + b] = t_A[b]
                    row[10 + b] = (1.0 if a == b else 0.0) - R_B[a, b]
                row[9] = -t_B[a]
                for k in range(UNKNOWNS):
                    if row[k] != 0.0:
                        for m in range(UNKNOWNS):
                            N[k, m] += weight * row[k] * row[m]
    # |R_B R - R R_A|^2 = 2 |r|^2 - 2 r^T (R_B kron R_A) r, because turns keep lengths.
    N[:9, :9] += 2.0 * count * np.eye(9) - products - products.T
    return N, count


@jit
def _motion(position, turn, i, j, R, t):
    """Set R to R_i^T R_j and t to R_i^T (p_j - p_i)."""
    R[:], t[:] = 0.0, 0.0
    for a in range(3):
        for c in range(3):
            t[a] += turn[i, c, a] * (position[j, c] - position[i, c])
            for b in range(3):
                R[a, b] += turn[i, c, a] * turn[j, c, b]


@jit
def cost(Q, R):
    """Return x^T Q x for x = (R by rows, 1)."""
    x = _lifted(R)
    return float(x @ (Q @ x))


@jit
def _lifted(R):
    x = np.ones(10)
    for a in range(3):
        for b in range(3):
            x[3 * a + b] = R[a, b]
    return x


@jit
def polish(Q, start, limit):
    """Return the rotation at the local minimum of `cost` reached from `start` by Newton's method.

    Steps are damped (Levenberg, Marquardt) until the cost falls.
    """
    R = start.copy()
    best = cost(Q, R)
    damping = 0.0
    G = np.zeros((3, 10))
    for _ in range(limit):
        Qx = Q @ _lifted(R)
        for k in range(3):
            # d/dphi_k of exp(phi) R: row i + 1 moves by row i + 2, and back.
            i, j = (k + 1) % 3, (k + 2) % 3
            G[k] = 0.0
            for b in range(3):
                G[k, 3 * i + b] = -R[j, b]
                G[k, 3 * j + b] = R[i, b]
        gradient = G @ Qx
        H = G @ Q @ G.T
        M = np.zeros((3, 3))
        for a in range(3):
            for b in range(3):
                for c in range(3):
                    M[a, b] += Qx[3 * a + c] * R[b, c]
        for k in range(3):
            H[k, k] -= M[0, 0] + M[1, 1] + M[2, 2]
            for m in range(3):
                H[k, m] += 0.5 * (M[k, m] + M[m, k])
        values, vectors = np.linalg.eigh(H)
        top = max(np.abs(values).max(), 1e-300)
        along = vectors.T @ gradient
        fell = False
        for _ in range(40):
            step = np.zeros(3)
            for k in range(3):
                step[k] = -along[k] / (max(np.abs(values[k]), 1e-12 * top) + damping)
            moved = _turned(vectors @ step, R)
            value = cost(Q, moved)
            if value < best:
                fell = True
                break
            damping = max(4.0 * damping, 1e-3 * top)
        if not fell:
            break
        done = np.abs(step).max() < 1e-12
        R, best = moved, value
        damping *= 0.1
        if damping < 1e-6 * top:
            damping = 0.0
        if done:
            break
    return R


@jit
def _turned(vector, R):
    """Return exp(vector) R, by way of a unit quaternion."""
    angle = np.sqrt(vector @ vector)
    q = np.array([1.0, 0.0, 0.0, 0.0])
    if angle > 0.0:
        q[0] = np.cos(0.5 * angle)
        q[1:] = np.sin(0.5 * angle) / angle * vector
    w, x, y, z = q
    T = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return T @ R

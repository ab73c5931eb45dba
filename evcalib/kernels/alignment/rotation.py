"""Rotations that align two sets of directions."""

import numpy as np

from evcalib.kernels.jit import jit


@jit
def best_rotation(H):
    """Return R that maximises trace(R^T H), H = sum_i w_i d_i e_i^T (Davenport's q-method).

    The largest eigenvector of Davenport's 4 x 4 matrix is the quaternion, so a reflection cannot
    come out, planar data included.
    """
    K = np.empty((4, 4))
    K[0, 0] = H[0, 0] + H[1, 1] + H[2, 2]
    K[1, 1] = H[0, 0] - H[1, 1] - H[2, 2]
    K[2, 2] = H[1, 1] - H[0, 0] - H[2, 2]
    K[3, 3] = H[2, 2] - H[0, 0] - H[1, 1]
    K[0, 1] = H[2, 1] - H[1, 2]
    K[0, 2] = H[0, 2] - H[2, 0]
    K[0, 3] = H[1, 0] - H[0, 1]
    K[1, 2] = H[0, 1] + H[1, 0]
    K[1, 3] = H[0, 2] + H[2, 0]
    K[2, 3] = H[1, 2] + H[2, 1]
    return matrix_of(largest_eigenvector(K))


@jit
def largest_eigenvector(K):
    """Return the unit eigenvector of the largest eigenvalue; reads K's upper triangle (Jacobi)."""
    A = K.copy()
    V = np.eye(4)
    for _ in range(20):
        off = 0.0
        for p in range(3):
            for q in range(p + 1, 4):
                off += A[p, q] * A[p, q]
        total = A[0, 0] ** 2 + A[1, 1] ** 2 + A[2, 2] ** 2 + A[3, 3] ** 2
        if off <= 1e-30 * total:
            break
        for p in range(3):
            for q in range(p + 1, 4):
                _rotate(A, V, p, q)
    best = 0
    for p in range(1, 4):
        if A[p, p] > A[best, best]:
            best = p
    return V[:, best].copy()


@jit
def _rotate(A, V, p, q):
    """Zero A[p, q] by one Jacobi rotation, keeping only the upper triangle."""
    if A[p, q] == 0.0:
        return
    theta = 0.5 * (A[q, q] - A[p, p]) / A[p, q]
    sign = 1.0 if theta >= 0 else -1.0
    t = sign / (abs(theta) + np.sqrt(theta * theta + 1.0))
    c = 1.0 / np.sqrt(t * t + 1.0)
    s = t * c
    A[p, p] -= t * A[p, q]
    A[q, q] += t * A[p, q]
    A[p, q] = 0.0
    for r in range(4):
        if r != p and r != q:
            i, j = (r, p) if r < p else (p, r)
            k, m = (r, q) if r < q else (q, r)
            at_p, at_q = A[i, j], A[k, m]
            A[i, j] = c * at_p - s * at_q
            A[k, m] = s * at_p + c * at_q
        v_p, v_q = V[r, p], V[r, q]
        V[r, p] = c * v_p - s * v_q
        V[r, q] = s * v_p + c * v_q


@jit
def matrix_of(q):
    """Return the rotation matrix of a unit quaternion (w, x, y, z)."""
    w, x, y, z = q
    R = np.empty((3, 3))
    R[0, 0] = 1 - 2 * (y * y + z * z)
    R[0, 1] = 2 * (x * y - w * z)
    R[0, 2] = 2 * (x * z + w * y)
    R[1, 0] = 2 * (x * y + w * z)
    R[1, 1] = 1 - 2 * (x * x + z * z)
    R[1, 2] = 2 * (y * z - w * x)
    R[2, 0] = 2 * (x * z - w * y)
    R[2, 1] = 2 * (y * z + w * x)
    R[2, 2] = 1 - 2 * (x * x + y * y)
    return R


@jit
def tukey_pass(e, d, weight, R, loss_scale, work):
    """Return H re-weighted by Tukey's biweight of each residual 1 - d . R e, and the summed score.

    e, d : (3, n) columns; weight : (n,).
    loss_scale : residual from which on a pair counts nothing; the weight is
        (1 - residual / scale)^2 and the score (1 - residual / scale)^3, both 0 beyond.
    work : (3, n) scratch.
    """
    inverse = 1.0 / loss_scale
    total = 0.0
    r00, r01, r02 = R[0, 0], R[0, 1], R[0, 2]
    r10, r11, r12 = R[1, 0], R[1, 1], R[1, 2]
    r20, r21, r22 = R[2, 0], R[2, 1], R[2, 2]
    score = np.empty(weight.size)
    for i in range(weight.size):
        x, y, z = e[0, i], e[1, i], e[2, i]
        fit = d[0, i] * (r00 * x + r01 * y + r02 * z)
        fit += d[1, i] * (r10 * x + r11 * y + r12 * z)
        fit += d[2, i] * (r20 * x + r21 * y + r22 * z)
        rest = max(0.0, 1.0 - (1.0 - fit) * inverse)
        w = weight[i] * rest * rest
        work[0, i] = w * d[0, i]
        work[1, i] = w * d[1, i]
        work[2, i] = w * d[2, i]
        score[i] = w * rest
    for i in range(weight.size):
        total += score[i]
    return work @ e.T, total

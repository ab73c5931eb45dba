"""Loops of the authors' released procedure (see evcalib.baselines.authors)."""

import numpy as np

from evcalib.kernels.alignment.rotation import best_rotation
from evcalib.kernels.jit import jit

RIDGE = 1e-5
TINY = 1e-10


@jit
def kabsch(v_e, v_o):
    """Return R that maximises sum_i v_o_i . R v_e_i."""
    U, _, Vt = np.linalg.svd(v_o.T @ v_e)
    turn = np.eye(3)
    turn[2, 2] = np.sign(np.linalg.det(U @ Vt))
    return U @ turn @ Vt


@jit
def multiplied_weights(v_e, v_o, floor, iterations):
    """Return R after re-weighting where each weight multiplies what is already weighted."""
    scaled, target = np.ascontiguousarray(v_e.T), np.ascontiguousarray(v_o.T)
    R = best_rotation(target @ scaled.T)
    for _ in range(iterations - 1):
        for i in range(len(v_e)):
            x, y, z = target[0, i], target[1, i], target[2, i]
            a = scaled[0, i] - (R[0, 0] * x + R[1, 0] * y + R[2, 0] * z)
            b = scaled[1, i] - (R[0, 1] * x + R[1, 1] * y + R[2, 1] * z)
            c = scaled[2, i] - (R[0, 2] * x + R[1, 2] * y + R[2, 2] * z)
            gain = 1.0 / max(floor, np.sqrt(a * a + b * b + c * c))
            scaled[0, i] *= gain
            scaled[1, i] *= gain
            scaled[2, i] *= gain
        R = best_rotation(target @ scaled.T)
    return R


@jit
def correlation_curve(t_e, v_e, t_o, coefficients, offsets):
    """Return the first canonical correlation at each offset."""
    n = t_e.size
    mean_e, cov_ee = np.zeros(3), np.zeros((3, 3))
    for i in range(n):
        mean_e += v_e[i] / n
    for i in range(n):
        for a in range(3):
            for b in range(3):
                cov_ee[a, b] += (v_e[i, a] - mean_e[a]) * (v_e[i, b] - mean_e[b]) / n

    curve = np.empty(offsets.size)
    centred, shifted = v_e - mean_e, np.empty((n, 3))
    for k in range(offsets.size):
        _spline(t_e, offsets[k], t_o, coefficients, shifted)
        cov_oo, cov_eo = np.zeros((3, 3)), np.zeros((3, 3))
        for a in range(3):
            shifted[:, a] -= shifted[:, a].mean()
        for i in range(n):
            for a in range(3):
                left, right = centred[i, a], shifted[i, a]
                for b in range(3):
                    cov_eo[a, b] += left * shifted[i, b]
                    cov_oo[a, b] += right * shifted[i, b]
        curve[k] = _first_correlation(cov_ee, cov_oo / n, cov_eo / n, n)
    return curve


@jit
def _spline(t_e, offset, t_o, coefficients, out):
    j = 0
    last = t_o.size - 2
    for i in range(t_e.size):
        t = t_e[i] + offset
        while j < last and t >= t_o[j + 1]:
            j += 1
        u = t - t_o[j]
        for a in range(3):
            value = coefficients[0, j, a] * u + coefficients[1, j, a]
            out[i, a] = (value * u + coefficients[2, j, a]) * u + coefficients[3, j, a]


@jit
def _first_correlation(cov_ee, cov_oo, cov_eo, n):
    """Weights from standardised, ridged covariances; correlation from the plain ones."""
    scale = n / (n - 1.0)
    sd_e, sd_o = np.empty(3), np.empty(3)
    for a in range(3):
        sd_e[a] = np.sqrt(cov_ee[a, a]) + TINY
        sd_o[a] = np.sqrt(max(cov_oo[a, a], 0.0)) + TINY
    S_ee, S_oo, S_eo = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            ridge = RIDGE if a == b else 0.0
            S_ee[a, b] = scale * cov_ee[a, b] / (sd_e[a] * sd_e[b]) + ridge
            S_oo[a, b] = scale * cov_oo[a, b] / (sd_o[a] * sd_o[b]) + ridge
            S_eo[a, b] = scale * cov_eo[a, b] / (sd_e[a] * sd_o[b]) + ridge
    inv_oo = _inverse(S_oo)
    K = _product(inv_oo, S_eo.T)
    w_e = _leading_vector(_product(_product(_inverse(S_ee), S_eo), K))
    w_o = np.zeros(3)
    for a in range(3):
        for b in range(3):
            w_o[a] += K[a, b] * w_e[b]
    num, var_e, var_o = 0.0, 0.0, 0.0
    for a in range(3):
        for b in range(3):
            num += w_e[a] * cov_eo[a, b] * w_o[b]
            var_e += w_e[a] * cov_ee[a, b] * w_e[b]
            var_o += w_o[a] * cov_oo[a, b] * w_o[b]
    return num / np.sqrt(var_e * var_o)


@jit
def _product(A, B):
    C = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            for c in range(3):
                C[a, b] += A[a, c] * B[c, b]
    return C


@jit
def _inverse(A):
    adj = _adjugate(A)
    return adj / (A[0, 0] * adj[0, 0] + A[0, 1] * adj[1, 0] + A[0, 2] * adj[2, 0])


@jit
def _leading_vector(A):
    """Return the eigenvector of the largest eigenvalue of a matrix with real, positive ones."""
    trace = A[0, 0] + A[1, 1] + A[2, 2]
    adj = _adjugate(A)
    minors = adj[0, 0] + adj[1, 1] + adj[2, 2]
    det = A[0, 0] * adj[0, 0] + A[0, 1] * adj[1, 0] + A[0, 2] * adj[2, 0]
    value = trace
    for _ in range(100):
        f = ((value - trace) * value + minors) * value - det
        slope = (3 * value - 2 * trace) * value + minors
        if slope == 0:
            break
        step = f / slope
        value -= step
        if abs(step) <= 1e-15 * abs(value):
            break
    shifted = A.copy()
    for a in range(3):
        shifted[a, a] -= value
    adj = _adjugate(shifted)
    best = 0
    for b in range(1, 3):
        if np.abs(adj[:, b]).sum() > np.abs(adj[:, best]).sum():
            best = b
    return adj[:, best] / np.sqrt((adj[:, best] ** 2).sum())


@jit
def _adjugate(A):
    out = np.empty((3, 3))
    for a in range(3):
        i, j = (a + 1) % 3, (a + 2) % 3
        for b in range(3):
            k, m = (b + 1) % 3, (b + 2) % 3
            out[b, a] = A[i, k] * A[j, m] - A[i, m] * A[j, k]
    return out

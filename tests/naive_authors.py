"""The released procedure's correlation curve in plain numpy and scipy, a candidate at a time."""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import inv, sqrtm, svd


def correlation(v_e, v_o):
    """First canonical correlation: weights from standardised data, applied to plain data."""
    x = (v_e - v_e.mean(axis=0)) / (v_e.std(axis=0) + 1e-10)
    y = (v_o - v_o.mean(axis=0)) / (v_o.std(axis=0) + 1e-10)
    cov = np.cov(np.hstack([x, y]).T)
    ridge = 1e-5 * np.eye(3)
    white_x = sqrtm(inv(cov[:3, :3] + ridge))
    white_y = sqrtm(inv(cov[3:, 3:] + ridge))
    u, _, vt = svd(white_x.T @ (cov[:3, 3:] + ridge) @ white_y)
    return np.corrcoef(v_e @ (white_x @ u[:, 0]), v_o @ (white_y @ vt[0]))[0, 1]


def correlation_curve(t_e, v_e, t_o, v_o, offsets):
    """Correlation at each offset, the odometry interpolated by a cubic spline."""
    spline = CubicSpline(t_o, v_o)
    return np.array([correlation(v_e, spline(t_e + offset)) for offset in offsets])

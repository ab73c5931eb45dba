"""Certifiably globally optimal hand-eye calibration (Giamou, Ma, Peretroukhin, Kelly 2019).

Eq. 2, with translation and scale eliminated by a Schur complement, is a quadratic form of the
rotation alone (see :mod:`evcalib.baselines.hand_eye`).  What makes it hard is that R must be a
rotation, which 21 quadratic equations say, some of them redundant, and a 22nd that makes them
homogeneous::

    minimise  x^T Q x,   x = (R by rows, y)
    so that   R R^T = y^2 I,   R^T R = y^2 I,   R_i x R_j = y R_k (columns),   y^2 = 1

The dual problem is a semidefinite program of one 10 x 10 matrix::

    maximise  gamma   so that   Z = Q + sum_i lambda_i P_i - gamma E  is positive semidefinite

Its optimum bounds the cost of every rotation from below.  Where a rotation meets the bound there is
no better one: that is the certificate.
"""

from __future__ import annotations

import threading
import warnings
from dataclasses import dataclass
from functools import cache
from itertools import combinations_with_replacement
from typing import Any

import numpy as np

from evcalib.arrays import Floats
from evcalib.baselines.hand_eye import HandEye, Quadratic, minimise, quadratic, solution
from evcalib.errors import InputError
from evcalib.geometry import unit
from evcalib.kernels.baselines import hand_eye as kernel
from evcalib.poses import PoseSeries, associate, motions

CERTIFIED = 1e-4
"""Relative gap up to which a solution is proved to be the best one: what the solver reaches where
it converges (`tests/test_cgoc.py`), and far below any difference that a rotation makes."""

EXACT = 1e-6
"""Cost, as a share of the largest eigenvalue of Q, below which the gap is compared with this:
the solver tells no smaller cost from zero."""

TOLERANCES = {"tol_gap_abs": 1e-12, "tol_gap_rel": 1e-10, "tol_feas": 1e-10}
"""Of the solver, tight because the cost may be a small share of Q."""

_LOCK = threading.Lock()


@dataclass(frozen=True, eq=False)
class Certificate:
    """What the dual problem proves.

    Attributes
    ----------
    bound : float
        No rotation has a cost below this.
    gap : float
        Cost of the solution less the bound.
    relative_gap : float
        The same as a share of the cost (or of the smallest cost that the solver can tell from 0).
    min_eigenvalue : float
        Smallest eigenvalue of Z; where it is negative, by rounding, the bound is lowered by
        four times its size (x^T x = 4), so that it holds.
    certified : bool
        Whether the relative gap is at most 1e-4.
    """

    bound: float
    gap: float
    relative_gap: float
    min_eigenvalue: float
    certified: bool


@dataclass(frozen=True, eq=False)
class Certified:
    """A solution of AX = XB and its certificate."""

    solution: HandEye
    certificate: Certificate


def cgoc(
    camera: PoseSeries,
    body: PoseSeries,
    *,
    offset: float = 0.0,
    monocular: bool = True,
    translation_weight: float = 1.0,
) -> Certified:
    """Align two trajectories and prove that no other rotation does better.

    Parameters
    ----------
    camera, body : PoseSeries
        Trajectories.
    offset : float
        ``t_body = t_cam + offset`` [s] to associate poses with.
    monocular : bool
        Whether the scale of the camera's trajectory is an unknown, or 1.
    translation_weight : float
        See :func:`evcalib.baselines.hand_eye.hand_eye`.

    Raises
    ------
    InputError
        If the trajectories are unusable, or cvxpy and Clarabel are not installed.
    """
    pairs = motions(camera, body, associate(camera, body, np.array([offset])), offset)
    form = quadratic(pairs, monocular=monocular, weight=translation_weight)
    R, certificate = certify(form)
    return Certified(solution(form, R, offset), certificate)


def certify(form: Quadratic) -> tuple[Floats, Certificate]:
    """Return the best R_cam_body of a quadratic form, and the certificate from the dual problem."""
    size = max(float(np.linalg.eigvalsh(form.Q)[-1]), 1e-300)
    Z, gamma = _solve(form.Q / size)
    values, vectors = np.linalg.eigh(Z)
    R = minimise(form, _rounded(vectors[:, 0]))
    cost = kernel.cost(form.Q, R)
    bound = size * (gamma + 4.0 * min(float(values[0]), 0.0))
    relative = (cost - bound) / max(cost, EXACT * size)
    return R, Certificate(
        bound=bound,
        gap=cost - bound,
        relative_gap=relative,
        min_eigenvalue=size * float(values[0]),
        certified=relative <= CERTIFIED,
    )


def _rounded(x: Floats) -> Floats:
    """Return the rotation next to a null vector of Z, which is (R by rows, 1) up to a factor.

    In the plane there are two solutions, a half turn apart, of which the null vectors mix; any
    rotation is a start then.
    """
    U, _, Vt = np.linalg.svd(unit(x)[:9].reshape(3, 3) * (np.sign(x[9]) or 1.0))
    return np.ascontiguousarray(U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt)


def _constraints() -> Floats:
    """Return the 21 matrices (10, 10) of ``x^T P x = 0`` for x = (R by rows, y)."""
    entry = np.arange(9).reshape(3, 3)
    out = []
    for index in (entry, entry.T):
        for i, j in combinations_with_replacement(range(3), 2):
            P = np.zeros((10, 10))
            np.add.at(P, (index[i], index[j]), 1.0)
            P[9, 9] = -1.0 if i == j else 0.0
            out.append(P)
    for k in range(3):
        first, second, third = (entry[:, (k + n) % 3] for n in range(3))
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            P = np.zeros((10, 10))
            P[first[b], second[c]] = 1.0
            P[first[c], second[b]] = -1.0
            P[third[a], 9] = -1.0
            out.append(P)
    return np.array([0.5 * (P + P.T) for P in out])


@cache
def _dual() -> tuple[Any, Any, Any, Any]:
    """Return the dual problem, its parameter Q, and the variables Z and gamma, compiled once."""
    try:
        import cvxpy
    except ImportError:
        raise InputError(
            'cgoc solves a semidefinite program: pip install "evcalib[rivals]"'
        ) from None
    Q = cvxpy.Parameter((10, 10), symmetric=True)
    gamma, multipliers = cvxpy.Variable(), cvxpy.Variable(21)
    E = np.zeros((10, 10))
    E[9, 9] = 1.0
    P = _constraints()
    total = cvxpy.reshape(P.reshape(21, 100).T @ multipliers, (10, 10), order="C")
    Z = Q + total - gamma * E
    return cvxpy.Problem(cvxpy.Maximize(gamma), [Z >> 0]), Q, Z, gamma


def _solve(Q: Floats) -> tuple[Floats, float]:
    """Return Z and gamma at the optimum of the dual problem."""
    with _LOCK:
        problem, parameter, Z, gamma = _dual()
        import cvxpy

        parameter.value = Q
        try:
            # An inaccurate solution is no matter: its bound takes account of what Z lacks.
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", "Solution may be inaccurate", UserWarning)
                problem.solve(solver="CLARABEL", **TOLERANCES)
        except cvxpy.error.SolverError as error:
            raise InputError(f"cgoc: the semidefinite program was not solved: {error}") from None
        if Z.value is None:
            raise InputError(f"cgoc: the semidefinite program was not solved: {problem.status}")
        found = np.asarray(Z.value)
        return 0.5 * (found + found.T), float(gamma.value)

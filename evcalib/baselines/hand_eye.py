"""Hand-eye calibration AX = XB of two trajectories (the paper's Eq. 2, its arg max an arg min).

With A a motion of the body and B the same motion of the camera, X = T_body_cam solves A X = X B.
Here it is written for the inverse Y = X^-1, B Y = Y A, because then a scale of the camera's
trajectory enters linearly too (Wise et al. 2020)::

    R_B R - R R_A = 0        (I - R_B) t + R t_A - s t_B = 0,       R = R_cam_body.

Without turning, I - R_B is zero: the lever arm drops out, and what is left is R t_A = s t_B, the
registration of two sets of translations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize
from scipy.spatial.transform import Rotation

from evcalib.alignment.observability import axis_name
from evcalib.alignment.offset import OffsetCurve, candidate_offsets
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.geometry import rotation_vector
from evcalib.kernels.baselines import hand_eye as kernel
from evcalib.poses import Motions, PoseSeries, associate, motions

SEARCH_STEP = 0.1
"""Grid of the search for the offset [s]; trajectories are integrals, and smooth.  A choice: the
peak is refined between the points."""

LEVER_TOLERANCE = np.radians(1.0)
"""Root mean square turn [rad] of the camera about the other axes below which the lever arm along an
axis is unobservable.  It is absolute: a share of the largest turn would call noise a motion."""

TURN_SPREAD = 0.1
"""Share of the largest spread of axes from which rotations alone determine the closed form; a
choice of the start, which the iterations then leave (`tests/test_hand_eye.py`)."""

SPREAD_TOLERANCE = np.radians(1.0)
"""Root mean square angle [rad] between the motions below which they are one line, about which the
rotation is unobservable: `HEADING_BIAS` rounded up."""

CUBE = Rotation.create_group("O").as_matrix()
"""The 24 rotations of a cube: starts all over SO(3), none farther than 63 degrees from one."""


@dataclass(frozen=True, eq=False)
class HandEye:
    """A solution of AX = XB.

    Attributes
    ----------
    R_body_cam : ndarray, shape (3, 3)
        Rotation.
    lever_arm : ndarray, shape (3,)
        Position of the camera in the body frame [m]; NaN along body axes where it is unobservable.
    reason : str
        What is unobservable and why; empty if nothing is.
    unknown_axis : ndarray, shape (3,), optional
        Body axis about which the rotation is unobservable.
    scale : float
        Metres per unit of the camera's trajectory.
    offset : float
        ``t_body = t_cam + offset`` [s], as given or estimated.
    cost : float
        Sum of the squares of Eq. 2 over all motions, per motion.
    curve : OffsetCurve, optional
        Share of the largest cost that each candidate offset saves, if the offset was searched.
    """

    R_body_cam: Floats
    lever_arm: Floats
    reason: str
    unknown_axis: Floats | None
    scale: float
    offset: float
    cost: float
    curve: OffsetCurve | None = None


@dataclass(frozen=True, eq=False)
class Quadratic:
    """Eq. 2 as a quadratic form of the rotation, with all else eliminated.

    Attributes
    ----------
    Q : ndarray, shape (10, 10)
        ``cost = x^T Q x`` with x = (R_cam_body by rows, 1).
    recover : ndarray, shape (4, 10)
        Scale and translation (of the body, in the camera frame) at the least cost, from x.
    hidden : ndarray, shape (3, k)
        Directions in the camera frame along which the translation is unobservable.
    """

    Q: Floats
    recover: Floats
    hidden: Floats


def hand_eye(
    camera: PoseSeries,
    body: PoseSeries,
    *,
    offset: float = 0.0,
    max_offset: float | None = None,
    monocular: bool = True,
    translation_weight: float = 1.0,
) -> HandEye:
    """Align two trajectories by least squares of Eq. 2.

    A closed form starts it: the axes of rotation (Park and Martin 1994) where they span a plane,
    else those and the translations together.  From it and from its 23 turns by a cube's rotations
    the best four are polished by Newton's method on SO(3).

    Parameters
    ----------
    camera, body : PoseSeries
        Trajectories.
    offset : float
        ``t_body = t_cam + offset`` [s] to associate poses with.
    max_offset : float, optional
        If given, the offset is an unknown: it is searched within +-max_offset [s] around `offset`.
    monocular : bool
        Whether the scale of the camera's trajectory is an unknown, or 1.
    translation_weight : float
        Weight of squared metres against squares of rotation matrices, which Eq. 2 adds as they are.

    Raises
    ------
    InputError
        If the trajectories share fewer than three instants, or one of them does not move.
    """
    if max_offset is None:
        t = associate(camera, body, np.array([offset]))
        pairs = motions(camera, body, t, offset)
        form = quadratic(pairs, monocular=monocular, weight=translation_weight)
        return solution(form, minimise(form, closed_form(pairs)), offset)

    candidates = offset + candidate_offsets(max_offset, min(SEARCH_STEP, max_offset / 2))
    t = associate(camera, body, candidates)

    def best(candidate: float) -> tuple[float, Quadratic, Floats]:
        pairs = motions(camera, body, t, candidate)
        form = quadratic(pairs, monocular=monocular, weight=translation_weight)
        R = minimise(form, closed_form(pairs))
        return float(kernel.cost(form.Q, R)), form, R

    costs = np.array([best(candidate)[0] for candidate in candidates])
    lowest = int(np.argmin(costs))
    low = float(candidates[lowest])
    step = float(candidates[1] - candidates[0])
    bounds = (max(low - step, candidates[0]), min(low + step, candidates[-1]))
    found = optimize.minimize_scalar(
        lambda x: best(x)[0], bounds=bounds, method="bounded", options={"xatol": 1e-4}
    )
    _, form, R = best(float(found.x))
    curve = OffsetCurve(
        method="hand_eye",
        offsets=candidates,
        score=1.0 - costs / max(float(costs.max()), 1e-300),
        overlap=np.ones(candidates.size),
        offset=float(found.x),
        second_peak_ratio=np.nan,
        at_edge=lowest in (0, candidates.size - 1),
    )
    return replace(solution(form, R, curve.offset), curve=curve)


def quadratic(pairs: Motions, *, monocular: bool = True, weight: float = 1.0) -> Quadratic:
    """Return Eq. 2 per motion as a form of the rotation; translation and scale by Schur complement.

    Raises
    ------
    InputError
        If the camera or the body does not move.
    """
    for name, position in (("camera", pairs.camera), ("body", pairs.body)):
        if not np.ptp(position, axis=0).any():
            raise InputError(f"trajectories: the {name} does not move")
    arrays = (pairs.camera, pairs.camera_turn, pairs.body, pairs.body_turn)
    N, count = kernel.normal_matrix(*map(np.ascontiguousarray, arrays), float(weight))
    N /= count
    values, vectors = np.linalg.eigh(N[10:, 10:] / weight)
    seen = values > LEVER_TOLERANCE**2
    # Unknowns that are eliminated: what is seen of the translation, and the scale.
    basis = np.zeros((13, int(seen.sum()) + monocular))
    basis[10:, monocular:] = vectors[:, seen]
    if monocular:
        basis[9, 0] = 1.0
    inverse = np.linalg.pinv(basis.T @ N @ basis, rcond=1e-12, hermitian=True)
    eliminate = -inverse @ basis.T @ N[:, :10]
    keep = np.eye(10)
    if monocular:
        keep[9, 9] = 0.0
    eliminate = eliminate @ keep
    full = np.vstack([keep, np.zeros((3, 10))]) + basis @ eliminate
    Q = full.T @ N @ full
    return Quadratic(0.5 * (Q + Q.T), full[9:], vectors[:, ~seen])


def closed_form(pairs: Motions) -> Floats:
    """Return a first R_cam_body from axes of rotation, with translations where axes do not do."""
    step = max(len(pairs.camera) // 10, 1)
    R_B, t_B = _steps(pairs.camera, pairs.camera_turn, step)
    R_A, t_A = _steps(pairs.body, pairs.body_turn, step)
    H = _axes(R_B).T @ _axes(R_A)
    spread = np.linalg.svd(H, compute_uv=False)
    if spread[1] <= max(TURN_SPREAD * spread[0], len(R_B) * LEVER_TOLERANCE**2):
        H = H + t_B.T @ t_A / max(float(np.linalg.norm(t_B) * np.linalg.norm(t_A)), 1e-300)
    U, _, Vt = np.linalg.svd(H)
    return U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt


def _steps(position: Floats, turn: Floats, step: int) -> tuple[Floats, Floats]:
    back = turn[:-step].transpose(0, 2, 1)
    return back @ turn[step:], np.einsum("nab,nb->na", back, position[step:] - position[:-step])


def _axes(turn: Floats) -> Floats:
    """Return rotation vectors (n, 3), without looking at turns that are none."""
    if np.all(turn == np.eye(3)):
        return np.zeros((len(turn), 3))
    return rotation_vector(turn)


def minimise(form: Quadratic, start: Floats, *, polished: int = 4) -> Floats:
    """Return the R_cam_body of least cost and positive scale, from a start and its cube's turns."""
    starts = CUBE @ start
    x = np.hstack([starts.reshape(len(starts), 9), np.ones((len(starts), 1))])
    order = np.argsort(np.einsum("na,ab,nb->n", x, form.Q, x), kind="stable")[:polished]
    found = [kernel.polish(form.Q, np.ascontiguousarray(starts[k]), 100) for k in order]
    # In the plane, a half turn and a negative scale cancel.
    return min(found, key=lambda R: (_scale(form, R) <= 0, kernel.cost(form.Q, R)))


def _scale(form: Quadratic, R: Floats) -> float:
    return float(form.recover[0] @ np.append(R.ravel(), 1.0))


def solution(form: Quadratic, R: Floats, offset: float) -> HandEye:
    """Return all unknowns at R_cam_body, with NaN for what is unobservable."""
    lifted = np.append(R.ravel(), 1.0)
    scale, *translation = form.recover @ lifted
    lever = -R.T @ np.array(translation)
    hidden = R.T @ form.hidden
    lost = np.linalg.norm(hidden, axis=1) > 0.1
    axis = _unknown_axis(form, R)
    return HandEye(
        R_body_cam=np.ascontiguousarray(R.T),
        lever_arm=np.where(lost, np.nan, lever),
        reason=_reason(form.hidden.shape[1], axis),
        unknown_axis=axis,
        scale=float(scale),
        offset=float(offset),
        cost=max(float(kernel.cost(form.Q, np.ascontiguousarray(R))), 0.0),
    )


def _unknown_axis(form: Quadratic, R: Floats) -> Floats | None:
    """Return the body axis about which the cost hardly changes when the rotation turns."""
    turned = np.zeros((3, 10))
    turned[:, :9] = [(R @ np.cross(np.eye(3), axis)).ravel() for axis in np.eye(3)]
    values, vectors = np.linalg.eigh(turned @ form.Q @ turned.T)
    return vectors[:, 0] if values[0] <= SPREAD_TOLERANCE**2 * values[-1] else None


def _reason(hidden: int, axis: Floats | None) -> str:
    reasons = []
    if axis is not None:
        reasons.append(f"The rotation about {axis_name(axis)} is unobservable.")
    if hidden == 3:
        reasons.append("The lever arm is unobservable: the camera does not turn.")
    elif hidden:
        reasons.append("The lever arm is unobservable along the axis about which the camera turns.")
    return " ".join(reasons)

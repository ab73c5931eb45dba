"""The turning that the events themselves show, against that of the gyro.

Matches that a gyro has turned back obey the epipolar constraint of a camera that does not turn, if
the gyro is right.  What is left over tells its bias and how it is turned against the camera.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from evcalib import checks
from evcalib.arrays import Floats, Integers
from evcalib.display import Shown
from evcalib.errors import InputError
from evcalib.geometry import rotation_vector_to_matrix
from evcalib.heading._correspondences import Correspondences
from evcalib.heading._result import HeadingEstimate
from evcalib.heading.epipolar import two_point
from evcalib.imu import Attitude, ImuSeries, attitude_of
from evcalib.kernels.heading.turn import TimedBearings, squared_residuals, turn_ransac
from evcalib.kernels.linalg import tangent_basis
from evcalib.series import bins
from evcalib.uncertainty import robust_sd, sandwich

FEWEST = 500
"""Matches below which nothing is told; a choice: a second of a lively scene has as many."""

MOST = 60_000
"""Matches that are taken, evenly; a choice of speed."""

SHARED = 0.5
"""Errors of matches go together over so much time [s], a usual track; the error bars count that."""

ROUNDS = 6
"""Steps of Gauss-Newton.  A choice, tried with a gyro that is 10 degrees off."""

LEFT = np.radians(0.2)
"""What else than the gyro's errors may turn matches [rad]: a heading that changes in its window, a
body that tilts with its acceleration.  Drives that tilt by 1 deg per m/s^2, and turn by 0.7 deg
between matches, showed turns of 2 to 14 deg that are not there (four simulated drives)."""

TOLD = np.radians(3.0)
"""Standard deviation [rad] below which the turn about an axis is told.  A choice: a gyro is mounted
by hand to a degree or two."""

TURN_SD = 1.0
"""Prior standard deviation [rad] of the turn of the gyro against what was given: none, but that
it stays finite where the camera does not turn."""


@dataclass(frozen=True, eq=False)
class GyroError(Shown):
    """What the events say of the gyro, in the axes of the camera.

    Attributes
    ----------
    bias : ndarray, shape (3,)
        What the rates of the attitude are too great by [rad/s].
    turn : ndarray, shape (3,)
        Rotation vector [rad] of the small turn that brings its rates to those of the camera.
    covariance : ndarray, shape (6, 6)
        Of bias and turn.
    matches : int
        How many tell it.
    noise : float
        Robust standard deviation of their residuals [rad].
    turning : float
        Angle by which the camera turns between the two of a match, root mean square [rad].
    """

    bias: Floats
    turn: Floats
    covariance: Floats
    matches: int
    noise: float
    turning: float

    @property
    def bias_sd(self) -> float:
        """Standard deviation of the bias [rad/s], the largest of the axes."""
        return float(np.sqrt(np.diag(self.covariance)[:3].max()))

    @property
    def _known(self) -> tuple[Floats, Floats]:
        """Axes (k, 3) about which the turn is known, and its standard deviations [rad] there."""
        left = (LEFT / max(self.turning, 1e-9)) ** 2
        variance, axes = np.linalg.eigh(self.covariance[3:, 3:] + left * np.eye(3))
        known = variance < TOLD**2
        return axes.T[known], np.sqrt(variance[known])

    @property
    def seen(self) -> Floats:
        """What is known of the turn [rad], shape (3,).

        A camera that turns about one axis only, as on a vehicle that yaws, does not show how its
        gyro is turned about that axis: that part is left out.
        """
        axes, _ = self._known
        return axes.T @ (axes @ self.turn)

    @property
    def told(self) -> bool:
        """Whether the turn is known about any axis."""
        return self._known[1].size > 0

    @property
    def angle(self) -> float:
        """Size of what is known of the turn [rad]."""
        return float(np.linalg.norm(self.seen))

    @property
    def angle_sd(self) -> float:
        """Standard deviation of that, about the worst known axis [rad]; inf if none is known."""
        _, sd = self._known
        return float(sd.max()) if sd.size else np.inf


def gyro_error(
    estimate: HeadingEstimate,
    attitude: Attitude,
    *,
    bias_sd: float = 0.05,
    turn_sd: float = TURN_SD,
) -> GyroError | None:
    """Find the bias and the turn of a gyro from the matches that it has turned back.

    Parameters
    ----------
    estimate : HeadingEstimate
        Made with the attitude, its correspondences kept.
    attitude : Attitude
        Of the gyro as it was taken to be.
    bias_sd : float
        Prior standard deviation of the bias [rad/s], about that of the attitude.
    turn_sd : float
        Prior standard deviation of the turn [rad], about that of the attitude.

    Returns
    -------
    GyroError or None
        None with too few matches.

    Raises
    ------
    InputError
        If the estimate has no correspondences.

    Notes
    -----
    Over a span dt in which the attitude turns by the rotation vector theta, a bias b and a turn
    phi leave the turn ``phi x theta - b dt``.  Every heading is unknown as well, and eliminated;
    so is, with few directions of travel, what a turn has in common with a sideways translation:
    the covariance says so.  Gauss-Newton under Tukey's loss.
    """
    checks.instance(estimate, "estimate", HeadingEstimate)
    checks.instance(attitude, "attitude", Attitude)
    found = estimate.correspondences
    if found is None:
        raise InputError("keep the correspondences (keep_correspondences=True)")
    rows = np.flatnonzero(found.inlier)
    if rows.size < FEWEST:
        return None
    rows = rows[np.linspace(0, rows.size - 1, min(rows.size, MOST)).astype(np.int64)]
    pairs = _Pairs.of(found, rows, estimate.headings.v, attitude)
    prior = np.r_[np.full(3, bias_sd), np.full(3, turn_sd)] ** -2.0
    unknowns, directions = np.zeros(6), estimate.headings.v.copy()
    covariance, noise = np.diag(1 / prior), np.inf
    for _ in range(ROUNDS):
        step, covariance, noise = _step(pairs, unknowns, directions, prior)
        unknowns = unknowns + step
    turning = float(np.sqrt(np.mean(np.sum(pairs.turn**2, axis=1))))
    return GyroError(unknowns[:3], unknowns[3:], covariance, rows.size, noise, turning)


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Matches half-way between their two times, with how the camera turned between these."""

    r1: Floats
    r2: Floats
    span: Floats
    turn: Floats
    heading: Integers
    stretch: Integers

    @classmethod
    def of(cls, c: Correspondences, rows: Integers, v: Floats, attitude: Attitude) -> _Pairs:
        t1, t2, heading = c.t1[rows], c.t2[rows], c.heading[rows]
        back = attitude.between(0.5 * (t1 + t2), t1)
        return cls(
            back.apply(c.r1[rows]),
            back.apply(c.r2[rows]),
            t2 - t1,
            attitude.between(t1, t2).as_rotvec(),
            heading,
            bins(t1 - t1.min(), SHARED),
        )

    def left(self, unknowns: Floats) -> Floats:
        """Return the turn that is left in each [rad]."""
        return np.cross(unknowns[3:], self.turn) - self.span[:, None] * unknowns[:3]


def _step(
    pairs: _Pairs, unknowns: Floats, directions: Floats, prior: Floats
) -> tuple[Floats, Floats, float]:
    """Make a step of Gauss-Newton, on directions in place; return it, covariance and noise."""
    half = Rotation.from_rotvec(0.5 * pairs.left(unknowns))
    r1, r2 = half.inv().apply(pairs.r1), half.apply(pairs.r2)
    v = directions[pairs.heading]
    size = np.sqrt(np.maximum(2 - (r1 * v).sum(1) ** 2 - (r2 * v).sum(1) ** 2, 1e-9))[:, None]
    normal = np.cross(r1, r2) / size
    residual = (normal * v).sum(axis=1)
    noise = max(robust_sd(residual), 1e-9)
    ratio = np.minimum((residual / (4.685 * noise)) ** 2, 1.0)
    weight = (1 - ratio) ** 2
    by_turn = 0.5 * (np.cross(r2, np.cross(v, r1)) - np.cross(r1, np.cross(r2, v))) / size
    shared = np.concatenate([-pairs.span[:, None] * by_turn, np.cross(pairs.turn, by_turn)], axis=1)
    bases = np.stack([tangent_basis(one) for one in directions])
    own = np.einsum("nij,nj->ni", bases[pairs.heading], normal)
    count = len(directions)

    def summed(columns: Floats) -> Floats:
        """Return the sums of columns per heading, weighted."""
        flat = (columns * weight.reshape(-1, *[1] * (columns.ndim - 1))).reshape(len(columns), -1)
        sums = np.stack([np.bincount(pairs.heading, c, count) for c in flat.T], axis=1)
        return np.asarray(sums, dtype=np.float64).reshape(count, *columns.shape[1:])

    block = summed(own[:, :, None] * own[:, None, :]) + 1e-12 * np.eye(2)
    cross = summed(own[:, :, None] * shared[:, None, :])
    pull = summed(own * residual[:, None])
    gain = np.linalg.solve(block, cross)
    reduced = shared - np.einsum("ni,nij->nj", own, gain[pairs.heading])
    information = (reduced * weight[:, None]).T @ reduced / noise**2 + np.diag(prior)
    gradient = (reduced * (weight * residual)[:, None]) / noise**2
    step = np.linalg.solve(information, -gradient.sum(axis=0) - prior * unknowns)
    directions -= np.einsum(
        "nij,ni->nj", bases, np.linalg.solve(block, (pull + cross @ step)[..., None])[..., 0]
    )
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    stretches = np.stack([np.bincount(pairs.stretch, column) for column in gradient.T], axis=1)
    # The prior is one observation of each unknown.
    every = np.concatenate([stretches, np.diag(np.sqrt(prior))])
    covariance = sandwich(information, every)
    return step, np.linalg.inv(information) if covariance is None else covariance, noise


COMMON = 0.1
"""Least share of the matches that a turn must explain to be taken for the bias.  A choice: of a
roll before spokes, where most matches are false, a fifth to a fourth agree."""

LARGEST_BIAS = 0.2
"""Rates [rad/s] above this are no bias: gyros are off by up to 20 deg/s by their data sheets, and
by 1 to 3 in files."""

AGREE_PX = 1.5
"""Largest residual [px] of a match that a turn explains, as of a heading's."""


def shared_turn(found: Correspondences, focal: float, seed: int = 0) -> Floats | None:
    """Return the steady turn that matches share which an attitude has turned back.

    For recordings in which hardly anything but turning is seen: what is left of it is the bias.

    Parameters
    ----------
    found : Correspondences
        Of windows without heading, too.
    focal : float
        Pixels per radian.
    seed : int
        Of the samples.

    Returns
    -------
    ndarray, shape (3,), or None
        The bias [rad/s] in the axes of the camera; None if too few share one, or it is too large.
    """
    if len(found) < FEWEST:
        return None
    rows = np.linspace(0, len(found) - 1, min(len(found), MOST)).astype(np.int64)
    pairs = TimedBearings(found.r1[rows], found.r2[rows], found.t2[rows] - found.t1[rows])
    half = turn_ransac(pairs, AGREE_PX / focal, 300, seed)
    squares = np.empty(rows.size)
    squared_residuals(half, pairs, squares)
    share = float(np.mean(squares < (AGREE_PX / focal) ** 2))
    # Bearings turn against the camera; rates that are too great turn them back too far.
    bias = 2.0 * np.asarray(half, dtype=np.float64)
    if share < COMMON or np.linalg.norm(bias) > LARGEST_BIAS:
        return None
    return bias


WINDOW, WINDOWS, OF_WINDOW = 0.1, 60, 300
"""Time of a window [s], windows and matches of each in which it is asked whether a gyro helps.
Choices of speed."""

HARM = 0.05
"""A gyro is refused without which this share of the matches more agree.  A choice: a right one
loses none."""

SURE = 4.0
"""Standard deviations beyond which a contradiction is one."""


def agreement(found: Correspondences, attitude: Attitude | None, focal: float) -> Floats:
    """Return which share of the matches agrees on one direction of motion, window by window.

    Parameters
    ----------
    found : Correspondences
        As the camera saw them, those of windows without heading too.
    attitude : Attitude, optional
        Turns them back; taken as they are without.
    focal : float
        Pixels per radian.

    Returns
    -------
    ndarray, shape (k,)
        Of the same windows, whatever the attitude is.
    """
    middle = 0.5 * (found.t1 + found.t2)
    window = bins(middle - middle.min(initial=np.inf), WINDOW)
    order = np.argsort(window, kind="stable")
    count = np.bincount(window)
    ends = np.cumsum(count)
    full = np.flatnonzero(count >= FEWEST_OF_WINDOW)
    full = full[np.linspace(0, full.size - 1, min(full.size, WINDOWS)).astype(np.int64)]
    shares = np.zeros(full.size)
    for k, one in enumerate(full):
        rows = order[ends[one] - count[one] : ends[one]]
        rows = rows[np.linspace(0, rows.size - 1, min(rows.size, OF_WINDOW)).astype(np.int64)]
        r1, r2 = found.r1[rows], found.r2[rows]
        if attitude is not None:
            centre = np.full(rows.size, middle[rows].mean())
            r1 = attitude.between(centre, found.t1[rows]).apply(r1)
            r2 = attitude.between(centre, found.t2[rows]).apply(r2)
        fitted = two_point(r1, r2, threshold=AGREE_PX / focal, seed=0)
        shares[k] = 0.0 if fitted is None else fitted.inliers.mean()
    return shares


FEWEST_OF_WINDOW = 40
"""Matches below which a window is not asked."""

RIGHT_HANDED = tuple(
    (signs, order)
    for order in permutations(range(3))
    for signs in product((1.0, -1.0), repeat=3)
    if np.linalg.det(np.diag(signs)[:, order]) > 0
)
"""The ways in which axes can point along those of another right-handed system."""


def refuse_harm(found: Correspondences, imu: ImuSeries, attitude: Attitude, focal: float) -> None:
    """Refuse a gyro with which the matches agree less than without, and say what would fit.

    Parameters
    ----------
    found : Correspondences
        As the camera saw them.
    imu : ImuSeries
        The samples.
    attitude : Attitude
        Made of them.
    focal : float
        Pixels per radian.

    Raises
    ------
    InputError
        With the axes that fit better, if any do.
    """
    alone, turned = agreement(found, None, focal), agreement(found, attitude, focal)
    if alone.size < 4:
        return
    lost = alone - turned
    if lost.mean() < HARM or lost.mean() < SURE * lost.std() / np.sqrt(lost.size):
        return
    best, axes = turned.mean(), ""
    for signs, order in RIGHT_HANDED:
        R = np.diag(signs)[:, order]
        share = agreement(found, attitude_of(imu, R, imu.rate.mean(axis=0)), focal).mean()
        if share > max(best, alone.mean()):
            best = share
            axes = ",".join(
                ("-" if row.sum() < 0 else "") + "xyz"[np.abs(row).argmax()] for row in R
            )
    advice = "is its unit right (--imu-unit), does its clock run with that of the events?"
    if axes:
        advice = (
            f"with the axes {axes} {100 * best:.0f} % do (--imu-rotation={axes}); else {advice}"
        )
    raise InputError(
        f"the events contradict the gyro: {100 * turned.mean():.0f} % of the matches agree with it,"
        f" {100 * alone.mean():.0f} % without it; {advice}"
    )


class Corrected(NamedTuple):
    """A gyro as the events show it: attitude, axes, bias and what it may still be off [rad/s]."""

    attitude: Attitude
    R_cam_imu: Floats
    bias: Floats
    bias_sd: float
    notes: tuple[str, ...]


def corrected(
    imu: ImuSeries,
    attitude: Attitude,
    estimate: HeadingEstimate,
    *,
    focal: float,
    R_cam_imu: Floats,
    bias: Floats | None = None,
    bias_sd: float = 0.05,
    turn: bool = False,
) -> Corrected:
    """Take bias, and turn if asked for, by what the events show.

    Parameters
    ----------
    imu : ImuSeries
        The samples.
    attitude : Attitude
        Made of them with these axes and this bias.
    estimate : HeadingEstimate
        Made with the attitude, its correspondences kept.
    focal : float
        Pixels per radian.
    R_cam_imu : ndarray, shape (3, 3)
        From the axes of the IMU to those of the camera.
    bias : ndarray, shape (3,), optional
        What the rates are too great by [rad/s]; nothing if not given.
    bias_sd : float
        Its standard deviation [rad/s].
    turn : bool
        Whether how the gyro is turned is corrected as well, where the events tell it.

    Returns
    -------
    Corrected
        And what was done, in words.

    Raises
    ------
    InputError
        If the events contradict the gyro.
    """
    found, R = estimate.correspondences, R_cam_imu
    assert found is not None
    bias = np.zeros(3) if bias is None else bias
    seen, notes = as_seen(found, attitude), list[str]()
    error = gyro_error(estimate, attitude, bias_sd=bias_sd)
    if error is None:
        alone = shared_turn(found, focal)
        if alone is None:
            refuse_harm(seen, imu, attitude, focal)
            note = "gyro: too little is seen to tell its bias, taken to be"
            return Corrected(attitude, R, bias, bias_sd, (f"{note} {in_degrees(bias)} deg/s",))
        bias, how = bias + R.T @ alone, "by a turn that all matches share"
    else:
        notes = _of_turn(error, turn)
        if not (turn and error.told):
            # A turn that is not corrected must not take a part of the bias with it.
            error = gyro_error(estimate, attitude, bias_sd=bias_sd, turn_sd=MOUNTED)
            assert error is not None
        # The bias was found in the axes of the camera as these were taken to be.
        bias, bias_sd = bias + R.T @ error.bias, error.bias_sd
        how = f"+-{np.degrees(bias_sd):.2f}, by the events"
        if turn and error.told:
            R = rotation_vector_to_matrix(error.seen) @ R
    attitude = attitude_of(imu, R, bias)
    refuse_harm(seen, imu, attitude, focal)
    notes.append(f"gyro: bias of {in_degrees(bias)} deg/s ({how})")
    return Corrected(attitude, R, bias, bias_sd, tuple(notes))


def _of_turn(error: GyroError, turn: bool) -> list[str]:
    """Return what the events say of how the gyro is turned, in words; refuse what cannot be."""
    off = f"{np.degrees(error.angle):.1f} deg (+-{np.degrees(error.angle_sd):.1f})"
    if not error.told:
        return ["the camera turns too little to tell how the gyro is turned"] if turn else []
    if turn:
        return [f"the gyro is turned by {off} against what was given, by the events: corrected"]
    if error.angle > max(WRONGLY_TURNED, SURE * error.angle_sd):
        raise InputError(
            f"the events contradict the gyro: it is turned by {off} against the camera as it was"
            " given; give how the IMU is turned (--imu-rotation), or let it be found"
            " (--imu-rotation estimate)"
        )
    if error.angle > max(TURNED, SURE * error.angle_sd):
        return [
            f"the gyro is turned by {off} against what was given, by the events"
            " (--imu-rotation estimate corrects that)"
        ]
    return []


TURNED, WRONGLY_TURNED = np.radians(3.0), np.radians(15.0)
"""A gyro that is turned by so much [rad] against what was given is told, or refused.  Choices: a
gyro is mounted by hand to a degree or two; in a wrong axis it is off by 90 degrees."""

MOUNTED = np.radians(1.0)
"""Turn that is left to a gyro while its bias is found [rad]: as exactly as one is mounted."""


def in_degrees(rates: Floats) -> str:
    """Return rates [rad/s] as a text in degrees."""
    return ", ".join(f"{rate:.2f}" for rate in np.degrees(rates))


def as_seen(found: Correspondences, attitude: Attitude) -> Correspondences:
    """Return correspondences as the camera saw them, those of which an attitude turned back.

    Parameters
    ----------
    found : Correspondences
        Turned back.
    attitude : Attitude
        By this.
    """
    return replace(found, r2=attitude.between(found.t2, found.t1).apply(found.r2))


def restabilised(found: Correspondences, old: Attitude, new: Attitude) -> Correspondences:
    """Return correspondences turned back by another attitude than the one they were made with.

    Parameters
    ----------
    found : Correspondences
        Made with the old attitude.
    old, new : Attitude
        Of the same times.
    """
    r2 = as_seen(found, old).r2
    return replace(found, r2=new.between(found.t1, found.t2).apply(r2))

"""All methods on one pair of streams, as rows and as a table of text."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from data_tools.simulation.streams import dead_reckon
from evcalib.alignment import Calibration
from evcalib.alignment.verdict import MAX_TURNING
from evcalib.arrays import Floats
from evcalib.baselines import METHODS, TRAJECTORY_METHODS, RivalInput, calibrate_with
from evcalib.errors import EvcalibError, InputError
from evcalib.geometry import matrix_to_rpy, rotation_angle
from evcalib.poses import GAP, PoseSeries
from evcalib.series import HeadingSeries, VelocitySeries, yaw_angles


@dataclass(frozen=True, eq=False)
class BaselineRow:
    """What one method made of the streams.

    Attributes
    ----------
    method : str
        Its name.
    calibration : Calibration, optional
        Its result; None if it failed.
    seconds : float
        Time that it took, compilation included.
    failure : str
        Why there is no result; empty if there is one.
    """

    method: str
    calibration: Calibration | None
    seconds: float
    failure: str = ""


def body_poses(velocities: VelocitySeries) -> PoseSeries:
    """Return the body's trajectory by dead reckoning (paper Eq. 13), turned by the yaw rate.

    A gap counts as one usual step: nobody knows how far the body went in it.
    """
    closed = VelocitySeries(
        _without_gaps(velocities.t), velocities.v, velocities.yaw_rate, velocities.frame
    )
    turn = Rotation.from_rotvec(np.outer(yaw_angles(closed), [0.0, 0.0, 1.0])).as_matrix()
    return PoseSeries(velocities.t, dead_reckon(closed), turn)


def _without_gaps(t: Floats) -> Floats:
    """Return times [s] with every gap (more than five usual steps) shortened to a usual step."""
    if t.size < 2:
        return np.zeros(t.size)
    step = np.diff(t)
    usual = float(np.median(step))
    return np.concatenate([[0.0], np.cumsum(np.where(step > GAP * usual, usual, step))])


def reckoned_poses(
    headings: HeadingSeries,
    velocities: VelocitySeries,
    speed: Floats | None = None,
    *,
    hold: float = 0.0,
) -> RivalInput:
    """Return the streams with trajectories by dead reckoning, for a body that does not turn.

    Parameters
    ----------
    headings : HeadingSeries
        Directions of the camera's motion.
    velocities : VelocitySeries
        Velocities of the body.
    speed : ndarray, shape (n,), optional
        Speed of the camera at each heading, in any unit; constant if not given.
    hold : float
        See :class:`evcalib.baselines.RivalInput`.

    Raises
    ------
    InputError
        If the body turns: headings do not tell how the camera turned with it.
    """
    rate = velocities.yaw_rate
    if rate is not None and np.sqrt(np.mean(rate**2)) > MAX_TURNING:
        raise InputError(
            "the body turns, and headings do not tell how the camera turned with it: the methods"
            " that align trajectories need the camera's (--trajectory)"
        )
    usable = headings.valid if headings.valid is not None else np.ones(len(headings), dtype=bool)
    speed = np.ones(len(headings)) if speed is None else np.asarray(speed, dtype=np.float64)
    v = headings.v[usable] * speed[usable, None]
    t = headings.t[usable]
    closed = VelocitySeries(_without_gaps(t), v, frame=headings.frame)
    camera = PoseSeries(t, dead_reckon(closed))
    return RivalInput(headings, velocities, camera, body_poses(velocities), hold)


def run_baselines(
    headings: HeadingSeries,
    velocities: VelocitySeries,
    *,
    trajectory: PoseSeries | None = None,
    methods: Sequence[str] = tuple(METHODS),
    max_offset: float = 1.0,
    hold: float = 0.0,
    seed: int = 0,
) -> list[BaselineRow]:
    """Run methods on the same streams; one that fails leaves its reason, and the others run.

    Parameters
    ----------
    headings, velocities
        The streams.
    trajectory : PoseSeries, optional
        Trajectory of the camera, on the camera clock, in any scale, for the methods that align
        trajectories; reckoned from the headings at constant speed if not given.
    methods : sequence of str
        Keys of :data:`evcalib.baselines.METHODS`.
    max_offset, hold, seed
        See :func:`evcalib.baselines.calibrate_with` and :class:`evcalib.baselines.RivalInput`.

    Raises
    ------
    InputError
        If a method is unknown.
    """
    unknown = [name for name in methods if name not in METHODS]
    if unknown:
        raise InputError(f"unknown method(s) {', '.join(unknown)}; there are {', '.join(METHODS)}")
    rows = []
    for name in methods:
        start = time.perf_counter()
        try:
            streams = RivalInput(headings, velocities, hold=hold)
            if name in TRAJECTORY_METHODS and trajectory is None:
                streams = reckoned_poses(headings, velocities, hold=hold)
            elif name in TRAJECTORY_METHODS:
                streams = replace(
                    streams, camera_poses=trajectory, body_poses=body_poses(velocities)
                )
            found = calibrate_with(name, streams, max_offset=max_offset, seed=seed)
        except EvcalibError as error:
            rows.append(BaselineRow(name, None, time.perf_counter() - start, str(error)))
        else:
            rows.append(BaselineRow(name, found, time.perf_counter() - start))
    return rows


def baseline_table(rows: Sequence[BaselineRow]) -> str:
    """Return rows as a table; the first method that has a result is what others are compared to.

    Standard deviations are given where a method states them and the motion determines the value.
    """
    first = next((row for row in rows if row.calibration is not None), None)
    lines = [
        f"{'method':18}{'offset':>10}{'sd':>8}{'roll':>9}{'pitch':>9}{'yaw':>9}{'sd':>7}"
        f"{'apart':>8}{'misfit':>8}{'time':>8}",
        f"{'':18}{'[ms]':>10}{'[ms]':>8}{'[deg]':>9}{'[deg]':>9}{'[deg]':>9}{'[deg]':>7}"
        f"{'[deg]':>8}{'[deg]':>8}{'[ms]':>8}",
    ]
    for row in rows:
        if row.calibration is None or first is None or first.calibration is None:
            lines.append(f"{row.method:18}failed: {row.failure}")
            continue
        found = row.calibration
        roll, pitch, yaw = np.degrees(matrix_to_rpy(found.R_body_cam))
        apart = np.degrees(rotation_angle(found.R_body_cam, first.calibration.R_body_cam))
        residual = np.degrees(np.median(found.residuals.angle))
        sd = _known(1e3 * found.offset_sd, found.offset_observable, ".1f")
        turn_sd = _known(np.degrees(found.rotation_sd), found.rotation_observable, ".2f")
        lines.append(
            f"{row.method:18}{1e3 * found.offset:10.1f}{sd:>8}{roll:9.2f}{pitch:9.2f}{yaw:9.2f}"
            f"{turn_sd:>7}{apart:8.2f}{residual:8.2f}{1e3 * row.seconds:8.1f}"
        )
    return "\n".join(lines)


def _known(value: float, known: bool, form: str) -> str:
    return format(value, form) if known and np.isfinite(value) else "-"

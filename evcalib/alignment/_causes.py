"""Why headings may disagree with the odometry: causes that can be tried out on the data."""

from __future__ import annotations

from dataclasses import replace

from evcalib.alignment._stream_pair import StreamPair
from evcalib.alignment.offset import find_offset
from evcalib.alignment.offset_refinement import refine_offset
from evcalib.alignment.registration import Solution
from evcalib.errors import InputError
from evcalib.geometry import turned_by_yaw
from evcalib.kinematics.velocity_track import velocity_track
from evcalib.series import HeadingSeries, VelocitySeries, yaw_angles

CLEARER = 3.0
"""How many times as many log-likelihood units as the data as given a cause must bring to be named,
beside agreement beyond chance: a choice, since several are tried."""


def likely_cause(
    headings: HeadingSeries, velocities: VelocitySeries, found: Solution, max_offset: float
) -> str:
    """Name what makes headings agree that do not agree as given, or nothing.

    Each cause is undone in the velocities, and offset and rotation are searched anew.  Signs that
    only mirror a motion in the plane are not among them: it then fits another rotation as well.

    Parameters
    ----------
    headings, velocities : HeadingSeries, VelocitySeries
        What was aligned.
    found : Solution
        What they gave.
    max_offset : float
        Half width of the search [s].

    Returns
    -------
    str
        Advice; empty where nothing helps.
    """
    best, said = CLEARER * max(found.evidence, 0.0), ""
    for advice, undone in _suspects(velocities):
        solution = _tried(headings, undone, max_offset)
        if solution is not None and solution.agrees and solution.evidence > best:
            best, said = solution.evidence, advice
    return said


def _tried(
    headings: HeadingSeries, velocities: VelocitySeries, max_offset: float
) -> Solution | None:
    try:
        track = velocity_track(velocities)
        curve = find_offset(headings, track, max_offset=max_offset)
        offset = refine_offset(headings, track, curve.offset).offset
        return Solution.at(StreamPair.of(headings, track), offset, "tukey")
    except InputError:
        return None


def _suspects(velocities: VelocitySeries) -> list[tuple[str, VelocitySeries]]:
    """Return advice, and the velocities as they would be if its cause were undone."""
    told, v = [], velocities.v
    for factor in (1000.0, 100.0):
        for axis, name in ((0, "forward"), (1, "sideways")):
            # Directions are the same if the other speed is divided, and speeds stay within bounds.
            scaled = v.copy()
            scaled[:, 1 - axis] /= factor
            told.append((
                f"The headings do agree if the {name} speed is multiplied by {factor:g}: are both"
                " speeds in the same unit?",
                replace(velocities, v=scaled),
            ))  # fmt: skip
    yaw_rate = velocities.yaw_rate
    if yaw_rate is not None and yaw_rate.any():
        yaw = yaw_angles(velocities)
        for sign, advice in (
            (-1, "The headings do agree if the velocities are turned back by the yaw: are they in"
                 " the frame of the ground (--twist-frame ground)?"),
            (1, "The headings do agree if the velocities are turned on by the yaw: are they in the"
                " body frame already, or has the yaw rate the wrong sign?"),
        ):  # fmt: skip
            told.append((advice, replace(velocities, v=turned_by_yaw(v, sign * yaw))))
    return told

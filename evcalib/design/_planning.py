"""The drive that tells most in a given time and space, or the shortest that tells enough."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np

from evcalib import checks
from evcalib.arrays import Floats
from evcalib.design._information import USUAL, Viewing
from evcalib.design._legs import USUAL_LIMITS, Driven, Ground, Legs, Limits
from evcalib.design._prediction import Prediction, predict
from evcalib.display import Shown
from evcalib.errors import InputError, NoAnswerError
from evcalib.joint import SYSTEMATIC, Systematic
from evcalib.kinematics import Vehicle
from evcalib.series import VelocitySeries

LEAST_TIME, SHORTER = 4.0, 0.8
"""Shortest drive that is looked for [s], and the share of the next longer one that each lasts."""

REFINED = 60
"""Most variants of the best drive that are tried: a choice of time."""


class Bars(NamedTuple):
    """Standard deviations that a drive is to reach.

    Parameters
    ----------
    offset : float
        Of the offset [s].
    rotation : float
        Of the rotation about the axis that shows least [rad].
    position : float, optional
        Of the worse of the position's x and y [m], where it counts.
    """

    offset: float = 0.002
    rotation: float = float(np.radians(0.1))
    position: float | None = None

    def shares(self, found: Prediction) -> Floats:
        """Return the bars of a drive in units of these."""
        pairs = [(found.offset_sd, self.offset), (found.worst_axis_sd, self.rotation)]
        if self.position is not None:
            pairs.append((float(found.position_sd.max()), self.position))
        return np.array([is_ / asked for is_, asked in pairs])


class Command(NamedTuple):
    """What to do, and from when on.

    Parameters
    ----------
    t : float
        Time [s].
    what : str
        In words.
    """

    t: float
    what: str


class Candidate(NamedTuple):
    """A drive of a family.

    How many legs, their angles and turns [rad], their blends in units of a leg, stops in units of a
    blend, and how the vehicle faces at first [rad].
    """

    family: str
    repeats: int
    angle: float
    turn: float
    blend: float
    stop: float
    facing: float = 0.0


@dataclass(frozen=True, eq=False)
class Plan(Shown):
    """A drive, and what it will tell.

    Attributes
    ----------
    kind : str
        Name of the motion.
    velocities : VelocitySeries
        Of the body's origin, from rest to rest.
    commands : tuple of Command
        The same in words.
    start : tuple of float
        Where the origin is in the space at first [m]: from its near end, and from its right side.
    facing : float
        How body X points at first, from the length of the space towards its width [rad].
    prediction : Prediction
        What it will tell.
    position_counts : bool
        Whether the position was among what the drive was chosen for.
    fingers : Plan, optional
        The paper's fingers in the same time and space, of a vehicle of this size that keeps its
        heading: those of the number and size that tell most, where any fit.
    """

    kind: str
    velocities: VelocitySeries
    commands: tuple[Command, ...]
    start: tuple[float, float]
    facing: float
    prediction: Prediction
    position_counts: bool
    fingers: Plan | None = None

    @property
    def duration(self) -> float:
        """Length of the drive [s]."""
        return float(self.velocities.t[-1])

    @property
    def text(self) -> str:
        """The plan in words."""
        along, across = self.start
        lines = [
            f"{self.kind}, {self.duration:.1f} s.",
            f"Looking along the space, place the body's origin {along:.2f} m from its near end and"
            f" {across:.2f} m from its right side, facing {np.degrees(self.facing):.0f} deg to the"
            " left.",
            *(f"{command.t:6.1f} s  {command.what}" for command in self.commands),
            f"Predicted bars: {_bars(self.prediction, self.position_counts)}.",
        ]
        if self.fingers is None:
            lines.append("The fingers of the paper do not fit into this time and space.")
        else:
            lines.append(
                "Fingers of the paper in the same time and space, without turning:"
                f" {_bars(self.fingers.prediction, False)}."
            )
        return "\n".join([*lines, self.prediction.summary, *self.prediction.advice])


def plan(
    vehicle: Vehicle,
    space: tuple[float, float],
    *,
    time: float = 20.0,
    offset_sd: float | None = None,
    rotation_sd: float | None = None,
    position_sd: float | None = None,
    limits: Limits = USUAL_LIMITS,
    viewing: Viewing = USUAL,
    max_offset: float = 1.0,
    systematic: Systematic = SYSTEMATIC,
) -> Plan:
    """Return the drive that tells most, or the shortest of those tried that tells what is asked.

    Parameters
    ----------
    vehicle : Vehicle
        What drives.  One that strafes keeps its heading, unless the position is asked for.
    space : tuple of float
        Length and width of the free space [m].
    time : float
        The drive takes no longer [s].
    offset_sd, rotation_sd, position_sd : float, optional
        Asked standard deviations: of the offset [s], of the rotation about the axis that shows
        least [rad], of the worse of the position's x and y [m].  With any of them the drive is as
        short as they allow; without, `Bars` weigh what it tells.
    limits : Limits
        What the drive keeps to.
    viewing, max_offset, systematic
        As in `predict`.

    Returns
    -------
    Plan
        The drive, its commands and its prediction.

    Raises
    ------
    InputError
        If the vehicle does not fit into the space, or no drive of it does.
    NoAnswerError
        If no drive in this time is predicted to tell what is asked.

    Notes
    -----
    Families of legs (`_FAMILIES`) are tried on a grid, and the best is refined one parameter at a
    time; each is as large as space and time allow, and as fast as the limits do.  Nothing is drawn:
    the same question has the same answer.
    """
    checks.positive(time, "time", "seconds")
    ground = Ground.of(vehicle, space, limits)
    asked = [sd for sd in (offset_sd, rotation_sd, position_sd) if sd is not None]
    for sd in asked:
        checks.positive(sd, "a standard deviation that is asked")
    usual = Bars(position=None if ground.strafes else 0.005)
    goal = Bars(
        offset_sd or usual.offset, rotation_sd or usual.rotation, position_sd or usual.position
    )

    def tell(drive: VelocitySeries) -> Prediction:
        return predict(drive, viewing=viewing, max_offset=max_offset, systematic=systematic)

    def best(longest: float) -> _Found | None:
        return _best(ground, longest, goal, tell)

    found = best(time)
    if found is None:
        raise InputError(
            f"no drive of this vehicle fits into {space[0]:g} x {space[1]:g} m and {time:g} s; find"
            " more space, or take more time"
        )
    if asked:
        given = Bars(offset_sd or np.inf, rotation_sd or np.inf, position_sd)
        found = _shortest(found, time, given, best)
    fingers = _best_fingers(ground, float(found.drive.velocities.t[-1]), goal, tell)
    return _plan_of(found, goal, None if fingers is None else _plan_of(fingers, Bars()))


def _plan_of(found: _Found, goal: Bars, fingers: Plan | None = None) -> Plan:
    drive, candidate = found.drive, found.candidate
    return Plan(
        kind=candidate.family,
        velocities=drive.velocities,
        commands=tuple(_commands(legs(candidate), drive)),
        start=(float(drive.start[0]), float(drive.start[1])),
        facing=candidate.facing,
        prediction=found.prediction,
        position_counts=goal.position is not None,
        fingers=fingers,
    )


class _Found(NamedTuple):
    candidate: Candidate
    drive: Driven
    prediction: Prediction
    cost: float


Tell = Callable[[VelocitySeries], Prediction]


def _shortest(
    found: _Found, time: float, given: Bars, best: Callable[[float], _Found | None]
) -> _Found:
    """Return the shortest drive, of lengths a fifth apart, that tells what is asked."""
    if (short := given.shares(found.prediction)).max() > 1:
        raise NoAnswerError(
            f"no drive of {time:g} s is predicted to tell what is asked: the best comes to"
            f" {_bars(found.prediction, given.position is not None)}, {short.max():.2g} times as"
            " much; allow more time or space, or ask for less"
        )
    lengths = time * SHORTER ** np.arange(1, 1 + int(np.log(LEAST_TIME / time) / np.log(SHORTER)))
    few, many = 0, max(lengths.size, 0)
    while few < many:
        middle = (few + many) // 2
        shorter = best(float(lengths[middle]))
        if shorter is not None and given.shares(shorter.prediction).max() <= 1:
            found, few = shorter, middle + 1
        else:
            many = middle
    return found


def _best(ground: Ground, time: float, goal: Bars, tell: Tell) -> _Found | None:
    """Return the drive of all families that comes closest to the goal in a time."""
    known: dict[Candidate, _Found | None] = {}

    def judge(candidate: Candidate) -> _Found | None:
        if candidate not in known:
            known[candidate] = _judged(ground, candidate, time, goal, tell)
        return known[candidate]

    for grid in (_grid, _small):
        tried = [judge(candidate) for candidate in grid(ground, goal)]
        found = min((one for one in tried if one is not None), key=_cost, default=None)
        if found is not None:
            break
    else:
        return None
    limit = len(known) + REFINED
    while len(known) < limit:
        near = [judge(one) for one in _variants(found.candidate, ground)]
        better = min((one for one in near if one is not None), key=_cost, default=found)
        if better.cost >= found.cost:
            break
        found = better
    return found


def _best_fingers(ground: Ground, time: float, goal: Bars, tell: Tell) -> _Found | None:
    """Return the paper's fingers at their best: three directions, 60 deg apart."""
    free, goal = replace(ground, strafes=True, least_radius=0.0), goal._replace(position=None)
    counts = {round(3 * 1.3**k) for k in range(10)}
    tried = (
        _judged(free, FINGERS._replace(repeats=n, facing=facing), time, goal, tell)
        for n, facing in product(sorted(counts), ground.facings)
    )
    return min((one for one in tried if one is not None), key=_cost, default=None)


def _cost(found: _Found) -> float:
    return found.cost


def _judged(
    ground: Ground, candidate: Candidate, time: float, goal: Bars, tell: Tell
) -> _Found | None:
    drive = ground.drive(legs(candidate), candidate.facing, time)
    if drive is None:
        return None
    try:
        prediction = tell(drive.velocities)
    except InputError:  # shorter than corners live
        return None
    # A drive that repeats itself comes after all others.
    cost = float(np.linalg.norm(goal.shares(prediction))) + 1e6 * prediction.repeats
    return _Found(candidate, drive, prediction, cost)


# Families of legs ------------------------------------------------------------------------------

Leg = tuple[float, float, float, float]
"""How long it lasts, v_x, v_y and yaw rate of the pivot."""


def _fingers(c: Candidate) -> Iterator[Leg]:
    """Go out and back, ahead and to both sides; curved where they turn."""
    for k in range(c.repeats):
        way = (0.0, c.angle, -c.angle)[k % 3]
        x, y, turn = np.cos(way), np.sin(way), c.turn * (-1) ** k
        yield from ((1.0, x, y, turn), _stop(c), (1.0, -x, -y, -turn), _stop(c))


def _polygon(c: Candidate) -> Iterator[Leg]:
    """Turn the direction by the angle from leg to leg; the body turns to and fro."""
    for k in range(c.repeats):
        yield 1.0, np.cos(k * c.angle), np.sin(k * c.angle), c.turn * (-1) ** k
        yield _stop(c)


def _slalom(c: Candidate) -> Iterator[Leg]:
    """Curve left and right; from 180 deg on the curves are eights."""
    for k in range(c.repeats):
        yield 1.0 if k else 0.5, 1.0, 0.0, c.turn * (-1) ** k
        yield _stop(c)


def _parking(c: Candidate) -> Iterator[Leg]:
    """Go to and fro and turn on with every leg, by 120 deg or so to one side, then to the other."""
    run = max(round(np.radians(120.0) / c.turn), 1)
    for k in range(c.repeats):
        yield 1.0, (-1) ** k, 0.0, c.turn * (-1) ** ((k + run // 2) // run)
        yield _stop(c)


def _star(c: Candidate) -> Iterator[Leg]:
    """Go out and back, turn on the spot, and again."""
    for k in range(c.repeats):
        yield from ((1.0, 1.0, 0.0, 0.0), _stop(c), (1.0, -1.0, 0.0, 0.0), _stop(c))
        turned = c.angle * (0, 1, -1)[(k + 1) % 3] - c.angle * (0, 1, -1)[k % 3]
        yield from ((abs(turned), 0.0, 0.0, float(np.sign(turned))), _stop(c))


def _stop(c: Candidate) -> Leg:
    return c.stop * c.blend, 0.0, 0.0, 0.0


_FAMILIES: dict[str, Callable[[Candidate], Iterator[Leg]]] = {
    "fingers": _fingers,
    "polygon": _polygon,
    "slalom": _slalom,
    "parking": _parking,
    "star": _star,
}

FINGERS = Candidate("fingers", 3, float(np.radians(60.0)), 0.0, 1 / 3, 2.0)
"""The paper's: of 2 s out and back half is at full speed, with half a second of pause."""


def legs(candidate: Candidate) -> Legs:
    """Return the legs of a candidate."""
    rows = np.array(list(_FAMILIES[candidate.family](candidate)), dtype=np.float64)
    rows = rows[rows[:, 0] > 0]
    return Legs(rows[:, 0], rows[:, 1:], candidate.blend)


def _grid(ground: Ground, goal: Bars) -> Iterator[Candidate]:
    """Return where the search begins."""
    deg, facing = np.radians, ground.facings[0]
    if ground.strafes:
        turns = [0.0] if goal.position is None else [deg(40.0), deg(90.0)]
        yield from (
            FINGERS._replace(repeats=n, facing=f) for n in (3, 6, 10) for f in ground.facings
        )
        for turn, n, angle in product(turns, (3, 6, 10), deg([60.0, 90.0])):
            yield Candidate("fingers", n, float(angle), turn, 0.5, 0.0, facing)
        for turn, n, angle in product(turns, (6, 12, 20), deg([75.0, 90.0, 120.0, 144.0])):
            yield Candidate("polygon", n, float(angle), turn, 0.5, 0.0, facing)
        return
    for n, turn, stop in product((3, 6, 10), deg([60.0, 180.0, 300.0]), (0.0, 1.0)):
        yield Candidate("slalom", n, 0.0, float(turn), 0.5, stop, facing)
    for n, turn in product((3, 6, 10), deg([40.0, 90.0])):
        yield Candidate("fingers", n, 0.0, float(turn), 0.5, 1.0, facing)
        yield Candidate("parking", 2 * n, 0.0, float(turn), 0.5, 1.0, facing)
        if not ground.least_radius:
            yield Candidate("star", n, float(turn), 0.0, 0.5, 1.0, facing)


def _small(ground: Ground, goal: Bars) -> Iterator[Candidate]:
    """Return what may still fit where none of the grid does: few legs, and small turns."""
    known = dict.fromkeys(one._replace(repeats=1) for one in _grid(ground, goal))
    for one, n, part in product(known, (1, 3), (0.2, 0.6)):
        yield one._replace(repeats=n, turn=part * one.turn)


def _variants(c: Candidate, ground: Ground) -> Iterator[Candidate]:
    """Return a candidate's neighbours, one parameter changed each."""
    yield from (
        c._replace(repeats=n) for n in {c.repeats - 1, c.repeats + 1, round(1.4 * c.repeats)} if n
    )
    for factor in (0.8, 1.25):
        if c.angle:
            yield c._replace(angle=min(c.angle * factor, np.pi))
        if c.turn:
            yield c._replace(turn=min(c.turn * factor, 2 * np.pi))
        yield c._replace(blend=float(np.clip(c.blend * factor, 0.1, 1.0)))
    least = 0.0 if ground.strafes or c.family == "slalom" else 1.0
    yield from (c._replace(stop=max(c.stop + more, least)) for more in (-1.0, 1.0))
    yield from (c._replace(facing=facing) for facing in ground.facings)


# Words -----------------------------------------------------------------------------------------


def _commands(made: Legs, drive: Driven) -> Iterator[Command]:
    """Return the legs of a drive in words."""
    starts = made.starts * drive.slowness
    for begins, lasts, (x, y, turn) in zip(starts[:-1], made.lasts, made.twist, strict=True):
        speed = float(np.hypot(x, y)) * drive.size
        words = ["stand still"]
        if speed:
            way = f"drive {_direction(np.degrees(np.arctan2(y, x)))} {speed * lasts:.2f} m"
            words = [way, f"at {speed / drive.slowness:.2f} m/s"]
        if turn:
            side = "left" if turn > 0 else "right"
            degrees = np.degrees(abs(turn) * lasts)
            turned = f"turn {degrees:.0f} deg to the {side}"
            words = [words[0], turned, *words[1:]] if speed else [f"{turned} on the spot"]
        yield Command(float(begins), ", ".join(words))
    yield Command(float(starts[-1]), "stop")


def _direction(degrees: float) -> str:
    turned = round(abs(degrees))
    if turned in (0, 180):
        return "backward" if turned else "forward"
    return f"{turned} deg to the {'left' if degrees > 0 else 'right'} of ahead,"


def _bars(found: Prediction, position: bool) -> str:
    parts = [
        f"offset {1e3 * found.offset_sd:.2f} ms",
        f"rotation {np.degrees(found.worst_axis_sd):.3f} deg about the axis that shows least",
    ]
    if position:
        parts.append(f"position {1e3 * found.position_sd.max():.1f} mm")
    return ", ".join(parts)

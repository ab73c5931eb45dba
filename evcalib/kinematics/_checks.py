"""What a drive says against the parameters of its vehicle: zeros of steering, radii, track width.

Where the wheels give more equations than a twist has unknowns, or another sensor tells the yaw
rate, a wrong parameter leaves a residual that goes with speed, steering or turning.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evcalib import checks
from evcalib.arrays import Floats, Integers
from evcalib.display import Shown
from evcalib.kinematics import _rigid
from evcalib.kinematics._states import WheelLog, WheelStates
from evcalib.kinematics._vehicles import Mecanum
from evcalib.kinematics._velocities import Vehicle
from evcalib.series import VelocitySeries, bins

BIN = 0.2
"""Rows are averaged over this time [s].  Noise of a regressor lessens what it is regressed on, and
so it is lessened first; a choice, shorter than turns."""
STEADY = 0.2
"""Means over wheels that steer by more within `BIN` [rad] are left out: a choice, of which the
cosine is within half a percent."""
MOST = 10_000
"""Means that enter, evenly taken.  A choice of speed."""
BLOCK = 1.0
"""Errors of the wheels are taken to be independent from one stretch of this length [s] to the
next.  A choice: longer than the noise of encoders, shorter than a turn."""
FEWEST = 8
"""Stretches that are needed.  A choice: scatter of fewer is not known to a third."""
FINEST = 1e-4
"""Noise of the wheels [m/s] below which none is believed: a tenth of a millimetre per second."""
SEEN = 0.3
"""A parameter is told where its sd is below this share of its prior: a choice, three sd within."""
GATE = 3.0
"""Standard deviations from which on a parameter is said to be off, as in the verdicts."""
ALIKE, UNLIKE = 0.9, 0.5
"""Correlation of two yaw rates over which a factor between them means something, and under which
they are not those of one drive."""
STEPS = 3
"""Steps of Gauss and Newton.  A choice: the parameters are small, two come within a hundredth."""
STEP = 1e-4
"""Half width of the differences that give derivatives [rad, shares].  A choice between rounding and
curvature, both below 1e-6 then."""
NOISY = 0.05
"""Share of the turning over which noise of the wheels' yaw rate lessens a size by 0.25 % and more:
noise of a regressor does, by the square of this."""
SLOW = 0.02
"""Yaw rates of the wheels whose root mean square is below this [rad/s] are noise: a choice, the
drift of a cheap gyro."""
DEGREES = (40.0, 80.0)
"""Factors between which one is that of degrees (57.3), whatever the track width."""
SIDEWAYS, TURNS = 0.01, 0.05
"""Shares of the speed below which a vehicle never went sideways, and over which it turned.  A real
mecanum robot that was driven like a car comes to 0.016 (tests/test_real_wheels.py)."""
NEAR = 0.02
"""A turning centre so near to the origin [m] is taken for it."""

PRIORS = {"steering zero": np.radians(5.0), "radius": 0.05, "size": 0.5, "bias": 0.1}
"""Standard deviations [rad, shares, rad/s] that are believed beforehand: choices, beyond what a
vehicle that drives at all has; the size is that of skid-steer vehicles."""
MATTERS = {"steering zero": np.radians(0.1), "radius": 0.002, "size": 0.005}
"""Errors that are not worth a word [rad, shares]: they turn no direction by more than 0.1 deg."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of a vehicle, as its drive tells it.

    Attributes
    ----------
    kind : {"steering zero", "radius", "size"}
        A steering zero is what the angle reads too much [rad]; a radius is the share by which it is
        larger than given, against the mean of all wheels; the size is the share by which all
        distances between the wheels are larger than given.
    wheel : str
        Its wheel; ``""`` for the size.
    value, sd : float
        Estimate and standard deviation.
    """

    kind: str
    wheel: str
    value: float
    sd: float

    @property
    def off(self) -> bool:
        """Whether it is off by more than 3 sd, and by more than what matters."""
        return abs(self.value) > max(GATE * self.sd, MATTERS[self.kind])

    def __str__(self) -> str:
        if self.kind == "steering zero":
            value, sd = np.degrees((self.value, self.sd))
            text = f"the steering of {self.wheel} reads {value:+.2f} deg too much (sd {sd:.2f})"
            return text + f": offset: {-value:.2f} with unit: deg in a column map takes it out"
        share, sd = 100 * self.value, 100 * self.sd
        if self.kind == "radius":
            return (
                f"the radius of {self.wheel} is {share:+.2f} % off (sd {sd:.2f}) against the mean"
                " of the wheels"
            )
        return (
            f"the distances between the wheels (track, wheelbase) act {share:+.1f} % off"
            f" (sd {sd:.1f}), if the yaw rate told is right"
        )


@dataclass(frozen=True)
class VehicleCheck(Shown):
    """What a drive says about its vehicle.

    Attributes
    ----------
    parameters : tuple of Parameter
        Those that the drive tells.
    contradictions : tuple of str
        What speaks against the vehicle, or the yaw rate, as a whole.
    """

    parameters: tuple[Parameter, ...] = ()
    contradictions: tuple[str, ...] = ()

    @property
    def advice(self) -> tuple[str, ...]:
        """What to look at: contradictions, and parameters that are off."""
        return (*self.contradictions, *(str(found) for found in self.parameters if found.off))


def check_vehicle(wheel_log: WheelLog, vehicle: Vehicle) -> VehicleCheck:
    """Hold the parameters of a vehicle against a drive, and its yaw rate if another sensor has one.

    Least squares over steering zeros, ratios of radii and the distances between the wheels, with
    the twist of each row eliminated (and a constant bias of the yaw rate).  What a drive does not
    show is left out: without turning, for instance, a zero that all wheels share.

    Parameters
    ----------
    wheel_log : WheelLog
        The drive.
    vehicle : Swerve, Mecanum, Omni or Rolling
        The vehicle as it was given.

    Returns
    -------
    VehicleCheck
        Advice, not a verdict: wheels that slip to one side look like a parameter, too.

    Examples
    --------
    >>> from evcalib.kinematics import Rolling
    >>> t = np.arange(0.0, 20.0, 0.05)
    >>> v = np.stack([0.5 + 0.2 * np.sin(t), 0 * t], axis=1)
    >>> states = Rolling.differential(0.412).wheel_states(v, np.sin(0.7 * t))
    >>> check = check_vehicle(WheelLog(t, states, np.sin(0.7 * t)), Rolling.differential(0.40))
    >>> check.parameters[-1].kind, round(check.parameters[-1].value, 3)
    ('size', 0.03)
    """
    checks.instance(wheel_log, "wheel_log", WheelLog)
    against = (*_sideways(wheel_log, vehicle), *_yaw_rates(wheel_log, vehicle))
    if against:
        return VehicleCheck(contradictions=against)
    log = _averaged(wheel_log)
    if not len(log):
        return VehicleCheck()
    block = np.unique(bins(log.t - log.t[0], BLOCK), return_inverse=True)[1]
    if block[-1] + 1 < FEWEST:
        return VehicleCheck()
    found = _parameters(log, vehicle, block)
    return VehicleCheck(
        found if _turns(wheel_log, log, vehicle) else tuple(p for p in found if p.wheel)
    )


def turning_centre(velocities: VelocitySeries) -> float | None:
    """Return the x of the point about which a vehicle turns that cannot go sideways [m].

    Parameters
    ----------
    velocities : VelocitySeries
        With a yaw rate.

    Returns
    -------
    float or None
        None where the sideways velocity does not go with the yaw rate, or only a little.
    """
    if velocities.yaw_rate is None:
        return None
    left, rate = velocities.v[:, 1], velocities.yaw_rate
    if not (left.any() and rate.any()):
        return None
    alike = float(left @ rate) / float(np.linalg.norm(left) * np.linalg.norm(rate))
    x = -float(left @ rate) / float(rate @ rate)
    return x if abs(alike) > np.sqrt(ALIKE) and abs(x) > NEAR else None


def _averaged(log: WheelLog) -> WheelLog:
    """Return means over `BIN`, at most `MOST` of them."""
    number = bins(log.t - log.t[0], BIN)
    starts = np.flatnonzero(np.append(True, np.diff(number) > 0))
    count = np.diff(np.append(starts, len(log)))

    def mean(values: Floats) -> Floats:
        return np.add.reduceat(values, starts) / count.reshape((-1,) + (1,) * (values.ndim - 1))

    keep: NDArray = np.ones(starts.size, dtype=bool)
    steer = None
    if log.states.steer is not None:
        angle = np.unwrap(log.states.steer, axis=0)
        swing = np.maximum.reduceat(angle, starts) - np.minimum.reduceat(angle, starts)
        keep = np.all(swing < STEADY, axis=1)
        steer = mean(angle)
    rows = np.flatnonzero(keep)[:: -(-int(keep.sum()) // MOST) or 1]
    states = WheelStates(mean(log.states.speed)[rows], None if steer is None else steer[rows])
    rate = None if log.yaw_rate is None else mean(log.yaw_rate)[rows]
    return WheelLog(mean(log.t)[rows], states, rate)


def _turns(whole: WheelLog, means: WheelLog, vehicle: Vehicle) -> bool:
    """Tell whether the wheels' yaw rate is far over the noise of means, which lessens the size."""
    rate = vehicle.twist(whole.states).yaw_rate
    noise = np.sqrt(np.mean(np.diff(rate, 2) ** 2) / 6 * len(means) / len(whole))
    return bool(max(SLOW, noise / NOISY) < np.std(rate))


def _names(log: WheelLog, vehicle: Vehicle) -> list[tuple[str, str]]:
    names = [("steering zero", name) for name in vehicle.steer_names]
    names += [("radius", name) for name in vehicle.speed_names]
    return [*names, ("size", ""), *([("bias", "")] if log.yaw_rate is not None else [])]


def _residuals(
    log: WheelLog, vehicle: Vehicle, names: list[tuple[str, str]], values: Floats
) -> Floats:
    """Return what wheels and yaw rate leave unexplained (n, m) [m/s] under parameters."""
    given = dict(zip(names, values, strict=True))
    radii = np.array([given.get(("radius", name), 0.0) for name in vehicle.speed_names])
    zeros = np.array([given.get(("steering zero", name), 0.0) for name in vehicle.steer_names])
    steer = None if log.states.steer is None else log.states.steer - zeros
    states = WheelStates(log.states.speed * (1 + radii - radii.mean()), steer)
    meant = vehicle.resized(1 + given.get(("size", ""), 0.0))
    matrix, measured = meant.equations(states)
    if log.yaw_rate is not None:
        # In units of the speed that it means at a wheel.
        arm = float(np.sqrt(((vehicle.positions - vehicle.positions.mean(0)) ** 2).sum(1).mean()))
        row = np.broadcast_to([0.0, 0.0, arm], (*matrix.shape[:-2], 1, 3))
        matrix = np.concatenate([matrix, row], axis=-2)
        rate = arm * (log.yaw_rate - given.get(("bias", ""), 0.0))
        measured = np.column_stack([measured, rate])
    return measured - _rigid.said(matrix, _rigid.fit(matrix, measured))


def _parameters(log: WheelLog, vehicle: Vehicle, block: Integers) -> tuple[Parameter, ...]:
    """Return what the drive tells, by Gauss-Newton on the residuals, with priors."""
    names = _names(log, vehicle)
    prior = np.array([PRIORS[kind] for kind, _ in names])
    values = np.zeros(len(names))
    for _ in range(STEPS):
        r = _residuals(log, vehicle, names, values)
        turned = [
            _residuals(log, vehicle, names, values + side * step)
            for step in STEP * np.eye(len(names))
            for side in (1, -1)
        ]
        J = np.stack([(a - b) / (2 * STEP) for a, b in zip(*[iter(turned)] * 2, strict=True)], 2)
        variance = max(float((r**2).sum()) / (len(r) * max(r.shape[1] - 3, 1)), FINEST**2)
        covariance = np.linalg.inv(np.einsum("nmi,nmj->ij", J, J) / variance + np.diag(prior**-2))
        values = values - covariance @ (np.einsum("nmi,nm->i", J, r) / variance + values / prior**2)
    pulls = np.zeros((block[-1] + 1, len(names)))
    np.add.at(pulls, block, np.einsum("nmi,nm->ni", J, r) / variance)
    scattered = covariance @ (pulls.T @ pulls) @ covariance * len(pulls) / (len(pulls) - 1)
    radii = np.array([kind == "radius" for kind, _ in names])
    relative = np.eye(len(names)) - np.outer(radii, radii) / radii.sum()
    told, scatter = (
        np.sqrt(np.diag(relative @ matrix @ relative.T)) for matrix in (covariance, scattered)
    )
    # A single wheel is its own mean.
    return tuple(
        Parameter(*name, float(value), float(max(sd, spread)))
        for name, value, sd, spread, before in zip(
            names, relative @ values, told, scatter, prior, strict=True
        )
        if name[0] in MATTERS and sd < SEEN * before and radii.sum() > (name[0] == "radius")
    )


def _yaw_rates(log: WheelLog, vehicle: Vehicle) -> tuple[str, ...]:
    """Say where the yaw rate told is in another unit, of another sign or of another drive."""
    if log.yaw_rate is None:
        return ()
    wheels, told = vehicle.twist(log.states).yaw_rate, log.yaw_rate - np.median(log.yaw_rate)
    wheels = wheels - np.median(wheels)
    size = float(np.linalg.norm(wheels) * np.linalg.norm(told))
    if size == 0 or np.sqrt(np.mean(wheels**2)) < SLOW:
        return ()
    alike, ratio = float(wheels @ told) / size, float(wheels @ told) / float(wheels @ wheels)
    if abs(alike) < UNLIKE:
        return (
            f"the yaw rate told does not go with that of the wheels (correlation {alike:.2f}): are"
            " both of one drive and one clock?",
        )
    if abs(alike) > ALIKE and DEGREES[0] < abs(ratio) < DEGREES[1]:
        return (
            f"the yaw rate told is {ratio:.0f} times that of the wheels: it is in degrees per"
            " second (unit: deg/s in a column map reads it)",
        )
    if alike < -UNLIKE:
        return (
            "the yaw rate told has the sign opposite to that of the wheels: its sensor is upside"
            " down (scale: -1 in a column map), or left and right wheels are exchanged",
        )
    return ()


def _sideways(log: WheelLog, vehicle: Vehicle) -> tuple[str, ...]:
    """Say where a vehicle that could go sideways by rollers never did."""
    if not isinstance(vehicle, Mecanum):
        return ()
    twist, arm = vehicle.twist(log.states), vehicle.half_length + vehicle.half_width
    ahead, left, turn = (
        float(np.sqrt(np.mean(values**2))) for values in (*twist.v.T, arm * twist.yaw_rate)
    )
    speed = float(np.hypot(ahead, turn))
    if left > SIDEWAYS * speed or turn < TURNS * speed:
        return ()
    return (
        "this vehicle turned, but its wheels never went sideways: if they have no rollers it is a"
        " differential or skid_steer vehicle, and turns"
        f" {arm / vehicle.half_width:.2f} times as fast as a mecanum vehicle, or less",
    )

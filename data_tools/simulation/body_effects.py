"""What a real body does besides driving: it leans when it accelerates, shakes, and obeys late."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import bilinear, butter, lfilter, lfilter_zi, sosfilt, sosfreqz

from data_tools.simulation.drives import Drive
from evcalib import checks
from evcalib.arrays import Floats
from evcalib.errors import InputError

SWAY_HZ, SWAY_DAMPING = 2.0, 0.4
"""Eigenfrequency and damping of a body on its springs or tyres, a choice: cars pitch at 1 to 2 Hz,
small robots on rubber wheels are stiffer."""

SAMPLES = 1000.0
"""Samples per second of a motion that a controller has shaped."""


def sway(t: Floats, acceleration: Floats, gain: float) -> Floats:
    """Return the rotation vectors [rad] of a body that leans as it accelerates.

    It leans backwards when it speeds up and outwards in a bend, as a second-order system that
    starts at rest (`SWAY_HZ`, `SWAY_DAMPING`).

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times [s], evenly spaced.
    acceleration : ndarray, shape (n, 3)
        Of the body's origin, in the body frame [m/s^2].
    gain : float
        Angle per acceleration that lasts [rad per m/s^2].

    Returns
    -------
    ndarray, shape (n, 3)
        Roll, pitch and no yaw.
    """
    w = 2 * np.pi * SWAY_HZ
    b, a = bilinear([w * w], [1.0, 2 * SWAY_DAMPING * w, w * w], 1.0 / (t[1] - t[0]))
    x, y = lfilter(b, a, acceleration[:, :2], axis=0).T
    return gain * np.stack([y, -x, np.zeros_like(x)], axis=1)


def vibration(t: Floats, sd: float, band: tuple[float, float], rng: np.random.Generator) -> Floats:
    """Return rotation vectors [rad] of normal noise within a band of frequencies.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times [s], evenly spaced.
    sd : float
        Standard deviation about each axis [rad].
    band : (float, float)
        Frequencies [Hz] between which the noise passes.
    rng : Generator
        Of the noise.

    Returns
    -------
    ndarray, shape (n, 3)
        About all three axes, independent of each other.

    Raises
    ------
    InputError
        If the band is none, or the samples are too far apart for it.
    """
    rate = 1.0 / (t[1] - t[0])
    low, high = band
    if not 0 < low < high < 0.5 * rate:
        raise InputError(f"a band of vibration runs from above 0 up to below {0.5 * rate:g} Hz")
    sos = butter(2, [low, high], "bandpass", fs=rate, output="sos")
    _, response = sosfreqz(sos, 1 << 16)
    settled = int(5.0 * rate / low)
    noise = rng.standard_normal((settled + t.size, 3))
    shaken = sosfilt(sos, noise, axis=0)[settled:]
    return sd / np.sqrt((np.abs(response) ** 2).mean()) * shaken


def obeyed(drive: Drive, dead_time: float, bandwidth: float) -> Drive:
    """Return what a vehicle does that is commanded a drive.

    Parameters
    ----------
    drive : Drive
        What is commanded; before its start, as at its start.
    dead_time : float
        Time [s] before anything happens.
    bandwidth : float
        Of the controllers [Hz]: two poles without overshoot, on the velocity's components and the
        yaw rate; 0 for controllers that follow at once.

    Returns
    -------
    Drive
        The same as a function of time, from samples.
    """
    if dead_time == bandwidth == 0.0:
        return drive
    t = np.arange(0.0, drive.duration + 1 / SAMPLES, 1 / SAMPLES)
    then = np.maximum(t - dead_time, 0.0)
    twist = np.column_stack([drive.velocity(then)[:, :2], drive.yaw_rate(then)])
    if bandwidth:
        w = 2 * np.pi * checks.positive(bandwidth, "bandwidth", "hertz")
        b, a = bilinear([w * w], [1.0, 2 * w, w * w], SAMPLES)
        twist, _ = lfilter(b, a, twist, axis=0, zi=np.outer(lfilter_zi(b, a), twist[0]))
    x, y, yaw_rate = twist.T
    return replace(
        drive,
        angle=lambda s: np.arctan2(np.interp(s, t, y), np.interp(s, t, x)),
        speed=lambda s: np.hypot(np.interp(s, t, x), np.interp(s, t, y)),
        yaw_rate=lambda s: np.interp(s, t, yaw_rate),
    )

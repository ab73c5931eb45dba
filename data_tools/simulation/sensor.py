"""The pixels of an event camera: thresholds, dead time, noise, and what slow, dim or lit ones do.

The effects are those of two public descriptions: Hu, Liu & Delbruck, "v2e: From Video Frames to
Realistic DVS Events" (CVPR workshops 2021), whose names and numbers stand in brackets in `Sensor`;
and Joubert et al., "Event Camera Simulator Improvements via Characterized Parameters" (Frontiers in
Neuroscience 15, 2021), for the readout.  A light of 1 is that of a white surface.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from data_tools.simulation import _simulator_kernels as kernels
from data_tools.simulation._random import generator
from data_tools.simulation._readout import Readout
from evcalib import checks
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.events import Events

PIECES = 16
"""Straight pieces of the light in one period of the lamps: 0.5 % off at most."""


@dataclass(frozen=True)
class Sensor:
    """What the pixels do.

    Attributes
    ----------
    threshold_on, threshold_off : float
        Change of log intensity that makes an event.
    mismatch : float
        Standard deviation of the thresholds, as a share of each; drawn once per pixel and
        polarity.  No threshold falls below a quarter of its nominal value.
    refractory : float
        Time [s] after an event in which the pixel is held in reset.
    noise_rate : float
        Background activity [events per second and pixel]: a Poisson process, both polarities
        equally often.  It resets the pixel like any event.
    light : float
        Light of the scene; dim light makes pixels slower and shot noise more frequent.
    cutoff : float
        Bandwidth of a pixel [Hz] where the light is 1, in proportion to its light elsewhere
        (``cutoff_hz``: 300 by default, 30 for dim light); 0 for pixels that are not slow.  One
        pole, on the logarithm.  The image is late by about 1 / (2 pi cutoff light).
    shot_noise : float
        More noise [events per second and pixel], where it is dark; a quarter of it is left where
        the light is 1 (``shot_noise_rate_hz``: 0.001 by default, 5 for dim light).
    leak_rate : float
        ON events per second and pixel without any change of light (``leak_rate_hz``: 0.01 by
        default, 0.1 for dim light): the memorised intensity falls.  Pixels of a lower threshold
        leak faster.
    hot_pixels, hot_rate : float
        Share of pixels that are hot, and the noise that these have besides [events per second].
    flicker, flicker_rate : float
        Depth to which lamps flicker, as a share of their light, and how often per second: 100
        where the mains have 50 Hz, 120 where they have 60.
    row_time, event_time : float
        Time [s] that the readout spends on a row that asks, and on each event in it.  It serves
        one row at a time, the one that has waited longest, and stamps its events when it does.
    stamp : float
        Events are stamped with the last multiple of this time [s].
    gap_rate, gap : float
        How often per second, on average, events are lost on their way, and for how long [s].
    """

    threshold_on: float = 0.2
    threshold_off: float = 0.2
    mismatch: float = 0.03
    refractory: float = 1e-4
    noise_rate: float = 0.1
    light: float = 1.0
    cutoff: float = 0.0
    shot_noise: float = 0.0
    leak_rate: float = 0.0
    hot_pixels: float = 0.0
    hot_rate: float = 100.0
    flicker: float = 0.0
    flicker_rate: float = 100.0
    row_time: float = 0.0
    event_time: float = 0.0
    stamp: float = 0.0
    gap_rate: float = 0.0
    gap: float = 0.02

    def __post_init__(self) -> None:
        for name in ("threshold_on", "threshold_off", "light", "flicker_rate"):
            checks.positive(getattr(self, name), name)
        for field in fields(self):
            value = getattr(self, field.name)
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"{field.name} must be a number of at least 0, not {value!r}")
        for name in ("hot_pixels", "flicker"):
            if getattr(self, name) >= 1:
                raise InputError(f"{name} is a share and must be below 1")

    def parameters(self, seed: int) -> kernels.Sensor:
        """Return the settings that all pixels share, times in microseconds."""
        shaping = (self.cutoff, self.shot_noise, self.leak_rate, self.flicker, self.light - 1.0)
        return kernels.Sensor(
            plain=not any(shaping),
            refractory=1e6 * self.refractory,
            seed=np.uint64(seed),
            light=self.light,
            cutoff=2e-6 * np.pi * self.cutoff,
            shot=1e-6 * self.shot_noise,
            leak=1e-6 * self.leak_rate * self.threshold_on,
            flicker=self.flicker,
            pulse=2e-6 * np.pi * self.flicker_rate,
            step=1e6 / (PIECES * self.flicker_rate),
        )

    def readout(self, seed: int) -> Readout:
        """Return what carries the events of one recording from the pixels to the computer."""
        return Readout(
            1e6 * self.row_time,
            1e6 * self.event_time,
            1e6 * self.stamp,
            1e6 * self.gap,
            1e-6 * self.gap_rate,
            generator(seed, "gaps"),
        )

    def new_state(self, count: int, seed: int) -> Floats:
        """Return pixels with their own thresholds; `start_pixels` fills in the rest."""
        rng = generator(seed, "thresholds")
        factor = np.maximum(1.0 + self.mismatch * rng.standard_normal((count, 2)), 0.25)
        state = np.zeros((count, kernels.COLUMNS))
        state[:, [kernels.ON, kernels.OFF]] = factor * (self.threshold_on, self.threshold_off)
        hot = generator(seed, "hot pixels").random(count) < self.hot_pixels
        rate = self.noise_rate + self.shot_noise + np.where(hot, self.hot_rate, 0.0)
        state[:, kernels.RATE] = 1e-6 * rate
        return state


def events_from_video(
    t_us: ArrayLike, log_intensity: ArrayLike, sensor: Sensor = Sensor(), seed: int = 0
) -> Events:
    """Return the events of a video, whose log intensity runs on lines between its frames.

    Parameters
    ----------
    t_us : array_like, shape (n,)
        Times of the frames [us], whole numbers, increasing.
    log_intensity : array_like, shape (n, height, width)
        Natural logarithm of the light of each pixel, which the sensor's `light` multiplies.
    sensor : Sensor
        What the pixels do.
    seed : int
        Of thresholds and noise.
    """
    times = checks.times(t_us, "t_us")
    levels = checks.floats(log_intensity, "log_intensity", (times.size, None, None))
    if (times != np.floor(times)).any():
        raise InputError("t_us must be whole microseconds")
    if times.size < 2 or not levels[0].size:
        raise InputError("a video needs two frames of at least one pixel")
    height, width = levels.shape[1:]
    flat = levels.reshape(times.size, -1) + np.log(sensor.light)
    state = sensor.new_state(height * width, seed)
    parameters, buffer = sensor.parameters(seed), empty_buffer(4096)
    while True:
        now = state.copy()
        kernels.start_pixels(times[0], flat[0], parameters, now)
        kernels.advance_lines(times, flat, parameters, now, buffer)
        if buffer.used[0] <= buffer.t.size:
            return sensor.readout(seed).carry(merge([buffer], width, height))
        buffer = empty_buffer(int(buffer.used[0]))


def empty_buffer(capacity: int) -> kernels.Buffer:
    """Return room for some events."""
    return kernels.Buffer(
        np.empty(capacity, dtype=np.int64),
        np.empty(capacity, dtype=np.int32),
        np.empty(capacity, dtype=np.bool_),
        np.zeros(1, dtype=np.int64),
    )


def merge(buffers: list[kernels.Buffer], width: int, height: int) -> Events:
    """Return the events of some buffers in order of time, then row, then column.

    Each pixel's events are in one buffer, in the order of their creation, which is kept.
    """
    t = np.concatenate([b.t[: b.used[0]] for b in buffers])
    pixel = np.concatenate([b.pixel[: b.used[0]] for b in buffers])
    p = np.concatenate([b.p[: b.used[0]] for b in buffers])
    start = t.min(initial=np.iinfo(np.int64).max)
    order = np.argsort((t - start) * (width * height) + pixel, kind="stable")
    y, x = np.divmod(pixel[order], width)
    return Events.from_arrays(x, y, t[order], p[order], width, height)

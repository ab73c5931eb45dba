"""The pixels of an event camera: thresholds, dead time and noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from data_tools.simulation import _simulator_kernels as kernels
from data_tools.simulation._random import generator
from evcalib import checks
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.events import Events


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
    """

    threshold_on: float = 0.2
    threshold_off: float = 0.2
    mismatch: float = 0.03
    refractory: float = 1e-4
    noise_rate: float = 0.1

    def __post_init__(self) -> None:
        checks.positive(self.threshold_on, "threshold_on")
        checks.positive(self.threshold_off, "threshold_off")
        for name in ("mismatch", "refractory", "noise_rate"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"{name} must be a number of at least 0, not {value!r}")

    def parameters(self, seed: int) -> kernels.Sensor:
        """Return the settings that all pixels share, times in microseconds."""
        return kernels.Sensor(1e6 * self.refractory, 1e-6 * self.noise_rate, np.uint64(seed))

    def new_state(self, count: int, seed: int) -> Floats:
        """Return pixels with their own thresholds; `start_pixels` fills in the rest."""
        rng = generator(seed, "thresholds")
        factor = np.maximum(1.0 + self.mismatch * rng.standard_normal((count, 2)), 0.25)
        state = np.zeros((count, 7))
        state[:, [kernels.ON, kernels.OFF]] = factor * (self.threshold_on, self.threshold_off)
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
        Natural logarithm of the light of each pixel.
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
    flat, state = levels.reshape(times.size, -1), sensor.new_state(height * width, seed)
    parameters, buffer = sensor.parameters(seed), empty_buffer(4096)
    while True:
        now = state.copy()
        kernels.start_pixels(times[0], flat[0], parameters, now)
        kernels.advance_lines(times, flat, parameters, now, buffer)
        if buffer.used[0] <= buffer.t.size:
            return merge([buffer], width, height)
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

"""The gyro of a simulated camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from data_tools.simulation._random import generator
from data_tools.simulation.simulator import Simulator
from evcalib import checks
from evcalib.arrays import Floats


@dataclass(frozen=True)
class Gyro:
    """What a gyro tells of the camera it sits in.

    Attributes
    ----------
    rate : float
        Samples per second.
    noise : float
        Density of the white noise [rad/s per root Hz].  The default is that of the InvenSense
        MPU-6150 in DAVIS cameras and of the Bosch BMI160 in the DVXplorer, 0.005 to 0.007
        deg/s per root Hz by their data sheets, rounded up.
    bias : tuple of float
        What is added about the camera's x, y and z [rad/s].
    """

    rate: float = 1000.0
    noise: float = float(np.radians(0.01))
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        checks.positive(self.rate, "rate", "samples per second")
        checks.floats(self.bias, "bias", (3,))
        checks.at_least_zero(self.noise, "noise")


def angular_rates(
    simulator: Simulator, gyro: Gyro = Gyro(), seed: int = 0
) -> tuple[Floats, Floats]:
    """Return what the gyro of a simulated camera tells.

    Parameters
    ----------
    simulator : Simulator
        The camera and its motion.
    gyro : Gyro
        Its errors.
    seed : int
        Of the noise.

    Returns
    -------
    t : ndarray, shape (n,)
        Times [s], on the clock of the events.
    rate : ndarray, shape (n, 3)
        Angular rate of the camera in its own frame [rad/s], the mean over a period around `t`.
    """
    path, period = simulator.trajectory, 1 / gyro.rate
    edges = np.arange(path.t[0], path.t[-1], period)
    t = 0.5 * (edges[1:] + edges[:-1])
    attitude = Rotation.from_matrix(path.rotation_at(edges) @ simulator.R_body_cam)
    truth = (attitude[:-1].inv() * attitude[1:]).as_rotvec() / period
    noise = generator(seed, "gyro").standard_normal(truth.shape)
    # White noise of a density is that over half the rate, up to which samples hold it.
    sd = gyro.noise * np.sqrt(0.5 * gyro.rate)
    return t, truth + gyro.bias + sd * noise

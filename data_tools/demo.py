"""The drive behind ``evcalib demo`` and README's picture."""

from __future__ import annotations

import numpy as np

from data_tools.motion import Noise, SyntheticStreams, s_curve, simulate


def demo_streams(seed: int = 1) -> SyntheticStreams:
    """Return an S-curve of 20 s with noise of 3 degrees that remembers, and 10 % outliers."""
    return simulate(
        s_curve(20.0, amplitude=np.radians(45), period=6.0),
        np.random.default_rng(seed),
        offset=0.137,
        heading_noise=Noise(0.05, rho=0.5, outliers=0.1),
        velocity_noise=Noise(0.02),
    )

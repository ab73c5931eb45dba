"""Block bootstrap of offset and rotation, for motions on which linearisation fails.

Where the vehicle turns at an instant, the score over the offset is a tent, not a parabola, and its
error depends on which headings happen to lie beside the turns.
"""

from __future__ import annotations

import numpy as np

from evcalib.alignment._stream_pair import StreamPair
from evcalib.alignment.offset_refinement import RefinedOffset
from evcalib.alignment.rotation import tukey_scale
from evcalib.arrays import Floats
from evcalib.series import bins
from evcalib.uncertainty import NoiseModel, peak_of_parabola

DRAWS = 200
"""Number of resamples: they give a standard deviation to 5 % (one over the root of twice as
many)."""

WINDOW = 0.15
"""Half width [s] of the search around the estimate in each resample: a choice of several standard
deviations where turns are instant (`tests/montecarlo.py`), and still within one basin."""


def bootstrap(
    pair: StreamPair, refined: RefinedOffset, noise: NoiseModel, rng: np.random.Generator
) -> Floats:
    """Return the covariance (4, 4) of rotation vector (body frame) [rad] and offset [s].

    Blocks of neighbouring headings, longer than the memory of the noise, are drawn with
    replacement, and offset and rotation are searched anew in each draw.
    """
    t = pair.headings.t
    steps = np.linspace(-WINDOW, WINDOW, 31)
    scale = min(tukey_scale(refined.mixture.sigma), 0.5)
    memory = 4 * noise.memory if noise.share > 0.1 else 0.0
    length = max(0.5, min(memory, float(np.ptp(t)) / 10))
    block = np.unique(bins(t - t[0], length), return_inverse=True)[1]
    count = int(block.max()) + 1
    errors = np.empty((DRAWS, 4))
    for draw in range(DRAWS):
        times = np.bincount(rng.integers(count, size=count), minlength=count)[block]
        drawn = pair.drawn(times)
        score, _, rotations = drawn.profile(refined.offset + steps, np.array([0.5, scale, scale]))
        errors[draw, 3] = _peak(steps, score)
        nearest = int(np.argmin(np.abs(steps - errors[draw, 3])))
        errors[draw, :3] = _rotation_vector(rotations[nearest] @ refined.R_body_cam.T)
    return np.cov(errors.T)


def sampling_floor(pair: StreamPair) -> float:
    """Return the least standard deviation [s] of an offset that rests on instant turns.

    No resample shows where a turn lies between two samples, and turns in step with a clock all lie
    at the same place: a uniform error of one step of each stream remains, however many turns.
    """
    steps = np.median(np.diff(pair.headings.t)), np.median(np.diff(pair.track.t))
    return float(np.hypot(*steps) / np.sqrt(12))


def _peak(steps: Floats, score: Floats, near: float = 0.05) -> float:
    top = steps[int(np.argmax(score))]
    around = np.abs(steps - top) <= near + 1e-9
    return float(top) + peak_of_parabola(steps[around] - top, score[around], near)[0]


def _rotation_vector(R: Floats) -> Floats:
    """Return the rotation vector [rad] of a small rotation."""
    return 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])

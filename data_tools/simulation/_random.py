"""Independent random streams from one seed."""

from __future__ import annotations

import zlib

import numpy as np

from evcalib.errors import InputError


def generator(seed: int, purpose: str) -> np.random.Generator:
    """Return the generator of a seed for one purpose, independent of those for others."""
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"seed must be a whole number of at least 0, not {seed!r}")
    return np.random.default_rng([int(seed), zlib.crc32(purpose.encode())])

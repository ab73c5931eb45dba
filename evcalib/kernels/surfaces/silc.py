"""Loops of the speed-invariant surface (SILC); a kernel per patch size, made on first use."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from evcalib.kernels.jit import jit
from evcalib.kernels.surfaces.vector import silc_patch


@lru_cache
def silc_update(size: int) -> Callable[..., Any]:
    """Return the update for patches of size x size pixels."""

    @jit
    def update(surface, plane, events, stride):
        """Apply events to a flat surface with a border of size // 2 cells; see `tos_update`."""
        x, y, p = events.x, events.y, events.p
        for i in range(x.size):
            start = (plane if p[i] else 0) + np.intp(y[i]) * stride + np.intp(x[i])
            silc_patch(surface, start, stride, size)

    return update

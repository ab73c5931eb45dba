"""Loops of the threshold-ordinal surface; a kernel per patch size, made on first use."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from evcalib.kernels.jit import jit
from evcalib.kernels.surfaces.vector import tos_patch


@lru_cache
def tos_update(k: int) -> Callable[..., Any]:
    """Return the update for patches of k x k pixels."""

    @jit
    def update(surface, plane, events, stride, threshold):
        """Apply events to a flat uint8 surface with a border of k // 2 cells, `stride` wide.

        Because of the border, the patch of pixel (x, y) starts at cell (x, y).  `plane` is the
        number of cells per polarity, 0 to merge them.
        """
        x, y, p = events.x, events.y, events.p
        for i in range(x.size):
            start = (plane if p[i] else 0) + np.intp(y[i]) * stride + np.intp(x[i])
            tos_patch(surface, start, stride, threshold, k)

    return update

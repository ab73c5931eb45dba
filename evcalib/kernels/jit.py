"""The one place where the compilation of kernels is decided."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba

from evcalib.kernels.cache import find_cache
from evcalib.kernels.compiling import show_compilation

find_cache()
show_compilation()


def jit(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel: cached on disk, without the GIL, IEEE division, no fast-math."""
    return numba.njit(cache=True, nogil=True, error_model="numpy")(function)

"""What is shown while kernels are compiled, which happens once and takes a while."""

from __future__ import annotations

import atexit
import threading
from typing import Any

from numba.core import event


class _Bar(event.Listener):
    """Counts kernels as they are compiled, on a terminal or in Jupyter only."""

    def __init__(self) -> None:
        self._depth = threading.local()
        self._bar: Any = None

    def on_start(self, event: event.Event) -> None:
        """Show the bar at the first kernel; those within others do not count."""
        self._depth.value = getattr(self._depth, "value", 0) + 1
        if self._bar is None:
            from tqdm.auto import tqdm

            self._bar = tqdm(desc="compiling, once", unit=" kernels", disable=None)
            atexit.register(self._bar.close)

    def on_end(self, event: event.Event) -> None:
        """Count a kernel that is whole."""
        self._depth.value -= 1
        if self._depth.value == 0:
            self._bar.update()


def show_compilation() -> None:
    """Show from now on what is compiled."""
    event.register("numba:compile", _Bar())

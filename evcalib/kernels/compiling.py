"""What is shown while kernels are compiled, which happens once and takes a while."""

from __future__ import annotations

import os
import threading

from numba.core import event


class _Bar(event.Listener):
    """Tells of each kernel while it is compiled, on a terminal or in Jupyter only.

    Every kernel has a bar of its own, which is gone when it is done: what is printed next begins
    on a line of its own.
    """

    def __init__(self) -> None:
        self._own = threading.local()
        self._count = 0

    def on_start(self, event: event.Event) -> None:
        """Show a bar; kernels within others have none."""
        self._own.depth = getattr(self._own, "depth", 0) + 1
        if self._own.depth > 1:
            return
        from tqdm.auto import tqdm

        # An argument that is given overrides what the environment says.
        off = True if os.environ.get("TQDM_DISABLE", "0") != "0" else None
        self._count += 1
        self._own.bar = tqdm(
            desc="compiling, once",
            initial=self._count,
            unit=" kernels",
            bar_format="{desc}: {n_fmt}{unit}",
            leave=False,
            disable=off,
        )

    def on_end(self, event: event.Event) -> None:
        """Take the bar away."""
        self._own.depth -= 1
        if self._own.depth == 0:
            self._own.bar.close()


def show_compilation() -> None:
    """Show from now on what is compiled."""
    event.register("numba:compile", _Bar())

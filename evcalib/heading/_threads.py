"""Threads in which independent work of a heading estimate runs; kernels leave Python's lock."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import ParamSpec, Protocol, TypeVar

import numba

P = ParamSpec("P")
T = TypeVar("T")

MOST = 4
"""Most threads beside that which makes the keyframes: that one is the bottleneck from there on."""


class Submit(Protocol):
    """Starts a call; what it returns, or raises, is asked of the future."""

    def __call__(
        self, function: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs
    ) -> Future[T]: ...


def at_once(function: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
    """Call a function here and now."""
    future: Future[T] = Future()
    future.set_result(function(*args, **kwargs))
    return future


class Threads:
    """Runs calls in threads, in the order in which they are given.

    There are as many as ``NUMBA_NUM_THREADS`` says, or as there are cores; with one, calls run at
    once.
    """

    def __init__(self) -> None:
        count = min(numba.config.NUMBA_NUM_THREADS, MOST)  # type: ignore[attr-defined]
        self._pool = None if count == 1 else ThreadPoolExecutor(count, "headings")
        self.submit: Submit = at_once if self._pool is None else self._pool.submit

    def stop(self) -> None:
        """End the threads; what has not begun is left."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

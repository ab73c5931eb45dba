"""Where trials run: here, in processes, or on a Dask cluster; all of them look the same.

A pool has `submit`, which returns a `concurrent.futures.Future`; `width`, how many trials run at
once; `deaths`, the errors that mean that a worker died; and `revive`, which makes a pool that died
as a whole usable again.
"""

from __future__ import annotations

import multiprocessing
import os
import re
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from typing import Any, Protocol

from evcalib.errors import EvcalibError, InputError

THREADS = ("OMP", "OPENBLAS", "MKL", "NUMBA", "VECLIB_MAXIMUM", "NUMEXPR")
"""Libraries whose threads a worker does without: there is one worker per core already."""

CONNECT = 10.0
"""Time [s] that a scheduler has to answer; a choice."""

ASK_EVERY = 5.0
"""Time [s] after which the number of a cluster's workers is asked for again; a choice."""


class Pool(Protocol):
    """What the engine needs to know."""

    deaths: tuple[type[BaseException], ...]

    @property
    def width(self) -> int:
        """How many trials run at once."""

    def submit(self, function: Callable[..., Any], *args: Any) -> Future:
        """Start a call."""

    def revive(self) -> None:
        """Make a pool that died usable again."""

    def stop(self) -> None:
        """End the work; what has not finished is lost."""


@contextmanager
def open_pool(workers: int = 1, scheduler: str | None = None) -> Iterator[Pool]:
    """Open the pool that `workers` or `scheduler` asks for.

    Raises
    ------
    InputError
        If there are no workers, or the scheduler cannot be reached.
    EvcalibError
        If no process can be started.
    """
    if workers < 1:
        raise InputError(f"workers must be at least 1, not {workers}")
    if scheduler is not None:
        if workers != 1:
            raise InputError("give either workers or a scheduler: a cluster has its own workers")
        with _cluster(scheduler) as client:
            yield ClusterPool(client)
        return
    if workers == 1:
        yield SerialPool()
        return
    with _without_threads():
        pool = ProcessPool(workers)
        try:
            yield pool
        except BaseException:
            pool.stop()
            raise
        pool.close()


class SerialPool:
    """Runs every call at once, in this process."""

    deaths: tuple[type[BaseException], ...] = ()
    width = 1

    def submit(self, function: Callable[..., Any], *args: Any) -> Future:
        """Run a call and return its finished future."""
        future: Future = Future()
        try:
            future.set_result(function(*args))
        except Exception as error:
            future.set_exception(error)
        return future

    def revive(self) -> None:
        """Do nothing: it dies with this process only."""

    def stop(self) -> None:
        """Do nothing: nothing runs."""


class ProcessPool:
    """Runs calls in spawned processes of one thread each.

    Every process holds one end of a pipe.  When the other end closes, because the pool is stopped
    or because this process is gone, however it went, it ends.
    """

    deaths: tuple[type[BaseException], ...] = (BrokenProcessPool,)

    def __init__(self, workers: int) -> None:
        self.width = workers
        self.revive()

    def submit(self, function: Callable[..., Any], *args: Any) -> Future:
        """Hand a call to a process."""
        try:
            return self._executor.submit(function, *args)
        except BrokenProcessPool as error:
            future: Future = Future()
            future.set_exception(error)
            return future

    def revive(self) -> None:
        """Start processes, in place of those that were there."""
        if hasattr(self, "_executor"):
            self.stop()
        context = multiprocessing.get_context("spawn")
        self._far, self._near = context.Pipe(duplex=False)
        self._executor = ProcessPoolExecutor(
            self.width, mp_context=context, initializer=_start_worker, initargs=(self._far,)
        )
        try:
            self._executor.submit(os.getpid).result()
        except BrokenProcessPool:
            raise EvcalibError(
                "no worker process can be started; in a script (a file), what starts workers must"
                " stand under `if __name__ == '__main__':`"
            ) from None

    def stop(self) -> None:
        """End the processes; what they have not finished is lost."""
        self._near.close()
        self.close()

    def close(self) -> None:
        """Let the processes end by themselves."""
        self._executor.shutdown(wait=True, cancel_futures=True)
        self._near.close()
        self._far.close()


class ClusterPool:
    """Runs calls on a Dask cluster, which moves the work of a lost worker to others by itself."""

    def __init__(self, client: Any) -> None:
        from distributed import KilledWorker

        self.deaths: tuple[type[BaseException], ...] = (KilledWorker,)
        self._client = client
        self._executor = client.get_executor(pure=False)
        self._width, self._ask_at = 1, 0.0

    @property
    def width(self) -> int:
        """Threads of all workers that the cluster had within the last seconds."""
        now = time.monotonic()
        if now >= self._ask_at:
            with suppress(OSError):
                self._width = max(1, sum(self._client.nthreads().values()))
            self._ask_at = now + ASK_EVERY
        return self._width

    def submit(self, function: Callable[..., Any], *args: Any) -> Future:
        """Hand a call to the cluster."""
        return self._executor.submit(function, *args)

    def revive(self) -> None:
        """Do nothing: the cluster looks after its workers."""

    def stop(self) -> None:
        """Cancel what has not finished: the workers are not ours to wait for."""
        self._executor.shutdown(wait=False)


@contextmanager
def _cluster(address: str) -> Iterator[Any]:
    try:
        from distributed import Client
    except ImportError:
        raise InputError('a scheduler needs Dask: pip install "evcalib[distributed]"') from None
    told = (
        f"the scheduler {address} cannot be reached%s; start one with `dask scheduler` and give the"
        " address that it prints, like tcp://127.0.0.1:8786"
    )
    if not re.search(r":\d+/?$", address) and "://" not in address:
        raise InputError(told % ": the address has no port")
    try:
        client = _connected(Client, address)
    except (OSError, ValueError) as error:
        raise InputError(told % f" ({error})") from None
    if not client.nthreads():
        print(
            f"evcalib: waiting for workers: the scheduler has none; start some with `dask worker"
            f" {address}`, or stop with Ctrl-C",
            file=sys.stderr,
            flush=True,
        )
    with client:
        yield client


def _connected(client: Any, address: str) -> Any:
    """Connect; where nobody listens that is seen before Dask tries, which leaves a half client."""
    host, _, port = address.rpartition("://")[2].rstrip("/").rpartition(":")
    if port.isdigit():
        with socket.create_connection((host.strip("[]"), int(port)), timeout=CONNECT):
            pass
    return client(address, timeout=CONNECT, set_as_default=False)


@contextmanager
def _without_threads() -> Iterator[None]:
    """Let processes that start now use one thread each."""
    names = [f"{name}_NUM_THREADS" for name in THREADS]
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _start_worker(lifeline: Connection) -> None:
    """Leave Ctrl-C to the parent, and end when the parent lets go."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        with suppress(EOFError, OSError):
            lifeline.recv()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()

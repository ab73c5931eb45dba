"""Pipes as input: copied to a file first, since files are read more than once, or refused."""

from __future__ import annotations

import os
import select
import stat
import time
from pathlib import Path

from evcalib.errors import InputError

WRITER = 5.0
"""Time [s] for which a pipe that nobody writes into is waited for: a choice, long enough for two
commands that are started together."""

_BLOCK = 1 << 20


def refuse_pipe(path: str | Path) -> None:
    """Refuse what is neither a file nor a folder, before opening it can wait for ever.

    Raises
    ------
    InputError
        If it is a pipe, a socket or a device.
    """
    if is_pipe(path):
        raise InputError(f"{path} is a pipe, and a file is read more than once: write it to a file")
    if _is(path, stat.S_ISCHR, stat.S_ISBLK):
        raise InputError(f"{path} is a device, not a file")


def is_pipe(path: str | Path) -> bool:
    """Tell whether a path is a pipe or a socket, like that of ``<(...)``."""
    return _is(path, stat.S_ISFIFO, stat.S_ISSOCK)


def copy_pipe(path: str | Path, target: Path) -> None:
    """Write all that comes out of a pipe to a file.

    Raises
    ------
    InputError
        If nothing comes for `WRITER` seconds because nobody writes, or the copy cannot be written.
    """
    until, size = time.monotonic() + WRITER, 0
    try:
        with open(target, "wb") as file:
            source = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
            try:
                while True:
                    try:
                        block = os.read(source, _BLOCK)
                    except BlockingIOError:  # there is a writer, who has not written yet
                        select.select([source], [], [])
                        continue
                    size += file.write(block)
                    if not block and (size or time.monotonic() > until):
                        break
                    if not block:
                        time.sleep(0.05)
            finally:
                os.close(source)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    if not size:
        raise InputError(
            f"nothing comes out of the pipe {path}: start what writes into it first, or give a file"
        )


def _is(path: str | Path, *kinds: object) -> bool:
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return False
    return any(kind(mode) for kind in kinds)  # type: ignore[operator]

"""Files that stand under their name only when they are whole, whoever else writes there.

Devices, pipes and links stay what they are.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from evcalib.errors import InputError

PART = ".part"

READER = 5.0
"""Time [s] for which a pipe without a reader is waited for: a choice, long enough for two commands
that are started together."""


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a name to write to, and put what was written under `path` at the end.

    A regular file, or one that is not there yet, is written beside its place and moved there; a
    link stays, and the file that it leads to is replaced.  The name is this process's own, so two
    that write the same file cannot mix: the last one wins, whole.  After an error, Ctrl-C
    included, what was written is removed; what a killed process left is removed by the next one
    that writes the same file.

    Into anything else, a device, a pipe, or where this program's own output goes, the finished
    content is written as into any open file: nothing is ever moved over it.

    Raises
    ------
    OSError
        If the file cannot be moved to its place, or nobody reads the pipe.
    """
    place = _place(path)
    if place is None:
        with tempfile.TemporaryDirectory(prefix="evcalib-") as folder:
            part = Path(folder) / path.name
            yield part
            _pour(part, path)
        return
    _remove_orphans(place)
    part = place.with_name(f"{place.name}.{os.getpid()}{PART}")
    try:
        yield part
        with open(part, "rb+") as file:
            os.fsync(file.fileno())
        part.replace(place)
    except BaseException:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        raise


def is_output(path: str | Path) -> bool:
    """Tell whether a path is where this program prints, like ``/dev/stdout``."""
    return _printing(path, (1,)) is not None


def _place(path: Path) -> Path | None:
    """Return the name of the regular file to replace; None where there is something else."""
    try:
        found = os.stat(path)
    except FileNotFoundError:
        return Path(os.path.realpath(path)) if path.is_symlink() else path
    real = Path(os.path.realpath(path)) if path.is_symlink() else path
    regular = stat.S_ISREG(found.st_mode) and real.is_file() and not real.is_symlink()
    return real if regular and _printing(path) is None else None


def _printing(path: str | Path, streams: tuple[int, ...] = (1, 2)) -> int | None:
    """Return the standard stream that goes to a file, if one does."""
    for stream in streams:
        with contextlib.suppress(OSError):
            if os.path.samestat(os.stat(path), os.fstat(stream)):
                return stream
    return None


def _pour(part: Path, path: Path) -> None:
    """Write the content of a file into a device or a pipe."""
    stream = _printing(path)
    if stream is None:
        target = _opened(path)
    else:
        # A stream that was redirected goes on where it is, and opening it anew would start over.
        sys.stdout.flush()
        target = os.dup(stream)
    with open(part, "rb") as source, open(target, "wb") as sink:
        shutil.copyfileobj(source, sink, 1 << 20)


def _opened(path: Path) -> int:
    """Open what is there for writing; a pipe, as soon as somebody reads it."""
    until = time.monotonic() + READER
    while True:
        try:
            opened = os.open(path, os.O_WRONLY | getattr(os, "O_NONBLOCK", 0))
        except OSError as error:
            if error.errno != errno.ENXIO:
                raise
            if time.monotonic() > until:
                why = "nobody reads this pipe; start its reader first"
                raise OSError(error.errno, why) from None
            time.sleep(0.05)
        else:
            if hasattr(os, "set_blocking"):
                os.set_blocking(opened, True)
            return opened


def _remove_orphans(path: Path) -> None:
    """Remove the parts of this file whose processes are no more."""
    form = re.compile(re.escape(path.name) + r"\.(\d+)" + re.escape(PART))
    with contextlib.suppress(OSError):
        for name in os.listdir(path.parent):
            found = form.fullmatch(name)
            if found and not _alive(int(found[1])):
                path.with_name(name).unlink(missing_ok=True)


def _alive(process: int) -> bool:
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


Writer = Callable[[Path], object]


def write_file(path: Path, writer: Writer) -> None:
    """Write a file so that it stands under its name only when it is whole; see `replacing`.

    Parameters
    ----------
    path : Path
        Final name.
    writer : callable
        Writes the content to the path that it is given.

    Raises
    ------
    InputError
        If the file cannot be written; what was written of it is removed.
    """
    if os.path.isdir(path) or not path.name:
        raise InputError(f"cannot write {path}: it is a folder, not a file")
    with refusing(path), replacing(path) as part:
        writer(part)


@contextlib.contextmanager
def refusing(path: Path) -> Iterator[None]:
    """Turn errors of the system into errors of the input."""
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None

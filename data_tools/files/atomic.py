"""Files that stand under their name only when they are whole, whoever else writes there."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path

from evcalib.errors import InputError

PART = ".part"


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a name to write to beside `path`, and move it there at the end.

    The name is this process's own, so two that write the same file cannot mix: the last one wins,
    whole.  After an error, Ctrl-C included, what was written is removed; what a killed process
    left is removed by the next one that writes the same file.

    Raises
    ------
    OSError
        If the file cannot be moved to its place.
    """
    _remove_orphans(path)
    part = path.with_name(f"{path.name}.{os.getpid()}{PART}")
    try:
        yield part
        with open(part, "rb+") as file:
            os.fsync(file.fileno())
        part.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        raise


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
    """Write a file so that it stands under its name only when it is whole.

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
    with _refusing(path), replacing(path) as part:
        writer(part)


@contextlib.contextmanager
def _refusing(path: Path) -> Iterator[None]:
    """Turn errors of the system into errors of the input."""
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None

"""What files a run read, for its report."""

from __future__ import annotations

import hashlib
from pathlib import Path

from evcalib.errors import InputError
from evcalib.pipeline import InputFile


def input_file(path: str | Path, *, digest: bool = False) -> InputFile:
    """Describe a file, or a folder (such as a ROS 2 bag) by the sum of its files.

    Parameters
    ----------
    path : path
        What was read.
    digest : bool
        Also compute the SHA-256 of a file, which reads it once more.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    path = Path(path)
    try:
        if path.is_dir():
            size = sum(one.stat().st_size for one in path.rglob("*") if one.is_file())
            return InputFile(path.resolve().name, size)
        size = path.stat().st_size
        if not digest:
            return InputFile(path.name, size)
        with open(path, "rb") as file:
            return InputFile(path.name, size, hashlib.file_digest(file, "sha256").hexdigest())
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None

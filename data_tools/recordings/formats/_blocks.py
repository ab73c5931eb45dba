"""A file's bytes in blocks, with errors of reading in words."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from evcalib.errors import InputError


def read_blocks(path: Path, start: int, size: int) -> Iterator[bytes]:
    """Yield the bytes from `start` to the end, `size` at a time, the last block shorter."""
    try:
        with path.open("rb") as file:
            file.seek(start)
            while block := file.read(size):
                yield block
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None

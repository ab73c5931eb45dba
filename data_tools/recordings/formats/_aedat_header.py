"""The text header of AEDAT 2 and 3: lines that begin with #, then data; and the chips it names."""

from __future__ import annotations

import re
from pathlib import Path

from data_tools.recordings.formats import Size
from evcalib.errors import InputError

MAGIC = b"#!AER-DAT"
LARGEST_HEADER = 1 << 24
"""Bytes; jAER writes all its preferences into it, 175 kB in a real file."""

_LINE = re.compile(rb"#[\t\x20-\x7e\x80-\xff]*\r?\n")
_TEXT = re.compile(rb"#[\t\x20-\x7e\x80-\xff]*\r?")
_END = re.compile(rb"#\s*!?\s*END[ -](OF ASCII )?HEADER", re.IGNORECASE)
_CHIPS: dict[str, Size] = {
    "DVS128": (128, 128),
    "DAVIS128": (128, 128),
    "DAVIS208": (208, 192),
    "DAVIS240": (240, 180),
    "DAVIS346": (346, 260),
    "DAVIS640": (640, 480),
}


def version(head: bytes) -> str:
    """Return ``2.0`` and the like, of a file that starts with `MAGIC`."""
    return head[len(MAGIC) :].split(b"\n")[0].decode("ascii", "replace").strip()


def chip_size(name: str) -> Size | None:
    """Return the sensor size (width, height) [px] of a chip, by a name that holds its own."""
    return next((size for chip, size in _CHIPS.items() if chip in name.upper()), None)


def read_header(path: Path) -> tuple[list[str], int]:
    """Return the lines of a header, and where the data starts [bytes].

    Raises
    ------
    InputError
        If the file cannot be read, or ends within its header.
    """
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_HEADER)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    lines, at = [], 0
    while (line := _LINE.match(data, at)) is not None:
        lines.append(line[0].decode("utf-8", "replace").strip())
        at = line.end()
        if _END.match(line[0]):
            break
    if at == len(data) or not lines or _TEXT.fullmatch(data, at):
        raise InputError(f"{path} ends within its header, or after it: it holds no events")
    return lines, at

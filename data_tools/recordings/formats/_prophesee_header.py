"""The text header that Prophesee's files start with: lines of `% keyword value`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from data_tools.recordings.formats import Size
from evcalib.errors import InputError

LARGEST_HEADER = 1 << 16

_LINE = re.compile(rb"% ?([ -~\t]*)\r?\n")
_TEXT = frozenset(b"\n" + bytes(range(32, 127)))
_LOOK = 8
_SIDES = re.compile(r"([1-9]\d{0,5})x([1-9]\d{0,5})")


@dataclass(frozen=True)
class Header:
    """Fields of a header, by keyword in small letters, and where the data starts [bytes]."""

    fields: dict[str, str]
    end: int

    @property
    def encoding(self) -> str | None:
        """``EVT3`` and the like; None where the header does not tell it."""
        named = self.fields.get("format", "").split(";")[0].strip().upper()
        version = self.fields.get("evt")
        numbered = None if version is None else "EVT" + version.removesuffix(".0")
        if named and numbered and named.replace(".", "") != numbered.replace(".", ""):
            return f"{named} or {numbered}"
        return named or numbered

    def option(self, name: str) -> str | None:
        """Return a field, or an option within the field `format` (`EVT3;height=720`)."""
        for part in self.fields.get("format", "").split(";")[1:]:
            key, _, value = part.partition("=")
            if key.strip().lower() == name:
                return value.strip()
        return self.fields.get(name)

    def size(self, path: Path, largest: int) -> Size | None:
        """Return the sensor's (width, height) [px] if the header tells it.

        Raises
        ------
        InputError
            If it is no size, or larger than the format can count.
        """
        width, height = self.option("width"), self.option("height")
        text = self.fields.get("geometry")
        if width is not None and height is not None:
            text = f"{width}x{height}"
        if text is None:
            return None
        found = _SIDES.fullmatch(text.strip())
        if found is None or max(int(found[1]), int(found[2])) > largest:
            raise InputError(f"{path} has a damaged header: it gives the sensor's size as {text!r}")
        return int(found[1]), int(found[2])


def parse_header(data: bytes) -> Header:
    """Parse the header of a file's first bytes; without one, the data starts at 0."""
    fields: dict[str, str] = {}
    at = 0
    while (line := _LINE.match(data, at, at + 4096)) is not None:
        at = line.end()
        key, _, value = line[1].decode("ascii").strip().partition(" ")
        fields.setdefault(key.lower(), value.strip())
        if key.lower() == "end":
            break
    return Header(fields, at)


def read_header(path: Path) -> Header:
    """Read and parse the header of a file.

    Raises
    ------
    InputError
        If the file cannot be read, or its header goes on after the last line that makes sense:
        it is cut off or damaged, and the rest of it would be taken for events.
    """
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_HEADER)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    header = parse_header(data)
    after = data[header.end : header.end + _LOOK]
    text = after[:2] == b"% " or (len(after) == _LOOK and _TEXT.issuperset(after))
    if header.end and "end" not in header.fields and text:
        raise InputError(f"{path} has a damaged header: {after!r} follows it")
    return header

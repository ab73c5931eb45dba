"""Prophesee's raw files: a text header, then EVT 2.0 or EVT 3.0 words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from data_tools.recordings.formats import Columns, Options, Size, Source
from data_tools.recordings.formats._blocks import read_blocks
from data_tools.recordings.formats._evt import UNKNOWN, Evt2Decoder, Evt3Decoder
from data_tools.recordings.formats._prophesee_header import Header, parse_header, read_header
from evcalib.errors import InputError

NAMES = ("evt2", "evt3")

LARGEST_SIDE = 2048
"""The words hold 11 bits of x and y."""

BLOCK_BYTES = 1 << 20

_DECODERS = {"evt2": Evt2Decoder, "evt3": Evt3Decoder}

WORD_BYTES = {"evt2": 4, "evt3": 2}

# A block with a larger share of unknown words is not what its header says.
_WRONG_WORDS = 0.1
_ENOUGH = 100

# What a sensor is known by where the header does not tell its size; the longer name first.
_SENSORS: tuple[tuple[str, Size], ...] = (
    ("genx320", (320, 320)),
    ("imx636", (1280, 720)),
    ("imx646", (1280, 720)),
    ("gen4", (1280, 720)),
    ("gen3", (640, 480)),
)


def matches(path: Path, head: bytes) -> bool:
    """Tell whether there is a header that names an encoding."""
    return parse_header(head).encoding is not None


def open(path: Path, options: Options) -> Source:
    """Open a raw file; without a header, `options` must say format and size."""
    header = read_header(path)
    name = _encoding(path, header, options)
    endianness = header.option("endianness")
    if endianness not in (None, "little"):
        raise InputError(f"{path} has {endianness}-endian words; only little-endian ones are read")
    declared = header.size(path, LARGEST_SIDE)
    notes: tuple[str, ...] = ()
    if declared is None and options.size is None:
        declared, notes = _implied(header)
    width, height = options.sensor(path, declared)

    def pieces(losses: Counter[str]) -> Iterator[Columns]:
        decoder = _DECODERS[name]()
        for block in read_blocks(path, header.end, BLOCK_BYTES):
            yield from decoder.pieces(block)
            _check_words(path, name, len(block), decoder.losses)
            losses.update(decoder.take_losses())
        decoder.finish()
        losses.update(decoder.take_losses())

    return Source(name, width, height, pieces, notes, fixed="us")


def _encoding(path: Path, header: Header, options: Options) -> str:
    found = header.encoding
    name = options.format if found is None else found.lower()
    if name not in NAMES:
        raise InputError(f"{path} holds {found} words; only EVT2 and EVT3 are read: convert it")
    if options.format not in (None, name):
        raise InputError(f"{path} holds {found} words by its header, not {options.format}")
    return name


def _check_words(path: Path, name: str, size: int, losses: Counter[str]) -> None:
    unknown = losses[UNKNOWN]
    if unknown > _WRONG_WORDS * size / WORD_BYTES[name] and unknown > _ENOUGH:
        raise InputError(
            f"{path}: {unknown} words of {size // WORD_BYTES[name]} are of unknown type;"
            f" is it {name.upper()}, and is the file whole?"
        )


def _implied(header: Header) -> tuple[Size | None, tuple[str, ...]]:
    told = " ".join(
        header.fields.get(key, "") for key in ("plugin_name", "sensor_name", "sensor_generation")
    ).lower()
    for sensor, size in _SENSORS:
        if sensor in told:
            return size, (f"the sensor's size, {size[0]}x{size[1]} px, is that of {sensor}",)
    return None, ()

"""What `rosbags` would take at its word: sizes of unpacked chunks, and the YAML of a folder."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from data_tools._unpack import MOST, check_ratio, unpack, zstd_size
from data_tools.text_files import read_yaml
from evcalib.errors import InputError

METADATA = "metadata.yaml"
_ZSTD_HEAD = 18


def check_folder(path: Path) -> None:
    """Refuse a folder whose description is no plain YAML, or whose packed files are bombs.

    Raises
    ------
    InputError
        Which of them, and why.
    """
    read_yaml(path / METADATA)
    for file in path.iterdir():
        with file.open("rb") as stream:
            size = zstd_size(stream.read(_ZSTD_HEAD))
        if size is not None:
            check_ratio(size, file.stat().st_size)


def bound_chunks(reader: Any) -> None:
    """See that no chunk of an opened reader unpacks to more than `MOST` bytes.

    The reader of ROS 1 bags is given functions that stop there.  For MCAP, LZ4 packs 255 times at
    best, and a zstd frame tells its size, which its library enforces.

    Raises
    ------
    InputError
        If a chunk declares more, or does not tell.
    """
    if hasattr(reader, "chunks"):
        from rosbags.rosbag1.reader import decompressors

        kinds = {function: kind for kind, function in decompressors.items()}
        for place, chunk in reader.chunks.items():
            bounded = partial(unpack, kind=kinds[chunk.decompressor])
            reader.chunks[place] = chunk._replace(decompressor=bounded)
        return
    whole = reader.storage
    for storage in getattr(whole, "storages", [whole]):
        for chunk in getattr(storage, "chunks", []):
            _check_mcap(storage, chunk)


def _check_mcap(storage: Any, chunk: Any) -> None:
    size = chunk.uncompressed_size
    if chunk.compression == "zstd":
        place = chunk.chunk_start_offset + 9 + 40 + len(chunk.compression)
        storage.bio.seek(place)
        told = zstd_size(storage.bio.read(_ZSTD_HEAD))
        size = MOST + 1 if told is None else max(size, told)
    if size > MOST:
        raise InputError(f"a chunk at byte {chunk.chunk_start_offset} unpacks to over {MOST} bytes")

"""What `rosbags` would take at its word: sizes of unpacked chunks, and the YAML of a folder."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

from data_tools.files.text import read_yaml
from data_tools.files.unpack import MOST, check_ratio, unpack, unpacked_size, zstd_size
from evcalib.errors import InputError

METADATA = "metadata.yaml"
_ZSTD_HEAD = 18


def check_files(path: Path) -> None:
    """Refuse what `rosbags` would be led astray by, in a file or a folder of files.

    That is a description that is no plain YAML, packed files that are bombs, and databases in
    which a query, which may never end, stands for the messages.

    Raises
    ------
    InputError
        Which of them, and why.
    """
    if path.is_dir():
        read_yaml(path / METADATA)
    for file in path.iterdir() if path.is_dir() else (path,):
        with file.open("rb") as stream:
            head = stream.read(_ZSTD_HEAD)
        size = zstd_size(head)
        if size is not None:
            check_ratio(size, file.stat().st_size)
        if head.startswith(b"SQLite format 3"):
            _check_database(file)


def _check_database(path: Path) -> None:
    address = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
    with closing(sqlite3.connect(address, uri=True)) as database:
        kinds = {kind for (kind,) in database.execute("SELECT type FROM sqlite_master")}
    if not kinds <= {"table", "index"}:
        raise InputError(f"{path} holds more than tables: {', '.join(sorted(kinds))}")


def bound_chunks(reader: Any) -> None:
    """See that no chunk of an opened reader unpacks to more than `MOST` bytes.

    The reader of ROS 1 bags is given functions that stop there.  For MCAP, LZ4 packs 255 times at
    best, and a zstd frame tells its size, which its library enforces.  Where it does not tell, as
    streaming writers leave it, the chunk is unpacked here once, in constant memory.

    Raises
    ------
    InputError
        If a chunk declares more, or unpacks to more than it declares.
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
        head = storage.bio.read(_ZSTD_HEAD)
        told = zstd_size(head)
        if told is None and size <= MOST:
            unpacked_size(head + storage.bio.read(chunk.compressed_size - len(head)), size)
        size = max(size, told or 0)
    if size > MOST:
        raise InputError(f"a chunk at byte {chunk.chunk_start_offset} unpacks to over {MOST} bytes")

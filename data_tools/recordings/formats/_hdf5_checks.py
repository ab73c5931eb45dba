"""What must hold of the datasets of an HDF5 file before any of their values is read."""

from __future__ import annotations

from math import prod
from pathlib import Path
from typing import Any

import h5py

from data_tools.files.unpack import check_ratio
from evcalib.errors import InputError

MAX_CHUNK = 1 << 28
"""A chunk [bytes] is unpacked as a whole, so larger ones are refused."""
MAX_CHUNK_ROWS = 1 << 25
MAX_ROW = 1024
"""Bytes of a row at most."""


def check_columns(path: Path, columns: list[h5py.Dataset]) -> None:
    """See that columns are numbers, all of them in the file, and of a size that it can hold.

    Raises
    ------
    InputError
        Which column is not, and why.
    """
    _check_kinds(columns)
    _check_sizes(path, columns)
    _check_filters(columns)
    for column in columns:
        _check_stored(column)


def _check_sizes(path: Path, columns: list[h5py.Dataset]) -> None:
    for column in columns:
        chunk = prod(column.chunks) * column.dtype.itemsize if column.chunks else 0
        if chunk > MAX_CHUNK or (column.chunks and column.chunks[0] > MAX_CHUNK_ROWS):
            raise InputError(
                f"{path}: {column.name} is in chunks of {chunk} bytes, each unpacked as a whole;"
                " write it in smaller ones: h5repack -l CHUNK=100000"
            )
    declared, held = sum(column.nbytes for column in columns), path.stat().st_size
    try:
        check_ratio(declared, held)
    except InputError:
        raise InputError(
            f"{path} declares {declared} bytes of events, but the whole file has {held}: it is"
            " damaged or made to fill the memory; write it again (h5repack) if it is sound"
        ) from None


def _check_kinds(columns: list[h5py.Dataset]) -> None:
    """Refuse what are no plain numbers in this file: texts, references, views of other files."""
    for column in columns:
        dtype = column.dtype
        kinds = [dtype[name] for name in dtype.names] if dtype.names else [dtype]
        if dtype.itemsize > MAX_ROW or any(kind.kind not in "biuf" for kind in kinds):
            raise InputError(f"{column.name} must hold numbers, not {str(dtype)[:100]}")
        if column.is_virtual or column.external:
            raise InputError(f"{column.name} is stored in other files; copy it into one: h5repack")


def _check_stored(column: h5py.Dataset) -> None:
    """See that all values are in the file: HDF5 reads zeros where they are not.

    A stored chunk that is larger than its content is refused: it could unpack to any size.
    """
    if not column.chunks or not column.size:
        if column.id.get_storage_size() != column.nbytes:
            raise InputError(f"{column.name} lacks values: the file is damaged")
        return
    steps = [range(0, n, c) for n, c in zip(column.shape, column.chunks, strict=True)]
    expected = prod(map(len, steps))
    largest = prod(column.chunks) * column.dtype.itemsize * 9 // 8 + 4096
    found: set[tuple[int, ...]] = set()

    def see(chunk: Any) -> None:
        at = tuple(chunk.chunk_offset)
        if chunk.size <= largest and all(k in step for k, step in zip(at, steps, strict=True)):
            found.add(at)

    if hasattr(column.id, "chunk_iter"):
        column.id.chunk_iter(see)
    count = len(found) if hasattr(column.id, "chunk_iter") else column.id.get_num_chunks()
    if count != expected:
        raise InputError(
            f"{column.name} lacks values: of its {expected} chunks {count} are sound; the file is"
            " damaged, or was not closed after writing"
        )


def _check_filters(columns: list[h5py.Dataset]) -> None:
    """See that all compressions can be undone; those beyond HDF5's own come with hdf5plugin."""
    for column in columns:
        plist = column.id.get_create_plist()
        for k in range(plist.get_nfilters()):
            code, _, _, name = plist.get_filter(k)
            if not (h5py.h5z.filter_avail(code) or _with_plugin(code)):
                label = name.decode("utf-8", "replace") or "unnamed"
                raise InputError(
                    f"{column.name} is compressed with {label} (HDF5 filter {code}), which is not"
                    ' installed: pip install "evcalib[formats]" has Blosc, Zstd and LZ4; for'
                    " Prophesee's ECF set HDF5_PLUGIN_PATH to its plugin"
                )


def _with_plugin(code: int) -> bool:
    try:
        import hdf5plugin  # noqa: F401
    except ImportError:
        return False
    return bool(h5py.h5z.filter_avail(code))

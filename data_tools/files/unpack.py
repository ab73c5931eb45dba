"""Compressed pieces of files, unpacked to a size that is known beforehand, never to all memory."""

from __future__ import annotations

import bz2
from typing import Any

from evcalib.errors import InputError

MOST = 1 << 30
"""No chunk or packet of a recording unpacks to more bytes."""

MAX_RATIO = 200
"""Recordings of events pack 3 to 20 times; a file that unpacks to more than this is a bomb."""
HARMLESS = 1 << 28
"""Sizes [bytes] below this are not compared with that of the packed file."""

_DAMAGE: tuple[type[Exception], ...] = (OSError, EOFError, RuntimeError)


def unpack(data: bytes, kind: str, most: int = MOST) -> bytes:
    """Return what one compressed piece holds.

    Parameters
    ----------
    data : bytes
        The whole piece: one bz2 stream, or one LZ4 or zstd frame.
    kind : {"none", "bz2", "lz4", "zstd"}
        How it is compressed.
    most : int
        Largest size [bytes] that it may have; at most `MOST`.

    Raises
    ------
    InputError
        If the piece is damaged, cut off, followed by other data, or larger than `most`.
    """
    most = min(most, MOST)
    if kind == "none":
        unpacked, whole = data, True
    else:
        stream = _stream(kind)
        # LZ4's room is allocated at once: no more than the piece can fill.
        room = min(most, 256 * len(data)) if kind == "lz4" else most
        try:
            unpacked = bytes(stream.decompress(data, room + 1))
        except (*_DAMAGE, *_errors(kind)) as error:
            raise InputError(f"{kind} data is damaged: {error}") from None
        whole = stream.eof and not stream.unused_data
    if len(unpacked) > most:
        raise InputError(f"{len(data)} bytes of {kind} data unpack to more than {most} bytes")
    if not whole:
        raise InputError(f"{kind} data is damaged or cut off")
    return unpacked


def zstd_size(head: bytes) -> int | None:
    """Return the size [bytes] that the head of a zstd frame declares; None if it is no such head.

    The library stops at this size.
    """
    if not head.startswith(b"\x28\xb5\x2f\xfd"):
        return None
    try:
        size = _zstd().get_frame_info(head).decompressed_size
    except ImportError:
        return None
    except _zstd().ZstdError:
        return None
    return None if size is None else int(size)


def unpacked_size(data: bytes, most: int) -> int:
    """Return what a zstd frame unpacks to [bytes], without holding it.

    Raises
    ------
    InputError
        If the frame is damaged or cut off, or unpacks to more than `most`.
    """
    stream, size = _stream("zstd"), 0
    try:
        while not stream.eof:
            size += (part := len(stream.decompress(data, 1 << 20)))
            if size > most:
                raise InputError(f"{len(data)} bytes unpack to more than the {most} declared")
            if not part and stream.needs_input:
                raise InputError("zstd data is cut off")
            data = b""
        if stream.unused_data:
            raise InputError("zstd data is damaged: it goes on after its end")
    except _errors("zstd") as error:
        raise InputError(f"zstd data is damaged: {error}") from None
    return size


def check_ratio(unpacked: int, packed: int) -> None:
    """Refuse what would unpack, or has unpacked, to more than a recording can.

    Raises
    ------
    InputError
        If the size is over `HARMLESS` and `MAX_RATIO` times the packed one.
    """
    if unpacked > HARMLESS and unpacked > MAX_RATIO * packed:
        raise InputError(
            f"{packed} bytes unpack to {unpacked} or more: it is damaged or made to fill the memory"
        )


def _stream(kind: str) -> Any:
    if kind == "bz2":
        return bz2.BZ2Decompressor()
    try:
        if kind == "lz4":
            from lz4.frame import LZ4FrameDecompressor

            return LZ4FrameDecompressor()
        if kind == "zstd":
            return _zstd().ZstdDecompressor()
    except ImportError:
        raise InputError(f'{kind} data needs a library: pip install "evcalib[formats]"') from None
    raise InputError(f"data is compressed with {kind!r}, which is not known")


def _errors(kind: str) -> tuple[type[Exception], ...]:
    return (_zstd().ZstdError,) if kind == "zstd" else ()


def _zstd() -> Any:
    try:
        from compression import zstd  # Python 3.14
    except ImportError:
        from backports import zstd
    return zstd

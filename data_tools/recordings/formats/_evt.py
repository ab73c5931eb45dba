"""Decoders of Prophesee's EVT 2.0 and EVT 3.0 words that keep their state from buffer to buffer."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from types import ModuleType

import numpy as np

from data_tools.recordings.formats import Columns, _evt2_kernels, _evt3_kernels

UNKNOWN = "words of unknown type"
"""Reason under which such words are counted."""

_ROOM = 1 << 18


class _WordDecoder:
    """What both decoders share: bytes in of any number, columns out.

    Attributes
    ----------
    losses : Counter of str
        What could not be used so far: reason and count.
    """

    _kernels: ModuleType
    _word: np.dtype
    _reasons: dict[int, str]

    def __init__(self) -> None:
        self._state = self._kernels.new_state()
        self._rest = b""
        self.losses: Counter[str] = Counter()

    def decode(self, data: bytes | bytearray | memoryview) -> Columns:
        """Return the events of the next bytes of the stream, in the order of the words.

        `data` may end within a word.  Times [us] are those of the sensor's clock, its loops
        undone; they may step back.  Pixels are not checked against a sensor.
        """
        return Columns.joined(list(self.pieces(data)))

    def pieces(self, data: bytes | bytearray | memoryview) -> Iterator[Columns]:
        """Yield what `decode` returns in pieces of up to 262,144 events, at least one piece."""
        buffer = self._rest + bytes(data) if self._rest else memoryview(data)
        words = np.frombuffer(buffer, self._word, len(buffer) // self._word.itemsize)
        self._rest = bytes(buffer[words.nbytes :])
        at = 0
        while True:
            read, piece = self._decode(words[at:])
            at += read
            self._count()
            yield piece
            if at == words.size:
                return

    def take_losses(self) -> Counter[str]:
        """Return what could not be used since this was last asked, and forget it."""
        losses, self.losses = self.losses, Counter()
        return losses

    def finish(self) -> None:
        """Count what is left of a word at the end of the stream."""
        if self._rest:
            self.losses["bytes of a cut-off last word"] += len(self._rest)
            self._rest = b""

    def _decode(self, words: np.ndarray) -> tuple[int, Columns]:
        # Pages of the room that no event reaches are never touched, so a copy would cost more.
        room = min(_ROOM, words.size * self._kernels.MOST_PER_WORD + self._kernels.MOST_PER_WORD)
        x, y = np.empty((2, room), np.uint16)
        t, p = np.empty(room, np.int64), np.empty(room, np.bool_)
        read, n = self._kernels.decode(words, x, y, t, p, self._state)
        return read, Columns(x[:n], y[:n], t[:n], p[:n])

    def _count(self) -> None:
        for field, reason in self._reasons.items():
            if self._state[field]:
                self.losses[reason] += int(self._state[field])
                self._state[field] = 0


class Evt2Decoder(_WordDecoder):
    """Decoder of EVT 2.0, 32-bit words, little-endian."""

    _kernels = _evt2_kernels
    _word = np.dtype("<u4")
    _reasons = {  # noqa: RUF012
        _evt2_kernels.EARLY: "events before the first time word",
        _evt2_kernels.UNKNOWN: UNKNOWN,
    }


class Evt3Decoder(_WordDecoder):
    """Decoder of EVT 3.0, 16-bit words, little-endian."""

    _kernels = _evt3_kernels
    _word = np.dtype("<u2")
    _reasons = {  # noqa: RUF012
        _evt3_kernels.NO_TIME: "events before the first time words",
        _evt3_kernels.NO_PLACE: "events before the first row or base column",
        _evt3_kernels.UNKNOWN: UNKNOWN,
    }

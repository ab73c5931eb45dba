"""The results of a running study: one line per finished piece of work, appended and checked.

Neither HDF5 nor Parquet survives being killed while a file is open for writing.  A text file that
is only ever appended to does: at worst its last line is torn, and a line that does not match its
checksum is as if it had never been written.  When the last trial is done, the journal is folded
into the columnar file (see `table`), and removed.

SQLite was tried in its place: 50 lines fewer, and as fast (0.4 s of processor time for 10,000 rows,
a transaction each, against 0.3 s), but a file that lost its end is lost whole, a changed byte comes
back as a wrong number, and folders without locks are refused.
"""

from __future__ import annotations

import json
import os
import time
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from data_tools.studies._engine.study import Outcome, check_identity
from evcalib.errors import EvcalibError, InputError

try:
    import fcntl
except ImportError:  # pragma: no cover  (Windows has no such locks; nothing else needs them)
    fcntl = None  # type: ignore[assignment]

SYNC_EVERY = 1.0
"""Time [s] between forcing what was written onto the disk; a killed process needs none of it.

A choice: a power cut costs a second of work, and quick trials do not wait for the disk each."""


class Journal:
    """An open journal, locked against a second run.

    Parameters
    ----------
    path : Path
        The file; made if there is none.
    identity : dict
        See `Study.identity`.

    Raises
    ------
    InputError
        If the file is of another run, is no journal, or is in use.
    EvcalibError
        If it cannot be written.
    """

    def __init__(self, path: Path, identity: Mapping[str, Any]) -> None:
        self.path = path
        self._sync_at = 0.0
        try:
            mode = "r+b" if path.exists() else "w+b"
            self._file = open(path, mode, buffering=0)  # noqa: SIM115  (stays open: it is locked)
        except OSError as error:
            raise EvcalibError(f"cannot write {path}: {error.strerror}") from None
        try:
            self._lock()
            self._end = self._check(identity)
        except BaseException:
            self._file.close()
            raise

    def append(self, outcomes: Sequence[Outcome]) -> None:
        """Write outcomes so that they outlive this process (and within a second, a power cut)."""
        content = [
            [*outcome.key, outcome.failure] if outcome.failure else [*outcome.key, outcome.rows]
            for outcome in outcomes
        ]
        self._write(content)

    def outcomes(self) -> Iterator[Outcome]:
        """Yield every outcome that was written, in the order of writing."""
        with open(self.path, "rb") as file:
            next(_lines(file), None)
            for content in _lines(file):
                for cell, trial, result in content or ():
                    key = (cell, trial)
                    if isinstance(result, str):
                        yield Outcome(key, failure=result)
                    else:
                        yield Outcome(key, tuple(result))

    def close(self) -> None:
        """Give up the lock."""
        if not self._file.closed:
            with suppress(OSError):
                os.fsync(self._file.fileno())
        self._file.close()

    def remove(self) -> None:
        """Delete the file."""
        self.path.unlink(missing_ok=True)
        self.close()

    def _lock(self) -> None:
        if fcntl is None:
            return
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(f"{self.path} is in use: the same study runs elsewhere") from None
        except OSError:  # pragma: no cover  (some network folders have no locks)
            return

    def _check(self, identity: Mapping[str, Any]) -> int:
        """Compare or write the first line, cut off a torn last one, return the length."""
        end = _whole(self._file)
        self._file.seek(0)
        if end == 0:
            torn, first = self._file.read(), _line(dict(identity))
            if not first.startswith(torn):
                raise InputError(f"{self.path} is no journal of a study; remove it")
            self._end = 0
            self._write(dict(identity))
            return self._end
        stored = _content(self._file.readline())
        if not isinstance(stored, dict):
            raise InputError(f"{self.path} is no journal of a study, or it is damaged; remove it")
        check_identity(stored, identity, self.path)
        self._file.truncate(end)
        return end

    def _write(self, content: Any) -> None:
        line = _line(content)
        try:
            self._file.seek(self._end)
            rest = memoryview(line)
            while rest:
                rest = rest[self._file.write(rest) :]
            self._file.truncate()
            if time.monotonic() >= self._sync_at:
                os.fsync(self._file.fileno())
                self._sync_at = time.monotonic() + SYNC_EVERY
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(self._end)
            raise EvcalibError(
                f"cannot write {self.path}: {error.strerror}; what was finished before is kept:"
                " mend the cause and give the same command again"
            ) from None
        self._end += len(line)


def _line(content: Any) -> bytes:
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":")).encode()
    return b"%08x %s\n" % (zlib.crc32(text), text)


def _content(line: bytes) -> Any:
    """Return what a line says, or None if it is damaged."""
    checksum, _, text = line.rstrip(b"\n").partition(b" ")
    if not line.endswith(b"\n") or checksum != b"%08x" % zlib.crc32(text):
        return None
    return json.loads(text)


def _lines(file: IO[bytes]) -> Iterator[Any]:
    for line in file:
        yield _content(line)


def _whole(file: IO[bytes]) -> int:
    """Return the length of the file up to its last line end."""
    end, block = file.seek(0, os.SEEK_END), 1 << 16
    while end > 0:
        start = max(0, end - block)
        file.seek(start)
        found = file.read(end - start).rfind(b"\n")
        if found >= 0:
            return start + found + 1
        end = start
    return 0

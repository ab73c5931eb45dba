"""The output folder of a run: complete, or marked as incomplete, and never half-written.

Every file is written beside its final name and moved there when it is whole.  A file
``INCOMPLETE`` stands in the folder from the first moment to the last; ``report.html`` and
``calibration.yaml`` get their names at the end, in this order.  So whatever ends a run, an error,
Ctrl-C, ``kill -9`` or a full disk:

- a file under its final name is whole;
- ``calibration.yaml`` means that everything else is there;
- where ``INCOMPLETE`` stands, the run did not finish.
"""

from __future__ import annotations

import contextlib
import os
import re
import time
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from data_tools.files.atomic import PART, Writer, refusing, write_file
from data_tools.logs.series_files import write_headings, write_velocities
from data_tools.runs.export import write_calibration
from evcalib.errors import EvcalibError, InputError

try:
    import fcntl
except ImportError:  # pragma: no cover  (not on Windows)
    fcntl = None  # type: ignore[assignment]
if TYPE_CHECKING:
    from evcalib.pipeline import CalibrationRun

MARKER = "INCOMPLETE"

CALIBRATION = "calibration.yaml"

LAST = ("report.html", CALIBRATION)
"""Files that get their names at the end, in this order."""

NAMES = (
    "headings.csv",
    "velocities.csv",
    "correlation.png",
    "directions.png",
    "residuals.png",
    "sphere.png",
    *LAST,
)
"""All files that a run, or an alignment, may leave behind."""


class RunFolder:
    """The folder of one run, as a context manager.

    Nothing in an existing folder is touched before the first `write`: an error of the input before
    it leaves the folder as it was.

    Parameters
    ----------
    path : path
        The folder; made if it is not there.
    overwrite : bool
        Replace the files of an earlier complete run.
    command : str
        What is running, for the marker.

    Raises
    ------
    InputError
        On entering, if the folder cannot be made or written, is in use by another run, holds files
        that are not ours, or a complete run that is not to be overwritten.
    """

    def __init__(self, path: str | Path, *, overwrite: bool = False, command: str = "") -> None:
        self.path = Path(path)
        self._overwrite = overwrite
        self._command = command
        self._started = time.strftime("%Y-%m-%d %H:%M:%S %z")
        self._stage = "starting"
        self._made: list[Path] = []
        self._was_marked = False
        self._written = False
        self._waiting: dict[str, Path] = {}
        self._locked: int | None = None

    def __enter__(self) -> Self:
        """Check the folder, make it, and mark it as incomplete."""
        self._check()
        self._made = [p for p in (self.path, *self.path.parents) if not os.path.lexists(p)]
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"cannot make the folder {self.path}: {error.strerror or error}"
            ) from None
        self._lock()
        try:
            self._check()
            self._mark()
        except BaseException:
            self._undo()
            self._unlock()
            raise
        return self

    def stage(self, name: str) -> None:
        """Note in the marker what is going on."""
        self._stage = name
        self._mark()

    def write(self, name: str, writer: Writer) -> None:
        """Write one of the files in `NAMES`; those in `LAST` get their names at the end.

        Raises
        ------
        InputError
            If it cannot be written; the run is then incomplete.
        """
        if name not in NAMES:
            raise ValueError(f"{name} is not a file of a run")
        if not self._written:
            self._clear()
            self._written = True
        path = self.path / name
        if name in LAST:
            self._waiting[name] = _write_part(path, writer)
        else:
            write_file(path, writer)

    def write_run(self, run: CalibrationRun) -> None:
        """Write headings, velocities, report and calibration of a run."""
        from evcalib.report import report_html

        self.write("headings.csv", lambda p: write_headings(p, run.estimate.headings))
        self.write("velocities.csv", lambda p: write_velocities(p, run.velocities))
        page = report_html(run)
        self.write("report.html", lambda p: p.write_text(page, encoding="utf-8"))
        self.write(CALIBRATION, lambda p: write_calibration(p, run.calibration, run))

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Give the last files their names, or say that the run is incomplete."""
        try:
            if error is None:
                self._finish()
        except BaseException as failure:
            error = failure
            raise
        finally:
            if error is not None:
                self._give_up(error)
            self._unlock()

    def _lock(self) -> None:
        """Keep other runs out, as long as this process lives."""
        if fcntl is None:
            return
        self._locked = os.open(self.path, os.O_RDONLY)
        try:
            fcntl.flock(self._locked, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._unlock()
            raise InputError(
                f"{self.path} is in use: another run is writing to it; give another folder"
            ) from None
        except OSError:  # pragma: no cover  (some network folders have no locks)
            return

    def _unlock(self) -> None:
        if self._locked is not None:
            os.close(self._locked)
            self._locked = None

    def _check(self) -> None:
        if not os.path.lexists(self.path):
            return
        if not os.path.isdir(self.path):
            raise InputError(f"cannot use {self.path} as a folder: it is a file")
        try:
            names = sorted(p.name for p in self.path.iterdir() if not p.name.startswith("."))
        except OSError as error:
            raise InputError(f"cannot read {self.path}: {error.strerror or error}") from None
        foreign = [name for name in names if not _is_ours(name)]
        if foreign:
            raise InputError(
                f"{self.path} holds files that are not of a calibration, such as {foreign[0]!r};"
                " give a new or an empty folder"
            )
        for name in names:
            file = self.path / name
            if file.is_symlink() or not file.is_file():
                raise InputError(
                    f"{file} is a link or no regular file, and would be replaced; give a new or an"
                    " empty folder"
                )
        self._was_marked = MARKER in names
        if CALIBRATION in names and not self._overwrite:
            raise InputError(
                f"{self.path} holds a finished calibration; give another folder, or --overwrite to"
                " replace it"
            )

    def _mark(self, why: str = "") -> None:
        lines = [
            "This run is not finished, or was cut short: do not rely on the files beside this one.",
            "Some of them may be of an earlier run." if not self._written else "",
            f"command: {self._command}" if self._command else "",
            f"started: {self._started}",
            f"stage: {self._stage}",
            f"stopped: {why}" if why else "",
        ]
        text = "".join(f"{line}\n" for line in lines if line)
        content = text.encode("utf-8", "backslashreplace")
        write_file(self.path / MARKER, lambda p: p.write_bytes(content))

    def _clear(self) -> None:
        """Remove what an earlier run left, its calibration first."""
        with refusing(self.path):
            parts = [path.name for path in self.path.iterdir() if path.name.endswith(PART)]
        for name in (*reversed(NAMES), *filter(_is_ours, parts)):
            path = self.path / name
            with refusing(path):
                path.unlink(missing_ok=True)

    def _finish(self) -> None:
        for name in LAST:
            if name in self._waiting:
                path = self.path / name
                with refusing(path):
                    self._waiting[name].replace(path)
                del self._waiting[name]
        with refusing(self.path / MARKER):
            (self.path / MARKER).unlink(missing_ok=True)

    def _give_up(self, error: BaseException) -> None:
        for part in self._waiting.values():
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)
        earlier = self._overwrite and os.path.lexists(self.path / CALIBRATION)
        if not self._written and not self._was_marked and (_expected(error) or earlier):
            self._undo()
            return
        why = "interrupted" if isinstance(error, KeyboardInterrupt) else str(error)
        with contextlib.suppress(InputError):
            self._mark(why or type(error).__name__)

    def _undo(self) -> None:
        """Leave the folder as it was found."""
        with contextlib.suppress(OSError):
            if not self._was_marked:
                (self.path / MARKER).unlink(missing_ok=True)
            for folder in self._made:
                folder.rmdir()


def _write_part(path: Path, writer: Writer) -> Path:
    """Write beside the final name, down to the disk, and return where."""
    part = path.with_name(path.name + PART)
    with refusing(path), _removing(part):
        writer(part)
        with open(part, "rb+") as file:
            os.fsync(file.fileno())
    return part


@contextlib.contextmanager
def _removing(part: Path) -> Iterator[None]:
    """Remove a part if anything goes wrong, Ctrl-C included."""
    try:
        yield
    except BaseException:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        raise


def _is_ours(name: str) -> bool:
    """Whether a file is of a run, or a part of one that a killed run left."""
    return re.sub(rf"(\.\d+)?{re.escape(PART)}$", "", name) in (*NAMES, MARKER)


def _expected(error: BaseException) -> bool:
    """Whether an error speaks to the user about the input."""
    return isinstance(error, EvcalibError)

"""The notebooks as a folder of the user's: copied, brought up to date, never overwritten.

A wheel holds the notebooks with their data in ``data_tools/course/_notebooks``; a checkout has
them in ``notebooks``.  A small file in the copy, `RECORD`, holds the SHA-256 of what was last
offered under each name.  A file with that content is as we left it and may be replaced by a newer
one; any other belongs to the user and is left, and a newer one is put beside it.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from data_tools.files.atomic import write_file
from evcalib import __version__
from evcalib.errors import InputError

RECORD = ".evcalib-notebooks.json"
FIRST = "00_quickstart.ipynb"
FORMS = ("[0-9][0-9]_*.ipynb", "README.md", "data/*", "data/*/*")
"""What belongs to the course; pyproject.toml puts the same files into the wheel."""

SHIPPED = Path(__file__).parent / "_notebooks"
CHECKOUT = Path(__file__).parents[2] / "notebooks"

__all__ = ["FIRST", "Copied", "copy_notebooks", "course_files", "home_of_notebooks"]


@dataclass(frozen=True)
class Copied:
    """What `copy_notebooks` did; names are relative to the folder, in order.

    Parameters
    ----------
    folder : Path
        Where the notebooks are.
    new, updated : tuple of str
        Files that were not there, and files of an earlier version that were replaced.
    kept : tuple of str
        Files that the user changed, left as they are.
    beside : dict of str to str
        Of those, the ones that changed here too, and the name under which the newer one was put.
    """

    folder: Path
    new: tuple[str, ...]
    updated: tuple[str, ...]
    kept: tuple[str, ...]
    beside: dict[str, str]

    def text(self) -> str:
        """Return what a user should know, a line each."""
        lines = []
        if self.new:
            lines.append(f"{len(self.new)} files copied to {self.folder}")
        if self.updated:
            lines.append(f"{len(self.updated)} files brought up to date in {self.folder}")
        for name in self.kept:
            if name in self.beside:
                lines.append(f"{name} was changed by you: kept, the new one is {self.beside[name]}")
        return "\n".join(lines)


def home_of_notebooks() -> tuple[Path, bool]:
    """Find the notebooks of this installation.

    Returns
    -------
    Path
        Their folder.
    bool
        Whether it is a checkout's own.

    Raises
    ------
    InputError
        If this installation has none.
    """
    if (SHIPPED / FIRST).is_file():
        return SHIPPED, False
    if (CHECKOUT / FIRST).is_file():
        return CHECKOUT, True
    raise InputError(
        "this installation of evcalib holds no notebooks; install it from a wheel or a checkout"
    )


def course_files(home: Path) -> list[str]:
    """List the files of the course.

    Parameters
    ----------
    home : Path
        A folder of notebooks.

    Returns
    -------
    list of str
        Names relative to the folder, with ``/``.
    """
    found = {path for form in FORMS for path in home.glob(form) if path.is_file()}
    return sorted(path.relative_to(home).as_posix() for path in found)


def copy_notebooks(folder: str | Path, *, home: Path | None = None) -> Copied:
    """Copy the notebooks with their data, or bring an earlier copy up to date.

    A file that the user changed is never written to.  One that was deleted comes back.

    Parameters
    ----------
    folder : path
        Where to; made if it is not there.
    home : Path, optional
        Where from; by default what `home_of_notebooks` finds.

    Returns
    -------
    Copied
        What was done.

    Raises
    ------
    InputError
        If the folder cannot be made, read or written.
    """
    home = home or home_of_notebooks()[0]
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {folder}: {error.strerror or error}") from None
    offered = _read_record(folder)
    new, updated, kept, beside = [], [], [], {}
    for name in course_files(home):
        target, content = folder / name, _content(home / name) or b""
        digest, present = _sha256(content), _content(target)
        if present is None:
            _write(target, content)
            new.append(name)
        elif _sha256(present) == digest:
            pass
        elif _sha256(present) == offered.get(name):
            _write(target, content)
            updated.append(name)
        else:
            kept.append(name)
            if offered.get(name) != digest:
                beside[name] = _put_beside(target, content)
        offered[name] = digest
    record = json.dumps({"files": offered}, indent=1, sort_keys=True) + "\n"
    if _content(folder / RECORD) != record.encode():
        _write(folder / RECORD, record.encode())
    return Copied(folder, tuple(new), tuple(updated), tuple(kept), beside)


def _read_record(folder: Path) -> dict[str, str]:
    """Return what was offered; nothing if the record is lost, so that every change is kept."""
    try:
        files = json.loads(_content(folder / RECORD) or b"{}")["files"]
        return {str(name): str(digest) for name, digest in files.items()}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}


def _put_beside(target: Path, content: bytes) -> str:
    """Write under a name of its own, unless the same is there already; return that name."""
    for number in count(1):
        tail = f".{__version__}" if number == 1 else f".{__version__}-{number}"
        path = target.with_name(f"{target.stem}{tail}{target.suffix}")
        present = _content(path)
        if present is None:
            _write(path, content)
        if present is None or present == content:
            return path.name
    raise AssertionError


def _content(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None


def _write(path: Path, content: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot make the folder {path.parent}: {error.strerror or error}"
        ) from None
    write_file(path, lambda part: part.write_bytes(content))


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()

"""Where compiled kernels are kept, if the usual places cannot be written."""

from __future__ import annotations

import atexit
import os
import shutil
import stat
import tempfile
import warnings
from pathlib import Path

import numba


def _can_hold_files(folder: Path) -> bool:
    """Tell whether files can be made in a folder, or in the nearest above it that there is."""
    try:
        while not folder.exists():
            folder = folder.parent
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _private_folder() -> Path:
    """Return a temporary folder that is this user's alone: what is cached there will be run."""
    user = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"evcalib-cache-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        ours = stat.S_ISDIR(found.st_mode) and not found.st_mode & 0o077
        if ours and getattr(found, "st_uid", user) == user and _can_hold_files(folder):
            return folder
    except OSError:
        pass
    folder = Path(tempfile.mkdtemp(prefix="evcalib-cache-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def find_cache() -> None:
    """Name a temporary folder for caches where neither the install nor the home can be written.

    numba keeps compiled kernels in ``NUMBA_CACHE_DIR``, else beside the source, else in the user's
    cache, and refuses to compile where none of these can be written; matplotlib complains.
    """
    home = Path(os.path.expanduser("~")).absolute()
    caches = Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache")
    settings = Path(os.environ.get("XDG_CONFIG_HOME") or home / ".config")
    beside = Path(__file__).resolve().parent / "__pycache__"
    homeless = {}
    if not (
        getattr(numba.config, "CACHE_DIR", "") or _can_hold_files(beside) or _can_hold_files(caches)
    ):
        homeless["NUMBA_CACHE_DIR"] = "compiled code"
    if not ("MPLCONFIGDIR" in os.environ or _can_hold_files(settings)):
        homeless["MPLCONFIGDIR"] = "what matplotlib keeps"
    if not homeless:
        return
    folder = str(_private_folder())
    # Processes that are started from here find it there, and say nothing more.
    os.environ.update(dict.fromkeys(homeless, folder))
    if "NUMBA_CACHE_DIR" in homeless:
        numba.config.CACHE_DIR = folder  # type: ignore[attr-defined]
        warnings.warn(
            "neither the folder of evcalib nor that of the user can be written:"
            f" {' and '.join(homeless.values())} goes to {folder};"
            f" {' and '.join(homeless)} can name another place",
            stacklevel=2,
        )

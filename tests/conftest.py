"""Shared fixtures: where the real recordings stand, the command line, quiet progress bars."""

import os
import sys
from pathlib import Path

import pytest

os.environ["TQDM_DISABLE"] = "1"

DATA = Path(os.environ.get("EVCALIB_DATA", Path(__file__).parents[2] / "shared" / "data"))


@pytest.fixture(scope="session")
def data() -> Path:
    """Return the folder of real recordings, or skip."""
    if not DATA.is_dir():
        pytest.skip(f"no real recordings in {DATA}: set EVCALIB_DATA to their folder")
    return DATA


@pytest.fixture
def run(monkeypatch, capsys):
    """Return a function that runs a command and gives its exit code, output and errors."""
    from data_tools import cli

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["evcalib", *map(str, words)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        out, err = capsys.readouterr()
        return stop.value.code or 0, out, err

    return call

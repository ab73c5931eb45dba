"""Shared fixtures: where the real recordings stand, and quiet progress bars."""

import os
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

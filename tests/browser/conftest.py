"""A browser for all tests of this folder, or the reason why there is none; a place for results."""

import json
import os
import platform
from importlib.metadata import version
from pathlib import Path

import pytest

ARTEFACTS = Path(__file__).parents[2] / ".artefacts" / "browser"


@pytest.fixture(scope="module")
def browser():
    """Start Chromium once, or skip.

    Not for the whole session: as long as playwright is there, nothing else can use asyncio.
    """
    pytest.importorskip("playwright", reason='needs playwright: pip install "evcalib[browser]"')
    import lab

    if lab.chromium() is None:
        pytest.skip("needs Debian's chromium (apt-get install chromium) or EVCALIB_CHROMIUM")
    with lab.open_browser() as browser:
        yield browser


@pytest.fixture(scope="module")
def results(browser):
    """Return a dictionary that is added to `results.json` at the end."""
    path = ARTEFACTS / "results.json"
    ARTEFACTS.mkdir(parents=True, exist_ok=True)
    found = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    found["machine"] = {
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 1),
        "python": platform.python_version(),
        "jupyterlab": version("jupyterlab"),
        "ipywidgets": version("ipywidgets"),
        "chromium": browser.browser.version,
    }
    yield found
    path.write_text(json.dumps(found, indent=1, sort_keys=True) + "\n", encoding="utf-8")

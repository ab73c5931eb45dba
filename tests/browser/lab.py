"""JupyterLab and Voila on the notebooks, driven in a real browser without a screen.

Debian's Chromium is driven by playwright; servers listen on 127.0.0.1 only, with settings, runtime
files and notebooks of their own in a temporary folder.  What was seen is left in
`.artefacts/browser` (`results.json` and screenshots), which git ignores.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import nbformat
from playwright.sync_api import BrowserContext, Page, sync_playwright

ROOT = Path(__file__).parents[2]
ARTEFACTS = ROOT / ".artefacts" / "browser"
PROBE = Path(__file__).with_name("probe.js")
SIZE = {"width": 1280, "height": 1800}
"""Of the browser's window, and so of one screenshot [px]."""
START_UP = 60.0
"""Longest wait for a server [s]."""
LONGEST_RUN = 300.0
"""Longest run of a notebook [s]."""
CHROMIUM = [
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-dev-shm-usage"),
    *("--no-first-run", "--disable-background-networking", "--disable-component-update"),
    "--disable-sync",
]
LAB_SETTINGS = {
    "notebook-extension/tracker": {"windowingMode": "none", "scrollPastEnd": False},
    "apputils-extension/notification": {
        "fetchNews": "false",
        "checkForUpdates": False,
        "doNotDisturbMode": True,
    },
}
NOTEBOOK = "jupyterapp.shell.currentWidget"


def chromium() -> str | None:
    """Return the path of the browser; None if there is none."""
    names = (os.environ.get("EVCALIB_CHROMIUM", ""), "chromium", "chromium-browser")
    return next(filter(None, map(shutil.which, filter(None, names))), None)


def copy_notebooks(folder: Path) -> None:
    """Copy the notebooks and their data, without outputs, so that all that is seen is new."""
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        notebook = nbformat.read(path, as_version=4)
        for cell in notebook.cells:
            if cell.cell_type == "code":
                cell.outputs, cell.execution_count = [], None
        nbformat.write(notebook, folder / path.name)
    for name in ("data", "pictures"):
        shutil.copytree(ROOT / "notebooks" / name, folder / name)


@dataclass
class Server:
    """A server that runs: its address and token, its notebooks, and where it writes its log."""

    base: str
    token: str
    folder: Path
    log: Path

    def url(self, path: str) -> str:
        """Return the address of a page."""
        return f"{self.base}/{path}{'&' if '?' in path else '?'}token={self.token}"


@contextmanager
def serve(folder: Path, words: list[str], *, token: str) -> Iterator[Server]:
    """Start a Jupyter server in a folder, with nothing of the user's configuration."""
    home = folder / ".jupyter-home"
    for name, values in LAB_SETTINGS.items():
        path = home / "settings" / "@jupyterlab" / f"{name}.jupyterlab-settings"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(values), encoding="utf-8")
    places = {
        "JUPYTER_CONFIG_DIR": "config",
        "JUPYTER_DATA_DIR": "share",
        "JUPYTER_RUNTIME_DIR": "runtime",
        "JUPYTERLAB_SETTINGS_DIR": "settings",
        "JUPYTERLAB_WORKSPACES_DIR": "workspaces",
        "IPYTHONDIR": "ipython",
    }
    environment = os.environ | {name: str(home / place) for name, place in places.items()}
    port, log = _free_port(), home / "log.txt"
    command = [sys.executable, "-m", *(word.format(port=port, folder=folder) for word in words)]
    with log.open("w") as out:
        process = subprocess.Popen(command, cwd=folder, env=environment, stdout=out, stderr=out)
        try:
            server = Server(f"http://127.0.0.1:{port}", token, folder, log)
            _wait_for(server, process)
            yield server
        finally:
            process.terminate()
            process.wait(timeout=30)


@contextmanager
def lab_server(folder: Path) -> Iterator[Server]:
    """Start JupyterLab."""
    token = secrets.token_hex(16)
    words = ["jupyterlab", "--no-browser", "--allow-root", "--ServerApp.ip=127.0.0.1"]
    words += ["--ServerApp.port={port}", "--ServerApp.port_retries=0"]
    words += [f"--IdentityProvider.token={token}", "--ServerApp.root_dir={folder}"]
    with serve(folder, [*words, "--LabApp.expose_app_in_browser=True"], token=token) as server:
        yield server


@contextmanager
def voila_server(folder: Path, notebook: str) -> Iterator[Server]:
    """Start Voila on one notebook."""
    words = ["voila", f"{notebook}.ipynb", "--no-browser", "--Voila.ip=127.0.0.1"]
    with serve(folder, [*words, "--port={port}", "--show_tracebacks=True"], token="") as server:
        yield server


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _wait_for(server: Server, process: subprocess.Popen[bytes]) -> None:
    end = time.monotonic() + START_UP
    while time.monotonic() < end and process.poll() is None:
        try:
            with urllib.request.urlopen(server.url("static/favicon.ico"), timeout=5):
                return
        except urllib.error.HTTPError:
            return  # it answers
        except OSError:
            time.sleep(0.1)
    raise RuntimeError(f"no server came up:\n{server.log.read_text()[-2000:]}")


@contextmanager
def open_browser() -> Iterator[BrowserContext]:
    """Start Chromium, with one cache for all pages."""
    with (
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=chromium(), args=CHROMIUM) as browser,
        browser.new_context(viewport=SIZE, service_workers="block") as context,
    ):
        context.add_init_script(path=PROBE)
        yield context


@contextmanager
def open_page(
    browser: BrowserContext, address: str, *, patience: float = START_UP
) -> Iterator[tuple[Page, list[str]]]:
    """Open a page of a server; also gives the list of all requests that go elsewhere."""
    elsewhere: list[str] = []

    def look(request) -> None:
        where = urlsplit(request.url)
        if where.scheme not in ("data", "blob") and where.hostname != "127.0.0.1":
            elsewhere.append(request.url)

    page = browser.new_page()
    page.on("request", look)
    try:
        page.goto(address, timeout=1e3 * patience)
        yield page, elsewhere
    except Exception:
        page.screenshot(path=ARTEFACTS / "failure.png")
        raise
    finally:
        page.close()


def photograph(page: Page, stem: str, *, most: int = 99) -> int:
    """Take pictures of all that scrolls around the first cell, a window at a time; how many."""
    outer = page.evaluate_handle(_SCROLLER).as_element()
    height, step = outer.evaluate("e => [e.scrollHeight, e.clientHeight]")
    count = min(-(-int(height) // int(step)), most)
    for number in range(count):
        outer.evaluate("(e, top) => { e.scrollTop = top; }", number * step)
        page.wait_for_timeout(80)
        outer.screenshot(path=ARTEFACTS / f"{stem}-{number:02d}.png")
    return count


class LabNotebook:
    """A notebook that is open in JupyterLab, with a kernel that lives as long as the *with* block.

    Parameters
    ----------
    page : Page
        At the `address` of the notebook.
    """

    def __init__(self, page: Page) -> None:
        self.page = page
        ready = f"window.jupyterapp && {NOTEBOOK}?.sessionContext?.session?.kernel"
        page.wait_for_function(f"() => {ready}?.status === 'idle'", timeout=1e3 * START_UP)
        page.evaluate(f"() => probe.listen({ready})")
        self._hide_sidebars()
        self.use_theme("JupyterLab Light")  # the last one used is kept from page to page

    @staticmethod
    def address(server: Server, name: str) -> str:
        """Return the address of a notebook, in a workspace of its own."""
        return server.url(f"lab/workspaces/{secrets.token_hex(4)}/tree/{name}.ipynb?reset")

    def run(self) -> float:
        """Run all cells and return how long it took [s]."""
        started = time.monotonic()
        self.page.evaluate("() => void jupyterapp.commands.execute('notebook:run-all-cells')")
        self._wait("() => probe.complaints.length || (" + _ALL_RUN + ")()")
        self.settle()
        return time.monotonic() - started

    def counts(self) -> list[int | None]:
        """Return the execution counts of the code cells."""
        return list(self.page.evaluate(f"() => {_CODE}.map(cell => cell.executionCount)"))

    def complaints(self) -> list[str]:
        """Return errors and lines on stderr: in the cells, and all that the kernel ever sent."""
        return list(self.page.evaluate(_COMPLAINTS))

    def settle(self) -> None:
        """Wait until the kernel is idle, and a moment longer for what it sent last."""
        self._wait(f"() => {NOTEBOOK}.sessionContext.session.kernel.status === 'idle'")
        self.page.wait_for_timeout(200)

    def use_theme(self, name: str) -> None:
        """Change the colours of JupyterLab, as *JupyterLab Dark*."""
        self.page.evaluate(
            "theme => jupyterapp.commands.execute('apputils:change-theme', { theme })", name
        )
        self._wait(f"() => document.body.dataset.jpThemeName === '{name}'")

    def __enter__(self) -> LabNotebook:
        return self

    def __exit__(self, *error: object) -> None:
        self.page.evaluate(f"() => {NOTEBOOK}.sessionContext.shutdown()")

    def _wait(self, condition: str) -> None:
        self.page.wait_for_function(condition, timeout=1e3 * LONGEST_RUN, polling=50)

    def _hide_sidebars(self) -> None:
        self.page.evaluate("""() => {
            if (!jupyterapp.shell.leftCollapsed) jupyterapp.shell.collapseLeft();
            if (!jupyterapp.shell.rightCollapsed) jupyterapp.shell.collapseRight();
        }""")


_SCROLLER = """() => {
    let at = document.querySelector('.jp-Cell');
    while (at && at.scrollHeight <= at.clientHeight + 1) at = at.parentElement;
    return at ?? document.documentElement;
}"""
_CODE = (
    f"[...{NOTEBOOK}.content.model.cells]"
    ".filter(cell => cell.type === 'code' && cell.sharedModel.getSource().trim())"
)
_ALL_RUN = f"() => {_CODE}.every(cell => cell.executionCount)"
_COMPLAINTS = f"""() => [...probe.complaints, ...{_CODE}.flatMap(cell => cell.outputs.toJSON())
    .filter(output => output.output_type === 'error' || output.name === 'stderr')
    .map(output => output.evalue || [output.text].flat().join(''))]"""

"""The notebooks in JupyterLab, and what makes a first run quick."""

from __future__ import annotations

import os
import socket
from pathlib import Path
from typing import Annotated, Any

import typer

from data_tools.cli._options import app
from evcalib.errors import InputError

DEFAULT_FOLDER = "evcalib-notebooks"


@app.command()
def lab(
    folder: Annotated[
        Path | None,
        typer.Argument(
            help="Folder of yours for the notebooks; files that you changed are never overwritten."
            f" Without it: the checkout's own notebooks, or else ./{DEFAULT_FOLDER}."
        ),
    ] = None,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Only print the address to open.")
    ] = False,
    port: Annotated[
        int | None,
        typer.Option(
            min=1, max=65535, help="Port on this machine; by default the first free one from 8888."
        ),
    ] = None,
) -> None:
    """Open the notebooks in JupyterLab; Ctrl-C ends it."""
    from data_tools.course import FIRST, copy_notebooks, home_of_notebooks

    server = _jupyterlab()
    if port is not None:
        _check_free(port)
    home, is_checkout = home_of_notebooks()
    target = folder or (home if is_checkout else Path(DEFAULT_FOLDER))
    if is_checkout and target.resolve() == home.resolve():
        # The server then also shows the source, to which the notebooks link.
        root, first = home.parent, f"{home.name}/{FIRST}"
    else:
        root, first = target, FIRST
        copied = copy_notebooks(target)
        if copied.text():
            print(copied.text(), flush=True)
    server.launch_instance(_arguments(root, first, no_browser=no_browser, port=port))


@app.command()
def warmup() -> None:
    """Compile all that calibrating needs, so that the first calibration does not wait for it."""
    import time

    from data_tools.runs.demo import warm_up

    started = time.process_time()
    warm_up()
    print(f"Compiled and kept; {time.process_time() - started:.0f} s of CPU.")


def _jupyterlab() -> Any:
    try:
        from jupyterlab.labapp import LabApp
    except ImportError:
        raise InputError('JupyterLab is not installed: pip install "evcalib[notebooks]"') from None
    return LabApp


def _arguments(root: Path, first: str, *, no_browser: bool, port: int | None) -> list[str]:
    """Return the server's command line: first notebook open, no question, no request outside."""
    words = [
        f"--ServerApp.root_dir={root.resolve()}",
        f"--LabApp.default_url=/lab/tree/{first}",
        f"--ServerApp.open_browser={not no_browser}",
        "--ServerApp.answer_yes=True",
        "--Application.log_level=WARN",
        "--LabApp.news_url=None",
        "--LabApp.check_for_updates_class=jupyterlab.NeverCheckForUpdate",
    ]
    if port is not None:
        words += [f"--ServerApp.port={port}", "--ServerApp.port_retries=0"]
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        # In a container everyone is root; the server listens on this machine only, with a token.
        words.append("--ServerApp.allow_root=True")
    return words


def _check_free(port: int) -> None:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            raise InputError(
                f"cannot use port {port}: {error.strerror or error}; give another --port"
            ) from None

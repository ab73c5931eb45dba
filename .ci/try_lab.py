"""Try ``evcalib lab`` of an installed wheel: it serves the notebooks and keeps a user's changes.

python .ci/try_lab.py      # with the python of the environment to try
"""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

FIRST = "00_quickstart.ipynb"
START = 60
"""Seconds that the server may take to start, and to stop."""


@contextmanager
def lab(folder: Path) -> Iterator[tuple[str, str]]:
    """Run the command in a folder; give the server's address and token; end it with Ctrl-C."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [
        Path(sys.executable).with_name("evcalib"),
        "lab",
        "--no-browser",
        "--port",
        str(port),
    ]
    homes = {
        name: str(folder / name) for name in ("JUPYTER_CONFIG_DIR", "JUPYTER_RUNTIME_DIR", "HOME")
    }
    server = subprocess.Popen(
        command, cwd=folder, env=os.environ | homes, stderr=subprocess.PIPE, text=True
    )
    try:
        address, token = _address(server)
        _wait(address, token)
        yield address, token
        server.send_signal(signal.SIGINT)
        _, rest = server.communicate(timeout=START)
        assert server.returncode == 0, (server.returncode, rest)
        assert "Traceback" not in rest, rest
    finally:
        server.kill()
        server.wait()


def _address(server: subprocess.Popen[str]) -> tuple[str, str]:
    told = []
    assert server.stderr is not None
    for line in server.stderr:
        told.append(line)
        found = re.search(r"(http://127\.0\.0\.1:\d+)/lab/tree/(\S+)\?token=(\w+)", line)
        if found:
            assert found[2] == FIRST
            return found[1], found[3]
    raise SystemExit(f"the server did not start:\n{''.join(told)}")


def _wait(address: str, token: str) -> None:
    """Wait until the server answers: it prints its address before it listens."""
    end = time.monotonic() + START
    while True:
        try:
            get(f"{address}/api/status?token={token}")
            return
        except urllib.error.URLError:
            if time.monotonic() > end:
                raise
            time.sleep(0.1)


def get(address: str) -> bytes:
    """Return what a page holds."""
    with urllib.request.urlopen(address, timeout=START) as answer:
        return bytes(answer.read())


def sources(notebook: dict[str, Any]) -> list[str]:
    """Return the cells' texts, which a server gives in one piece and a file in lines."""
    return ["".join(cell["source"]) for cell in notebook["cells"]]


def refused(address: str) -> int:
    """Return with what code a page is refused; 0 if it is not."""
    try:
        get(address)
    except urllib.error.HTTPError as answer:
        return answer.code
    return 0


def main() -> None:
    """Start, look, change a notebook, stop, start again."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
        mine = Path(scratch) / "evcalib-notebooks"
        with lab(Path(scratch)) as (server, token):
            page = get(f"{server}/lab/tree/{FIRST}?token={token}")
            assert b"jupyter-config-data" in page
            told = json.loads(get(f"{server}/api/contents/{FIRST}?token={token}"))
            assert sources(told["content"]) == sources(json.loads((mine / FIRST).read_text()))
            assert refused(f"{server}/api/contents/{FIRST}") == 403
        before = {path: path.read_bytes() for path in mine.rglob("*") if path.is_file()}
        changed = next(path for path in sorted(before) if path.name.startswith("01_"))
        before[changed] = b"{}"
        changed.write_bytes(b"{}")
        with lab(Path(scratch)):
            after = {path: path.read_bytes() for path in mine.rglob("*") if path.is_file()}
        assert after == before
        print(f"evcalib lab: {len(before)} files, served with a token only; a changed one was kept")


main()

"""Build the notebooks: run each ``NAME.py`` (jupytext percent) and store it as ``NAME.ipynb``.

    python notebooks/_build.py            # all
    python notebooks/_build.py 03_kinematics 04_offset

The same source gives the same bytes: cells get stable names, and what differs from run to run
(timing, versions, ids and saved state of widgets) is dropped.  Pictures are stored with a palette,
which takes a third of the room.  A callback of a widget that fails goes unnoticed here: run
``pytest notebooks`` afterwards.
"""

from __future__ import annotations

import os
import sys
from base64 import b64decode, b64encode
from io import BytesIO
from pathlib import Path

import jupytext
import nbformat
from nbclient import NotebookClient
from PIL import Image

HERE = Path(__file__).parent
PNG = "image/png"
WIDGET = "application/vnd.jupyter.widget-view+json"


def sources() -> list[Path]:
    """Return the sources of all notebooks, in order."""
    return sorted(path for path in HERE.glob("*.py") if not path.name.startswith("_"))


def build(source: Path) -> Path:
    """Run one notebook and store it with its outputs."""
    notebook = jupytext.read(source)
    for number, cell in enumerate(notebook.cells):
        cell.id = f"{source.stem}-{number:02d}"
    client = NotebookClient(
        notebook,
        timeout=600,
        kernel_name="python3",
        record_timing=False,
        coalesce_streams=True,
        resources={"metadata": {"path": str(source.parent)}},
    )
    client.execute()
    _refuse_noise(notebook, client)
    _drop_volatile(notebook)
    target = source.with_suffix(".ipynb")
    nbformat.write(notebook, target)
    return target


def _refuse_noise(notebook: nbformat.NotebookNode, client: NotebookClient) -> None:
    """Raise on what nbclient lets pass: stderr, and errors inside the output of a widget."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    for state in client.widget_state.values():
        outputs += state.get("outputs", ())
    for output in outputs:
        if output["output_type"] == "error":
            raise RuntimeError("a callback failed:\n" + "\n".join(output["traceback"]))
        if output.get("name") == "stderr":
            raise RuntimeError("said on stderr:\n" + output["text"])


def _drop_volatile(notebook: nbformat.NotebookNode) -> None:
    python = {"display_name": "Python 3", "language": "python", "name": "python3"}
    notebook.metadata = nbformat.from_dict(
        {"kernelspec": python, "language_info": {"name": "python"}}
    )
    views = 0
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            data = output.get("data", {})
            if WIDGET in data:
                data[WIDGET]["model_id"] = f"view-{views}"
                views += 1
            if PNG in data:
                data[PNG] = b64encode(_with_palette(b64decode(data[PNG]))).decode("ascii")


def _with_palette(picture: bytes) -> bytes:
    image = Image.open(BytesIO(picture)).convert("RGB")
    stored = BytesIO()
    image.quantize(256, dither=Image.Dither.NONE).save(stored, "png", optimize=True)
    return stored.getvalue()


if __name__ == "__main__":
    os.environ["TQDM_DISABLE"] = "1"
    names = sys.argv[1:] or [path.stem for path in sources()]
    for name in names:
        target = build(HERE / f"{name}.py")
        print(f"{target.name}: {target.stat().st_size / 1000:.0f} kB")

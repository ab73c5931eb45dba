"""What a stored notebook must be: built from its own source, run once, clean, small, readable."""

import base64
import re
from itertools import pairwise
from pathlib import Path

import jupytext
import nbformat

WIDGET = "application/vnd.jupyter.widget-view+json"
LARGEST = 300_000
"""Size of a stored notebook [bytes]."""
LONGEST = 14
"""Lines of a code cell."""
NEAR = 3
"""A widget has a static picture in one of so many code cells before it, or in its own."""


def faults(source: Path) -> list[str]:
    """Return all that is wrong with the stored notebook of a source; empty if nothing is.

    Whether its outputs are still what the code gives is for nbval to say.
    """
    target = source.with_suffix(".ipynb")
    if not target.is_file():
        return ["not built"]
    stored = nbformat.read(target, as_version=4)
    found = _stale(stored, jupytext.read(source)) + _unrun(stored) + _noisy(stored)
    found += _of_one_run(stored, target) + _long(stored) + _pictureless(stored)
    if (size := target.stat().st_size) >= LARGEST:
        found.append(f"large: {size} bytes")
    return found


def _code(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def _stale(stored, source):
    def cells(notebook):
        return [(c.cell_type, c.source, c.metadata.get("tags", [])) for c in notebook.cells]

    old, new = cells(stored), cells(source)
    if len(old) != len(new):
        return [f"stale: {len(old)} cells, {len(new)} in the source"]
    return [
        f"stale: cell {k}"
        for k, pair in enumerate(zip(old, new, strict=True))
        if pair[0] != pair[1]
    ]


def _unrun(stored):
    counts = [cell.execution_count for cell in _code(stored)]
    return [] if counts == list(range(1, len(counts) + 1)) else [f"not run in order: {counts}"]


def _noisy(stored):
    return [
        f"noisy: {output.get('text', output.get('ename'))}"
        for cell in _code(stored)
        for output in cell.outputs
        if output.output_type == "error" or output.get("name") == "stderr"
    ]


def _of_one_run(stored, target):
    found = []
    if set(stored.metadata) != {"kernelspec", "language_info"}:
        found.append(f"of one run: metadata {sorted(stored.metadata)}")
    names = [f"{target.stem}-{number:02d}" for number in range(len(stored.cells))]
    if [cell.id for cell in stored.cells] != names:
        found.append("of one run: names of cells")
    text = target.read_text(encoding="utf-8")
    for sign in (str(target.parent.resolve().parent), str(Path.home()) + "/", " at 0x"):
        if sign in text:
            found.append(f"of one run: {sign!r}")
    return found


def _long(stored):
    kinds = [cell.cell_type for cell in stored.cells]
    found = ["two code cells in a row"] if ("code", "code") in set(pairwise(kinds)) else []
    return found + [
        f"long: {cell.source.splitlines()[0]!r} starts {lines} lines"
        for cell in _code(stored)
        if (lines := len(cell.source.splitlines())) > LONGEST
    ]


def _pictureless(stored):
    """A viewer without a kernel shows nothing of a widget: a picture has to stand above it."""
    shown = [set().union(*(output.get("data", {}) for output in c.outputs)) for c in _code(stored)]
    return [
        f"no static figure above the widget of code cell {k + 1}"
        for k, kinds in enumerate(shown)
        if WIDGET in kinds and "image/png" not in set().union(*shown[max(0, k - NEAR) : k + 1])
    ]


def pictures(stored) -> list[bytes]:
    """Return the stored pictures of a notebook, in order."""
    data = [output.get("data", {}) for cell in _code(stored) for output in cell.outputs]
    return [base64.b64decode(re.sub(r"\s", "", d["image/png"])) for d in data if "image/png" in d]

"""The notebooks as files: built, from their own source, clean and small.

That the stored outputs are still what the code gives is checked by nbval (``pytest notebooks``).
"""

from itertools import pairwise
from pathlib import Path

import jupytext
import nbformat
import pytest

FOLDER = Path(__file__).parents[1] / "notebooks"
SOURCES = sorted(path for path in FOLDER.glob("*.py") if not path.name.startswith("_"))
BUILD = "run `python notebooks/_build.py {}` and `pytest notebooks`"

pytestmark = pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)


def built(source):
    target = source.with_suffix(".ipynb")
    assert target.is_file(), "not built: " + BUILD.format(source.stem)
    return nbformat.read(target, as_version=4)


def code(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def test_stored_cells_are_those_of_the_source(source):
    def cells(notebook):
        return [(c.cell_type, c.source, c.metadata.get("tags", [])) for c in notebook.cells]

    assert cells(built(source)) == cells(jupytext.read(source)), BUILD.format(source.stem)


def test_every_cell_was_run_once_in_order(source):
    counts = [cell.execution_count for cell in code(built(source))]
    assert counts == list(range(1, len(counts) + 1))


def test_no_output_is_an_error_or_a_warning(source):
    for cell in code(built(source)):
        for output in cell.outputs:
            assert output.output_type != "error", cell.source
            assert output.get("name") != "stderr", cell.source


def test_nothing_of_one_run_or_one_machine_is_stored(source):
    notebook = built(source)
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    assert [cell.id for cell in notebook.cells] == [
        f"{source.stem}-{number:02d}" for number in range(len(notebook.cells))
    ]
    text = source.with_suffix(".ipynb").read_text(encoding="utf-8")
    assert str(FOLDER.parent) not in text
    assert " at 0x" not in text


def test_stored_file_is_small(source):
    assert source.with_suffix(".ipynb").stat().st_size < 300_000


def test_code_cells_are_short(source):
    for cell in code(built(source)):
        assert len(cell.source.splitlines()) < 15, cell.source


def test_no_two_code_cells_in_a_row(source):
    kinds = [cell.cell_type for cell in built(source).cells]
    assert ("code", "code") not in set(pairwise(kinds))

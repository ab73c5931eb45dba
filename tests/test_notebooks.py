"""The notebooks as files, and a test of these tests: each kind of fault makes them fail.

That the stored outputs are still what the code gives is checked by nbval (``pytest notebooks``).
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest
from notebook_checks import LARGEST, faults

FOLDER = Path(__file__).parents[1] / "notebooks"
SOURCES = sorted(path for path in FOLDER.glob("*.py") if not path.name.startswith("_"))


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_stored_notebook_is_sound(source):
    name = source.stem
    assert not faults(source), f"`python notebooks/_build.py {name}`, then `pytest notebooks`"


SMALL = """\
# %% [markdown]
# # A small notebook

# %%
import ipywidgets
import matplotlib.pyplot as plt

print(f"{2 / 3:.4f}")
plt.plot([0, 1])
plt.show()

# %% [markdown]
# A widget.

# %%
ipywidgets.interactive(lambda x: None, x=ipywidgets.IntSlider(max=9, description="x"))

# %% [markdown]
# Words.

# %%
sorted({"one", "two", "three"})
"""


def build(source, seed=0):
    """Build a notebook in a process of its own and return its bytes."""
    code = "import sys, pathlib, _build; _build.build(pathlib.Path(sys.argv[1]))"
    environment = os.environ | {"PYTHONHASHSEED": str(seed), "PYTHONPATH": str(FOLDER)}
    subprocess.run(
        [sys.executable, "-c", code, str(source)],
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    )
    return source.with_suffix(".ipynb").read_bytes()


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    source = tmp_path_factory.mktemp("small") / "small.py"
    source.write_text(SMALL, encoding="utf-8")
    build(source)
    return source


@pytest.fixture
def copy(small, tmp_path):
    """Return a function that copies the small notebook, altered, and gives the copy's source."""

    def altered(change, name="small"):
        source = tmp_path / "small.py" if name == "small" else tmp_path / f"{name}.py"
        source.write_text(SMALL, encoding="utf-8")
        notebook = nbformat.read(small.with_suffix(".ipynb"), as_version=4)
        change(notebook)
        nbformat.write(notebook, source.with_suffix(".ipynb"))
        return source

    return altered


def code_cell(notebook, number):
    return [cell for cell in notebook.cells if cell.cell_type == "code"][number]


def alter_digit(notebook):
    text = code_cell(notebook, 0).outputs[0]
    text["text"] = text["text"].replace("0.6667", "0.6668")


def strip_output(notebook):
    code_cell(notebook, 2).outputs = []


def edit_cell(notebook):
    code_cell(notebook, 2).source += "  # edited"


def never_run(notebook):
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.update(outputs=[], execution_count=None)


def run_twice(notebook):
    code_cell(notebook, 2).execution_count = 7


def say_on_stderr(notebook):
    warning = nbformat.v4.new_output("stream", name="stderr", text="a warning")
    code_cell(notebook, 2).outputs.append(warning)


def swell(notebook):
    code_cell(notebook, 2).outputs[0]["data"]["text/plain"] += LARGEST * "x"


def keep_state(notebook):
    notebook.metadata["widgets"] = {}


def take_figure_away(notebook):
    first = code_cell(notebook, 0)
    first.outputs = [o for o in first.outputs if "image/png" not in o.get("data", {})]


def show_address(notebook):
    code_cell(notebook, 2).outputs[0]["data"]["text/plain"] = "<thing at 0x7f00>"


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (edit_cell, "stale: cell 5"),
        (lambda notebook: notebook.cells.pop(), "stale: 5 cells, 6 in the source"),
        (never_run, r"not run in order: \[None, None, None\]"),
        (run_twice, r"not run in order: \[1, 2, 7\]"),
        (say_on_stderr, "noisy: a warning"),
        (swell, "large: 3"),
        (keep_state, "of one run: metadata"),
        (show_address, "of one run: ' at 0x'"),
        (take_figure_away, "no static figure above the widget of code cell 2"),
    ],
)
def test_each_fault_of_a_stored_notebook_is_found(copy, change, fault):
    assert re.match(fault, "\n".join(faults(copy(change))))


def test_faults_of_the_source_are_found(small, tmp_path):
    assert faults(small) == []
    lonely = tmp_path / "lonely.py"
    lonely.write_text(SMALL, encoding="utf-8")
    assert faults(lonely) == ["not built"]
    lonely.write_text("# %%\n" + 15 * "x = 1\n" + "# %%\nx\n", encoding="utf-8")
    build(lonely)
    assert faults(lonely) == ["two code cells in a row", "long: 'x = 1' starts 15 lines"]


def test_the_same_source_gives_the_same_bytes(small):
    first = small.with_suffix(".ipynb").read_bytes()
    assert build(small, seed=1) == first


def test_a_callback_that_fails_stops_the_build(tmp_path):
    source = tmp_path / "failing.py"
    source.write_text(
        "# %%\nimport ipywidgets\nipywidgets.interact(lambda x: 1 / x, x=(0, 3, 1));\n".replace(
            "(0, 3, 1)", "ipywidgets.IntSlider(0)"
        ),
        encoding="utf-8",
    )
    with pytest.raises(subprocess.CalledProcessError) as stop:
        build(source)
    assert "ZeroDivisionError" in stop.value.stderr


def test_what_is_said_on_stderr_stops_the_build(tmp_path):
    source = tmp_path / "noisy.py"
    source.write_text("# %%\nimport warnings\nwarnings.warn('look')\n", encoding="utf-8")
    with pytest.raises(subprocess.CalledProcessError) as stop:
        build(source)
    assert "look" in stop.value.stderr


def test_nbval_finds_altered_and_stripped_outputs_and_failing_callbacks(copy, tmp_path):
    """With the very options of this project; a sound notebook passes."""

    def fail_later(notebook):
        code_cell(
            notebook, 1
        ).source = "ipywidgets.interact(lambda x: 1 / x, x=ipywidgets.IntSlider(0));"

    changes = {"sound": list, "digit": alter_digit, "stripped": strip_output, "failing": fail_later}
    for name, change in changes.items():
        copy(change, name)
    words = [
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "-c",
        str(FOLDER.parent / "pyproject.toml"),
    ]
    done = subprocess.run(
        [
            sys.executable,
            *words,
            "--rootdir",
            str(tmp_path),
            "-rf",
            *map(str, tmp_path.glob("*.ipynb")),
        ],
        capture_output=True,
        text=True,
    )
    failed = re.findall(r"^FAILED \S*?(\w+)\.ipynb::Cell (\d)", done.stdout, re.MULTILINE)
    assert sorted(failed) == [("digit", "0"), ("failing", "1"), ("stripped", "2")]

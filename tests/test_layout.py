"""The shape of the house that no import contract can state (those run as ``lint-imports``)."""

import ast
import graphlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = sorted(path for name in ("evcalib", "data_tools") for path in (ROOT / name).rglob("*.py"))

NOUNS = {
    *("__init__", "__main__", "_event_columns", "_lazy", "_moved", "arrays", "camera", "checks"),
    *("display", "errors", "events", "geometry", "imu", "poses", "series"),
}
"""What everything is said in; all else stands in the folder of its step."""


def module_of(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for path in FILES}


def imports(path):
    """Return the modules of ours that a file imports, also in functions."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in MODULES)
        elif isinstance(node, ast.ImportFrom) and node.module in MODULES:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in MODULES else node.module


def folder_of(module):
    path = MODULES[module]
    return module if path.name == "__init__.py" else module.rpartition(".")[0]


def only_lists(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return not any(isinstance(node, ast.FunctionDef | ast.ClassDef) for node in tree.body)


def is_private(module):
    return module.rpartition(".")[2].startswith("_")


@pytest.mark.parametrize("module", MODULES)
def test_private_files_are_reached_through_their_folder(module):
    mine = folder_of(module)
    foreign = {
        other
        for other in imports(MODULES[module])
        if is_private(other)
        and folder_of(other) not in ("evcalib", "data_tools")
        and not f"{mine}.".startswith(f"{other.rpartition('.')[0]}.")
    }
    assert foreign == set()


def test_no_circle_of_files():
    """Lists of public names aside: a file imports its own folder's files directly."""
    faces = {m for m, path in MODULES.items() if path.name == "__init__.py" and only_lists(path)}
    graph = {module: set(imports(MODULES[module])) - {module} for module in set(MODULES) - faces}
    assert [module for module, others in graph.items() if folder_of(module) in others & faces] == []
    for face in faces:
        graph[face] = {other for other in imports(MODULES[face]) if other.startswith(f"{face}.")}
    graphlib.TopologicalSorter(graph).prepare()


def test_only_nouns_stand_at_the_top():
    assert {path.stem for path in (ROOT / "evcalib").glob("*.py")} == NOUNS
    assert {path.stem for path in (ROOT / "data_tools").glob("*.py")} == {"__init__", "_moved"}


def test_kernels_mirror_the_steps():
    steps = {path.name for path in (ROOT / "evcalib" / "kernels").iterdir() if path.is_dir()}
    rooms = {path.name for path in (ROOT / "evcalib").iterdir() if path.is_dir()}
    assert steps - {"__pycache__"} <= rooms

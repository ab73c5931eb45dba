"""What the package says of itself agrees with itself."""

import importlib.util
import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.version import Version

import evcalib

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
OURS = ("formats", "rivals", "distributed", "notebooks")
"""Extras that change what the package can do."""


def lines(path):
    return [line for line in path.read_text().splitlines() if line and not line.startswith("#")]


def lowest(requirements):
    found = {}
    for requirement in map(Requirement, requirements):
        bounds = [spec.version for spec in requirement.specifier if spec.operator == ">="]
        found[requirement.name] = bounds
    return found


def test_oldest_versions_are_the_lower_bounds():
    wanted = lowest(PROJECT["dependencies"] + [line for name in OURS for line in EXTRAS[name]])
    pinned = dict(line.split("==") for line in lines(ROOT / ".ci" / "oldest.txt"))
    assert {name: [number] for name, number in pinned.items()} == wanted


def test_exact_versions_satisfy_the_bounds():
    exact = dict(line.split("==") for line in lines(ROOT / "environment.txt"))
    exact = {name.lower(): Version(number) for name, number in exact.items()}
    named = PROJECT["dependencies"] + [line for name in (*OURS, "tests") for line in EXTRAS[name]]
    for requirement in map(Requirement, named):
        if requirement.name != "evcalib":
            assert exact[requirement.name.lower()] in requirement.specifier, requirement.name


def test_version_is_the_same_everywhere():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    newest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[1]
    assert {PROJECT["version"], citation["version"], newest, version("evcalib")} == {
        evcalib.__version__
    }
    assert citation["license"] == PROJECT["license"]


def test_binder_installs_what_readme_says():
    post_build = ROOT / ".binder" / "postBuild"
    assert os.access(post_build, os.X_OK)
    command = 'pip install --no-cache-dir -c environment.txt -e ".[notebooks]"'
    assert command in post_build.read_text()
    major, minor = (ROOT / ".binder" / "runtime.txt").read_text().split("-")[1].split(".")
    assert Version(f"{major}.{minor}") in Requirement(f"x{PROJECT['requires-python']}").specifier


def licences():
    spec = importlib.util.spec_from_file_location("licences", ROOT / ".ci" / "licences.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("expression", "free"),
    [
        ("BSD-3-Clause", True),
        ("Apache-2.0 OR BSD-2-Clause", True),
        ("MIT OR GPL-3.0-only", True),
        ("MIT AND GPL-3.0-only", False),
        ("(MIT OR GPL-3.0-only) AND AGPL-3.0-only", False),
        ("BSD-3-Clause AND GPL-3.0-or-later WITH GCC-exception-3.1", True),
        ("BSD-2-Clause AND Apache-2.0 WITH LLVM-exception AND GPL-2.0-only", False),
        ("LGPL-3.0-only", True),
        ("GPL-3.0-only", False),
        ("unknown", False),
        ("", False),
    ],
)
def test_licences_that_bind_us_are_refused(expression, free):
    assert licences().permitted(expression) is free


def test_runtime_dependencies_leave_users_free():
    tool = licences()
    found = {n: tool.licence(n, p) for n, p in tool.closure("evcalib", set()).items()}
    assert {"numpy", "numba", "llvmlite", "h5py"} <= set(found)
    assert [f"{n}: {text}" for n, text in found.items() if not tool.permitted(text)] == []


HOMELESS = """
import os, warnings
from pathlib import Path
from evcalib.kernels import cache
held = cache._can_hold_files
cache._can_hold_files = lambda folder: str(folder).startswith(os.environ["TMPDIR"]) and held(folder)
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    from evcalib.kernels.jit import jit
    from evcalib.kernels import joint
    cache.find_cache()
print(len(told), told[0].message)
print(os.environ["NUMBA_CACHE_DIR"], os.environ["MPLCONFIGDIR"])
import matplotlib
print(matplotlib.get_configdir())
"""


@pytest.mark.parametrize("taken", [False, True])
def test_caches_go_to_a_temporary_folder_where_nothing_else_can_be_written(tmp_path, taken):
    """What lies in a folder that others can write is never run: it would be their code."""
    mine = tmp_path / f"evcalib-cache-{os.getuid()}"
    if taken:
        mine.mkdir()
        mine.chmod(0o777)
    env = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "MPLCONFIGDIR")}
    done = subprocess.run(
        [sys.executable, "-c", HOMELESS],
        env={**env, "TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    told, folders, matplotlib = done.stdout.splitlines()
    assert told.startswith("1 neither the folder of evcalib nor that of the user can be written")
    numba, settings = folders.split()
    assert numba == settings == matplotlib
    assert numba.startswith(f"{tmp_path}{os.sep}evcalib-cache-")
    assert (numba == str(mine)) is not taken

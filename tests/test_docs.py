"""Docstrings: there, in numpydoc form, true to the signature; and their examples are run."""

import doctest
import importlib
import inspect
import pkgutil
import re
from dataclasses import is_dataclass
from pathlib import Path

import pytest

import data_tools
import evcalib

ROOT = Path(__file__).parents[1]


def public_modules():
    for package in (evcalib, data_tools):
        yield package.__name__
        for found in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            parts = found.name.split(".")
            if not any(part.startswith("_") for part in parts) and "cli" not in parts:
                yield found.name


MODULES = sorted(public_modules())


def own_names(module):
    """Return what a module defines without an underscore, or lists in ``__all__``."""
    listed = getattr(module, "__all__", None)
    if listed is not None:
        return {name: getattr(module, name) for name in listed}
    return {
        name: thing
        for name, thing in vars(module).items()
        if not name.startswith("_") and getattr(thing, "__module__", None) == module.__name__
    }


def sections(thing):
    """Return the sections of a numpydoc docstring by title; the text before them under ``''``."""
    text = inspect.getdoc(thing) or ""
    pieces = re.split(r"(?:^|\n)([A-Z][A-Za-z ]+)\n-{3,}\n", text)
    return {"": pieces[0], **dict(zip(pieces[1::2], pieces[2::2], strict=True))}


def described(section):
    """Return the names that a section describes: its lines that are not indented."""
    heads = [line for line in section.splitlines() if line and not line.startswith(" ")]
    return [name.strip(" *") for head in heads for name in head.split(" : ")[0].split(",")]


def parameters(thing):
    try:
        names = inspect.signature(thing).parameters
    except ValueError:  # a subclass of a type written in C
        return []
    return [name for name in names if not name.startswith("_") and name not in ("self", "cls")]


def gives_something(thing):
    return inspect.signature(thing).return_annotation not in (None, "None", inspect.Signature.empty)


def complaints(thing, *, full):
    """Return what is wrong with a docstring; in full, sections may not be left out."""
    if isinstance(thing, type) and issubclass(thing, Exception):
        return [] if thing.__doc__ else ["no docstring"]
    text = sections(thing)
    first = text[""].strip().split("\n\n")[0]
    found = [] if first.endswith(".") else [f"first paragraph {first!r} is no sentence"]
    takes, told = parameters(thing), described(text.get("Parameters", ""))
    if is_dataclass(thing):
        told += described(text.get("Attributes", ""))
        takes = [name for name in takes if name in thing.__annotations__]  # not the parent's
    if sorted(told) != sorted(takes) and (told or (full and "Attributes" not in text)):
        found.append(f"describes {told}, takes {takes}")
    if full and not isinstance(thing, type) and gives_something(thing):
        found += [] if {"Returns", "Yields"} & set(text) else ["no Returns"]
    return found


@pytest.mark.parametrize("name", MODULES)
def test_public_docstrings_are_true_to_the_signatures(name):
    module = importlib.import_module(name)
    assert module.__doc__ or not own_names(module), "module without a docstring"
    full = hasattr(module, "__all__")
    wrong = {
        thing_name: complaints(thing, full=full)
        for thing_name, thing in own_names(module).items()
        if inspect.isfunction(thing) or inspect.isclass(thing)
    }
    assert {key: value for key, value in wrong.items() if value} == {}


WITH_EXAMPLES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for package in ("evcalib", "data_tools")
    for path in (ROOT / package).rglob("*.py")
    if ">>> " in path.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples_in_docstrings_give_what_they_say(name):
    found = doctest.testmod(importlib.import_module(name))
    assert found.attempted > 0
    assert found.failed == 0


def test_the_public_functions_that_are_quick_have_an_example():
    slow = {"calibrate", "estimate_headings", "Calibration", "EvcalibError", "InputError"}
    lacking = [name for name in evcalib.__all__ if ">>> " not in getattr(evcalib, name).__doc__]
    assert set(lacking) == slow

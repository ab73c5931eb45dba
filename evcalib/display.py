"""How results print: a few lines at the prompt, a small table in Jupyter."""

from __future__ import annotations

import html
import inspect
import re
import textwrap
from collections.abc import Iterator, Mapping, Sized
from dataclasses import fields, is_dataclass
from typing import Any
from unicodedata import category

import numpy as np

WIDTH = 88
"""Characters of a line, so that it stands unbroken in a terminal and beside a notebook's margin."""

FEW = 4
"""So many numbers are told one by one; of more, shape and range."""

Rows = list[tuple[str, str]]

_NUMBERS = (int, float, np.number, np.bool_)

_TIED = "\xa0"

_UNIT = re.compile(r"\[([a-zA-Z][^\[\]]*)\]")


class Shown:
    """A dataclass that prints its name, its numbers with their units, and its arrays' ranges.

    Units are those that the docstring gives, in brackets, under Attributes.
    """

    _most_lines = 1

    def __init_subclass__(cls, **given: Any) -> None:
        super().__init_subclass__(**given)
        # A dataclass writes its own unless the class itself has one.
        cls.__repr__ = Shown.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        numbers, lines = [], []
        for name, value in self._safe_rows():
            if isinstance(getattr(self, name, None), _NUMBERS):
                numbers.append(f"{name} {value}".replace(" ", _TIED))
            else:
                lines += _wrapped(f"{name} {value}", self._most_lines)
        packed = [line.replace(_TIED, " ") for line in _wrapped(", ".join(numbers), len(numbers))]
        return "\n  ".join([_name(self), *packed, *lines])

    def _repr_html_(self) -> str:
        """Return the table that Jupyter shows."""
        rows = "".join(
            f"<tr><th style='text-align:left'>{html.escape(name)}</th>"
            f"<td style='text-align:left'>{html.escape(value)}</td></tr>"
            for name, value in self._safe_rows()
        )
        return f"<table><caption>{_name(self)}</caption>{rows}</table>"

    def _safe_rows(self) -> Rows:
        return [(visible(name), visible(value)) for name, value in self._shown_rows()]

    def _shown_rows(self) -> Rows:
        """Return what is shown, name and value; those that are None come last, in one row."""
        told = _told(self)
        rows = [(name, _brief(value, unit)) for name, value, unit in told if value is not None]
        missing = ", ".join(name for name, value, _ in told if value is None)
        return [*rows, ("without", missing)] if missing else rows


def _wrapped(text: str, most: int) -> list[str]:
    return textwrap.wrap(text, WIDTH - 2, max_lines=max(most, 1), placeholder=" ...")


def visible(text: str) -> str:
    """Return text with a mark for each character that turns, hides or breaks what stands by it."""
    if text.isprintable():
        return text  # as are the megabytes of a picture
    return "".join("\ufffd" if _unseen(c) else c for c in text)


def _unseen(character: str) -> bool:
    """Whether a character is a control, half of a pair, or turns the direction of writing."""
    return character not in "\n\t" and category(character) in ("Cc", "Cf", "Cs")


def _name(thing: Any) -> str:
    length = f", {len(thing):,} rows" if isinstance(thing, Sized) else ""
    return f"{type(thing).__name__}{length}"


def _told(thing: Any) -> list[tuple[str, Any, str]]:
    """Return name, value and unit of a dataclass's fields."""
    units = _units(type(thing))
    return [(f.name, getattr(thing, f.name), units.get(f.name, "")) for f in fields(thing)]


def _units(cls: type) -> dict[str, str]:
    """Return the units of a class's attributes, as far as its docstrings name one each."""
    found: dict[str, str] = {}
    for one in reversed(cls.__mro__):
        _, _, text = inspect.cleandoc(one.__doc__ or "").partition("\nAttributes\n")
        for names, about in re.findall(r"^([\w, ]+?)(?: :.*)?\n((?:    .*\n?)+)", text, re.M):
            units = set(_UNIT.findall(about))
            found |= dict.fromkeys(names.split(", "), units.pop() if len(units) == 1 else "")
    return found


def _brief(value: Any, unit: str = "") -> str:
    """Return a value in a line."""
    unit = unit and f" {unit}"
    if is_dataclass(value):
        single = [
            (n, v, u) for n, v, u in _told(value) if isinstance(v, (*_NUMBERS, str)) and v != ""
        ]
        return ", ".join([_name(value), *(f"{n} {_brief(v, u)}" for n, v, u in single)])
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float | np.floating):
        return f"{value:.6g}{unit}"
    if isinstance(value, int | np.integer):
        return f"{value:,}{unit}"
    if isinstance(value, np.ndarray):
        return _range(value, unit)
    if isinstance(value, Mapping):
        return "; ".join(f"{key}: {_brief(inner)}" for key, inner in value.items()) or "nothing"
    if isinstance(value, tuple | list):
        return "; ".join(_listed(value, unit))
    return " ".join(str(value).split())


def _listed(values: tuple | list, unit: str) -> Iterator[str]:
    if len(values) <= FEW:
        yield from (_brief(value, unit.strip()) for value in values)
    else:
        kinds = dict.fromkeys(type(value).__name__ for value in values)
        yield f"{len(values):,} of {' or '.join(kinds)}"


def _range(array: np.ndarray, unit: str) -> str:
    """Return a small array whole, of others shape and range."""
    if array.size <= FEW and array.ndim == 1:
        return f"({', '.join(_brief(value) for value in array.tolist())}){unit}"
    shape = f"shape {array.shape}"
    if array.dtype == np.bool_:
        return f"{shape}, {int(array.sum()):,} true"
    if array.dtype.kind not in "iuf" or not array.size:
        return f"{shape} of {array.dtype}"
    finite = array[np.isfinite(array)]
    span = f", {_brief(finite.min())} to {_brief(finite.max())}{unit}" if finite.size else ""
    lost = array.size - finite.size
    return f"{shape}{span}{f', {lost:,} not finite' if lost else ''}"
